//! What shaders and structures both know of lanes: which instruction set computes them, and which of them take part.

#![forbid(unsafe_code)]

mod mask;
mod tier;

pub use mask::LaneMask;
pub use tier::Tier;
#[cfg(target_arch = "x86_64")]
pub use tier::has_byte_permutes;
