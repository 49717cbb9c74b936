//! What shaders and structures both know of lanes: which instruction set computes them.

#![forbid(unsafe_code)]

mod tier;

pub use tier::Tier;
#[cfg(target_arch = "x86_64")]
pub use tier::has_byte_permutes;
