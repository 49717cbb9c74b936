//! Modules that ask for 32-bit denormals to be flushed to zero, and those that ask for them to be
//! preserved. Vulkan, "Precision and Operation of SPIR-V Instructions": with `DenormFlushToZero`
//! the results of arithmetic must not be denormal, operands may be flushed, and moves of bits must
//! not flush.

use rspirv::spirv::{Capability, ExecutionMode, GlslStd450Op as GLOp, Op, StorageClass};

use crate::assembler::Assembler;
use crate::expect;

const SIGN: u32 = 1 << 31;
/// The least normal number.
const NORMAL: u32 = 0x0080_0000;

/// A module that applies `make` to a 32-bit float of the given bits, with an execution mode. The
/// arguments of `make`: the module, the type, the float, and the instruction set of GLSL.
fn module(
    mode: Option<ExecutionMode>,
    make: impl Fn(&mut Assembler, u32, u32, u32) -> u32,
) -> Vec<u32> {
    let mut a = Assembler::new();
    a.capability(Capability::Float64);
    let glsl = a.import("GLSL.std.450");
    if let Some(mode) = mode {
        a.capability(Capability::DenormFlushToZero);
        a.capability(Capability::DenormPreserve);
        a.modes.push((mode, &[32]));
    }
    let float = a.global(Op::TypeFloat, &[32]);
    a.read();
    let number = a.make(float, Op::Bitcast, &[a.given]);
    let made = make(&mut a, float, number, glsl);
    let result = a.make(a.word, Op::Bitcast, &[made]);
    a.finish(result)
}

fn flushing(make: impl Fn(&mut Assembler, u32, u32, u32) -> u32) -> Vec<u32> {
    module(Some(ExecutionMode::DenormFlushToZero), make)
}

#[test]
fn sums_are_flushed_only_where_a_module_asks_for_it() {
    let twice = |a: &mut Assembler, float, x, _| a.make(float, Op::FAdd, &[x, x]);
    // The double of a denormal has the double of its bits.
    let kept = [
        (1, 2),
        (SIGN | 1, SIGN | 2),
        (0x0040_0000, NORMAL),
        (0x3f80_0000, 0x4000_0000),
    ];
    expect(&module(None, twice), &kept);
    expect(&module(Some(ExecutionMode::DenormPreserve), twice), &kept);
    // The sign stays. No case where flushed operands give another result.
    let flushed = [
        (1, 0),
        (SIGN | 1, SIGN),
        (0x003f_ffff, 0),
        (NORMAL, 0x0100_0000),
        (0x3f80_0000, 0x4000_0000),
        (0x7f80_0000, 0x7f80_0000),
    ];
    expect(&flushing(twice), &flushed);
}

#[test]
fn differences_products_and_functions_are_flushed() {
    // Normal operands with denormal results.
    let less = |a: &mut Assembler, float, x, _: u32| {
        let least = a.value(float, Op::Constant, &[NORMAL]);
        a.make(float, Op::FSub, &[x, least])
    };
    expect(&flushing(less), &[(NORMAL | 1, 0), (0x0100_0000, NORMAL)]);
    expect(&module(None, less), &[(NORMAL | 1, 1)]);
    let half = |a: &mut Assembler, float, x, _: u32| {
        let half = a.value(float, Op::Constant, &[0.5f32.to_bits()]);
        a.make(float, Op::FMul, &[x, half])
    };
    expect(&flushing(half), &[(NORMAL, 0), (SIGN | NORMAL, SIGN)]);
    expect(&module(None, half), &[(NORMAL, 0x0040_0000)]);
    let denormals = [
        (1, 0),
        (0x007f_ffff, 0),
        (NORMAL, NORMAL),
        (0x3f00_0000, 0x3f00_0000),
    ];
    for op in [GLOp::FAbs, GLOp::Fract, GLOp::Length] {
        let one =
            |a: &mut Assembler, float, x, glsl| a.make(float, Op::ExtInst, &[glsl, op as u32, x]);
        expect(&flushing(one), &denormals);
        expect(&module(None, one), &[(1, 1)]);
    }
    // The lesser of a denormal and one; to the power of one.
    for op in [GLOp::FMin, GLOp::NMin, GLOp::Pow] {
        let two = |a: &mut Assembler, float, x, glsl| {
            let one = a.value(float, Op::Constant, &[1f32.to_bits()]);
            a.make(float, Op::ExtInst, &[glsl, op as u32, x, one])
        };
        expect(&flushing(two), &denormals);
        expect(&module(None, two), &[(1, 1)]);
    }
}

#[test]
fn negated_denormals_are_flushed() {
    let negated = |a: &mut Assembler, float, x, _: u32| a.make(float, Op::FNegate, &[x]);
    expect(
        &flushing(negated),
        &[(1, SIGN), (SIGN | 1, 0), (NORMAL, SIGN | NORMAL)],
    );
    expect(&module(None, negated), &[(1, SIGN | 1)]);
}

#[test]
fn moves_of_bits_do_not_flush() {
    let cases = [
        (1, 1),
        (SIGN | 0x0012_3456, SIGN | 0x0012_3456),
        (0x7fff_ffff, 0x7fff_ffff),
    ];
    expect(&flushing(|_, _, x, _| x), &cases);
    expect(
        &flushing(|a, float, x, _| a.make(float, Op::CopyObject, &[x])),
        &cases,
    );
    let selected = |a: &mut Assembler, float, x, _: u32| {
        let zero = a.value(float, Op::Constant, &[0]);
        let is_zero = a.make(a.bool, Op::IEqual, &[a.given, a.numbers[0]]);
        a.make(float, Op::Select, &[is_zero, zero, x])
    };
    expect(&flushing(selected), &cases);
    // Also a constant.
    let constant =
        |a: &mut Assembler, float, _: u32, _: u32| a.value(float, Op::Constant, &[0x0000_1234]);
    expect(&flushing(constant), &[(0, 0x1234)]);
}

#[test]
fn conversions_to_32_bits_are_flushed_also_in_constants() {
    // 2^-140, and 2^-126, the least normal number.
    let cases = [(1023 - 140, 1 << 9, 0), (1023 - 126, NORMAL, NORMAL)];
    for (exponent, kept, flushed) in cases {
        let high = exponent << 20;
        let converted = |a: &mut Assembler, float, _: u32, _: u32| {
            let double = a.global(Op::TypeFloat, &[64]);
            let wide = a.value(double, Op::Constant, &[0, high]);
            a.make(float, Op::FConvert, &[wide])
        };
        expect(&flushing(converted), &[(0, flushed)]);
        expect(&module(None, converted), &[(0, kept)]);
        let constant = |a: &mut Assembler, float, _: u32, _: u32| {
            let double = a.global(Op::TypeFloat, &[64]);
            let wide = a.value(double, Op::SpecConstant, &[0, high]);
            a.value(float, Op::SpecConstantOp, &[Op::FConvert as u32, wide])
        };
        expect(&flushing(constant), &[(0, flushed)]);
        expect(&module(None, constant), &[(0, kept)]);
    }
}

#[test]
fn other_widths_are_preserved() {
    // The half of the least normal number of 64 bits, by its high word.
    let wide = |a: &mut Assembler, float, _: u32, _: u32| {
        let double = a.global(Op::TypeFloat, &[64]);
        let half = a.value(double, Op::Constant, &[0, 0x3fe0_0000]);
        let pair = a.global(Op::TypeVector, &[a.word, 2]);
        let both = a.make(pair, Op::CompositeConstruct, &[a.numbers[0], a.given]);
        let x = a.make(double, Op::Bitcast, &[both]);
        let product = a.make(double, Op::FMul, &[x, half]);
        let both = a.make(pair, Op::Bitcast, &[product]);
        let high = a.make(a.word, Op::CompositeExtract, &[both, 1]);
        a.make(float, Op::Bitcast, &[high])
    };
    expect(&flushing(wide), &[(0x0010_0000, 0x0008_0000)]);
}

#[test]
fn atomic_sums_are_flushed_in_memory() {
    let left = |mode: Option<ExecutionMode>| {
        module(mode, |a, float, x, _| {
            a.capability(Capability::AtomicFloat32AddEXT);
            let class = StorageClass::Workgroup;
            let pointer = a.pointer(class, float);
            let sum = a.value(pointer, Op::Variable, &[class as u32]);
            a.interface.push(sum);
            let least = a.value(float, Op::Constant, &[SIGN | NORMAL]);
            a.act(Op::Store, &[sum, x]);
            let order = [sum, a.numbers[1], a.numbers[0], least];
            a.make(float, Op::AtomicFAddEXT, &order);
            a.make(float, Op::Load, &[sum])
        })
    };
    expect(&left(None), &[(NORMAL | 1, 1), (0x00c0_0000, 0x0040_0000)]);
    let flushed = left(Some(ExecutionMode::DenormFlushToZero));
    expect(
        &flushed,
        &[(NORMAL | 1, 0), (0x00c0_0000, 0), (0x0100_0000, NORMAL)],
    );
}
