//! Fragment shading rates (spec, "Fragment Shading Rates").

#![forbid(unsafe_code)]

use ash::vk::{self, FragmentShadingRateCombinerOpKHR as Op};

use crate::capabilities::limits::{MAX_COVERAGE_SAMPLES, MAX_FRAGMENT_SIDE};

/// Largest exponent of a fragment's side.
const MOST: u8 = MAX_FRAGMENT_SIDE.ilog2() as u8;

/// Size of fragments: powers of two, by their exponents.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rate {
    /// The exponents of width and height.
    pub logs: [u8; 2],
}

impl Rate {
    /// From a `VkExtent2D`. Values that are no powers of two give an arbitrary rate.
    pub fn of_size(size: vk::Extent2D) -> Self {
        let log = |side: u32| side.trailing_zeros().min(u32::from(MOST)) as u8;
        Self {
            logs: [log(size.width), log(size.height)],
        }
    }

    /// From the rate's encoding in shaders and attachments: two bits for each side.
    pub fn from_word(word: u32) -> Self {
        Self {
            logs: [(word >> 2 & 3) as u8, (word & 3) as u8],
        }
    }

    /// The rate's encoding in shaders (`ShadingRateKHR`).
    pub fn word(self) -> u32 {
        u32::from(self.logs[0]) << 2 | u32::from(self.logs[1])
    }

    /// Width and height in pixels.
    pub fn pixels(self) -> [usize; 2] {
        self.logs.map(|log| 1 << log)
    }

    /// Whether fragments are single pixels.
    pub fn is_one(self) -> bool {
        self.logs == [0; 2]
    }

    /// Applies a combiner operation, before the result is clamped to a supported rate.
    pub fn combine(self, other: Self, op: Op) -> Self {
        let side = |axis: usize| {
            let (a, b) = (self.logs[axis], other.logs[axis]);
            match op {
                Op::REPLACE => b,
                Op::MIN => a.min(b),
                Op::MAX => a.max(b),
                Op::MUL => a + b,
                _ => a,
            }
        };
        Self {
            logs: [side(0), side(1)],
        }
    }

    /// The supported rate for a sample count that replaces this one: the largest area within it,
    /// then the smallest aspect ratio.
    pub fn supported(self, samples: u32) -> Self {
        let fits = |rate: &Rate| {
            rate.logs[0] <= self.logs[0]
                && rate.logs[1] <= self.logs[1]
                && rate.samples().as_raw() & samples != 0
        };
        let order = |rate: &Rate| {
            let [x, y] = rate.logs;
            (x + y, u8::MAX - x.abs_diff(y))
        };
        let fitting = RATES.into_iter().filter(fits);
        // The last of equal rates wins.
        fitting.max_by_key(order).unwrap_or_default()
    }

    /// The supported sample counts (`sampleCounts`).
    pub fn samples(self) -> vk::SampleCountFlags {
        let [width, height] = self.pixels();
        match width * height {
            1 => vk::SampleCountFlags::from_raw(!0),
            // All powers of two up to this.
            area => {
                let most = MAX_COVERAGE_SAMPLES / area as u32;
                vk::SampleCountFlags::from_raw((2 * most.min(8)) - 1)
            }
        }
    }
}

/// All rates, in the order of `vkGetPhysicalDeviceFragmentShadingRatesKHR`.
pub const RATES: [Rate; 7] = [
    Rate { logs: [2, 2] },
    Rate { logs: [2, 1] },
    Rate { logs: [1, 2] },
    Rate { logs: [1, 1] },
    Rate { logs: [1, 0] },
    Rate { logs: [0, 1] },
    Rate { logs: [0, 0] },
];

/// `VkPipelineFragmentShadingRateStateCreateInfoKHR`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ShadingRate {
    pub pipeline: Rate,
    /// The combiners of the primitive's and the attachment's rate.
    pub combiners: [Op; 2],
}

impl ShadingRate {
    /// Creates the state from sizes and operations.
    pub fn new(size: vk::Extent2D, combiners: [Op; 2]) -> Self {
        Self {
            pipeline: Rate::of_size(size),
            combiners,
        }
    }

    /// Whether the primitive's rate, and the attachment's, have an effect.
    pub fn uses(&self) -> [bool; 2] {
        self.combiners.map(|op| op != Op::KEEP)
    }

    /// The combined rate of pipeline and primitive.
    pub fn of_primitive(&self, primitive: Rate) -> Rate {
        self.pipeline.combine(primitive, self.combiners[0])
    }

    /// The final rate, from [`Self::of_primitive`] and the attachment's rate.
    pub fn at(&self, primitive: Rate, attachment: Rate, samples: u32) -> Rate {
        primitive
            .combine(attachment, self.combiners[1])
            .supported(samples)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rate(x: u8, y: u8) -> Rate {
        Rate { logs: [x, y] }
    }

    #[test]
    fn rates_are_clamped_to_the_largest_area_within() {
        assert_eq!(rate(2, 2).supported(1), rate(2, 2));
        assert_eq!(rate(4, 4).supported(1), rate(2, 2));
        assert_eq!(rate(2, 2).supported(4), rate(1, 1));
        assert_eq!(rate(2, 0).supported(1), rate(1, 0));
        assert_eq!(rate(0, 2).supported(8), rate(0, 1));
        assert_eq!(rate(1, 2).supported(2), rate(1, 2));
        assert_eq!(rate(0, 0).supported(8), rate(0, 0));
    }

    #[test]
    fn combiners_combine_sides() {
        let [a, b] = [rate(1, 2), rate(2, 0)];
        let combined = |op| a.combine(b, op).logs;
        assert_eq!(combined(Op::KEEP), [1, 2]);
        assert_eq!(combined(Op::REPLACE), [2, 0]);
        assert_eq!(combined(Op::MIN), [1, 0]);
        assert_eq!(combined(Op::MAX), [2, 2]);
        assert_eq!(combined(Op::MUL), [3, 2]);
    }

    #[test]
    fn numbers_are_those_of_shaders() {
        assert_eq!(rate(2, 1).word(), 9);
        assert_eq!(Rate::from_word(9), rate(2, 1));
        let size = vk::Extent2D {
            width: 2,
            height: 4,
        };
        assert_eq!(Rate::of_size(size), rate(1, 2));
    }
}
