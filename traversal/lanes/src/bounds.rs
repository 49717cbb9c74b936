//! The lesser and the greater of two numbers, with the same bits on every processor, NaN payloads
//! aside.
//!
//! LLVM makes a choice of numbers by their order, and `f32::min` and `f32::max`, single
//! instructions on ARM, which answer a signalling NaN by a NaN, where x86 and the language's own
//! order answer by the other number. They and all others agree about quiet NaNs.
#![forbid(unsafe_code)]

/// The number; a quiet NaN for a signalling one where LLVM would tell them apart.
#[inline(always)]
pub fn quiet(x: f32) -> f32 {
    if cfg!(target_arch = "x86_64") {
        return x;
    }
    let bits = x.to_bits();
    // In integers: arithmetic that changes nothing else is folded away.
    let is_nan = bits & 0x7fff_ffff > f32::INFINITY.to_bits();
    f32::from_bits(bits | u32::from(is_nan) << 22)
}

/// The lesser; `x` if they are equal, the number if one is NaN.
#[inline(always)]
pub fn min(x: f32, y: f32) -> f32 {
    let (x, y) = (quiet(x), quiet(y));
    if y < x || x.is_nan() { y } else { x }
}

/// The greater; `x` if they are equal, the number if one is NaN.
#[inline(always)]
pub fn max(x: f32, y: f32) -> f32 {
    let (x, y) = (quiet(x), quiet(y));
    if y > x || x.is_nan() { y } else { x }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::{Portable, Vector};

    /// Of both kinds and signs; the first two are signalling.
    const NANS: [u32; 4] = [0x7fb8_c2b3, 0xff80_0001, 0x7fc0_0000, 0xffff_ff32];

    #[test]
    fn a_nan_is_no_bound() {
        for bits in NANS {
            let nan = f32::from_bits(std::hint::black_box(bits));
            // With constants, which compilers know not to be NaN.
            assert_eq!(min(max(nan, 0.0), 1.0), 0.0, "{bits:x}");
            assert_eq!(max(min(nan, 1.0), 0.0), 1.0, "{bits:x}");
            assert_eq!(max(min(2.0, nan), 0.0), 2.0, "{bits:x}");
            let v = Portable;
            let row = v.splat(nan);
            let clamped = v.min(v.max(row, v.splat(0.0)), v.splat(1.0));
            assert_eq!(clamped, [0.0; 16], "{bits:x}");
            let clamped = v.max(v.min(row, v.splat(1.0)), v.splat(0.0));
            assert_eq!(clamped, [1.0; 16], "{bits:x}");
        }
    }

    #[test]
    fn of_equal_numbers_the_first_is_taken() {
        for x in [0.0f32, -0.0] {
            assert_eq!(min(x, -x).to_bits(), x.to_bits());
            assert_eq!(max(x, -x).to_bits(), x.to_bits());
        }
        assert_eq!((min(1.0, 2.0), max(1.0, 2.0)), (1.0, 2.0));
        assert_eq!((min(2.0, 1.0), max(2.0, 1.0)), (1.0, 2.0));
    }
}
