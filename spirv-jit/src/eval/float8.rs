//! Floats of 8 bits, of the encodings E4M3 and E5M2 ("FP8 Formats for Deep Learning",
//! Micikevicius et al., 2022): elements of matrices in memory.

#![forbid(unsafe_code)]

use super::narrow::f32_from_f16;
use crate::eval::f16;

/// All bits but the sign.
const MAGNITUDE: u8 = 0x7f;

/// Exact.
pub fn f32_from_e5m2(bits: u8) -> f32 {
    f32_from_f16(f16::from_bits(u16::from(bits) << 8))
}

/// Exact. All ones are the only NaN, and there is no infinity.
pub fn f32_from_e4m3(bits: u8) -> f32 {
    if bits & MAGNITUDE == MAGNITUDE {
        return f32::NAN;
    }
    // A 16-bit float has a bit more of an exponent, whose bias is 8 larger.
    let sign = u16::from(bits & !MAGNITUDE) << 8;
    let half = sign | u16::from(bits & MAGNITUDE) << 7;
    f32_from_f16(f16::from_bits(half)) * 256.0
}

/// The nearest number, ties to even; what is too large becomes infinite.
pub fn e5m2_from_f32(value: f32) -> u8 {
    let magnitude = match value.is_nan() {
        true => MAGNITUDE,
        false => nearest(value.abs(), 2, 15).min(0x7c) as u8,
    };
    sign_of(value) | magnitude
}

/// The nearest number, ties to even; what is too large becomes NaN.
pub fn e4m3_from_f32(value: f32) -> u8 {
    let magnitude = match value.is_nan() {
        true => MAGNITUDE,
        false => nearest(value.abs(), 3, 7).min(MAGNITUDE.into()) as u8,
    };
    sign_of(value) | magnitude
}

fn sign_of(value: f32) -> u8 {
    (value.to_bits() >> 24) as u8 & !MAGNITUDE
}

/// The bits of the nearest number with a fraction of so many bits and an exponent of that bias and
/// of any width.
fn nearest(magnitude: f32, fraction: u32, bias: u32) -> u32 {
    let bits = magnitude.to_bits();
    let least_normal = (128 - bias) << 23;
    if bits < least_normal {
        // In units of the least number, exactly.
        let units = magnitude * f32::from_bits((127 + bias - 1 + fraction) << 23);
        return units.round_ties_even() as u32;
    }
    let cut = 23 - fraction;
    let up = (1 << (cut - 1)) - 1 + (bits >> cut & 1);
    ((bits + up) >> cut) - ((127 - bias) << fraction)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each finite number comes back, and what lies between two goes to the nearer one.
    fn check(narrow: fn(f32) -> u8, widen: fn(u8) -> f32, largest: u8) {
        for bits in 0..=largest {
            for sign in [0, 0x80] {
                assert_eq!(narrow(widen(bits | sign)), bits | sign);
            }
            if bits == largest {
                continue;
            }
            let (low, high) = (widen(bits), widen(bits + 1));
            let middle = (low + high) / 2.0;
            assert_eq!(narrow(middle), bits + (bits & 1), "{middle}");
            assert_eq!(narrow(middle.next_down()), bits);
            assert_eq!(narrow(middle.next_up()), bits + 1);
        }
    }

    #[test]
    fn numbers_of_eight_bits_are_the_nearest() {
        check(e4m3_from_f32, f32_from_e4m3, 0x7e);
        check(e5m2_from_f32, f32_from_e5m2, 0x7b);
        // The largest and the least numbers of the paper's table 1.
        assert_eq!(
            [f32_from_e4m3(0x7e), f32_from_e4m3(1)],
            [448.0, 2f32.powi(-9)]
        );
        assert_eq!(
            [f32_from_e5m2(0x7b), f32_from_e5m2(1)],
            [57344.0, 2f32.powi(-16)]
        );
    }

    #[test]
    fn numbers_that_are_too_large_are_infinite_or_nan() {
        assert_eq!([e4m3_from_f32(464.0), e4m3_from_f32(464.1)], [0x7e, 0x7f]);
        assert_eq!(
            [e5m2_from_f32(61439.9), e5m2_from_f32(61440.0)],
            [0x7b, 0x7c]
        );
        for narrow in [e4m3_from_f32, e5m2_from_f32] {
            assert_eq!(narrow(f32::NAN) & 0x7f, 0x7f);
        }
        assert_eq!(
            [e4m3_from_f32(f32::INFINITY), e5m2_from_f32(f32::INFINITY)],
            [0x7f, 0x7c]
        );
        assert!(f32_from_e4m3(0xff).is_nan() && f32_from_e5m2(0x7d).is_nan());
        assert_eq!(f32_from_e5m2(0xfc), f32::NEG_INFINITY);
    }
}
