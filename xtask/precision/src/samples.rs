//! Operands of functions of several: structured ones, and random ones of three kinds.

use spirv_jit::ir::Type;

use super::format::Format;

/// The operands of a sample, as bits. The same index gives the same ones.
pub fn operands(index: u64, format: Format) -> [u32; 3] {
    let random = [
        scramble(index),
        scramble(!index),
        scramble(index ^ 0x5555_5555_5555_5555),
    ];
    let mut operands = random.map(|word| word as u32);
    match index % 4 {
        // Corners: powers of two, and their neighbours.
        0 => {
            for (operand, word) in operands.iter_mut().zip(random) {
                *operand = corner(word, format);
            }
        }
        // Numbers near one another, where sums cancel.
        1 => {
            let near = operands[0] ^ (operands[1] & 0x8000_01ff);
            operands[1] = near;
        }
        // Moderate ones, whose results are numbers.
        2 => operands = operands.map(|word| moderate(word, format)),
        _ => {}
    }
    // The product's opposite, or nearly.
    if index % 4 >= 2 && index & 4 != 0 {
        let product = format.value(operands[0]) * format.value(operands[1]);
        operands[2] = match format.ty {
            Type::F16 => u32::from(half::f16::from_f64(-product).to_bits()),
            _ => (-product as f32).to_bits(),
        } ^ (random[2] as u32 & 1);
    }
    match format.ty {
        Type::F16 => operands.map(|word| word & 0xffff),
        _ => operands,
    }
}

fn corner(word: u64, format: Format) -> u32 {
    let (fraction, exponents, sign) = match format.ty {
        Type::F16 => (10, 32, 15),
        _ => (23, 256, 31),
    };
    let power = ((word >> 8) as u32 % exponents) << fraction;
    let offset = (word >> 32) as u32 % 7;
    power.wrapping_add(offset).wrapping_sub(3) & ((1 << sign) - 1) | ((word as u32 & 1) << sign)
}

fn moderate(word: u32, format: Format) -> u32 {
    match format.ty {
        Type::F16 => word & 0x83ff | 0x3400 | word >> 4 & 0x0c00,
        _ => word & 0x807f_ffff | 0x3c00_0000 | word >> 3 & 0x0380_0000,
    }
}

/// SplitMix64's finishing steps: a sample follows from its number alone, so that threads may share
/// them, and `docs/precision.md` holds what these samples gave.
fn scramble(index: u64) -> u64 {
    let mut word = index
        .wrapping_mul(0x9e37_79b9_7f4a_7c15)
        .wrapping_add(0x1234_5678_9abc_def1);
    word = (word ^ word >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    word = (word ^ word >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    word ^ word >> 31
}
