//! Where samples lie in a pixel, the standard sample locations (spec, "Multisampling",
//! `standardSampleLocations`), and masks of them.

pub use spirv_jit::ir::interface::sample_locations as locations;

/// Samples of a pixel, at most.
pub const MAX_SAMPLES: usize = 8;

/// In 1/16 of a pixel, from its upper left corner.
type Location = [i32; 2];

/// In units of fixed-point positions.
pub fn fixed_point([x, y]: Location) -> [i32; 2] {
    [x * 16, y * 16]
}

/// From the pixel's centre, in pixels: exact.
pub fn from_center([x, y]: Location) -> [f32; 2] {
    [(x - 8) as f32 / 16.0, (y - 8) as f32 / 16.0]
}

/// Masks of samples, the first in the lowest bits. They are stored at once, since they are loaded
/// so, and a load waits for several stores that it spans.
#[inline(always)]
pub fn masks_of(bits: u128) -> [u16; MAX_SAMPLES] {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::*;
        // SAFETY: every processor of this architecture has SSE2; eight masks are as long as its
        // registers.
        unsafe { std::mem::transmute(_mm_set_epi64x((bits >> 64) as i64, bits as i64)) }
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        std::array::from_fn(|sample| (bits >> (16 * sample)) as u16)
    }
}

/// All lanes of any sample.
#[inline(always)]
pub fn any(masks: &[u16; MAX_SAMPLES]) -> u16 {
    masks.iter().fold(0, |all, mask| all | mask)
}

/// Covered samples.
#[inline(always)]
pub fn count(masks: &[u16; MAX_SAMPLES]) -> u64 {
    masks.iter().map(|mask| u64::from(mask.count_ones())).sum()
}

/// Query counts of a draw in a tile.
#[derive(Default)]
pub struct Counts {
    pub samples: u64,
    pub invocations: u64,
}
