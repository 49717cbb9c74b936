//! Conversions of 16-bit floats, without branches and calls: loops over lanes become vectors.

#![forbid(unsafe_code)]

use half::f16;

/// Exact; a NaN becomes quiet.
#[inline(always)]
pub(super) fn f32_from_f16(value: f16) -> f32 {
    const QUIET: u32 = 0x0040_0000;
    /// The difference of the exponents' biases.
    const BIAS: u32 = (127 - 15) << 23;
    let bits = value.to_bits() as u32;
    let magnitude = (bits & 0x7fff) << 13;
    let number = magnitude + BIAS;
    // A denormal one lies that far above the least normal one.
    let least = BIAS + (1 << 23);
    let denormal = (f32::from_bits(magnitude | least) - f32::from_bits(least)).to_bits();
    let special = match magnitude {
        0x0f80_0000 => 0x7f80_0000,
        _ => magnitude | 0x7f80_0000 | QUIET,
    };
    let finite = if magnitude < 1 << 23 {
        denormal
    } else {
        number
    };
    let bits_of_magnitude = if magnitude < 0x0f80_0000 {
        finite
    } else {
        special
    };
    f32::from_bits(bits_of_magnitude | (bits & 0x8000) << 16)
}

/// Rounds once, to nearest even; a NaN becomes quiet.
#[inline(always)]
pub(super) fn f16_from_f32(value: f32) -> f16 {
    const INFINITE: u32 = 0x7f80_0000;
    let bits = value.to_bits();
    let magnitude = bits & 0x7fff_ffff;
    // Half a step up, less where a tie is to stay even; may carry into the exponent.
    let up = 0xfff + (magnitude >> 13 & 1);
    let normal = magnitude.wrapping_add(up).wrapping_sub((127 - 15) << 23) >> 13;
    // Near one half, an f32 has the steps of denormal 16-bit floats.
    let denormal = (f32::from_bits(magnitude) + 0.5)
        .to_bits()
        .wrapping_sub(0.5f32.to_bits());
    let nan = 0x7e00 | magnitude >> 13 & 0x3ff;
    let least = 0x3880_0000; // 2^-14
    let beyond = 0x4780_0000; // 2^16
    let finite = if magnitude < least { denormal } else { normal };
    let number = if magnitude < beyond { finite } else { 0x7c00 };
    let number = if magnitude > INFINITE { nan } else { number };
    f16::from_bits((number | bits >> 16 & 0x8000) as u16)
}

/// The nearest number with the high half of an f32, ties to even; a NaN becomes quiet.
#[inline(always)]
pub(crate) fn bfloat16_from_f32(value: f32) -> u16 {
    let bits = value.to_bits();
    let nearest = bits.wrapping_add(0x7fff + (bits >> 16 & 1)) >> 16;
    let nan = bits >> 16 | 0x40;
    (if value.is_nan() { nan } else { nearest }) as u16
}

/// Rounds once: by way of an `f32` that is rounded to odd.
#[inline(always)]
pub(crate) fn f16_from_f64(value: f64) -> f16 {
    f16_from_f32(odd_f32_from_f64(value))
}

/// Rounded to odd: the number itself if `f32` has it, else the neighbour whose last bit is set. A
/// second rounding to at least two bits less gives the number that one rounding gives (Boldo and
/// Melquiond 2008, "Emulation of FMA and Correctly Rounded Sums"), for an odd neighbour is neither
/// a narrower number nor halfway between two.
#[inline(always)]
pub(crate) fn odd_f32_from_f64(value: f64) -> f32 {
    let near = value as f32;
    let bits = near.to_bits();
    let back = near as f64;
    // Towards zero, then the sticky bit.
    let toward_zero = if back.abs() > value.abs() {
        bits.wrapping_sub(1)
    } else {
        bits
    };
    let odd = if back == value || value.is_nan() {
        bits
    } else {
        toward_zero | 1
    };
    f32::from_bits(odd)
}

/// `a * b + c` rounded to odd, of numbers that 16-bit floats hold. The product is exact: two
/// significands of 11 bits make one of 22, and its exponent lies between -48 and 32. So are the
/// differences that give the sum's rounding error (Knuth, TAOCP 4.2.2, theorem B): all are
/// multiples of 2^-48 below 2^33, and none is subnormal or overflows.
#[inline(always)]
#[allow(clippy::double_comparisons)]
pub(crate) fn odd_fma(a: f32, b: f32, c: f32) -> f32 {
    let product = a * b;
    let sum = product + c;
    let of_c = sum - product;
    let of_product = sum - of_c;
    let error = (product - of_product) + (c - of_c);
    // An infinity's error is NaN, and ordered comparisons with that are false.
    let is_inexact = error < 0.0 || error > 0.0;
    let bits = sum.to_bits();
    // All ones where the sum lies beyond the exact one: one step back towards zero.
    let back = ((bits ^ error.to_bits()) as i32 >> 31) as u32;
    let odd = bits.wrapping_add(back) | 1;
    f32::from_bits(if is_inexact { odd } else { bits })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widened_as_by_the_crate() {
        for value in (0..=u16::MAX).map(f16::from_bits) {
            let (ours, expected) = (f32_from_f16(value), value.to_f32_const());
            assert_eq!(
                ours.to_bits(),
                expected.to_bits(),
                "{:04x}",
                value.to_bits()
            );
        }
    }

    #[test]
    fn rounded_as_by_the_crate() {
        let check = |bits: u32| {
            for bits in [bits, bits | 1 << 31] {
                let value = f32::from_bits(bits);
                let (ours, expected) = (f16_from_f32(value), f16::from_f32_const(value));
                assert_eq!(ours.to_bits(), expected.to_bits(), "{bits:08x}");
            }
        };
        // Around each 16-bit float, and halfway to the next.
        for value in (0..0x8000).map(f16::from_bits) {
            let exact = value.to_f32_const().to_bits();
            for near in [0, 0x1000] {
                for by in [-1, 0, 1] {
                    check(exact.wrapping_add(near).wrapping_add_signed(by) & 0x7fff_ffff);
                }
            }
        }
        // Halfway between denormal ones the distance is another.
        for steps in 0..4096 {
            let halfway = (steps as f32 * 2f32.powi(-26)).to_bits();
            check(halfway);
            check(halfway + 1);
        }
        for bits in (0..0x8000_0000).step_by(4099) {
            check(bits);
        }
    }
}
