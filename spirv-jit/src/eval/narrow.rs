//! Rounding to 16-bit floats.

#![forbid(unsafe_code)]

use half::f16;

/// Rounds once, to nearest even.
#[inline(always)]
pub(super) fn f16_from_f32(value: f32) -> f16 {
    f16::from_f32(value)
}

/// Rounds once: by way of an `f32` that is rounded to odd, which keeps the second rounding exact.
#[inline(always)]
pub(crate) fn f16_from_f64(value: f64) -> f16 {
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
    f16_from_f32(f32::from_bits(odd))
}
