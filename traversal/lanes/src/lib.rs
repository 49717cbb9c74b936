//! Knowledge about lanes that shaders, images, drawing and structures share: the instruction set,
//! masks of active lanes, rows of numbers, and vectors of them.

#![deny(unsafe_code)]

pub mod bounds;
#[cfg(windows)]
#[allow(unsafe_code)]
mod fused;
pub mod halves;
mod mask;
#[allow(unsafe_code)]
mod prefetch;
pub mod quad;
mod tier;
#[allow(unsafe_code)]
pub mod vector;

pub use mask::LaneMask;
pub use prefetch::{prefetch, prefetch_line, prefetch_lines};
#[cfg(target_arch = "x86_64")]
pub use tier::has_byte_permutes;
pub use tier::{Tier, has_bit_counts, has_half_arithmetic};

/// Lanes that there are.
pub const LANES: usize = LaneMask::LANES;

/// A row: a word of each lane, side by side.
pub type Row = [u32; LANES];

/// A row, aligned to a cache line.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AlignedRow(pub Row);

/// A row: what a function gives for each of sixteen lanes. As [`std::array::from_fn`], which
/// compilers leave out of line at this size.
#[inline(always)]
pub fn by_lane<T: Copy>(mut number: impl FnMut(usize) -> T) -> [T; LANES] {
    let mut row = [number(0); LANES];
    for (lane, word) in row.iter_mut().enumerate().skip(1) {
        *word = number(lane);
    }
    row
}

/// `array::map` as a loop: the library's is not always inlined, and then neither vectorised nor
/// compiled for the caller's vectors.
#[inline(always)]
pub fn map<T: Copy, U: Copy + Default>(values: &[T; LANES], f: impl Fn(T) -> U) -> [U; LANES] {
    let mut out = [U::default(); LANES];
    for lane in 0..LANES {
        out[lane] = f(values[lane]);
    }
    out
}
