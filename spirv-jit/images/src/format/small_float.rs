//! Floats of fewer than 32 bits that have no sign: unsigned 11- and 10-bit, and the shared exponent
//! (spec, "Fixed-Point Data Conversions" and the sections on 16-bit, 11-bit and 10-bit floats and
//! on `VK_FORMAT_E5B9G9R9_UFLOAT_PACK32`).
#![forbid(unsafe_code)]

use lanes::halves::half_to_f32;

/// Unsigned float with 5 exponent bits and `mantissa` bits of mantissa, to f32.
#[inline]
pub fn ufloat_to_f32(bits: u32, mantissa: u32) -> f32 {
    // It is an f16 without sign and with fewer mantissa bits.
    half_to_f32((bits << (10 - mantissa)) as u16)
}

/// f32 to unsigned float of `mantissa` bits, round to nearest even. Negative values give 0, finite
/// ones at most the largest finite one, NaN stays NaN.
pub fn f32_to_ufloat(value: f32, mantissa: u32) -> u32 {
    let infinity = 31 << mantissa;
    if value.is_nan() {
        return infinity | 1;
    }
    if value <= 0.0 {
        return 0;
    }
    if value == f32::INFINITY {
        return infinity;
    }
    // In units of the last place of its binade; subnormals share the smallest binade's.
    let exponent = ((value.to_bits() >> 23) as i32 - 127).max(-14);
    let units = (value as f64 * step_inverse(exponent - mantissa as i32)).round_ties_even() as u32;
    // A carry out of the mantissa moves on to the next exponent by itself.
    let bits = (((exponent + 14) as u32) << mantissa) + units;
    bits.min(infinity - 1)
}

/// `2^-exponent`.
fn step_inverse(exponent: i32) -> f64 {
    f64::from_bits(((1023 - exponent) as u64) << 52)
}

/// Bits of mantissa and bias of the shared-exponent format.
const SHARED_MANTISSA: i32 = 9;
const SHARED_BIAS: i32 = 15;

/// E5B9G9R9 to r, g, b: exact.
pub fn shared_exponent_to_f32(word: u32) -> [f32; 3] {
    let exponent = (word >> 27) as i32 - SHARED_BIAS - SHARED_MANTISSA;
    let scale = f32::from_bits(((127 + exponent) as u32) << 23);
    [0, 9, 18].map(|shift| ((word >> shift) & 0x1ff) as f32 * scale)
}

/// r, g, b to E5B9G9R9 by the spec's algorithm.
pub fn f32_to_shared_exponent(rgb: [f32; 3]) -> u32 {
    /// (2^9 - 1) / 2^9 * 2^(31 - 15)
    const MAX: f32 = 65408.0;
    // A NaN is not greater than 0.
    let clamped = rgb.map(|c| if c > 0.0 { c.min(MAX) } else { 0.0 });
    let max = clamped[0].max(clamped[1]).max(clamped[2]);
    let floor_log2 = (max.to_bits() >> 23) as i32 - 127;
    let preliminary = floor_log2.max(-SHARED_BIAS - 1) + 1 + SHARED_BIAS;
    let units = |c: f32, exponent: i32| {
        (c as f64 * step_inverse(exponent - SHARED_BIAS - SHARED_MANTISSA) + 0.5).floor() as u32
    };
    let carries = units(max, preliminary) == 1 << SHARED_MANTISSA;
    let exponent = preliminary + carries as i32;
    let [r, g, b] = clamped.map(|c| units(c, exponent));
    (exponent as u32) << 27 | b << 18 | g << 9 | r
}
