//! Native code for straight stretches of pure operations, on x86-64 with AVX2 or AVX-512.
//!
//! A stretch is a run of operations without branches, suspensions and memory of the shader's. The
//! interpreter performs it as one instruction: what goes from one operation to the next stays in
//! registers, and only results that are used behind the stretch are stored to their rows. The
//! copies at a branch may end a stretch: they change active lanes alone. Everything else is the
//! interpreter's; operations without native code end a stretch.
//!
//! ```text
//! operations ──> [`stretch`]: instructions on values ──> [`allocate`]: registers ──> [`encode`]: bytes ──> [`memory`]: executable pages
//! ```
//!
//! Code reads masks of lanes, and reads and writes rows of the frame at distances that are known
//! when it is written, and nothing else: no address comes from a shader.

mod allocate;
mod encode;
mod group;
mod memory;
mod opcodes;
mod stretch;

use lanes::{LaneMask, Tier};

pub(crate) use encode::Encoding;
pub(crate) use group::group;
pub(crate) use memory::Executable;
pub use memory::{CodePages, provide};
pub(crate) use stretch::{Place, Row, Stretch};

/// A stretch: the first subgroup's frame, the uniform rows, how many subgroups follow one another,
/// how many bytes their frames are apart, and the subgroups' masks of active lanes.
#[cfg(target_arch = "x86_64")]
pub(crate) type Code = unsafe extern "sysv64" fn(*mut u8, *const u8, usize, usize, *const LaneMask);
/// No tier of this machine's has native code.
#[cfg(not(target_arch = "x86_64"))]
pub(crate) type Code = unsafe extern "C" fn(*mut u8, *const u8, usize, usize, *const LaneMask);

/// How a tier's instructions are written; `None` for tiers without native code, or where no pages
/// are provided for it.
pub(crate) fn encoding(tier: Tier) -> Option<Encoding> {
    match tier {
        _ if memory::provided().is_none() => None,
        Tier::Portable => None,
        Tier::Avx2 => Some(Encoding::Vex),
        Tier::Avx512 => Some(Encoding::Evex),
    }
}
