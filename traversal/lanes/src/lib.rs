//! Knowledge about lanes that shaders and structures share: the instruction set, and masks of
//! active lanes.

#![deny(unsafe_code)]

mod mask;
mod tier;

pub use mask::LaneMask;
pub use tier::Tier;
#[cfg(target_arch = "x86_64")]
pub use tier::{gathers_slowly, has_byte_permutes};

/// A row: what a function gives for each of sixteen lanes. As [`std::array::from_fn`], which
/// compilers leave out of line at this size.
#[inline(always)]
pub fn by_lane<T: Copy>(mut number: impl FnMut(usize) -> T) -> [T; LaneMask::LANES] {
    let mut row = [number(0); LaneMask::LANES];
    for (lane, word) in row.iter_mut().enumerate().skip(1) {
        *word = number(lane);
    }
    row
}
