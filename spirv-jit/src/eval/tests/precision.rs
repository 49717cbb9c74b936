//! Transcendental functions against `std`'s f64 ones, over a sample of all of f32. The bounds
//! asserted here are ours, in ULP of the exact result; each is inside what Vulkan's "Precision and
//! Operation of SPIR-V Instructions" allows, which [`vulkan_table`] holds separately.

use crate::eval::*;

/// Every 997th f32, and the first and last ones of each binade.
pub(super) fn samples() -> impl Iterator<Item = f32> {
    let sparse = (0..=u32::MAX / 997).map(|k| k * 997);
    let edges = (0..512u32).flat_map(|e| [e << 23, (e << 23) + 1, (e << 23).wrapping_sub(1)]);
    sparse.chain(edges).map(f32::from_bits)
}

/// Distance in units of the exact result's last f32 place.
pub(super) fn ulps(got: f32, exact: f64) -> f64 {
    let rounded = exact as f32;
    if got.is_nan() || exact.is_nan() {
        return if got.is_nan() && exact.is_nan() {
            0.0
        } else {
            f64::INFINITY
        };
    }
    if got == rounded {
        return ((got as f64 - exact).abs() / unit(exact)).min(0.5);
    }
    // The neighbour of infinity counts as one unit off, not as infinitely far.
    let finite = |x: f32| x.clamp(-f32::MAX, f32::MAX) as f64;
    let beyond = |x: f32| if x.is_infinite() { 1.0 } else { 0.0 };
    let exact = if rounded.is_infinite() {
        finite(rounded)
    } else {
        exact
    };
    (finite(got) - exact).abs() / unit(exact) + beyond(got) + beyond(rounded)
}

/// The last f32 place of a number.
fn unit(exact: f64) -> f64 {
    let exponent = if exact == 0.0 {
        -149
    } else {
        (exact.abs().log2().floor() as i32 - 23).max(-149)
    };
    2f64.powi(exponent)
}

fn check(
    name: &str,
    bound: f64,
    function: fn(f32) -> f32,
    exact: fn(f64) -> f64,
    holds: impl Fn(f32) -> bool,
) {
    let mut worst = (0.0, 0.0f32);
    for x in samples().filter(|&x| holds(x)) {
        let error = ulps(function(x), exact(x as f64));
        if error > worst.0 {
            worst = (error, x);
        }
    }
    println!("{name}: {:.3} ULP at {:e}", worst.0, worst.1);
    let (error, x) = worst;
    let (got, exact) = (function(x), exact(x as f64));
    assert!(
        error <= bound,
        "{name}({x:e}) = {got:e}, exact {exact:e}: {error} ULP"
    );
}

#[test]
fn errors_are_within_bounds() {
    let all = |_: f32| true;
    let moderate = |x: f32| !(x.abs() > 1e9);
    check("sin", 1.6, fsin, f64::sin, moderate);
    check("cos", 1.6, fcos, f64::cos, moderate);
    check("tan", 3.5, ftan, f64::tan, moderate);
    check("asin", 4.0, fasin, f64::asin, all);
    check("acos", 4.0, facos, f64::acos, all);
    check("atan", 3.0, fatan, f64::atan, all);
    check("sinh", 0.6, fsinh, f64::sinh, all);
    check("cosh", 0.6, fcosh, f64::cosh, all);
    check("tanh", 0.6, ftanh, f64::tanh, all);
    check("asinh", 0.6, fasinh, f64::asinh, all);
    check("acosh", 0.6, facosh, f64::acosh, all);
    check("atanh", 0.6, fatanh, f64::atanh, all);
    check("exp", 1.5, fexp, f64::exp, all);
    check("exp2", 1.5, fexp2, f64::exp2, all);
    check("log", 1.5, flog, f64::ln, all);
    check("log2", 1.5, flog2, f64::log2, all);
    check("inverse_sqrt", 1.6, finverse_sqrt, |x| 1.0 / x.sqrt(), all);
    check("sqrt", 0.5, fsqrt, f64::sqrt, all);
}

#[test]
fn vulkan_table() {
    let pi = std::f32::consts::PI;
    for x in samples() {
        let w = x as f64;
        if x.abs() <= pi {
            let bound = 2f64.powi(-11);
            assert!((fsin(x) as f64 - w.sin()).abs() <= bound);
            assert!((fcos(x) as f64 - w.cos()).abs() <= bound);
        }
        if x.is_finite() {
            let bound = 3.0 + 2.0 * w.abs();
            assert!(ulps(fexp(x), w.exp()) <= bound);
            assert!(ulps(fexp2(x), w.exp2()) <= bound);
        }
        if (0.5..=2.0).contains(&x) {
            assert!((flog(x) as f64 - w.ln()).abs() < 2f64.powi(-21));
            assert!((flog2(x) as f64 - w.log2()).abs() < 2f64.powi(-21));
        }
        // Far out, sine and cosine are still such.
        assert!(x.is_infinite() || x.is_nan() || (fsin(x).abs() <= 1.0 && fcos(x).abs() <= 1.0));
    }
}

/// Pairs of floats of moderate size: a small linear congruence walks through their bits.
pub(super) fn pairs(count: usize) -> impl Iterator<Item = (f32, f32)> {
    let mut state = 0x1234_5678_9abc_def0u64;
    let mut next = move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        f32::from_bits((state >> 32) as u32)
    };
    (0..count).map(move |_| (next(), next()))
}

#[test]
fn functions_of_two() {
    let mut worst = [0.0f64; 3];
    for (x, y) in pairs(2_000_000) {
        let error = ulps(fatan2(y, x), (y as f64).atan2(x as f64));
        worst[0] = worst[0].max(error);
        // The base's magnitude, an exponent that leads somewhere in range.
        let base = x.abs();
        if base > 0.0 && base.is_finite() {
            let exponent = ((y.to_bits() % 20_001) as f32 - 10_000.0) / 10_000.0;
            for (range, worst) in [16.0, 160.0].into_iter().zip(&mut worst[1..]) {
                let power = exponent * range / base.log2().abs().max(1e-6);
                let error = ulps(fpow(base, power), (base as f64).powf(power as f64));
                *worst = worst.max(error);
            }
        }
    }
    let [atan2, pow, far] = worst;
    println!("atan2: {atan2:.3}, pow: {pow:.3} between 2^-16 and 2^16, {far:.3} ULP beyond");
    assert!(atan2 <= 4.0 && pow <= 1.1 && far <= 4.0, "{worst:?}");
}

#[test]
fn special_values() {
    let (inf, nan, zero) = (f32::INFINITY, f32::NAN, 0.0f32);
    let same = |a: f32, b: f32| a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan());
    let cases = [
        (fsin(-zero), -zero),
        (fsin(inf), nan),
        (fcos(zero), 1.0),
        (fcos(-inf), nan),
        (ftan(-zero), -zero),
        (fexp(-inf), 0.0),
        (fexp(inf), inf),
        (fexp(zero), 1.0),
        (fexp2(-inf), 0.0),
        (fexp2(inf), inf),
        (fexp2(-149.0), f32::from_bits(1)),
        (fexp2(10.0), 1024.0),
        (flog(zero), -inf),
        (flog(-zero), -inf),
        (flog(-1.0), nan),
        (flog(inf), inf),
        (flog(1.0), 0.0),
        (flog2(8.0), 3.0),
        (flog2(zero), -inf),
        (flog2(f32::from_bits(1)), -149.0),
        (fpow(2.0, 10.0), 1024.0),
        (fpow(zero, 2.0), 0.0),
        (fpow(5.0, zero), 1.0),
        (fpow(-1.0, 2.0), nan),
        (fpow(inf, 1.0), inf),
        (fpow(inf, -1.0), 0.0),
        (fatan2(zero, 1.0), 0.0),
        (fatan2(zero, -1.0), std::f32::consts::PI),
        (fatan2(-zero, -1.0), -std::f32::consts::PI),
        (fatan2(1.0, zero), std::f32::consts::FRAC_PI_2),
        (fatan2(nan, 1.0), nan),
        (fatan2(1.0, nan), nan),
        (fatan(inf), std::f32::consts::FRAC_PI_2),
        (fasin(2.0), nan),
        (facos(-1.0), std::f32::consts::PI),
        (facos(1.0), 0.0),
        (fsinh(-zero), -zero),
        (fsinh(-88.8), -1.837_897_6e38),
        (fcosh(-89.0), 2.244_806_4e38),
        (fsinh(-89.5), -inf),
        (fcosh(89.5), inf),
        (fcosh(88.722_83), 1.701_399_3e38),
        (ftanh(inf), 1.0),
        (ftanh(-inf), -1.0),
        (fatanh(1.0), inf),
        (fatanh(-1.0), -inf),
        (fatanh(1.5), nan),
        (facosh(0.5), nan),
        (facosh(inf), inf),
        (fasinh(-inf), -inf),
        (fsqrt(-1.0), nan),
        (finverse_sqrt(zero), inf),
        (finverse_sqrt(inf), 0.0),
    ];
    for (k, (got, expected)) in cases.into_iter().enumerate() {
        assert!(same(got, expected), "case {k}: {got:e} for {expected:e}");
    }
    for f in [
        fsin,
        fcos,
        ftan,
        fasin,
        facos,
        fatan,
        fsinh,
        fcosh,
        ftanh,
        fasinh,
        facosh,
        fatanh,
        fexp,
        flog,
        fexp2,
        flog2,
        fsqrt,
        finverse_sqrt,
    ] {
        assert!(f(nan).is_nan());
    }
}
