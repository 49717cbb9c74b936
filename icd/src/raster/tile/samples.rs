//! Where samples lie in a pixel (spec, "Multisampling", "Custom Sample Locations"), and masks of
//! them.

use std::ops::Deref;

use crate::capabilities::limits;
use crate::object::graphics_state::Multisample;
use crate::object::shading_rate::Rate;

/// Samples of a pixel, at most.
pub const MAX_SAMPLES: usize = 8;

/// In 1/16 of a pixel, from its upper left corner.
pub type Location = [i32; 2];

/// The standard locations of 1, 2, 4 or 8 samples (`standardSampleLocations`).
pub const fn standard(samples: u32) -> &'static [Location] {
    match samples {
        2 => &[[12, 12], [4, 4]],
        4 => &[[6, 2], [14, 6], [2, 10], [10, 14]],
        8 => &[
            [9, 5],
            [7, 11],
            [13, 9],
            [5, 3],
            [3, 13],
            [1, 7],
            [11, 15],
            [15, 1],
        ],
        _ => &[CENTER],
    }
}

/// The pixel's centre, where a single sample lies.
pub const CENTER: Location = [8, 8];

/// Samples of a fragment, at most: of one of several pixels, those of all its pixels
/// (`maxFragmentShadingRateCoverageSamples`).
pub const MAX_COVERAGE: usize = limits::MAX_COVERAGE_SAMPLES as usize;

/// The locations of all samples of a fragment.
#[derive(Clone, Copy)]
pub struct Locations {
    all: [Location; MAX_COVERAGE],
    samples: usize,
}

impl Locations {
    /// Those of a state; a single sample lies at the centre.
    pub fn new(samples: u32, state: &Multisample) -> Self {
        let mut all = [CENTER; MAX_COVERAGE];
        let count = samples.clamp(1, MAX_SAMPLES as u32) as usize;
        match state.has_locations && count > 1 {
            true => {
                all[..MAX_SAMPLES]
                    .copy_from_slice(&state.locations.map(|place| place.map(i32::from)));
            }
            false => all[..count].copy_from_slice(standard(samples)),
        }
        Self {
            all,
            samples: count,
        }
    }

    /// Those of a fragment of several pixels, each with these samples: from eight sixteenths to the
    /// left of its centre, and above it. They are in the order of the coverage mask, which begins
    /// with the last pixel (spec, "Multisampling").
    pub fn of_pixels(&self, rate: Rate) -> Self {
        let mut all = [CENTER; MAX_COVERAGE];
        let [width, height] = rate.pixels();
        for (place, index) in all.iter_mut().zip(0..width * height * self.samples) {
            let pixel = width * height - 1 - index / self.samples;
            let from_corner = [pixel % width, pixel / width];
            for (axis, size) in [width, height].into_iter().enumerate() {
                let in_pixel = self[index % self.samples][axis];
                place[axis] = in_pixel + 16 * from_corner[axis] as i32 - 8 * (size as i32 - 1);
            }
        }
        Self {
            all,
            samples: (width * height * self.samples).min(MAX_COVERAGE),
        }
    }

    /// The locations along an axis, four bits a sample.
    pub fn packed(&self, axis: usize) -> u32 {
        let places = self.iter().take(MAX_SAMPLES).zip((0..).step_by(4));
        places.fold(0, |word, (place, at)| word | (place[axis] as u32) << at)
    }
}

impl Deref for Locations {
    type Target = [Location];

    #[inline(always)]
    fn deref(&self) -> &[Location] {
        &self.all[..self.samples]
    }
}

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
