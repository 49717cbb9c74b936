//! Cheaper functions of `f32` (`TUFF_ACCURACY=fast`): one precision throughout, short polynomials,
//! no divisions where a product does.
//!
//! | function | bound, held by this module's tests |
//! | --- | --- |
//! | sin, cos | absolute error 2^-18 for |x| ≤ 4096; beyond that in [−1, 1] |
//! | tan | as sin over cos |
//! | atan, atan2 | 32 ULP |
//! | exp | 3 + 2 |x| ULP; below 2^-126.5 it is 0, above 2^127.5 infinite |
//! | exp2 | 4 ULP; ends as exp |
//! | log, log2 | 4 ULP, or an absolute error of 2^-21 for x in [½, 2]; subnormal arguments count as 0 |
//! | pow | as exp2(y log2 x) |
//! | inverse_sqrt | 3 ULP; subnormal arguments count as 0 |
//!
//! All of that is inside Vulkan's "Precision and Operation of SPIR-V Instructions". Coefficients
//! are minimax fits of the relative error.

use std::f32::consts::{FRAC_2_PI, FRAC_PI_2, LN_2, LOG2_E, PI};

use super::wide;

macro_rules! functions {
    ($($method:ident $name:ident($($argument:ident),*);)*) => {
        /// The cheaper functions of a type; those of `f64` are its only ones.
        pub trait Fast: Sized {
            $(fn $method(self, $($argument: Self),*) -> Self;)*
        }

        impl Fast for f32 {
            $(#[inline(always)]
            fn $method(self, $($argument: f32),*) -> f32 {
                $name(self, $($argument),*)
            })*
        }

        impl Fast for f64 {
            $(#[inline(always)]
            fn $method(self, $($argument: f64),*) -> f64 {
                wide::$name(self, $($argument),*)
            })*
        }
    };
}
functions! {
    sin_fast sin();
    cos_fast cos();
    tan_fast tan();
    atan_fast atan();
    atan2_fast atan2(x);
    exp_fast exp();
    exp2_fast exp2();
    log_fast log();
    log2_fast log2();
    pow_fast pow(power);
    inverse_sqrt_fast inverse_sqrt();
}

/// Adding this leaves the nearest integer in the low bits of the sum.
const MAGIC: f32 = 12_582_912.0;

/// x = k π/2 + r.
#[inline(always)]
fn reduce_half_pi(x: f32) -> (f32, u32) {
    let shifted = x.mul_add(FRAC_2_PI, MAGIC);
    let k = shifted - MAGIC;
    let r = (-k).mul_add(FRAC_PI_2, x);
    let r = (-k).mul_add(-4.371_139e-8, r);
    // Far out r is noise, but must stay a sine's argument; NaN passes.
    let r = if r > 0.8 { 0.8 } else { r };
    let r = if r < -0.8 { -0.8 } else { r };
    (r, shifted.to_bits())
}

#[inline(always)]
fn parts(r: f32) -> (f32, f32) {
    let z = r * r;
    let sin = 0.008_163_25f32.mul_add(z, -0.166_633_89);
    let cos = (-0.001_359_18f32).mul_add(z, 0.041_655_77);
    let cos = cos.mul_add(z, -0.499_998_85);
    ((z * r).mul_add(sin, r), z.mul_add(cos, 1.0))
}

#[inline(always)]
fn quadrant(r: f32, k: u32) -> f32 {
    let (s, c) = parts(r);
    let value = if k & 1 == 0 { s } else { c };
    f32::from_bits(value.to_bits() ^ (k & 2) << 30)
}

#[inline(always)]
pub(super) fn sin(x: f32) -> f32 {
    let (r, k) = reduce_half_pi(x);
    quadrant(r, k)
}

#[inline(always)]
pub(super) fn cos(x: f32) -> f32 {
    let (r, k) = reduce_half_pi(x);
    quadrant(r, k.wrapping_add(1))
}

#[inline(always)]
pub(super) fn tan(x: f32) -> f32 {
    let (r, k) = reduce_half_pi(x);
    let (s, c) = parts(r);
    let odd = k & 1 != 0;
    let (high, low) = if odd { (-c, s) } else { (s, c) };
    high / low
}

/// atan of 0 ≤ t ≤ 1.
#[inline(always)]
fn atan_unit(t: f32) -> f32 {
    let z = t * t;
    let p = 0.008_106_328f32.mul_add(z, -0.037_796_605);
    let p = p.mul_add(z, 0.084_840_917);
    let p = p.mul_add(z, -0.135_445_7);
    let p = p.mul_add(z, 0.198_978_72);
    let p = p.mul_add(z, -0.333_284_92);
    (z * t).mul_add(p, t)
}

#[inline(always)]
pub(super) fn atan(x: f32) -> f32 {
    let a = x.abs();
    let swap = a > 1.0;
    let v = atan_unit(if swap { 1.0 / a } else { a });
    let v = if swap { FRAC_PI_2 - v } else { v };
    v.copysign(x)
}

#[inline(always)]
pub(super) fn atan2(y: f32, x: f32) -> f32 {
    let (ay, ax) = (y.abs(), x.abs());
    let swap = ay > ax;
    let (low, high) = if swap { (ax, ay) } else { (ay, ax) };
    let t = low / high;
    let t = if high == 0.0 { 0.0 } else { t };
    let t = if low == f32::INFINITY { 1.0 } else { t };
    let v = atan_unit(t);
    let v = if swap { FRAC_PI_2 - v } else { v };
    let v = if x.is_sign_negative() { PI - v } else { v };
    let v = v.copysign(y);
    if x.is_nan() || y.is_nan() {
        f32::NAN
    } else {
        v
    }
}

#[inline(always)]
pub(super) fn exp2(x: f32) -> f32 {
    let x = if x > 128.0 { 128.0 } else { x };
    let x = if x < -127.0 { -127.0 } else { x };
    let shifted = x + MAGIC;
    let f = x - (shifted - MAGIC);
    let p = 0.001_326_47f32.mul_add(f, 0.009_671_51);
    let p = p.mul_add(f, 0.055_507_34);
    let p = p.mul_add(f, 0.240_222_42);
    let p = p.mul_add(f, 0.693_146_98);
    let p = p.mul_add(f, 1.0);
    let n = shifted.to_bits().wrapping_sub(MAGIC.to_bits());
    p * f32::from_bits(n.wrapping_add(127) << 23)
}

#[inline(always)]
pub(super) fn exp(x: f32) -> f32 {
    exp2(x * LOG2_E)
}

/// log2 of a number that is no special case.
#[inline(always)]
fn log2_core(x: f32) -> f32 {
    const SQRT_HALF: u32 = 0x3f35_04f3;
    let offset = x.to_bits().wrapping_sub(SQRT_HALF);
    let n = (offset as i32 >> 23) as f32;
    let f = f32::from_bits((offset & 0x007f_ffff).wrapping_add(SQRT_HALF)) - 1.0;
    let p = (-0.145_809_78f32).mul_add(f, 0.234_041_56);
    let p = p.mul_add(f, -0.248_877_13);
    let p = p.mul_add(f, 0.287_098_81);
    let p = p.mul_add(f, -0.360_239_63);
    let p = p.mul_add(f, 0.480_923_23);
    let p = p.mul_add(f, -0.721_352_8);
    // A coefficient of the fit, however near it comes to a constant.
    #[allow(clippy::approx_constant)]
    let p = p.mul_add(f, 1.442_695);
    f.mul_add(p, n)
}

#[inline(always)]
fn log_special(x: f32, value: f32) -> f32 {
    let value = if x == f32::INFINITY { x } else { value };
    let value = if x < f32::MIN_POSITIVE {
        f32::NEG_INFINITY
    } else {
        value
    };
    if x < 0.0 || x.is_nan() {
        f32::NAN
    } else {
        value
    }
}

#[inline(always)]
pub(super) fn log2(x: f32) -> f32 {
    log_special(x, log2_core(x))
}

#[inline(always)]
pub(super) fn log(x: f32) -> f32 {
    log_special(x, log2_core(x) * LN_2)
}

#[inline(always)]
pub(super) fn pow(x: f32, y: f32) -> f32 {
    let power = y * log2(x);
    let value = exp2(power);
    if power.is_nan() { f32::NAN } else { value }
}

/// Newton's iteration from an estimate by the exponent's bits: no square root and no division.
#[inline(always)]
pub(super) fn inverse_sqrt(x: f32) -> f32 {
    let half = 0.5 * x;
    let mut y = f32::from_bits(0x5f37_5a86u32.wrapping_sub(x.to_bits() >> 1));
    for _ in 0..3 {
        y *= (-half * y).mul_add(y, 1.5);
    }
    let y = if x < f32::MIN_POSITIVE {
        f32::INFINITY
    } else {
        y
    };
    let y = if x == f32::INFINITY { 0.0 } else { y };
    if x < 0.0 || x.is_nan() { f32::NAN } else { y }
}
