//! Products of matrices, in every tier, against their definition in `eval` and against sums in
//! exact arithmetic.

use std::fmt::Write;

use super::numbers::Random;
use super::{Bench, on_tiers};
use crate::eval::f16;
use crate::eval::matrix::{self, MatrixRows};
use crate::eval::narrow::bfloat16_from_f32;
use crate::ir::Type;
use crate::ir::op::{Component, MatrixProduct};

const SIZE: usize = MatrixProduct::SIZE;

/// All products that there are.
fn products() -> impl Iterator<Item = MatrixProduct> {
    let all = Component::ALL;
    let factors = all.into_iter().flat_map(move |a| all.map(|b| (a, b)));
    let sums = factors.flat_map(move |(a, b)| all.map(|sum| (a, b, sum)));
    let products = sums.flat_map(|(a, b, sum)| {
        [false, true].map(|saturates| MatrixProduct {
            a,
            b,
            sum,
            saturates,
        })
    });
    products.filter(MatrixProduct::is_valid)
}

/// A program that multiplies the matrices in inputs 0, 16 and 32 on.
fn program(product: &MatrixProduct) -> String {
    let inputs: Vec<String> = (0..3 * SIZE).map(|row| format!("payload.{row}")).collect();
    let mut text = format!(
        "module closest_hit
        inputs {}
        output_rows {SIZE}
        func f0 {{\n",
        inputs.join(", ")
    );
    let components = [product.a, product.b, product.sum];
    let types = components.map(Component::ty);
    let mut next = 0;
    let mut value = |text: &mut String, ty: Type, op: String| {
        writeln!(text, "v{next}: {ty} = {op}").unwrap();
        next += 1;
        next - 1
    };
    let mut args = Vec::new();
    for row in 0..3 * SIZE {
        let ty = types[row / SIZE];
        let word = value(&mut text, Type::I32, format!("input[{row}]"));
        let integer = match ty.bits() {
            32 => word,
            _ => value(&mut text, ty.as_integer(), format!("uconvert v{word}")),
        };
        args.push(match ty.is_float() {
            true => value(&mut text, ty, format!("bitcast v{integer}")),
            false => integer,
        });
    }
    let list = |values: &[usize]| -> String {
        let names: Vec<String> = values.iter().map(|value| format!("v{value}")).collect();
        names.join(", ")
    };
    let first = 4 * 3 * SIZE;
    let results: Vec<String> = (0..SIZE)
        .map(|row| format!("v{}: {}", first + row, types[2]))
        .collect();
    let op = crate::ir::text::print_op(&crate::ir::Op::MatrixProduct(*product));
    writeln!(text, "{} = {op} {}", results.join(", "), list(&args)).unwrap();
    let mut next = first + SIZE;
    let mut ends = Vec::new();
    for row in 0..SIZE {
        let mut last = first + row;
        if types[2].is_float() {
            writeln!(text, "v{next}: {} = bitcast v{last}", types[2].as_integer()).unwrap();
            (last, next) = (next, next + 1);
        }
        if types[2].bits() < 32 {
            writeln!(text, "v{next}: i32 = uconvert v{last}").unwrap();
            (last, next) = (next, next + 1);
        }
        ends.push(last);
    }
    writeln!(text, "end({})\n}}", list(&ends)).unwrap();
    text
}

/// The results of a product of matrices, the same on every tier.
fn run(product: &MatrixProduct, matrices: [&MatrixRows; 3]) -> MatrixRows {
    let text = program(product);
    let mut results: Option<MatrixRows> = None;
    on_tiers(|tier| {
        let mut bench = Bench::new(&text, tier, 2);
        for row in 0..3 * SIZE {
            bench.input(row, |lane| matrices[row / SIZE][row % SIZE][lane % SIZE]);
        }
        bench.run_to_end();
        let rows: Vec<Vec<u32>> = (0..SIZE).map(|row| bench.io(row)).collect();
        for lanes in [0..SIZE, SIZE..2 * SIZE] {
            let found: MatrixRows = std::array::from_fn(|row| {
                std::array::from_fn(|lane| match rows[row][lanes.start + lane] {
                    // The payload of a NaN is unspecified.
                    bits if is_nan(product.sum, bits) => u32::MAX,
                    bits => bits,
                })
            });
            assert_eq!(
                found,
                *results.get_or_insert(found),
                "{product:?} in {tier:?}"
            );
        }
    });
    results.unwrap()
}

impl Random {
    fn matrix(&mut self, mut component: impl FnMut(u64) -> u32) -> MatrixRows {
        std::array::from_fn(|_| std::array::from_fn(|_| component(self.next())))
    }
}

/// The bits of a component, for a number that it holds.
fn encode(component: Component, number: i64) -> u32 {
    let float = number as f32;
    match component {
        Component::F16 => f16::from_f32(float).to_bits().into(),
        Component::BFloat16 => float.to_bits() >> 16,
        Component::F32 => float.to_bits(),
        Component::S8 | Component::U8 => u32::from(number as u8),
        Component::S32 | Component::U32 => number as u32,
        Component::E4M3 | Component::E5M2 => unreachable!("no matrix of a subgroup has such"),
    }
}

#[test]
fn every_product_of_small_numbers_is_exact() {
    let mut random = Random(7);
    for product in products() {
        let number = |component: Component, bits: u64| match component {
            Component::U8 | Component::U32 => (bits % 5) as i64,
            _ => (bits % 5) as i64 - 2,
        };
        let kinds = [product.a, product.b, product.sum];
        let [a, b, c] = kinds.map(|kind| random.matrix(|bits| number(kind, bits) as u32));
        let of = |rows: &MatrixRows, kind: Component| {
            rows.map(|row| row.map(|n| encode(kind, (n as i32).into())))
        };
        let encoded = [of(&a, kinds[0]), of(&b, kinds[1]), of(&c, kinds[2])];
        let found = run(&product, encoded.each_ref());
        for row in 0..SIZE {
            for column in 0..SIZE {
                let products = (0..SIZE).map(|k| i64::from(a[row][k] as i32 * b[k][column] as i32));
                let sum = i64::from(c[row][column] as i32) + products.sum::<i64>();
                let expected = match product.sum {
                    Component::U32 if product.saturates => sum.max(0),
                    _ => sum,
                };
                let expected = encode(product.sum, expected);
                assert_eq!(
                    found[row][column], expected,
                    "{product:?} at {row}, {column}"
                );
            }
        }
    }
}

#[test]
fn random_bits_give_the_bits_of_the_definition() {
    let mut random = Random(11);
    for product in products() {
        for round in 0..4 {
            // Bits of any kind, or moderate numbers, whose sums round.
            let mut matrix = |component: Component| {
                random.matrix(|bits| match (component, round % 2) {
                    (Component::S32 | Component::U32, _) => bits as u32,
                    (Component::S8 | Component::U8, _) => bits as u32 & 0xff,
                    (Component::F32, 0) => bits as u32,
                    (_, 0) => bits as u32 & 0xffff,
                    _ => {
                        let number = (bits as i32) as f32 / (1 << 28) as f32;
                        matrix::narrow(component, number)
                    }
                })
            };
            let [a, b, c] = [matrix(product.a), matrix(product.b), matrix(product.sum)];
            let found = run(&product, [&a, &b, &c]);
            let expected = matrix::product(&product, [&a, &b, &c]);
            for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
                let are_nan = *found == u32::MAX && is_nan(product.sum, *expected);
                assert!(
                    are_nan || found == expected,
                    "{product:?}: {found:x}, not {expected:x}"
                );
            }
        }
    }
}

fn is_nan(component: Component, bits: u32) -> bool {
    match component {
        Component::F16 => f16::from_bits(bits as u16).is_nan(),
        Component::BFloat16 => f32::from_bits(bits << 16).is_nan(),
        Component::F32 => f32::from_bits(bits).is_nan(),
        _ => false,
    }
}

#[test]
fn integers_saturate_once_at_the_end() {
    let product = |sum, a, b| MatrixProduct {
        a,
        b,
        sum,
        saturates: true,
    };
    // The products go up, then down: steps that saturated would not come back.
    let mut a = [[0; SIZE]; SIZE];
    for (k, word) in a[0].iter_mut().enumerate() {
        *word = if k < 8 { 127 } else { 0x81 };
    }
    let b = [[127; SIZE]; SIZE];
    let c = [[i32::MAX as u32 - 5; SIZE]; SIZE];
    let signed = product(Component::S32, Component::S8, Component::S8);
    assert_eq!(run(&signed, [&a, &b, &c])[0], c[0]);
    a[0] = [1; SIZE];
    assert_eq!(run(&signed, [&a, &b, &c])[0], [i32::MAX as u32; SIZE]);
    a[0] = [0xff; SIZE];
    let least = [[i32::MIN as u32 + 3; SIZE]; SIZE];
    assert_eq!(run(&signed, [&a, &b, &least])[0], [i32::MIN as u32; SIZE]);
    let unsigned = product(Component::U32, Component::U8, Component::U8);
    let most = [[u32::MAX - 5; SIZE]; SIZE];
    assert_eq!(run(&unsigned, [&a, &b, &most])[0], [u32::MAX; SIZE]);
    let wrapping = MatrixProduct {
        saturates: false,
        ..unsigned
    };
    let sum = (255 * 127 * 16u32).wrapping_add(u32::MAX - 5);
    assert_eq!(run(&wrapping, [&a, &b, &most])[0], [sum; SIZE]);
}

#[test]
fn bfloat16_is_rounded_to_the_nearest() {
    // Each number, and what lies between it and the next one: exactly half, and on either side.
    for bits in 0..0x7f80u32 {
        let next = bits + 1;
        let even = bits + (bits & 1);
        for (low, expected) in [
            (0, bits),
            (1, bits),
            (0x7fff, bits),
            (0x8000, even),
            (0x8001, next),
        ] {
            for sign in [0, 0x8000] {
                let value = f32::from_bits((bits | sign) << 16 | low);
                assert_eq!(u32::from(bfloat16_from_f32(value)), expected | sign);
            }
        }
    }
    assert_eq!(bfloat16_from_f32(f32::INFINITY), 0x7f80);
    for nan in [0x7f80_0001, 0x7fff_ffff, 0xff80_0001] {
        let bits = u32::from(bfloat16_from_f32(f32::from_bits(nan)));
        assert!(f32::from_bits(bits << 16).is_nan());
    }
}
