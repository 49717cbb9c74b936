//! Conversions.

use rspirv::spirv::{self, Decoration, Op};

use super::Lowerer;
use super::values::Values;
use crate::Error;
use crate::ir::{self, Type, Value};
use crate::parse::Instruction;

impl Lowerer<'_> {
    pub(super) fn lower_conversion(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        let parts = self.leaves(operands[0])?;
        let op = match instruction.opcode {
            Op::ConvertFToU => ir::Op::FToU,
            Op::ConvertFToS => ir::Op::FToS,
            Op::ConvertSToF => ir::Op::SToF,
            Op::ConvertUToF => ir::Op::UToF,
            Op::UConvert => ir::Op::UConvert,
            Op::SConvert => ir::Op::SConvert,
            Op::FConvert => ir::Op::FConvert,
            Op::QuantizeToF16 => ir::Op::FQuantizeF16,
            Op::Bitcast => {
                let types = self.types.leaves(instruction.result_type)?;
                let values = self.bitcast(&parts, &types)?;
                return self.define_typed(instruction, values);
            }
            Op::ConvertUToPtr => {
                let address = self.b.i64_of(self.scalar_of(&parts)?, false)?;
                let value = Self::scalars([address]);
                return self.define(instruction.result, value);
            }
            Op::ConvertPtrToU => {
                let ty = self.types.scalar(instruction.result_type)?;
                let address = self.scalar_of(&parts)?;
                let value = self.resize(address, ty)?;
                return self.define_typed(instruction, vec![value]);
            }
            _ => {
                let address = match parts[..] {
                    [low, high] => self.b.pack64(low, high, Type::I64)?,
                    _ => self.scalar_of(&parts)?,
                };
                return self.define_typed(instruction, vec![address]);
            }
        };
        let ty = self.types.component(instruction.result_type)?;
        let rounding = self
            .module
            .annotations
            .id(instruction.result, Decoration::FPRoundingMode);
        let toward_zero = instruction.opcode == Op::FConvert
            && rounding == Some(spirv::FPRoundingMode::RTZ as u32);
        if self.lower_bfloat16_conversion(instruction, op, toward_zero)? {
            return Ok(());
        }
        let mut values = Values::with_capacity(parts.len());
        for &part in parts.iter() {
            let same = self.b.ty(part) == ty && !matches!(op, ir::Op::FQuantizeF16);
            values.push(if same {
                part
            } else if toward_zero && ty.bits() < self.b.ty(part).bits() {
                self.convert_toward_zero(part, ty)?
            } else {
                self.b.emit(op, &[part], ty)?
            });
        }
        self.define_typed(instruction, values)
    }

    /// A narrower float that is no larger in magnitude: the nearest one, or the one before it.
    /// Magnitudes are ordered like their bits.
    pub(super) fn convert_toward_zero(&mut self, x: Value, ty: Type) -> Result<Value, Error> {
        let nearest = self.b.emit(ir::Op::FConvert, &[x], ty)?;
        let back = self.b.emit(ir::Op::FConvert, &[nearest], self.b.ty(x))?;
        let (size, wanted) = (
            self.b.unary(ir::Op::FAbs, back)?,
            self.b.unary(ir::Op::FAbs, x)?,
        );
        let beyond = self.b.compare(ir::Op::FOLt, wanted, size)?;
        let bits = self.b.as_integer(nearest)?;
        let one = self.b.constant(ty.as_integer(), 1);
        let before = self.b.binary(ir::Op::ISub, bits, one)?;
        let before = self.b.emit(ir::Op::Bitcast, &[before], ty)?;
        self.b.select(beyond, before, nearest)
    }

    fn scalar_of(&self, parts: &[Value]) -> Result<Value, Error> {
        match *parts {
            [value] => Ok(value),
            _ => Err(self.b.invalid("a scalar is expected")),
        }
    }

    /// The same bits as scalars of other types; lower-order components first.
    pub(super) fn bitcast(&mut self, parts: &[Value], types: &[Type]) -> Result<Vec<Value>, Error> {
        let from: u32 = parts.iter().map(|&part| self.b.ty(part).bits()).sum();
        let to: u32 = types.iter().map(|ty| ty.bits()).sum();
        let bools = parts
            .iter()
            .map(|&part| self.b.ty(part))
            .chain(types.iter().copied());
        if from != to || bools.into_iter().any(|ty| ty == Type::I1) {
            return Err(self.b.invalid("a bitcast cannot change the number of bits"));
        }
        if parts.len() == types.len() {
            let mut values = Vec::with_capacity(parts.len());
            for (&part, &ty) in parts.iter().zip(types) {
                let same = self.b.ty(part) == ty;
                values.push(if same {
                    part
                } else {
                    self.b.emit(ir::Op::Bitcast, &[part], ty)?
                });
            }
            return Ok(values);
        }
        let narrow = |ty: Type| match ty.bits() {
            8 => Type::I8,
            16 => Type::I16,
            32 => Type::I32,
            _ => Type::I64,
        };
        let source = narrow(self.b.ty(parts[0]));
        let target = narrow(types[0]);
        let mut bits = Vec::with_capacity(parts.len());
        for &part in parts {
            bits.push(self.b.as_integer(part)?);
        }
        let mut values = Vec::with_capacity(types.len());
        if source.bits() > target.bits() {
            let ratio = source.bits() / target.bits();
            for wide in bits {
                for index in 0..ratio {
                    let count = self.b.constant(source, (index * target.bits()) as u64);
                    let shifted = self.b.binary(ir::Op::LShr, wide, count)?;
                    values.push(self.b.emit(ir::Op::UConvert, &[shifted], target)?);
                }
            }
        } else {
            let ratio = (target.bits() / source.bits()) as usize;
            for group in bits.chunks(ratio) {
                let mut wide = self.b.constant(target, 0);
                for (index, &part) in group.iter().enumerate() {
                    let part = self.b.emit(ir::Op::UConvert, &[part], target)?;
                    let count = self.b.constant(target, index as u64 * source.bits() as u64);
                    let placed = self.b.binary(ir::Op::Shl, part, count)?;
                    wide = self.b.binary(ir::Op::Or, wide, placed)?;
                }
                values.push(wide);
            }
        }
        for (value, &ty) in values.iter_mut().zip(types) {
            if ty != target {
                *value = self.b.emit(ir::Op::Bitcast, &[*value], ty)?;
            }
        }
        Ok(values)
    }
}
