//! The cheaper functions against `std`'s f64 ones: the bounds at the head of `eval::fast`.

use super::precision::{pairs, samples, ulps};
use crate::eval::*;

#[test]
fn trigonometry() {
    for x in samples().filter(|x| x.abs() <= 4096.0) {
        let w = x as f64;
        let bound = 2f64.powi(-18);
        assert!((fsin_fast(x) as f64 - w.sin()).abs() <= bound, "sin {x:e}");
        assert!((fcos_fast(x) as f64 - w.cos()).abs() <= bound, "cos {x:e}");
        assert!(ulps(fatan_fast(x), w.atan()) <= 32.0, "atan {x:e}");
        if w.cos().abs() > 0.1 {
            let error = (ftan_fast(x) as f64 - w.tan()).abs();
            assert!(error <= 2f64.powi(-11), "tan {x:e}");
        }
    }
    for x in samples().filter(|x| x.is_finite()) {
        assert!(fsin_fast(x).abs() <= 1.0 && fcos_fast(x).abs() <= 1.0);
    }
}

#[test]
fn powers_and_logarithms() {
    for x in samples().filter(|x| x.is_finite()) {
        let w = x as f64;
        let ends = |exact: f64| exact < 2f64.powf(-126.4) || exact > 2f64.powf(127.4);
        if !ends(w.exp2()) {
            assert!(ulps(fexp2_fast(x), w.exp2()) <= 4.0, "exp2 {x:e}");
        }
        if !ends(w.exp()) {
            let bound = 3.0 + 2.0 * w.abs();
            assert!(ulps(fexp_fast(x), w.exp()) <= bound, "exp {x:e}");
        }
        if x >= f32::MIN_POSITIVE {
            let near = (0.5..=2.0).contains(&x);
            for (got, exact) in [(flog_fast(x), w.ln()), (flog2_fast(x), w.log2())] {
                let small = (got as f64 - exact).abs() <= 2f64.powi(-21);
                assert!(near && small || ulps(got, exact) <= 4.0, "log {x:e}");
            }
            let exact = 1.0 / w.sqrt();
            assert!(ulps(finverse_sqrt_fast(x), exact) <= 3.0, "{x:e}");
        }
    }
}

#[test]
fn functions_of_two() {
    for (x, y) in pairs(1_000_000) {
        let angle = (y as f64).atan2(x as f64);
        if angle.abs() > 1e-30 || angle == 0.0 {
            assert!(ulps(fatan2_fast(y, x), angle) <= 32.0, "atan2 {y:e} {x:e}");
        }
        let base = x.abs();
        let power = (y.to_bits() % 20_001) as f32 / 100.0 - 100.0;
        let power = power / base.log2().abs().max(1e-6);
        if base.is_normal() {
            let exponent = power as f64 * (base as f64).log2();
            // The error of the logarithm counts by the exponent's size; near 1 it is absolute.
            let log_error =
                4.0 * exponent.abs() * 2f64.powi(-23) + power.abs() as f64 * 2f64.powi(-21);
            let bound = 4.0 + log_error * 2f64.powi(24);
            let error = ulps(fpow_fast(base, power), exponent.exp2());
            assert!(error <= bound, "pow {base:e} {power:e}: {error} > {bound}");
        }
    }
}

#[test]
fn special_values() {
    let (inf, nan, zero) = (f32::INFINITY, f32::NAN, 0.0f32);
    let cases = [
        (fsin_fast(zero), 0.0),
        (fcos_fast(zero), 1.0),
        (fexp_fast(-inf), 0.0),
        (fexp_fast(inf), inf),
        (fexp2_fast(10.0), 1024.0),
        (fexp2_fast(inf), inf),
        (flog_fast(zero), -inf),
        (flog2_fast(inf), inf),
        (flog2_fast(8.0), 3.0),
        (fpow_fast(2.0, 10.0), 1024.0),
        (fpow_fast(zero, 2.0), 0.0),
        (fpow_fast(5.0, zero), 1.0),
        (finverse_sqrt_fast(zero), inf),
        (finverse_sqrt_fast(inf), 0.0),
        (fatan2_fast(zero, -1.0), std::f32::consts::PI),
        (fatan_fast(inf), std::f32::consts::FRAC_PI_2),
    ];
    for (k, (got, expected)) in cases.into_iter().enumerate() {
        assert_eq!(got, expected, "case {k}");
    }
    let not_a_number = [
        fsin_fast(nan),
        fcos_fast(inf),
        ftan_fast(nan),
        fexp_fast(nan),
        fexp2_fast(nan),
        flog_fast(-1.0),
        flog2_fast(nan),
        fpow_fast(-1.0, 2.0),
        finverse_sqrt_fast(-1.0),
        fatan_fast(nan),
        fatan2_fast(nan, 1.0),
    ];
    for (k, got) in not_a_number.into_iter().enumerate() {
        assert!(got.is_nan(), "case {k}: {got}");
    }
}
