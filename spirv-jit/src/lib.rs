//! SPIR-V to vectorised programs.
//!
//! ```text
//! SPIR-V words ──> parse (rspirv) ──> lower ──> ir ──> pass ──> plan ──> Program ──> interp
//! ```
//!
//! This crate knows no Vulkan handle and no acceleration structure. The caller that runs a
//! [`Program`] passes an [`Environment`](environment::Environment) (descriptor sets, push
//! constants, dispatch size) and the states of up to a wave of subgroups; the program runs until
//! the wave *yields* and the caller answers the event.

pub mod abort;
mod accuracy;
mod descriptor;
pub mod descriptor_heap;
pub mod environment;
pub mod error;
pub mod eval;
pub mod facts;
#[cfg(target_arch = "x86_64")]
mod half_vectors;
pub mod hit_object;
pub mod interp;
pub mod ir;
pub mod lower;
pub mod native;
pub mod origin;
pub mod parse;
pub mod pass;
mod plan;
pub mod printf;
pub mod program;
pub mod query;
pub mod reach;
mod request;
mod state;
mod types;
pub mod views;

pub use accuracy::Accuracy;
pub use error::Error;
pub use lanes::{LaneMask, Tier};
pub use program::{CompileRequest, Program, compile};

/// Lanes in a subgroup, whatever the tier or the machine
/// (`VkPhysicalDeviceSubgroupProperties::subgroupSize`).
pub const SUBGROUP_SIZE: usize = 16;
