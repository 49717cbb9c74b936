//! Every elementwise kernel of every tier against `eval`, on random bits and on the bits where
//! things go wrong.

use std::fmt::Write;

use super::{Bench, on_tiers};
use crate::eval::{self, Float, Int, f16};
use crate::ir::Type;

/// A scalar type of `eval` with its IR type.
pub(super) trait Scalar: Copy {
    const TYPE: Type;
    fn of(bits: u64) -> Self;
    fn bits(self) -> u64;
}

macro_rules! scalar {
    ($t:ty, $ty:ident, $bits:ident => $of:expr, $value:ident => $to:expr) => {
        impl Scalar for $t {
            const TYPE: Type = Type::$ty;
            fn of($bits: u64) -> Self {
                $of
            }
            fn bits(self) -> u64 {
                let $value = self;
                $to
            }
        }
    };
}
scalar!(bool, I1, b => b & 1 != 0, v => v as u64);
scalar!(u8, I8, b => b as u8, v => v as u64);
scalar!(u16, I16, b => b as u16, v => v as u64);
scalar!(u32, I32, b => b as u32, v => v as u64);
scalar!(u64, I64, b => b, v => v);
scalar!(f16, F16, b => f16::from_bits(b as u16), v => v.to_bits() as u64);
scalar!(f32, F32, b => f32::from_bits(b as u32), v => v.to_bits() as u64);
scalar!(f64, F64, b => f64::from_bits(b), v => v.to_bits());

/// Bits that find corners in any type, and random ones.
fn samples(seed: u64) -> Vec<u64> {
    let mut corners = vec![0, 1, 2, 3, 7, 8, 31, 32, 33, 63, 64, u64::MAX, u64::MAX - 1];
    for shift in [7, 8, 10, 15, 16, 23, 31, 32, 52, 63] {
        corners.extend([1 << shift, (1u64 << shift) - 1, u64::MAX << shift]);
    }
    for value in [
        0.0f32,
        0.5,
        1.0,
        2.5,
        3.0e9,
        1e30,
        1e-40,
        f32::INFINITY,
        f32::NAN,
        0.75,
    ] {
        for value in [value, -value] {
            let half = f16::from_f32(value).to_bits() as u64;
            corners.extend([value.to_bits() as u64, (value as f64).to_bits(), half]);
        }
    }
    let mut state = seed;
    for _ in 0..500 {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        let word = state ^ (state >> 29);
        // Random bits, and random bits of moderate exponents.
        let moderate = (word as u32 & 0x83ff_ffff | 0x3c00_0000) as u64;
        let moderate_64 = word & 0x80ff_ffff_ffff_ffff | 0x3f00_0000_0000_0000;
        let moderate_16 = word & 0x83ff | 0x3800;
        corners.extend([word, moderate, moderate_64, moderate_16]);
    }
    corners
}

/// Text that makes a value of type `ty` named `to` from input rows `row` and `row + 1`.
pub(super) fn make(text: &mut String, next: &mut u32, ty: Type, row: usize) -> u32 {
    let mut line = |ty: &str, op: String| {
        let v = *next;
        *next += 1;
        writeln!(text, "v{v}: {ty} = {op}").unwrap();
        v
    };
    let low = line("i32", format!("input[{row}]"));
    match ty {
        Type::I32 => low,
        Type::F32 => line("f32", format!("bitcast v{low}")),
        Type::I8 => line("i8", format!("uconvert v{low}")),
        Type::I16 => line("i16", format!("uconvert v{low}")),
        Type::F16 => {
            let v = line("i16", format!("uconvert v{low}"));
            line("f16", format!("bitcast v{v}"))
        }
        Type::I1 => {
            let one = line("i32", "const 1".into());
            let bit = line("i32", format!("and v{low}, v{one}"));
            line("i1", format!("ieq v{bit}, v{one}"))
        }
        Type::I64 | Type::F64 => {
            let high = line("i32", format!("input[{}]", row + 1));
            line(&ty.to_string(), format!("pack64 v{low}, v{high}"))
        }
        Type::Descriptor => unreachable!("no operand of these operations"),
    }
}

/// A program that applies `op` to values made from the inputs, and ends with the result's bits.
fn program(op: &str, from: &[Type], to: Type) -> String {
    let mut text = String::from("module closest_hit\ninputs ");
    let rows: Vec<String> = (0..2 * from.len())
        .map(|k| format!("payload.{k}"))
        .collect();
    writeln!(text, "{}\noutput_rows 2\nfunc f0 {{", rows.join(", ")).unwrap();
    let mut next = 0;
    let args: Vec<String> = from
        .iter()
        .enumerate()
        .map(|(k, &ty)| format!("v{}", make(&mut text, &mut next, ty, 2 * k)))
        .collect();
    let v = next;
    writeln!(text, "v{v}: {to} = {op} {}", args.join(", ")).unwrap();
    writeln!(text, "v{}: i32 = const 0", v + 1).unwrap();
    match to {
        Type::I32 | Type::F32 => writeln!(text, "end(v{v}, v{})", v + 1),
        Type::I64 | Type::F64 => writeln!(
            text,
            "v{}: i32, v{}: i32 = unpack64 v{v}\nend(v{}, v{})",
            v + 2,
            v + 3,
            v + 2,
            v + 3
        ),
        Type::I1 => writeln!(
            text,
            "v{}: i32 = const 1\nv{}: i32 = select v{v}, v{}, v{}\nend(v{}, v{})",
            v + 2,
            v + 3,
            v + 2,
            v + 1,
            v + 3,
            v + 1
        ),
        _ => writeln!(
            text,
            "v{}: i16 = {} v{v}\nv{}: i32 = uconvert v{}\nend(v{}, v{})",
            v + 2,
            if to == Type::F16 {
                "bitcast"
            } else {
                "uconvert"
            },
            v + 3,
            v + 2,
            v + 3,
            v + 1
        ),
    }
    .unwrap();
    text + "}\n"
}

/// Runs `op` over the samples on every tier and compares with `reference`, NaN payloads aside.
fn check(op: &str, from: &[Type], to: Type, reference: fn([u64; 3]) -> u64) {
    let text = program(op, from, to);
    let columns: Vec<Vec<u64>> = (0..from.len())
        .map(|k| {
            let mut samples = samples(k as u64 + 1);
            // Every operand walks its samples in another order.
            let len = samples.len();
            samples.rotate_left(k * 37 % len);
            if k == 1 {
                samples.reverse();
            }
            samples
        })
        .collect();
    let is_nan = |bits: u64| match to {
        Type::F16 => f16::from_bits(bits as u16).is_nan(),
        Type::F32 => f32::from_bits(bits as u32).is_nan(),
        Type::F64 => f64::from_bits(bits).is_nan(),
        _ => false,
    };
    on_tiers(|tier| {
        for start in (0..columns[0].len()).step_by(128) {
            let args = |lane: usize| -> [u64; 3] {
                std::array::from_fn(|k| {
                    let column = columns.get(k);
                    column.map_or(0, |c| c[(start + lane) % c.len()])
                })
            };
            let mut bench = Bench::new(&text, tier, 8);
            for k in 0..from.len() {
                bench.input(2 * k, |lane| args(lane)[k] as u32);
                bench.input(2 * k + 1, |lane| (args(lane)[k] >> 32) as u32);
            }
            bench.run_to_end();
            let (low, high) = (bench.io(0), bench.io(1));
            for lane in 0..128 {
                let got = low[lane] as u64 | (high[lane] as u64) << 32;
                let expected = reference(args(lane));
                assert!(
                    got == expected || (is_nan(got) && is_nan(expected)),
                    "{tier:?} {op} {from:?} {:x?}: {got:x} instead of {expected:x}",
                    args(lane)
                );
            }
        }
    });
}

macro_rules! on_types {
    ($check:ident($f:ident): $($t:ty),*) => {$(
        $check!($f, $t);
    )*};
}

macro_rules! binary {
    ($f:ident, $t:ty) => {
        check(stringify!($f), &[<$t>::TYPE; 2], <$t>::TYPE, |[a, b, _]| {
            Scalar::bits(eval::$f(<$t>::of(a), <$t>::of(b)))
        })
    };
}

macro_rules! compare {
    ($f:ident, $t:ty) => {
        check(stringify!($f), &[<$t>::TYPE; 2], Type::I1, |[a, b, _]| {
            eval::$f(<$t>::of(a), <$t>::of(b)) as u64
        })
    };
}

macro_rules! test_op {
    ($f:ident, $t:ty) => {
        check(stringify!($f), &[<$t>::TYPE], Type::I1, |[a, ..]| {
            eval::$f(<$t>::of(a)) as u64
        })
    };
}

macro_rules! ints {
    ($check:ident: $($f:ident)*) => {$(
        on_types!($check($f): u8, u16, u32, u64);
    )*};
}

macro_rules! floats {
    ($check:ident: $($f:ident)*) => {$(
        on_types!($check($f): f16, f32, f64);
    )*};
}

#[test]
fn integers() {
    ints!(binary: iadd isub imul umul_hi smul_hi udiv sdiv urem srem smod and or xor);
    ints!(binary: shl lshr ashr smin smax umin umax);
    ints!(compare: ieq ine ult ule slt sle);
    macro_rules! int_unary {
        ($f:ident, $t:ty) => {
            check(stringify!($f), &[<$t>::TYPE], <$t>::TYPE, |[a, ..]| {
                eval::$f(<$t>::of(a)).to_u64()
            })
        };
    }
    ints!(int_unary: not ineg iabs isign bit_reverse bit_count find_lsb find_smsb find_umsb);
}

#[test]
fn booleans() {
    on_types!(binary(and): bool);
    on_types!(binary(or): bool);
    on_types!(binary(xor): bool);
    on_types!(compare(ieq): bool);
    on_types!(compare(ine): bool);
    check("not", &[Type::I1], Type::I1, |[a, ..]| (a & 1) ^ 1);
}

#[test]
fn floats() {
    floats!(binary: fadd fsub fmul fdiv frem fmod fmin fmax);
    floats!(compare: foeq fone folt fole fueq fune fult fule);
    floats!(test_op: fis_nan fis_inf);
    macro_rules! float_unary {
        ($f:ident, $t:ty) => {
            check(stringify!($f), &[<$t>::TYPE], <$t>::TYPE, |[a, ..]| {
                Scalar::bits(eval::$f(<$t>::of(a)))
            })
        };
    }
    floats!(float_unary: fneg fabs fsign ffloor fceil ftrunc fround_even fround ffract fsqrt);
    floats!(float_unary: finverse_sqrt fquantize_f16 ffrexp_mantissa fflush_denormal);
    macro_rules! ternary {
        ($f:ident, $t:ty) => {
            check(stringify!($f), &[<$t>::TYPE; 3], <$t>::TYPE, |[a, b, c]| {
                Scalar::bits(eval::$f(<$t>::of(a), <$t>::of(b), <$t>::of(c)))
            })
        };
    }
    floats!(ternary: ffma);
    macro_rules! exponent {
        ($f:ident, $t:ty) => {
            check(stringify!($f), &[<$t>::TYPE], Type::I32, |[a, ..]| {
                eval::$f(<$t>::of(a)) as u64
            })
        };
    }
    floats!(exponent: ffrexp_exponent);
    macro_rules! scale {
        ($f:ident, $t:ty) => {
            check(
                stringify!($f),
                &[<$t>::TYPE, Type::I32],
                <$t>::TYPE,
                |[a, b, _]| Scalar::bits(eval::$f(<$t>::of(a), b as u32)),
            )
        };
    }
    floats!(scale: fldexp);
}

/// Remainders where no lane has a large quotient, which is where the kernels take another way than
/// `eval`.
#[test]
fn moderate_remainders() {
    on_tiers(|tier| {
        for (op, reference) in [
            ("frem", eval::frem::<f32> as fn(f32, f32) -> f32),
            ("fmod", eval::fmod::<f32>),
        ] {
            let text = program(op, &[Type::F32; 2], Type::F32);
            for round in 0..200u32 {
                let mut bench = Bench::new(&text, tier, 4);
                let word = |lane: usize, k: u32| {
                    let x = (lane as u32 + 64 * round).wrapping_mul(2_654_435_761)
                        ^ k.wrapping_mul(0x9e37_79b9);
                    x ^ x >> 15
                };
                // The divisor's exponent is anywhere, the dividend's at most 20 above it.
                let divisor = |lane| {
                    let e = 30 + word(lane, 1) % 180;
                    f32::from_bits(word(lane, 2) & 0x807f_ffff | e << 23)
                };
                let dividend = |lane: usize| {
                    let y = divisor(lane);
                    match lane % 4 {
                        // Multiples, exact or rounded.
                        0 => y * (word(lane, 3) % 1000) as f32,
                        _ => {
                            let e = y.to_bits() >> 23 & 0xff;
                            let e = e + 10 - word(lane, 4) % 30;
                            f32::from_bits(word(lane, 5) & 0x807f_ffff | e << 23)
                        }
                    }
                };
                bench.input(0, |lane| dividend(lane).to_bits());
                bench.input(2, |lane| divisor(lane).to_bits());
                bench.run_to_end();
                for (lane, &got) in bench.io(0).iter().enumerate() {
                    let (x, y) = (dividend(lane), divisor(lane));
                    assert_eq!(got, reference(x, y).to_bits(), "{tier:?} {op} {x:e} {y:e}");
                }
            }
        }
    });
}

#[test]
fn transcendental_functions() {
    macro_rules! small_floats {
        ($check:ident: $($f:ident)*) => {$(
            on_types!($check($f): f16, f32);
        )*};
    }
    macro_rules! float_unary {
        ($f:ident, $t:ty) => {
            check(stringify!($f), &[<$t>::TYPE], <$t>::TYPE, |[a, ..]| {
                Scalar::bits(eval::$f(<$t>::of(a)))
            })
        };
    }
    small_floats!(binary: fpow fatan2);
    small_floats!(float_unary: fsin fcos ftan fasin facos fatan fsinh fcosh ftanh fasinh facosh);
    small_floats!(float_unary: fatanh fexp flog fexp2 flog2);
    small_floats!(binary: fpow_fast fatan2_fast);
    small_floats!(float_unary: fsin_fast fcos_fast ftan_fast fatan_fast fexp_fast fexp2_fast flog_fast flog2_fast finverse_sqrt_fast);
}

fn conversions<A: Scalar + Float, B: Scalar + Int>() {
    let (float, int) = (A::TYPE, B::TYPE);
    check("fto_s", &[float], int, |[a, ..]| {
        eval::fto_s::<A, B>(<A as Scalar>::of(a)).to_u64()
    });
    check("fto_u", &[float], int, |[a, ..]| {
        eval::fto_u::<A, B>(<A as Scalar>::of(a)).to_u64()
    });
    check("sto_f", &[int], float, |[a, ..]| {
        Scalar::bits(eval::sto_f::<B, A>(<B as Scalar>::of(a)))
    });
    check("uto_f", &[int], float, |[a, ..]| {
        Scalar::bits(eval::uto_f::<B, A>(<B as Scalar>::of(a)))
    });
}

fn widths<A: Scalar + Int, B: Scalar + Int>() {
    check("sconvert", &[A::TYPE], B::TYPE, |[a, ..]| {
        eval::sconvert::<A, B>(A::of(a)).to_u64()
    });
    check("uconvert", &[A::TYPE], B::TYPE, |[a, ..]| {
        eval::uconvert::<A, B>(A::of(a)).to_u64()
    });
}

fn float_widths<A: Scalar + Float, B: Scalar + Float>() {
    check("fconvert", &[A::TYPE], B::TYPE, |[a, ..]| {
        Scalar::bits(eval::fconvert::<A, B>(<A as Scalar>::of(a)))
    });
}

#[test]
fn conversion_kernels() {
    macro_rules! each {
        ($f:ident: $($a:ty => $($b:ty),*;)*) => {
            $($($f::<$a, $b>();)*)*
        };
    }
    each!(conversions:
        f16 => u8, u16, u32, u64;
        f32 => u8, u16, u32, u64;
        f64 => u8, u16, u32, u64;
    );
    each!(widths:
        u8 => u16, u32, u64;
        u16 => u8, u32, u64;
        u32 => u8, u16, u64;
        u64 => u8, u16, u32;
    );
    each!(float_widths:
        f16 => f32, f64;
        f32 => f16, f64;
        f64 => f16, f32;
    );
}

#[test]
fn operations_of_mixed_types() {
    macro_rules! fields {
        ($t:ty) => {
            let ty = <$t>::TYPE;
            check(
                "bitfield_uextract",
                &[ty, Type::I32, Type::I32],
                ty,
                |[a, b, c]| eval::bitfield_uextract(<$t>::of(a), b as u32, c as u32) as u64,
            );
            check(
                "bitfield_sextract",
                &[ty, Type::I32, Type::I32],
                ty,
                |[a, b, c]| eval::bitfield_sextract(<$t>::of(a), b as u32, c as u32) as u64,
            );
            check("select", &[Type::I1, ty, ty], ty, |[a, b, c]| {
                eval::select(a & 1 != 0, <$t>::of(b), <$t>::of(c)) as u64
            });
        };
    }
    fields!(u8);
    fields!(u16);
    fields!(u32);
    fields!(u64);
}
