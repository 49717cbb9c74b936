//! Conversions.

use super::{Float, Int};

/// Truncates and saturates; NaN gives 0.
#[inline(always)]
pub fn fto_s<A: Float, B: Int>(a: A) -> B {
    match (A::Bits::BITS, B::BITS) {
        (64, 64) => B::from_u64(a.to_f64() as i64 as u64),
        (_, 64) => B::from_u64(narrow_f32(a) as i64 as u64),
        (_, 32) => B::from_u64(saturate_32(a.to_f64(), -2_147_483_648.0, 2_147_483_647.0) as u64),
        (_, 16) => B::from_u64(saturate_32(a.to_f64(), -32_768.0, 32_767.0) as u64),
        _ => B::from_u64(saturate_32(a.to_f64(), -128.0, 127.0) as u64),
    }
}

#[inline(always)]
pub fn fto_u<A: Float, B: Int>(a: A) -> B {
    match (A::Bits::BITS, B::BITS) {
        (64, 64) => B::from_u64(a.to_f64() as u64),
        (_, 64) => B::from_u64(narrow_f32(a) as u64),
        (_, 32) => B::from_u64(saturate_32(a.to_f64(), 0.0, 4_294_967_295.0) as u64),
        (_, 16) => B::from_u64(saturate_32(a.to_f64(), 0.0, 65_535.0) as u64),
        _ => B::from_u64(saturate_32(a.to_f64(), 0.0, 255.0) as u64),
    }
}

/// The low 32 bits of an f64 truncated and clamped to `low..=high`; 0 for NaN. Says the same as
/// `as`, which does not become vector code.
#[inline(always)]
fn saturate_32(value: f64, low: f64, high: f64) -> u32 {
    let value = value.trunc();
    let clamped = if value < low { low } else { value };
    let clamped = if clamped > high { high } else { clamped };
    let clamped = if value.is_nan() { 0.0 } else { clamped };
    super::wide::low_word(clamped)
}

/// Exact for what fits `f32`, which is all that it is used for.
#[inline(always)]
fn narrow_f32<A: Float>(a: A) -> f32 {
    a.to_f64() as f32
}

/// Rounds once. A 64-bit integer by way of f64 would round twice to an f32. To an f16 it goes by
/// way of f32, which holds every integer below 2^24; from 65,520 on an f16 is infinite.
#[inline(always)]
pub fn sto_f<A: Int, B: Float>(a: A) -> B {
    match B::Bits::BITS {
        64 => B::from_f64(a.to_i64() as f64),
        _ => B::from_f32(a.to_i64() as f32),
    }
}

/// As [`sto_f`].
#[inline(always)]
pub fn uto_f<A: Int, B: Float>(a: A) -> B {
    match B::Bits::BITS {
        64 => B::from_f64(a.to_u64() as f64),
        _ => B::from_f32(a.to_u64() as f32),
    }
}

/// Between widths, rounding once.
#[inline(always)]
pub fn fconvert<A: Float, B: Float>(a: A) -> B {
    match A::Bits::BITS {
        64 => B::from_f64(a.to_f64()),
        _ => B::from_f32(narrow_f32(a)),
    }
}

/// Sign-extends or truncates.
#[inline(always)]
pub fn sconvert<A: Int, B: Int>(a: A) -> B {
    B::from_u64(a.to_i64() as u64)
}

/// Zero-extends or truncates.
#[inline(always)]
pub fn uconvert<A: Int, B: Int>(a: A) -> B {
    B::from_u64(a.to_u64())
}
