//! Floats of the encoding `BFloat16KHR` (`SPV_KHR_bfloat16`).

use half::{bf16, f16};
use rspirv::spirv::{Capability, Decoration, FPRoundingMode, Op};
use shaders::compute::{Memory, compile, dispatch};

use crate::assembler::Assembler;

/// Numbers on the steps of bfloat16, and in and beside the middle between two.
fn numbers() -> Vec<f64> {
    let mut numbers = vec![
        0.0, 1.0, 0.1, 3.0e38, 3.4e38, 1e300, 1e-38, 1e-40, 1e-45, 9.0e-41,
    ];
    for bits in [0x0001u32, 0x007f, 0x0080, 0x3f80, 0x3f81, 0x42ff, 0x7f7f] {
        let at = |bits: u32| f64::from(f32::from_bits(bits));
        let (step, next) = (at(bits << 16), at((bits + 1) << 16));
        let middle = match next.is_finite() {
            true => (step + next) / 2.0,
            false => step + (step - at((bits - 1) << 16)) / 2.0,
        };
        // Beside the middle by less than an f32 tells.
        let near = [middle * (1.0 - 1e-12), middle, middle * (1.0 + 1e-12)];
        numbers.extend([step].into_iter().chain(near));
    }
    let negative: Vec<f64> = numbers.iter().map(|number| -number).collect();
    numbers.extend(negative);
    numbers.extend([f64::INFINITY, f64::NEG_INFINITY, f64::NAN]);
    numbers
}

struct BFloats {
    a: Assembler,
    bfloat: u32,
    float: u32,
    double: u32,
    half: u32,
    short: u32,
}

impl BFloats {
    fn new() -> Self {
        let mut a = Assembler::new();
        for capability in [
            Capability::BFloat16TypeKHR,
            Capability::BFloat16DotProductKHR,
            Capability::Float16,
            Capability::Float64,
            Capability::Int16,
        ] {
            a.capability(capability);
        }
        let bfloat = a.global(Op::TypeFloat, &[16, 0]);
        let [half, float, double] = [16, 32, 64].map(|bits| a.global(Op::TypeFloat, &[bits]));
        let short = a.global(Op::TypeInt, &[16, 0]);
        Self {
            a,
            bfloat,
            float,
            double,
            half,
            short,
        }
    }

    /// A word of the input.
    fn input_word(&mut self, index: usize) -> u32 {
        let class = rspirv::spirv::StorageClass::StorageBuffer;
        let pointer = self.a.pointer(class, self.a.word);
        let chain = [self.a.input, self.a.numbers[0], self.a.numbers[index]];
        let at = self.a.make(pointer, Op::AccessChain, &chain);
        self.a.make(self.a.word, Op::Load, &[at])
    }

    fn convert(&mut self, op: Op, ty: u32, value: u32) -> u32 {
        self.a.make(ty, op, &[value])
    }

    /// Ends the module: its result is the bits of a bfloat16.
    fn finish(mut self, value: u32) -> Vec<u32> {
        let bits = self.convert(Op::Bitcast, self.short, value);
        let word = self.convert(Op::UConvert, self.a.word, bits);
        self.a.finish(word)
    }
}

/// The result of a module for its input.
fn run(
    words: &[u32],
    inputs: impl IntoIterator<Item = Vec<u32>>,
    mut check: impl FnMut(u32, &[u32]),
) {
    let program = compile(words);
    for input in inputs {
        let mut memory = Memory {
            buffers: vec![(0, input.clone()), (16, vec![0])],
            ..Memory::default()
        };
        dispatch(&program, 1, &mut memory);
        check(memory.buffers[1].1[0], &input);
    }
}

/// The nearest number, ties to even: of those beside the one that two roundings give.
fn nearest(number: f64) -> bf16 {
    let near = bf16::from_f32(number as f32);
    if number.is_nan() || number.is_infinite() || number == 0.0 {
        return near;
    }
    let magnitude = near.to_bits() & 0x7fff;
    let numbers = (magnitude.saturating_sub(1)..=magnitude + 1).filter(|&bits| bits <= 0x7f80);
    let distance = |bits: u16| match bits {
        // Where the next finite number would be.
        0x7f80 => 2f64.powi(128) - number.abs(),
        _ => bf16::from_bits(bits).to_f64() - number.abs(),
    };
    let least = numbers.min_by(|&a, &b| {
        let by_distance = distance(a).abs().total_cmp(&distance(b).abs());
        by_distance.then((a & 1).cmp(&(b & 1)))
    });
    bf16::from_bits(least.unwrap() | near.to_bits() & 0x8000)
}

fn assert_same(found: u32, expected: bf16, given: f64) {
    let found = bf16::from_bits(u16::try_from(found).unwrap());
    let are_nan = found.is_nan() && expected.is_nan();
    assert!(
        are_nan || found.to_bits() == expected.to_bits(),
        "{given:e}: {found:?}, not {expected:?}"
    );
}

#[test]
fn floats_become_the_nearest_one() {
    let mut b = BFloats::new();
    let word = b.input_word(0);
    let number = b.convert(Op::Bitcast, b.float, word);
    let result = b.convert(Op::FConvert, b.bfloat, number);
    let singles = numbers()
        .into_iter()
        .map(|number| vec![(number as f32).to_bits()]);
    run(&b.finish(result), singles, |found, given| {
        let given = f32::from_bits(given[0]);
        assert_same(found, nearest(given.into()), given.into());
    });

    let mut b = BFloats::new();
    let pair = b.a.global(Op::TypeVector, &[b.a.word, 2]);
    let words = [b.input_word(0), b.input_word(1)];
    let words = b.a.make(pair, Op::CompositeConstruct, &words);
    let number = b.convert(Op::Bitcast, b.double, words);
    let result = b.convert(Op::FConvert, b.bfloat, number);
    let doubles = numbers().into_iter().map(|number| {
        let bits = number.to_bits();
        vec![bits as u32, (bits >> 32) as u32]
    });
    run(&b.finish(result), doubles, |found, given| {
        let given = f64::from_bits(u64::from(given[0]) | u64::from(given[1]) << 32);
        assert_same(found, nearest(given), given);
    });

    let mut b = BFloats::new();
    let word = b.input_word(0);
    let bits = b.convert(Op::UConvert, b.short, word);
    let number = b.convert(Op::Bitcast, b.half, bits);
    let result = b.convert(Op::FConvert, b.bfloat, number);
    let halves = (0..=0xffff).step_by(97).map(|bits| vec![bits]);
    run(&b.finish(result), halves, |found, given| {
        let given = f16::from_bits(given[0] as u16).to_f32();
        assert_same(found, nearest(given.into()), given.into());
    });
}

#[test]
fn floats_are_cut_where_the_decoration_says_so() {
    let mut b = BFloats::new();
    let word = b.input_word(0);
    let number = b.convert(Op::Bitcast, b.float, word);
    let result = b.convert(Op::FConvert, b.bfloat, number);
    let mode = FPRoundingMode::RTZ as u32;
    b.a.decorate(result, Decoration::FPRoundingMode, &[mode]);
    let cases = [
        (0x3f80_ffff, 0x3f80),
        (0xbf81_8001, 0xbf81),
        (0x7f7f_ffff, 0x7f7f),
    ];
    let given = cases.map(|(given, _)| vec![given]);
    run(&b.finish(result), given, |found, given| {
        let case = cases.iter().find(|case| case.0 == given[0]);
        assert_eq!(Some(found), case.map(|case| case.1));
    });
}

#[test]
fn integers_are_rounded_once() {
    let numbers = [
        0,
        1,
        -1,
        255,
        257,
        385,
        0x0101_0000,
        0x0101_0001,
        0x0180_8001,
        i32::MAX,
        i32::MIN,
    ];
    for op in [Op::ConvertSToF, Op::ConvertUToF] {
        let mut b = BFloats::new();
        let word = b.input_word(0);
        let result = b.convert(op, b.bfloat, word);
        let given = numbers.map(|number| vec![number as u32]);
        run(&b.finish(result), given, |found, given| {
            let number = match op {
                Op::ConvertSToF => f64::from(given[0] as i32),
                _ => f64::from(given[0]),
            };
            assert_same(found, nearest(number), number);
        });
    }
}

#[test]
fn numbers_come_back_as_floats_and_integers() {
    let all = || (0..=0xffff).step_by(89).map(|bits| vec![bits]);
    let number = |bits: u32| bf16::from_bits(bits as u16);

    let mut b = BFloats::new();
    let word = b.input_word(0);
    let bits = b.convert(Op::UConvert, b.short, word);
    let value = b.convert(Op::Bitcast, b.bfloat, bits);
    let float = b.convert(Op::FConvert, b.float, value);
    let result = b.convert(Op::Bitcast, b.a.word, float);
    run(&b.a.finish(result), all(), |found, given| {
        let (found, expected) = (f32::from_bits(found), number(given[0]).to_f32());
        assert!(found.to_bits() == expected.to_bits() || found.is_nan() && expected.is_nan());
    });

    let mut b = BFloats::new();
    let word = b.input_word(0);
    let bits = b.convert(Op::UConvert, b.short, word);
    let value = b.convert(Op::Bitcast, b.bfloat, bits);
    let result = b.convert(Op::ConvertFToS, b.a.word, value);
    run(&b.a.finish(result), all(), |found, given| {
        assert_eq!(found as i32, number(given[0]).to_f32() as i32);
    });
}

/// Constants, copies through variables, selections and parts of vectors keep the bits, and the sum
/// of products is rounded once, from f32.
#[test]
fn vectors_hold_them_and_have_products() {
    let mut b = BFloats::new();
    let triple = b.a.global(Op::TypeVector, &[b.bfloat, 3]);
    // 1, 2⁻⁷ and 2⁻⁸, next to 1.
    let parts = [0x3f80, 0x3c00, 0x3b80].map(|bits| b.a.value(b.bfloat, Op::Constant, &[bits]));
    let one = parts[0];
    let left = b.a.value(triple, Op::ConstantComposite, &parts);
    let right = b.a.value(triple, Op::ConstantComposite, &[one; 3]);
    let null = b.a.value(triple, Op::ConstantNull, &[]);
    let word = b.input_word(0);
    let is_zero = b.a.make(b.a.bool, Op::IEqual, &[word, b.a.numbers[0]]);
    let flags = b.a.global(Op::TypeVector, &[b.a.bool, 3]);
    let conditions = b.a.make(flags, Op::CompositeConstruct, &[is_zero; 3]);
    let chosen = b.a.make(triple, Op::Select, &[conditions, left, null]);
    let dot = b.a.make(b.bfloat, Op::Dot, &[chosen, right]);
    let sum = 1.0 + 2f32.powi(-7) + 2f32.powi(-8);
    let expected = [bf16::from_f32(sum), bf16::from_f32(0.0)];
    run(&b.finish(dot), [vec![0], vec![1]], |found, given| {
        assert_same(found, expected[given[0] as usize], sum.into());
    });
}

/// A specialization constant that is converted.
#[test]
fn constants_are_converted() {
    let mut b = BFloats::new();
    // 1 + 2⁻⁸ + 2⁻²⁰: above the middle of two numbers.
    let number = b.a.value(b.float, Op::SpecConstant, &[0x3f80_8008]);
    let convert = [Op::FConvert as u32, number];
    let result = b.a.value(b.bfloat, Op::SpecConstantOp, &convert);
    run(&b.finish(result), [vec![0]], |found, _| {
        assert_eq!(found, 0x3f81)
    });
}
