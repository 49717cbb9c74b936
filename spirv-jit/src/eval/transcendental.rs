//! Transcendental functions of `f32`: straight-line code from IEEE operations and explicit fused
//! multiply-adds, so that every tier gets the same bits. Bounds are those of the table in Vulkan's
//! "Precision and Operation of SPIR-V Instructions"; what is reached is far inside them and held by
//! this module's tests.
//!
//! Reductions and the hyperbolic functions use `f64` inside: rounding its result once is simpler
//! than splitting constants, and a vector of 16 lanes pays one more instruction per step.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, LN_2, LOG2_E, PI};

use super::wide;

/// Horner's scheme with fused steps, highest coefficient first.
#[inline(always)]
fn poly<const N: usize>(x: f32, coefficients: [f32; N]) -> f32 {
    let mut p = coefficients[0];
    let mut i = 1;
    while i < N {
        p = p.mul_add(x, coefficients[i]);
        i += 1;
    }
    p
}

/// x = k π/2 + r with |r| ≤ π/4: (r, k mod 4). Exact to f32 for |x| < 2^50; beyond that r is
/// somewhere in range.
#[inline(always)]
fn reduce_half_pi(x: f32) -> (f32, u32) {
    const MAGIC: f64 = 6_755_399_441_055_744.0;
    let x = x as f64;
    let shifted = x.mul_add(std::f64::consts::FRAC_2_PI, MAGIC);
    let k = shifted - MAGIC;
    let r = (-k).mul_add(std::f64::consts::FRAC_PI_2, x);
    let r = (-k).mul_add(6.123_233_995_736_766e-17, r);
    // Towards 2^50 rounding may have chosen the neighbour of k, whose r is up to 0.85; beyond that
    // r is noise, but must stay a sine's argument. NaN passes.
    let r = if r > 1.0 { 1.0 } else { r };
    let r = if r < -1.0 { -1.0 } else { r };
    (r as f32, shifted.to_bits() as u32)
}

#[inline(always)]
fn sin_poly(r: f32) -> f32 {
    let z = r * r;
    let p = poly(
        z,
        [1.0 / 362_880.0, -1.0 / 5_040.0, 1.0 / 120.0, -1.0 / 6.0],
    );
    (z * r).mul_add(p, r)
}

#[inline(always)]
fn cos_poly(r: f32) -> f32 {
    let z = r * r;
    poly(
        z,
        [
            -1.0 / 3_628_800.0,
            1.0 / 40_320.0,
            -1.0 / 720.0,
            1.0 / 24.0,
            -0.5,
            1.0,
        ],
    )
}

/// sin of k π/2 + r.
#[inline(always)]
fn sin_quadrant(r: f32, k: u32) -> f32 {
    let (s, c) = (sin_poly(r), cos_poly(r));
    let value = if k & 1 == 0 { s } else { c };
    f32::from_bits(value.to_bits() ^ (k & 2) << 30)
}

#[inline(always)]
pub(super) fn sin(x: f32) -> f32 {
    let (r, k) = reduce_half_pi(x);
    let value = sin_quadrant(r, k);
    // Keeps −0.
    if x == 0.0 { x } else { value }
}

#[inline(always)]
pub(super) fn cos(x: f32) -> f32 {
    let (r, k) = reduce_half_pi(x);
    sin_quadrant(r, k.wrapping_add(1))
}

#[inline(always)]
pub(super) fn tan(x: f32) -> f32 {
    let (r, k) = reduce_half_pi(x);
    let (s, c) = (sin_poly(r), cos_poly(r));
    let value = if k & 1 == 0 { s / c } else { -c / s };
    if x == 0.0 { x } else { value }
}

/// atan of 0 ≤ t ≤ 1.
#[inline(always)]
fn atan_unit(t: f32) -> f32 {
    // tan(π/8): beyond it, atan t = π/4 + atan((t − 1)/(t + 1)).
    let upper = t > 0.414_213_57;
    let z = if upper { (t - 1.0) / (t + 1.0) } else { t };
    let base = if upper { FRAC_PI_4 } else { 0.0 };
    let q = z * z;
    let p = poly(
        q,
        [
            1.0 / 21.0,
            -1.0 / 19.0,
            1.0 / 17.0,
            -1.0 / 15.0,
            1.0 / 13.0,
            -1.0 / 11.0,
            1.0 / 9.0,
            -1.0 / 7.0,
            1.0 / 5.0,
            -1.0 / 3.0,
        ],
    );
    base + (z * q).mul_add(p, z)
}

#[inline(always)]
pub(super) fn atan(x: f32) -> f32 {
    let a = x.abs();
    let swap = a > 1.0;
    let t = if swap { 1.0 / a } else { a };
    let v = atan_unit(t);
    let v = if swap { FRAC_PI_2 - v } else { v };
    v.copysign(x)
}

#[inline(always)]
pub(super) fn atan2(y: f32, x: f32) -> f32 {
    let (ay, ax) = (y.abs(), x.abs());
    let swap = ay > ax;
    let (low, high) = if swap { (ax, ay) } else { (ay, ax) };
    let t = low / high;
    // 0/0 is 0, ∞/∞ is 1 (as the C library has it); NaN stays.
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
pub(super) fn asin(x: f32) -> f32 {
    // √(1 − x²) without cancellation.
    atan2(x, ((1.0 - x) * (1.0 + x)).sqrt())
}

#[inline(always)]
pub(super) fn acos(x: f32) -> f32 {
    atan2(((1.0 - x) * (1.0 + x)).sqrt(), x)
}

/// p 2^n for an integer n in −300..=300.
#[inline(always)]
fn scaled(p: f32, n: f32) -> f32 {
    // In two halves, because 2^n itself may be out of range.
    // Its low bits hold the integer; an `as` conversion saturates and does not become vector code.
    const MAGIC: f32 = 12_582_912.0;
    let n = (n + MAGIC).to_bits().wrapping_sub(MAGIC.to_bits()) as i32;
    let half = n >> 1;
    let two_to = |e: i32| f32::from_bits((e.wrapping_add(127) as u32) << 23);
    p * two_to(half) * two_to(n.wrapping_sub(half))
}

/// 2^n e^r for |r| ≤ ½ ln 2 and an integer n in −300..=300, rounded once more where the result is
/// subnormal.
#[inline(always)]
fn exp_scaled(r: f32, n: f32) -> f32 {
    let p = poly(
        r,
        [
            1.0 / 5_040.0,
            1.0 / 720.0,
            1.0 / 120.0,
            1.0 / 24.0,
            1.0 / 6.0,
            0.5,
            1.0,
            1.0,
        ],
    );
    scaled(p, n)
}

#[inline(always)]
pub(super) fn exp(x: f32) -> f32 {
    let clamped = if x > 90.0 { 90.0 } else { x };
    let clamped = if clamped < -110.0 { -110.0 } else { clamped };
    let n = (clamped * LOG2_E).round_ties_even();
    // ln 2 as a 12-bit head, whose multiples are exact, and a tail.
    let r = n.mul_add(-0.693_359_4, clamped);
    let r = n.mul_add(0.000_212_194_44, r);
    let value = exp_scaled(r, n);
    if x.is_nan() { x } else { value }
}

#[inline(always)]
pub(super) fn exp2(x: f32) -> f32 {
    let clamped = if x > 130.0 { 130.0 } else { x };
    let clamped = if clamped < -160.0 { -160.0 } else { clamped };
    let n = clamped.round_ties_even();
    let value = exp_scaled((clamped - n) * LN_2, n);
    if x.is_nan() { x } else { value }
}

/// x = 2^n m with m in [√½, √2): (n, m − 1). x is positive; subnormals are scaled first.
#[inline(always)]
fn log_split(x: f32) -> (f32, f32) {
    const SQRT_HALF: u32 = 0x3f35_04f3;
    let tiny = x < f32::MIN_POSITIVE;
    let scaled = if tiny { x * 16_777_216.0 } else { x };
    let bias = if tiny { 24.0 } else { 0.0 };
    let offset = scaled.to_bits().wrapping_sub(SQRT_HALF);
    let n = (offset as i32 >> 23) as f32 - bias;
    let m = f32::from_bits((offset & 0x007f_ffff).wrapping_add(SQRT_HALF));
    (n, m - 1.0)
}

/// The value of a logarithm outside its domain.
#[inline(always)]
fn log_special(x: f32, value: f32) -> f32 {
    // Positive and finite.
    let is_common = x.to_bits().wrapping_sub(1) < f32::INFINITY.to_bits() - 1;
    let special = if x > 0.0 { x } else { f32::NAN };
    let special = if x == 0.0 { f32::NEG_INFINITY } else { special };
    if is_common { value } else { special }
}

/// log(1 + f) = f − (f²/2 − s (f²/2 + R)), s = f/(2 + f), R = z (2/3 + 2/5 z + …), z = s²: returns
/// (f²/2, s (f²/2 + R)).
#[inline(always)]
fn log1p_parts(f: f32) -> (f32, f32) {
    let s = f / (2.0 + f);
    let z = s * s;
    let r = z * poly(z, [2.0 / 9.0, 2.0 / 7.0, 2.0 / 5.0, 2.0 / 3.0]);
    let half_square = 0.5 * f * f;
    (half_square, s * (half_square + r))
}

#[inline(always)]
pub(super) fn log(x: f32) -> f32 {
    let (n, f) = log_split(x);
    let (half_square, rest) = log1p_parts(f);
    let low = n.mul_add(-0.000_212_194_44, rest);
    let value = n.mul_add(0.693_359_4, f - (half_square - low));
    log_special(x, value)
}

#[inline(always)]
pub(super) fn log2(x: f32) -> f32 {
    // log2 e = head + tail, the head short enough for exact products with a short f.
    const HEAD: f32 = 1.442_871_1;
    const TAIL: f32 = -0.000_176_052_86;
    let (n, f) = log_split(x);
    let (half_square, rest) = log1p_parts(f);
    // log(1 + f) = high + low, high with its last 12 bits clear.
    let high = f32::from_bits((f - half_square).to_bits() & 0xffff_f000);
    let low = (f - high) - half_square + rest;
    let value = (low + high).mul_add(TAIL, low * HEAD);
    let value = high.mul_add(HEAD, value) + n;
    log_special(x, value)
}

/// `exp2(y log2 x)`, the logarithm as an unevaluated sum of two f32: 1.1 ULP for results between
/// 2^-16 and 2^16, 4 beyond. NaN for a negative base.
#[inline(always)]
pub(super) fn pow(x: f32, y: f32) -> f32 {
    const MAGIC: f32 = 12_582_912.0;
    // 2 / ln 2.
    const HEAD: f32 = 2.885_390_1;
    const TAIL: f32 = 3.851_926e-8;
    let (n, f) = log_split(x);
    // f / (2 + f) = s + s_low.
    let d = 2.0 + f;
    let d_low = f - (d - 2.0);
    let inverse = 1.0 / d;
    let s = f * inverse;
    let rest = (-s).mul_add(d, f);
    let s_low = (-s).mul_add(d_low, rest) * inverse;
    let z = s.mul_add(s, (s + s) * s_low);
    // log2(1 + f) = s (HEAD + TAIL + z q(z)), q interpolated where Chebyshev polynomials are zero.
    let q = poly(z, [0.336_589_6, 0.411_901_2, 0.577_079_77, 0.961_796_7]);
    let main = HEAD * s;
    let main_low = HEAD.mul_add(s, -main);
    let main_low = HEAD.mul_add(s_low, TAIL.mul_add(s, main_low));
    let main_low = (s * z).mul_add(q, main_low);
    let sum = n + main;
    let sum_low = (main - (sum - n)) + main_low;
    let log = sum + sum_low;
    let log_low = sum_low - (log - sum);
    let log = log_special(x, log);
    let power = y * log;
    let power_low = y.mul_add(log_low, y.mul_add(log, -power));
    // Farther out all is 0 or infinite.
    let power_low = if power.abs() < 160.0 { power_low } else { 0.0 };
    let clamped = if power > 160.0 { 160.0 } else { power };
    let clamped = if clamped < -160.0 { -160.0 } else { clamped };
    let n = (clamped + MAGIC) - MAGIC;
    // 2^r for |r| ≤ ½, found in the same way.
    let r = (clamped - n) + power_low;
    let p = poly(
        r,
        [
            1.545_416_2e-4,
            0.001_339_201_7,
            0.009_618_081,
            0.055_503_55,
            0.240_226_51,
            LN_2,
            1.0,
        ],
    );
    let value = scaled(p, n);
    if value.is_nan() { f32::NAN } else { value }
}

/// e^x in f64, for |x| up to where f32 has long overflowed.
#[inline(always)]
fn exp_wide(x: f64) -> f64 {
    let x = if x > 200.0 { 200.0 } else { x };
    let x = if x < -200.0 { -200.0 } else { x };
    wide::exp_core(x)
}

/// sinh for |x| < ¼ by its series.
#[inline(always)]
fn sinh_small(x: f64) -> f64 {
    let z = x * x;
    let p = (1.0 / 362_880.0f64).mul_add(z, 1.0 / 5_040.0);
    let p = p.mul_add(z, 1.0 / 120.0);
    let p = p.mul_add(z, 1.0 / 6.0);
    (x * z).mul_add(p, x)
}

#[inline(always)]
fn sinh_wide(x: f64) -> f64 {
    let e = exp_wide(x);
    let large = 0.5 * e - 0.5 / e;
    if x.abs() < 0.25 { sinh_small(x) } else { large }
}

#[inline(always)]
fn cosh_wide(x: f64) -> f64 {
    let e = exp_wide(x);
    0.5 * e + 0.5 / e
}

#[inline(always)]
pub(super) fn sinh(x: f32) -> f32 {
    let value = sinh_wide(x as f64) as f32;
    if x.is_nan() || x == 0.0 { x } else { value }
}

#[inline(always)]
pub(super) fn cosh(x: f32) -> f32 {
    let value = cosh_wide(x as f64) as f32;
    if x.is_nan() { x } else { value }
}

#[inline(always)]
pub(super) fn tanh(x: f32) -> f32 {
    let w = x as f64;
    let value = (sinh_wide(w) / cosh_wide(w)) as f32;
    if x.is_nan() || x == 0.0 { x } else { value }
}

#[inline(always)]
pub(super) fn asinh(x: f32) -> f32 {
    let a = x.abs() as f64;
    let z = a * a;
    let p = (105.0 / 3456.0f64).mul_add(z, -15.0 / 336.0);
    let p = p.mul_add(z, 3.0 / 40.0);
    let p = p.mul_add(z, -1.0 / 6.0);
    let small = (a * z).mul_add(p, a);
    let large = wide::log_core(a + (z + 1.0).sqrt());
    let value = if a < 0.1 { small } else { large } as f32;
    let value = if a == f64::INFINITY {
        f32::INFINITY
    } else {
        value
    };
    if x.is_nan() { x } else { value.copysign(x) }
}

/// NaN below 1.
#[inline(always)]
pub(super) fn acosh(x: f32) -> f32 {
    let w = x as f64;
    let value = wide::log_core(w + ((w - 1.0) * (w + 1.0)).sqrt()) as f32;
    let value = if x == f32::INFINITY { x } else { value };
    // Phrased so that NaN fails too.
    if x >= 1.0 { value } else { f32::NAN }
}

/// NaN outside [−1, 1].
#[inline(always)]
pub(super) fn atanh(x: f32) -> f32 {
    let a = x.abs() as f64;
    let z = a * a;
    let p = (1.0 / 9.0f64).mul_add(z, 1.0 / 7.0);
    let p = p.mul_add(z, 1.0 / 5.0);
    let p = p.mul_add(z, 1.0 / 3.0);
    let small = (a * z).mul_add(p, a);
    let large = 0.5 * wide::log_core((1.0 + a) / (1.0 - a));
    let value = if a < 0.1 { small } else { large } as f32;
    let value = if a == 1.0 { f32::INFINITY } else { value };
    if a <= 1.0 {
        value.copysign(x)
    } else {
        f32::NAN
    }
}
