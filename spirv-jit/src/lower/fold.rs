//! `OpSpecConstantOp`: integer, boolean and composite operations on constants.

use std::rc::Rc;

use rspirv::spirv::Op;

use super::constants::{Constants, truncate};
use super::denormals::flushed;
use super::types::Types;
use crate::Error;
use crate::eval;
use crate::ir::Type;
use crate::parse::{Id, Instruction, opcode_name};

/// Evaluates an operation over constants to the bits of its scalars.
pub(super) fn fold_operation(
    types: &Types,
    constants: &Constants,
    instruction: &Instruction,
    operands: &[u32],
) -> Result<Vec<u64>, Error> {
    let at = instruction.offset;
    let opcode = Op::from_u32(operands[0]).unwrap_or(Op::Nop);
    let operands = &operands[1..];
    let argument = |index: usize| -> Result<(Id, Rc<[u64]>), Error> {
        let id = operands.get(index).copied();
        let constant = id.and_then(|id| constants.find(id));
        let (Some(id), Some(constant)) = (id, constant) else {
            return Err(Error::invalid(
                at,
                "an operand of a constant is not constant",
            ));
        };
        Ok((constant.ty, constants.bits(types, id)?))
    };
    match opcode {
        Op::CooperativeMatrixLengthKHR => {
            let ty = operands.first().copied().unwrap_or(0);
            Ok(vec![types.element_count(ty)?.into()])
        }
        Op::CompositeExtract => {
            let (ty, bits) = argument(0)?;
            let (first, element) = types.path(ty, &operands[1..])?;
            let count = types.leaves(element)?.len();
            Ok(bits[first..first + count].to_vec())
        }
        Op::CompositeInsert => {
            let (_, object) = argument(0)?;
            let (ty, bits) = argument(1)?;
            let (first, element) = types.path(ty, &operands[2..])?;
            let count = types.leaves(element)?.len();
            if object.len() != count {
                return Err(Error::invalid(at, "the inserted object has the wrong type"));
            }
            let mut out = bits.to_vec();
            out[first..first + count].copy_from_slice(&object);
            Ok(out)
        }
        Op::VectorShuffle => {
            let (_, a) = argument(0)?;
            let (_, b) = argument(1)?;
            let pick = |&index: &u32| match index as usize {
                index if index < a.len() => Ok(a[index]),
                index if index < a.len() + b.len() => Ok(b[index - a.len()]),
                _ if index == u32::MAX => Ok(0),
                _ => Err(Error::invalid(at, "shuffle index out of range")),
            };
            operands[2..].iter().map(pick).collect()
        }
        _ => {
            let result = types.component(instruction.result_type)?;
            let (ty, first) = argument(0)?;
            let from = types.component(ty)?;
            let mut rest = Vec::new();
            for index in 1..operands.len() {
                rest.push(argument(index)?.1);
            }
            let count = types.leaves(instruction.result_type)?.len();
            if opcode == Op::FConvert {
                let is_bfloat16 = [ty, instruction.result_type].map(|ty| types.is_bfloat16(ty));
                let fold = |&bits: &u64| fold_float((from, result), is_bfloat16, bits);
                let folded: Option<Vec<u64>> = first.iter().map(fold).collect();
                let mut folded =
                    folded.ok_or_else(|| Error::invalid(at, "OpFConvert cannot be folded"))?;
                if constants.flushes_denormals && result == Type::F32 {
                    for bits in &mut folded {
                        *bits = flushed(*bits as u32).into();
                    }
                }
                return Ok(folded);
            }
            let lane =
                |bits: &[u64], index: usize| bits.get(index).or(bits.first()).copied().unwrap_or(0);
            (0..count)
                .map(|index| {
                    let a = lane(&first, index);
                    let b = rest.first().map_or(0, |bits| lane(bits, index));
                    let c = rest.get(1).map_or(0, |bits| lane(bits, index));
                    fold_scalar(opcode, from, result, [a, b, c]).ok_or_else(|| {
                        let name = opcode_name(opcode);
                        Error::invalid(at, format!("Op{name} cannot be folded"))
                    })
                })
                .collect()
        }
    }
}

/// One scalar of an operation. Division by zero and shifts past the width follow the IR's prose.
fn fold_scalar(opcode: Op, from: Type, to: Type, [a, b, c]: [u64; 3]) -> Option<u64> {
    let signed = |bits: u64| {
        let unused = 64 - from.bits();
        (bits << unused) as i64 >> unused
    };
    let (sa, sb) = (signed(a), signed(b));
    let shift = (b % from.bits() as u64) as u32;
    let out = match opcode {
        Op::SConvert => sa as u64,
        Op::UConvert => a,
        Op::QuantizeToF16 => {
            let value = f32::from_bits(a as u32);
            let mut half = half::f16::from_f32(value).to_f32();
            if half.abs() < half::f16::MIN_POSITIVE.to_f32() {
                half = 0.0f32.copysign(half);
            }
            half.to_bits() as u64
        }
        Op::SNegate => a.wrapping_neg(),
        Op::Not => !a,
        Op::LogicalNot => (a == 0) as u64,
        Op::IAdd => a.wrapping_add(b),
        Op::ISub => a.wrapping_sub(b),
        Op::IMul => a.wrapping_mul(b),
        Op::UDiv => a.checked_div(b).unwrap_or(0),
        Op::UMod => a.checked_rem(b).unwrap_or(a),
        Op::SDiv if sb == 0 => 0,
        Op::SDiv => sa.wrapping_div(sb) as u64,
        Op::SRem | Op::SMod if sb == 0 => a,
        Op::SRem => sa.wrapping_rem(sb) as u64,
        Op::SMod => {
            let remainder = sa.wrapping_rem(sb);
            let wrong_sign = remainder != 0 && (remainder < 0) != (sb < 0);
            (if wrong_sign {
                remainder + sb
            } else {
                remainder
            }) as u64
        }
        Op::ShiftLeftLogical => a << shift,
        Op::ShiftRightLogical => a >> shift,
        Op::ShiftRightArithmetic => (sa >> shift) as u64,
        Op::BitwiseOr | Op::LogicalOr => a | b,
        Op::BitwiseAnd | Op::LogicalAnd => a & b,
        Op::BitwiseXor => a ^ b,
        Op::LogicalNotEqual | Op::INotEqual => (a != b) as u64,
        Op::LogicalEqual | Op::IEqual => (a == b) as u64,
        Op::ULessThan => (a < b) as u64,
        Op::ULessThanEqual => (a <= b) as u64,
        Op::UGreaterThan => (a > b) as u64,
        Op::UGreaterThanEqual => (a >= b) as u64,
        Op::SLessThan => (sa < sb) as u64,
        Op::SLessThanEqual => (sa <= sb) as u64,
        Op::SGreaterThan => (sa > sb) as u64,
        Op::SGreaterThanEqual => (sa >= sb) as u64,
        Op::Select => {
            if a != 0 {
                b
            } else {
                c
            }
        }
        _ => return None,
    };
    Some(truncate(out, to))
}

/// A conversion of floats; `is_bfloat16`: the first or the second type is of that encoding.
fn fold_float((from, to): (Type, Type), is_bfloat16: [bool; 2], bits: u64) -> Option<u64> {
    let value = match from {
        _ if is_bfloat16[0] => f32::from_bits((bits as u32) << 16) as f64,
        Type::F16 => half::f16::from_bits(bits as u16).to_f64(),
        Type::F32 => f32::from_bits(bits as u32) as f64,
        Type::F64 => f64::from_bits(bits),
        _ => return None,
    };
    match to {
        _ if is_bfloat16[1] => {
            let odd = eval::narrow::odd_f32_from_f64(value);
            Some(eval::narrow::bfloat16_from_f32(odd).into())
        }
        Type::F16 => Some(eval::narrow::f16_from_f64(value).to_bits() as u64),
        Type::F32 => Some((value as f32).to_bits() as u64),
        Type::F64 => Some(value.to_bits()),
        _ => None,
    }
}
