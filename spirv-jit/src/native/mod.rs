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
mod listing;
mod memory;
mod opcodes;
mod stretch;

use lanes::{LaneMask, Tier};

use crate::SUBGROUP_SIZE;

pub(crate) use encode::Encoding;
pub(crate) use group::group;
pub use listing::NativeCounts;
pub(crate) use listing::{Listed, ListedTurns, count, text};
pub(crate) use memory::Executable;
pub use memory::{CodePages, provide};
pub(crate) use stretch::{
    IrOperand, Lanes, Merged, PrivateRow, Sameness, Stretch, Turns, ValueRow,
};

/// A stretch: the first subgroup's frame, the uniform rows, how many subgroups follow one another,
/// how many bytes their frames are apart, and the subgroups' masks of active lanes.
#[cfg(target_arch = "x86_64")]
pub(crate) type Code = unsafe extern "sysv64" fn(*mut u8, *const u8, usize, usize, *const LaneMask);
/// No tier of this machine's has native code.
#[cfg(not(target_arch = "x86_64"))]
pub(crate) type Code = unsafe extern "C" fn(*mut u8, *const u8, usize, usize, *const LaneMask);

/// A loop: as [`Code`], with what else it is given. Lanes that are still in the loop when
/// the fuel is out are written as far behind the active lanes' masks as [`STAYING`] says.
#[cfg(target_arch = "x86_64")]
pub(crate) type LoopCode =
    unsafe extern "sysv64" fn(*mut u8, *const u8, usize, usize, *mut LaneMask, *mut LoopContext);
/// No tier of this machine's has native code.
#[cfg(not(target_arch = "x86_64"))]
pub(crate) type LoopCode =
    unsafe extern "C" fn(*mut u8, *const u8, usize, usize, *mut LaneMask, *mut LoopContext);

/// Bytes from the mask of a subgroup's active lanes to that of those that stay in a loop.
pub(crate) const STAYING: usize = 32;

/// Memory that a loop loads words from, or stores words to.
#[repr(C, align(64))]
#[derive(Clone, Copy)]
pub(crate) struct Region {
    /// The highest offset of a word, minus 2³¹, in all lanes.
    last: [i32; SUBGROUP_SIZE],
    /// The address of the offset 2³¹, whether that is inside or not.
    base: *const u8,
}

impl Region {
    /// Of so many bytes, of which words are accessed that are inside as a whole. `none`: the word
    /// that is accessed instead where there are none.
    pub fn new(base: *const u8, size_bytes: u64, none: *const u32) -> Region {
        let (last, base) = match size_bytes.min(1 << 32).checked_sub(4) {
            Some(last) => ((last as u32 ^ 1 << 31) as i32, base),
            None => (i32::MIN, none.cast()),
        };
        Region {
            last: [last; SUBGROUP_SIZE],
            base: base.wrapping_add(1 << 31),
        }
    }

    /// The address of the offset 2³¹.
    pub fn base(&self) -> *const u8 {
        self.base
    }
}

/// A loop accesses so many buffers, at most; one that it loads from and stores to counts twice.
pub(crate) const MAX_REGIONS: usize = 8;

/// The number of workgroup memory among regions. Each subgroup has a base of its own.
pub(crate) const WORKGROUP: usize = MAX_REGIONS;

/// Memory of a subgroup's own that a loop accesses: by subgroup, of those that code comes to next.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Own {
    /// The first private row.
    pub private: *mut u8,
    /// Workgroup memory, as [`Region`] has bases.
    pub workgroup: *const u8,
}

/// Fuel and memory of a loop.
#[repr(C, align(64))]
pub(crate) struct LoopContext {
    /// Fuel; below zero where it is out.
    pub fuel: i64,
    pub own: *const Own,
    /// How many private rows there are.
    pub private_rows: u32,
    /// Where loads of one word read that are not inside.
    pub zeros: *const u32,
    /// Where stores to regions without words go.
    pub dropped: u32,
    pub regions: [Region; MAX_REGIONS + 1],
}

/// The word of regions that have none.
pub(crate) static ZEROS: u32 = 0;

impl LoopContext {
    /// How far behind the context's start fields are.
    const OWN: i32 = std::mem::offset_of!(LoopContext, own) as i32;
    const PRIVATE_ROWS: i32 = std::mem::offset_of!(LoopContext, private_rows) as i32;
    const ZEROS: i32 = std::mem::offset_of!(LoopContext, zeros) as i32;

    /// How far behind the context's start the last offsets of a region are.
    const fn last(region: usize) -> i32 {
        (std::mem::offset_of!(LoopContext, regions) + region * size_of::<Region>()) as i32
    }

    /// The same of its base.
    const fn base(region: usize) -> i32 {
        Self::last(region) + std::mem::offset_of!(Region, base) as i32
    }
}

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
