//! Arithmetic of 16-bit floats on every tier against exact whole numbers.

use effort::rounds;

use super::{Bench, on_tiers};
use crate::eval::f16;

/// A finite number as an integer times a power of two.
#[derive(Clone, Copy)]
struct Exact {
    is_negative: bool,
    magnitude: u128,
    exponent: i32,
}

impl Exact {
    fn of(bits: u16) -> Exact {
        let (field, fraction) = (bits >> 10 & 31, bits & 0x3ff);
        let hidden = if field == 0 { 0 } else { 0x400 };
        Exact {
            is_negative: bits >> 15 != 0,
            magnitude: (fraction | hidden).into(),
            exponent: i32::from(field.max(1)) - 25,
        }
    }

    fn times(self, b: Exact) -> Exact {
        Exact {
            is_negative: self.is_negative != b.is_negative,
            magnitude: self.magnitude * b.magnitude,
            exponent: self.exponent + b.exponent,
        }
    }

    /// A sum of zero is −0 only if both are.
    fn plus(self, b: Exact) -> Exact {
        let exponent = self.exponent.min(b.exponent);
        let signed = |x: Exact| {
            let magnitude = (x.magnitude << (x.exponent - exponent)) as i128;
            if x.is_negative { -magnitude } else { magnitude }
        };
        let sum = signed(self) + signed(b);
        let both = self.is_negative && b.is_negative;
        Exact {
            is_negative: if sum == 0 { both } else { sum < 0 },
            magnitude: sum.unsigned_abs(),
            exponent,
        }
    }

    /// To nearest even. With `more` the number lies above `magnitude` by less than its last place.
    fn rounded(self, more: bool) -> u16 {
        let sign = u16::from(self.is_negative) << 15;
        if self.magnitude == 0 {
            return sign;
        }
        let leading = self.magnitude.ilog2() as i32 + self.exponent;
        let last = (leading - 10).max(-24);
        let shift = last - self.exponent;
        let steps = if shift <= 0 {
            self.magnitude << -shift
        } else if shift > 100 {
            0
        } else {
            let below = self.magnitude >> shift;
            let rest = self.magnitude & ((1 << shift) - 1);
            let half = 1 << (shift - 1);
            let up = rest > half || rest == half && (more || below & 1 != 0);
            below + u128::from(up)
        };
        let bits = ((last + 24) << 10) as u128 + steps;
        sign | bits.min(0x7c00) as u16
    }
}

const INFINITY: u16 = 0x7c00;

fn is_nan(bits: u16) -> bool {
    bits & 0x7fff > INFINITY
}

fn is_infinite(bits: u16) -> bool {
    bits & 0x7fff == INFINITY
}

fn is_zero(bits: u16) -> bool {
    bits & 0x7fff == 0
}

/// `a * b + c`; `None` is NaN.
fn fma(a: u16, b: u16, c: u16) -> Option<u16> {
    let is_invalid = is_infinite(a) && is_zero(b) || is_zero(a) && is_infinite(b);
    if [a, b, c].into_iter().any(is_nan) || is_invalid {
        return None;
    }
    let sign = (a ^ b) & 0x8000;
    match (is_infinite(a) || is_infinite(b), is_infinite(c)) {
        (true, true) if sign != c & 0x8000 => None,
        (true, _) => Some(sign | INFINITY),
        (false, true) => Some(c),
        _ => {
            let sum = Exact::of(a).times(Exact::of(b)).plus(Exact::of(c));
            Some(sum.rounded(false))
        }
    }
}

const ONE: u16 = 0x3c00;

fn sum(a: u16, b: u16) -> Option<u16> {
    fma(a, ONE, b)
}

fn difference(a: u16, b: u16) -> Option<u16> {
    fma(a, ONE, b ^ 0x8000)
}

/// A zero of the product's sign changes no product.
fn product(a: u16, b: u16) -> Option<u16> {
    fma(a, b, (a ^ b) & 0x8000)
}

fn quotient(a: u16, b: u16) -> Option<u16> {
    let is_invalid = is_zero(a) && is_zero(b) || is_infinite(a) && is_infinite(b);
    if is_nan(a) || is_nan(b) || is_invalid {
        return None;
    }
    let sign = (a ^ b) & 0x8000;
    if is_infinite(a) || is_zero(b) {
        return Some(sign | INFINITY);
    }
    if is_infinite(b) {
        return Some(sign);
    }
    let (a, b) = (Exact::of(a), Exact::of(b));
    let dividend = (a.magnitude as u64) << 40;
    let divisor = b.magnitude as u64;
    let quotient = Exact {
        is_negative: a.is_negative != b.is_negative,
        magnitude: (dividend / divisor).into(),
        exponent: a.exponent - b.exponent - 40,
    };
    Some(quotient.rounded(!dividend.is_multiple_of(divisor)))
}

fn root(a: u16) -> Option<u16> {
    if is_zero(a) || a == INFINITY {
        return Some(a);
    }
    if is_nan(a) || a & 0x8000 != 0 {
        return None;
    }
    let a = Exact::of(a);
    let even = a.exponent & !1;
    let square = a.magnitude << (a.exponent - even) << 80;
    let magnitude = square.isqrt();
    let root = Exact {
        is_negative: false,
        magnitude,
        exponent: (even - 80) / 2,
    };
    Some(root.rounded(magnitude * magnitude != square))
}

/// A program of some operations on the first of three inputs.
fn program(operations: &[(&str, usize)]) -> String {
    let mut text = String::from("module closest_hit\ninputs payload.0, payload.1, payload.2\n");
    text += &format!("output_rows {}\nfunc f0 {{\n", operations.len());
    for k in 0..3 {
        text += &format!(
            "v{k}: i32 = input[{k}]\nv1{k}: i16 = uconvert v{k}\nv2{k}: f16 = bitcast v1{k}\n"
        );
    }
    for (k, (op, count)) in operations.iter().enumerate() {
        let args = ["v20", "v21", "v22"][..*count].join(", ");
        text += &format!(
            "v3{k}: f16 = {op} {args}\nv4{k}: i16 = bitcast v3{k}\nv5{k}: i32 = uconvert v4{k}\n"
        );
    }
    let ends: Vec<String> = (0..operations.len()).map(|k| format!("v5{k}")).collect();
    text + &format!("end({})\n}}\n", ends.join(", "))
}

const SUBGROUPS: usize = 16;
const LANES: usize = 16 * SUBGROUPS;

type Triple = [u16; 3];

/// Benches for operations with their exact results, one a tier.
struct Halves<'a> {
    operations: &'a [(&'a str, usize, &'a dyn Fn(Triple) -> Option<u16>)],
    benches: Vec<Bench>,
}

impl<'a> Halves<'a> {
    fn new(operations: &'a [(&'a str, usize, &'a dyn Fn(Triple) -> Option<u16>)]) -> Self {
        let names: Vec<(&str, usize)> = operations.iter().map(|op| (op.0, op.1)).collect();
        let text = program(&names);
        let mut benches = Vec::new();
        on_tiers(|tier| benches.push(Bench::new(&text, tier, SUBGROUPS)));
        Halves {
            operations,
            benches,
        }
    }

    /// Computes all lanes of a wave on every tier.
    fn check(&mut self, triples: &[Triple; LANES]) {
        let exact: Vec<Vec<Option<u16>>> = (self.operations.iter())
            .map(|op| triples.iter().map(|&triple| op.2(triple)).collect())
            .collect();
        for (tier, bench) in self.benches.iter_mut().enumerate() {
            for state in &mut bench.states {
                bench.program.start(state, crate::LaneMask::ALL);
            }
            for row in 0..3 {
                bench.input(row, |lane| triples[lane][row].into());
            }
            bench.run_to_end();
            for (k, op) in self.operations.iter().enumerate() {
                for ((got, exact), triple) in bench.io(k).iter().zip(&exact[k]).zip(triples) {
                    let same = match exact {
                        Some(bits) => *got == u32::from(*bits),
                        None => *got < 0x10000 && is_nan(*got as u16),
                    };
                    let name = op.0;
                    assert!(
                        same,
                        "tier {tier}: {name} {triple:04x?}: {got:04x}, {exact:04x?}"
                    );
                }
            }
        }
    }
}

/// Sums, differences, products and quotients: of all pairs in a deep run, else of every first
/// operand with some second ones, others for each.
#[test]
fn arithmetic_of_16_bit_floats_is_exact() {
    let operations: [(&str, usize, &dyn Fn(Triple) -> Option<u16>); 4] = [
        ("fadd", 2, &|[a, b, _]| sum(a, b)),
        ("fsub", 2, &|[a, b, _]| difference(a, b)),
        ("fmul", 2, &|[a, b, _]| product(a, b)),
        ("fdiv", 2, &|[a, b, _]| quotient(a, b)),
    ];
    let mut halves = Halves::new(&operations);
    let is_deep = rounds(1) > 1;
    let count = if is_deep { 0x10000 } else { 8 };
    for a in 0..=u16::MAX {
        for start in (0..count).step_by(LANES) {
            let mut triples = [[0; 3]; LANES];
            for (lane, triple) in triples.iter_mut().enumerate() {
                *triple = if is_deep {
                    [a, (start + lane) as u16, 0]
                } else {
                    // Several first operands a wave, and second ones all over the range.
                    let a = a.wrapping_add((lane / count) as u16);
                    let b = (a as usize * 8 + lane % count).wrapping_mul(40_503);
                    [a, b as u16, 0]
                };
            }
            if is_deep || (a as usize).is_multiple_of(LANES / count) {
                halves.check(&triples);
            }
        }
    }
}

#[test]
fn roots_of_16_bit_floats_are_exact() {
    let operations: [(&str, usize, &dyn Fn(Triple) -> Option<u16>); 1] =
        [("fsqrt", 1, &|[a, ..]| root(a))];
    let mut halves = Halves::new(&operations);
    for start in (0..0x10000).step_by(LANES) {
        halves.check(&std::array::from_fn(|lane| [(start + lane) as u16, 0, 0]));
    }
}

/// Triples of all kinds: any bits; alike exponents; sums that nearly cancel; sums close to a number
/// halfway between two, above and below by less than an f32 shows.
fn triple(random: &mut fastrand::Rng) -> Triple {
    let [a, b, c] = [random.u16(..), random.u16(..), random.u16(..)];
    let moderate = |bits: u16| bits & 0x83ff | ((bits >> 10 & 7) + 11) << 10;
    // A power of two times 1 + `steps` / 1024.
    let power = |exponent: i32, steps: i32| {
        let number = 2f64.powi(exponent) * (1.0 + f64::from(steps) / 1024.0);
        f16::from_f64(number).to_bits()
    };
    match random.u8(..5) {
        0 => [a, b, c],
        1 => [moderate(a), moderate(b), moderate(c)],
        2 => {
            let (a, b) = (moderate(a), moderate(b));
            let near = product(a, b).unwrap_or(0) ^ 0x8000;
            [a, b, near.wrapping_add(random.u16(..4))]
        }
        _ => {
            let c = if random.bool() { c & 0x83ff } else { c };
            // Half of the last place of `c`, or that and some more of them.
            let last = i32::from((c >> 10 & 31).max(1)) - 25;
            let scale = random.i32(-12..12);
            let steps = random.i32(-6..7);
            let other = if random.bool() {
                -steps
            } else {
                random.i32(-6..7)
            };
            let whole = if random.bool() { 0 } else { random.i32(..3) };
            let a = power(last - 1 - scale, steps) | a & 0x8000;
            let b = power(scale + whole, other) | b & 0x8000;
            [a, b, c]
        }
    }
}

#[test]
fn products_and_sums_of_16_bit_floats_are_rounded_once() {
    let operations: [(&str, usize, &dyn Fn(Triple) -> Option<u16>); 1] =
        [("ffma", 3, &|[a, b, c]| fma(a, b, c))];
    let mut halves = Halves::new(&operations);
    let mut random = fastrand::Rng::with_seed(47);
    // 256 thousand triples; 10^9 in a deep run.
    let waves = if rounds(1) > 1 { 4_000_000 } else { 1_000 };
    for _ in 0..waves {
        halves.check(&std::array::from_fn(|_| triple(&mut random)));
    }
}

/// The reference gives known results.
#[test]
fn exact_numbers_are_rounded_to_nearest_even() {
    let bits = |number: f64| f16::from_f64(number).to_bits();
    assert_eq!(sum(bits(1.0), bits(2f64.powi(-11))), Some(bits(1.0)));
    assert_eq!(fma(0x3c01, 0x3bfe, bits(2048.0)), Some(bits(2048.0)));
    assert_eq!(fma(0x3c01, 0x3c00, bits(2048.0)), Some(bits(2050.0)));
    assert_eq!(sum(bits(65504.0), bits(15.99)), Some(bits(65504.0)));
    assert_eq!(sum(bits(65504.0), bits(16.0)), Some(INFINITY));
    assert_eq!(product(1, bits(0.5)), Some(0));
    assert_eq!(product(3, bits(0.5)), Some(2));
    assert_eq!(quotient(bits(1.0), bits(3.0)), Some(bits(1.0 / 3.0)));
    assert_eq!(root(bits(2.0)), Some(bits(2f64.sqrt())));
    assert_eq!(difference(ONE, ONE), Some(0));
    assert_eq!(sum(0x8000, 0x8000), Some(0x8000));
}
