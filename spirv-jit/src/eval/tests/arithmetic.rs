//! Integers, floats and conversions: the corners that the IR's prose fixes, and rounding against
//! wider arithmetic.

use crate::eval::*;

#[test]
fn division_has_no_holes() {
    assert_eq!(udiv(7u32, 0), 0);
    assert_eq!(urem(7u32, 0), 7);
    assert_eq!(sdiv(7u32, 0), 0);
    assert_eq!(srem(-7i32 as u32, 0), -7i32 as u32);
    assert_eq!(smod(-7i32 as u32, 0), -7i32 as u32);
    assert_eq!(sdiv(i32::MIN as u32, u32::MAX), i32::MIN as u32);
    assert_eq!(srem(i32::MIN as u32, u32::MAX), 0);
    assert_eq!(sdiv(0x80u8, 0xff), 0x80);
    assert_eq!(smod(-7i32 as u32, 3), 2);
    assert_eq!(smod(7u32, -3i32 as u32), -2i32 as u32);
    assert_eq!(srem(-7i32 as u32, 3), -1i32 as u32);
}

/// Quotients close to integers, against the machine's own division.
#[test]
fn division_of_32_bits_is_exact() {
    let corners = [
        1u32,
        2,
        3,
        7,
        10,
        641,
        0xffff,
        0x10001,
        0x7fff_ffff,
        0x8000_0001,
        u32::MAX,
    ];
    for b in corners.into_iter().chain((1..2000).map(|k| k * 2_147_377)) {
        for q in [0u32, 1, 2, 5, 1000, u32::MAX / b, u32::MAX / b / 2] {
            for near in [0, 1, 2, u32::MAX, u32::MAX - 1] {
                let a = q.wrapping_mul(b).wrapping_add(near);
                assert_eq!(udiv(a, b), a / b);
                assert_eq!(urem(a, b), a % b);
                let (x, y) = (a as i32, b as i32);
                assert_eq!(sdiv(a, b) as i32, x.wrapping_div(y), "{x} {y}");
                assert_eq!(srem(a, b) as i32, x.wrapping_rem(y), "{x} {y}");
            }
        }
    }
}

#[test]
fn bits_are_found() {
    assert_eq!(find_lsb(0u32), u32::MAX);
    assert_eq!(find_lsb(12u32), 2);
    assert_eq!(find_umsb(0u16), u16::MAX);
    assert_eq!(find_umsb(0x8000u16), 15);
    assert_eq!(find_smsb(u32::MAX), u32::MAX);
    assert_eq!(find_smsb(0u32), u32::MAX);
    assert_eq!(find_smsb(-5i32 as u32), 2);
    assert_eq!(find_smsb(5u64), 2);
    assert_eq!(shl(1u32, 33), 2);
    assert_eq!(ashr(0x80u8, 9), 0xc0);
    assert_eq!(umul_hi(u32::MAX, u32::MAX), u32::MAX - 1);
    assert_eq!(smul_hi(u32::MAX, u32::MAX), 0);
    assert_eq!(umul_hi(u64::MAX, 2), 1);
}

#[test]
fn bit_fields() {
    assert_eq!(bitfield_uextract(0xabcd_1234u32, 8, 8), 0x12);
    assert_eq!(bitfield_sextract(0xabcd_1234u32, 24, 8), 0xffff_ffab);
    assert_eq!(bitfield_sextract(0xabcd_1234u32, 0, 32), 0xabcd_1234);
    assert_eq!(bitfield_sextract(0xabcd_1234u32, 5, 0), 0);
    assert_eq!(bitfield_uextract(0xabcd_1234u32, 0, 32), 0xabcd_1234);
    assert_eq!(bitfield_uextract(0xabcd_1234u32, 32, 4), 0);
    assert_eq!(bitfield_insert(0xffff_ffffu32, 0, 8, 8), 0xffff_00ff);
    assert_eq!(bitfield_insert(0u32, u32::MAX, 0, 32), u32::MAX);
    assert_eq!(bitfield_insert(5u32, u32::MAX, 3, 0), 5);
    assert_eq!(bitfield_insert(0u64, 0xff, 40, 8), 0xff << 40);
}

#[test]
fn minimum_and_maximum() {
    let nan = f32::NAN;
    assert_eq!(fmin(nan, 1.0f32), 1.0);
    assert_eq!(fmin(1.0f32, nan), 1.0);
    assert_eq!(fmax(nan, 1.0f32), 1.0);
    assert_eq!(fmax(1.0f32, nan), 1.0);
    assert!(fmax(nan, nan).is_nan());
    for (a, b) in [(0.0f32, -0.0f32), (-0.0, 0.0)] {
        assert_eq!(fmin(a, b).to_bits(), (-0.0f32).to_bits());
        assert_eq!(fmax(a, b).to_bits(), 0);
    }
    assert_eq!(fmin(-1.0f64, f64::INFINITY), -1.0);
}

#[test]
fn comparisons_with_nan() {
    let nan = f32::NAN;
    for (a, b) in [(nan, 1.0), (1.0, nan), (nan, nan)] {
        assert!(!foeq(a, b) && !fone(a, b) && !folt(a, b) && !fole(a, b));
        assert!(fueq(a, b) && fune(a, b) && fult(a, b) && fule(a, b));
    }
    assert!(fis_nan(nan) && !fis_nan(f32::INFINITY));
    assert!(fis_inf(f32::NEG_INFINITY) && !fis_inf(f32::MAX) && !fis_inf(0.0f32) && !fis_inf(nan));
    assert!(fis_inf(f16::INFINITY) && !fis_inf(f16::MAX));
}

#[test]
fn floats_to_integers_saturate() {
    assert_eq!(fto_s::<f32, u32>(1e20), i32::MAX as u32);
    assert_eq!(fto_s::<f32, u32>(-1e20), i32::MIN as u32);
    assert_eq!(fto_s::<f32, u32>(f32::NAN), 0);
    assert_eq!(fto_u::<f32, u32>(-5.0), 0);
    assert_eq!(fto_u::<f32, u8>(300.0), 255);
    assert_eq!(fto_s::<f64, u16>(-40000.0), 0x8000);
    assert_eq!(fto_s::<f64, u32>(-2.9), -2i32 as u32);
    assert_eq!(fto_u::<f64, u64>(1.5e19), 15_000_000_000_000_000_000);
    assert_eq!(fto_s::<f16, u64>(f16::from_f32(-3.7)), -3i64 as u64);
    assert_eq!(sto_f::<u8, f32>(0x80), -128.0);
    assert_eq!(uto_f::<u64, f32>(u64::MAX), 18_446_744_073_709_551_616.0);
    assert_eq!(uto_f::<u32, f16>(70_000), f16::INFINITY);
    assert_eq!(sto_f::<u64, f64>(-3i64 as u64), -3.0);
    assert_eq!(sconvert::<u8, u32>(0x80), 0xffff_ff80);
    assert_eq!(uconvert::<u8, u32>(0x80), 0x80);
}

/// Halves computed exactly: every operand pair's sum, product and quotient fits f64 so well that
/// rounding once is rounding right.
#[test]
fn half_precision_rounds_once() {
    let halves = (0..=u16::MAX).step_by(37).map(f16::from_bits);
    for a in halves.clone() {
        for b in halves.clone().step_by(7) {
            let (x, y) = (a.to_f64(), b.to_f64());
            let same = |got: f16, exact: f64| {
                let rounded = round_to_half(exact);
                assert!(
                    got.to_bits() == rounded || (got.is_nan() && exact.is_nan()),
                    "{a} {b}: {got} for {exact}"
                );
            };
            same(fadd(a, b), x + y);
            same(fmul(a, b), x * y);
            // The quotient in f64 is itself rounded, but never onto a midpoint between halves.
            same(fdiv(a, b), x / y);
            same(ffma(a, a, b), x * x + y);
        }
    }
}

/// Round to nearest even by comparing with both neighbours.
fn round_to_half(exact: f64) -> u16 {
    let sign = if exact.is_sign_negative() { 0x8000 } else { 0 };
    let magnitude = exact.abs();
    if magnitude >= 65520.0 {
        return sign | 0x7c00;
    }
    // The largest half that is not above.
    let (mut low, mut high) = (0u16, 0x7c00u16);
    while high - low > 1 {
        let middle = (low + high) / 2;
        if f16::from_bits(middle).to_f64() <= magnitude {
            low = middle;
        } else {
            high = middle;
        }
    }
    let below = magnitude - f16::from_bits(low).to_f64();
    let above = if low + 1 == 0x7c00 {
        65536.0 - magnitude
    } else {
        f16::from_bits(low + 1).to_f64() - magnitude
    };
    let up = above < below || (above == below && low & 1 == 1);
    sign | (low + up as u16)
}

#[test]
fn exponents_and_mantissas() {
    for bits in (0..0x7f80_0000u32).step_by(9973).skip(1) {
        let x = f32::from_bits(bits);
        let (m, e) = (ffrexp_mantissa(x), ffrexp_exponent(x));
        assert!((0.5..1.0).contains(&m), "{x:e}");
        assert_eq!(fldexp(m, e), x);
        assert_eq!(m as f64 * 2f64.powi(e as i32), x as f64);
    }
    assert_eq!(ffrexp_mantissa(-0.0f32).to_bits(), (-0.0f32).to_bits());
    assert_eq!(ffrexp_exponent(0.0f32), 0);
    assert_eq!(fldexp(1.0f32, 1000), f32::INFINITY);
    assert_eq!(fldexp(3.0f32, -150i32 as u32), f32::from_bits(2));
    assert_eq!(fldexp(1.0f64, -1074i32 as u32), f64::from_bits(1));
    assert_eq!(fldexp(f64::from_bits(1), 2000), 2f64.powi(926));
    // 1.5 units of the last place and a bit: one rounding goes up, two would go to even.
    let x = 1.0 + 2f64.powi(-1) + 2f64.powi(-52);
    assert_eq!(fldexp(x, -1074i32 as u32), f64::from_bits(2));
    let x = 1.0 + 2f64.powi(-52);
    assert_eq!(fldexp(x, -1075i32 as u32), f64::from_bits(1));
}

#[test]
fn rounding_and_remainders() {
    assert_eq!(fround(2.5f32), 3.0);
    assert_eq!(fround(-2.5f32), -3.0);
    assert_eq!(fround_even(2.5f32), 2.0);
    assert_eq!(fround(0.49999997f32), 0.0);
    assert_eq!(fmod(-1.0f32, 3.0), 2.0);
    assert_eq!(fmod(1.0f32, -3.0), -2.0);
    assert_eq!(frem(-7.0f32, 3.0), -1.0);
    assert_eq!(frem(1e30f32, 3.0), 1e30f32 % 3.0);
    assert_eq!(ffract(-0.25f32), 0.75);
    assert_eq!(fsign(-3.0f32), -1.0);
    assert_eq!(fsign(-0.0f32).to_bits(), (-0.0f32).to_bits());
    assert_eq!(fsign(f32::NAN).to_bits(), 0);
    assert_eq!(fsign(-f32::NAN).to_bits(), 0);
    assert_eq!(fsign(-f16::NAN).to_bits(), 0);
    assert_eq!(fquantize_f16(1.0 + 2f32.powi(-11)), 1.0);
    assert_eq!(fquantize_f16(1e6f32), f32::INFINITY);
    assert_eq!(
        fquantize_f16(-(2f32.powi(-15))).to_bits(),
        (-0.0f32).to_bits()
    );
    assert_eq!(fquantize_f16(2f32.powi(-14)), 2f32.powi(-14));
    assert_eq!(fneg(f16::ONE), f16::NEG_ONE);
}
