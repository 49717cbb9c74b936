//! Functions computed in `f64`: for `f64` operands, and as the exact-enough inside of some `f32`
//! ones.

use std::f64::consts::{LN_2, LOG2_E};

/// The low 32 bits, in two's complement, of an integer of at most 2^51 in magnitude.
#[inline(always)]
pub(super) fn low_word(integer: f64) -> u32 {
    (integer + 6_755_399_441_055_744.0).to_bits() as u32
}

/// `x * 2^exponent`. With `rounds` the result may be subnormal in f64 and is rounded once; without
/// it the caller rounds to a narrower type and the product itself is exact.
#[inline(always)]
pub(super) fn ldexp(x: f64, exponent: i32, rounds: bool) -> f64 {
    let two_to = |e: i32| f64::from_bits(((e + 1023) as u64) << 52);
    if rounds {
        // Three exact or overflowing steps; on the way down only the last one can round, because
        // each stops at 2^-969 while the value stays normal until it.
        let e = exponent.clamp(-2200, 2200);
        let first = e.clamp(-969, 1023);
        let second = (e - first).clamp(-969, 1023);
        let third = (e - first - second).clamp(-969, 1023);
        x * two_to(first) * two_to(second) * two_to(third)
    } else {
        x * two_to(exponent.clamp(-400, 400))
    }
}

/// e^x for |x| < 700, relative error about 2^-50.
#[inline(always)]
pub(super) fn exp_core(x: f64) -> f64 {
    // Adding this leaves the nearest integer in the low bits of the sum.
    const MAGIC: f64 = 6_755_399_441_055_744.0;
    let shifted = x.mul_add(LOG2_E, MAGIC);
    let n = shifted - MAGIC;
    let r = (-n).mul_add(LN_2, x);
    let r = (-n).mul_add(2.319_046_813_846_299_6e-17, r);
    let mut p = 1.0 / 6_227_020_800.0;
    for c in [
        1.0 / 479_001_600.0,
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5_040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ] {
        p = f64::mul_add(p, r, c);
    }
    // 2^n: the integer stands in the low bits.
    let scale = f64::from_bits(
        (shifted
            .to_bits()
            .wrapping_sub(MAGIC.to_bits())
            .wrapping_add(1023))
            << 52,
    );
    p * scale
}

/// log x for a normal, positive, finite x; absolute error about 2^-52 of the larger of 1 and the
/// result.
#[inline(always)]
pub(super) fn log_core(x: f64) -> f64 {
    let (n, series, s) = log_parts(x);
    n.mul_add(LN_2, series * s)
}

/// x = 2^n m with m in [√½, √2); log m = series × s with s = (m − 1)/(m + 1).
#[inline(always)]
fn log_parts(x: f64) -> (f64, f64, f64) {
    const SQRT_HALF: u64 = 0x3fe6_a09e_667f_3bcd;
    const MAGIC: f64 = 6_755_399_441_055_744.0;
    let offset = x.to_bits().wrapping_sub(SQRT_HALF);
    // Arithmetic shift by 52, without one: AVX2 lacks it for 64 bits. Biased so that it is never
    // negative.
    let biased = offset.wrapping_add(2048 << 52) >> 52;
    let biased = biased & 0xfff;
    let n = f64::from_bits(biased | MAGIC.to_bits()) - (MAGIC + 2048.0);
    let m = f64::from_bits((offset & 0x000f_ffff_ffff_ffff).wrapping_add(SQRT_HALF));
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    let mut p = 2.0 / 19.0;
    for c in [
        2.0 / 17.0,
        2.0 / 15.0,
        2.0 / 13.0,
        2.0 / 11.0,
        2.0 / 9.0,
        2.0 / 7.0,
        2.0 / 5.0,
        2.0 / 3.0,
        2.0,
    ] {
        p = f64::mul_add(p, z, c);
    }
    (n, p, s)
}

// The f64 forms: SPIR-V's extended instructions take 16 and 32 bits only, but exact results of
// `f32` come from here. They are those of the `libm` crate: the system's library differs from
// machine to machine.
macro_rules! unary {
    ($($name:ident)*) => {$(
        #[inline(always)]
        pub(super) fn $name(x: f64) -> f64 {
            libm::$name(x)
        }
    )*};
}
unary! {
    sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh exp log exp2 log2
}

#[inline(always)]
pub(super) fn pow(x: f64, y: f64) -> f64 {
    libm::pow(x, y)
}

#[inline(always)]
pub(super) fn atan2(y: f64, x: f64) -> f64 {
    libm::atan2(y, x)
}

#[inline(always)]
pub(super) fn inverse_sqrt(x: f64) -> f64 {
    1.0 / x.sqrt()
}
