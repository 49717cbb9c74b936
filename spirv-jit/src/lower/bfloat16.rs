//! Floats of the encoding `BFloat16KHR`: the high half of an f32. Values hold their bits as an i16.
//! Only conversions, `OpDot` and matrix products compute with them.

use rspirv::spirv::Op;

use super::Lowerer;
use super::values::Values;
use crate::Error;
use crate::ir::{self, Type, Value};
use crate::parse::Instruction;

/// Bits of an f32 below those of a bfloat16.
const LOW: u32 = 16;

impl Lowerer<'_> {
    /// Lowers a conversion from or to bfloat16; false for others.
    pub(super) fn lower_bfloat16_conversion(
        &mut self,
        instruction: &Instruction,
        op: ir::Op,
        toward_zero: bool,
    ) -> Result<bool, Error> {
        let operand = self.module.operands(instruction)[0];
        let from = self.types.is_bfloat16(self.type_of(operand)?);
        let to = self.types.is_bfloat16(instruction.result_type);
        if !(from || to) || instruction.opcode == Op::QuantizeToF16 {
            return Ok(false);
        }
        let ty = self.types.component(instruction.result_type)?;
        let mut values = Values::new();
        for &part in self.leaves(operand)?.iter() {
            values.push(match (from, to) {
                (true, true) => part,
                (true, false) => {
                    let number = self.widen_bfloat16(part)?;
                    match ty {
                        Type::F32 => number,
                        _ => self.b.emit(op, &[number], ty)?,
                    }
                }
                _ => {
                    let number = match self.b.ty(part) {
                        Type::F32 | Type::F64 => part,
                        // Exact.
                        Type::F16 | Type::I8 | Type::I16 => self.b.emit(op, &[part], Type::F32)?,
                        _ => self.b.emit(op, &[part], Type::F64)?,
                    };
                    self.narrow_to_bfloat16(number, toward_zero)?
                }
            });
        }
        self.define_typed(instruction, values)?;
        Ok(true)
    }

    /// A bfloat16 as an f32.
    pub(super) fn widen_bfloat16(&mut self, bits: Value) -> Result<Value, Error> {
        let word = self.b.i32_of(bits, false)?;
        let low = self.b.i32(LOW);
        let word = self.b.binary(ir::Op::Shl, word, low)?;
        self.b.emit(ir::Op::Bitcast, &[word], Type::F32)
    }

    /// An f32 or f64 as the nearest bfloat16, ties to even, or as the one before it towards zero.
    pub(super) fn narrow_to_bfloat16(
        &mut self,
        number: Value,
        toward_zero: bool,
    ) -> Result<Value, Error> {
        let bits = match self.b.ty(number) {
            Type::F64 => self.odd_bits(number)?,
            _ => self.b.as_integer(number)?,
        };
        let low = self.b.i32(LOW);
        let high = self.b.binary(ir::Op::LShr, bits, low)?;
        let rounded = match toward_zero {
            true => high,
            false => {
                let (one, half) = (self.b.i32(1), self.b.i32((1 << (LOW - 1)) - 1));
                let odd = self.b.binary(ir::Op::And, high, one)?;
                let up = self.b.binary(ir::Op::IAdd, odd, half)?;
                let sum = self.b.binary(ir::Op::IAdd, bits, up)?;
                self.b.binary(ir::Op::LShr, sum, low)?
            }
        };
        // A NaN keeps a bit.
        let quiet = self.b.i32(0x40);
        let nan = self.b.binary(ir::Op::Or, high, quiet)?;
        let is_nan = self.b.emit(ir::Op::FIsNan, &[number], Type::I1)?;
        let bits = self.b.select(is_nan, nan, rounded)?;
        self.b.emit(ir::Op::UConvert, &[bits], Type::I16)
    }

    /// The bits of an f64 rounded to odd in an f32, so that a second rounding gives the same result
    /// as a single one.
    fn odd_bits(&mut self, number: Value) -> Result<Value, Error> {
        let near = self.convert_toward_zero(number, Type::F32)?;
        let back = self.b.emit(ir::Op::FConvert, &[near], Type::F64)?;
        let is_inexact = self.b.compare(ir::Op::FUNe, back, number)?;
        let bits = self.b.as_integer(near)?;
        let one = self.b.i32(1);
        let odd = self.b.binary(ir::Op::Or, bits, one)?;
        self.b.select(is_inexact, odd, bits)
    }
}
