//! Arithmetic, logic and comparison, component by component.

use rspirv::spirv::{GlslStd450Op as GLOp, Op, StorageClass};

use super::Lowerer;
use super::types::{TypeKind, UNTYPED};
use super::values::Values;
use crate::Error;
use crate::ir::{self, Type, Value};
use crate::parse::Instruction;

/// The correspondence of a SPIR-V operation and one of the IR.
#[derive(Clone, Copy)]
enum OpMapping {
    Unary(ir::Op),
    Binary(ir::Op),
    Compare(ir::Op),
    /// The comparison with its operands swapped, since the IR has only less-than.
    Swapped(ir::Op),
    Test(ir::Op),
    /// A shift, whose count may have another width.
    Shift(ir::Op),
}

/// Operations with one equivalent in the IR.
fn row(opcode: Op) -> Option<OpMapping> {
    use OpMapping::{Binary, Compare, Shift, Swapped, Test, Unary};
    Some(match opcode {
        Op::SNegate => Unary(ir::Op::INeg),
        Op::FNegate => Unary(ir::Op::FNeg),
        Op::Not | Op::LogicalNot => Unary(ir::Op::Not),
        Op::BitReverse => Unary(ir::Op::BitReverse),
        Op::IAdd => Binary(ir::Op::IAdd),
        Op::FAdd => Binary(ir::Op::FAdd),
        Op::ISub => Binary(ir::Op::ISub),
        Op::FSub => Binary(ir::Op::FSub),
        Op::IMul => Binary(ir::Op::IMul),
        Op::FMul => Binary(ir::Op::FMul),
        Op::UDiv => Binary(ir::Op::UDiv),
        Op::SDiv => Binary(ir::Op::SDiv),
        Op::FDiv => Binary(ir::Op::FDiv),
        Op::UMod => Binary(ir::Op::URem),
        Op::SRem => Binary(ir::Op::SRem),
        Op::SMod => Binary(ir::Op::SMod),
        Op::FRem => Binary(ir::Op::FRem),
        Op::FMod => Binary(ir::Op::FMod),
        Op::BitwiseOr | Op::LogicalOr => Binary(ir::Op::Or),
        Op::BitwiseXor | Op::LogicalNotEqual => Binary(ir::Op::Xor),
        Op::BitwiseAnd | Op::LogicalAnd => Binary(ir::Op::And),
        Op::LogicalEqual | Op::IEqual => Compare(ir::Op::IEq),
        Op::INotEqual => Compare(ir::Op::INe),
        Op::ULessThan => Compare(ir::Op::ULt),
        Op::ULessThanEqual => Compare(ir::Op::ULe),
        Op::UGreaterThan => Swapped(ir::Op::ULt),
        Op::UGreaterThanEqual => Swapped(ir::Op::ULe),
        Op::SLessThan => Compare(ir::Op::SLt),
        Op::SLessThanEqual => Compare(ir::Op::SLe),
        Op::SGreaterThan => Swapped(ir::Op::SLt),
        Op::SGreaterThanEqual => Swapped(ir::Op::SLe),
        Op::FOrdEqual => Compare(ir::Op::FOEq),
        Op::FOrdNotEqual => Compare(ir::Op::FONe),
        Op::FOrdLessThan => Compare(ir::Op::FOLt),
        Op::FOrdLessThanEqual => Compare(ir::Op::FOLe),
        Op::FOrdGreaterThan => Swapped(ir::Op::FOLt),
        Op::FOrdGreaterThanEqual => Swapped(ir::Op::FOLe),
        Op::FUnordEqual => Compare(ir::Op::FUEq),
        Op::FUnordNotEqual => Compare(ir::Op::FUNe),
        Op::FUnordLessThan => Compare(ir::Op::FULt),
        Op::FUnordLessThanEqual => Compare(ir::Op::FULe),
        Op::FUnordGreaterThan => Swapped(ir::Op::FULt),
        Op::FUnordGreaterThanEqual => Swapped(ir::Op::FULe),
        Op::IsNan => Test(ir::Op::FIsNan),
        Op::IsInf => Test(ir::Op::FIsInf),
        Op::ShiftLeftLogical => Shift(ir::Op::Shl),
        Op::ShiftRightLogical => Shift(ir::Op::LShr),
        Op::ShiftRightArithmetic => Shift(ir::Op::AShr),
        _ => return None,
    })
}

impl Lowerer<'_> {
    pub(super) fn lower_arithmetic(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let Some(row) = row(instruction.opcode) else {
            return self.lower_composed(instruction);
        };
        let operands = self.module.operands(instruction);
        let a = self.leaves(operands[0])?;
        let b = match operands.get(1) {
            Some(&id) => self.leaves(id)?,
            None => a.clone(),
        };
        if a.len() != b.len() {
            return Err(self
                .b
                .invalid("operands have different numbers of components"));
        }
        let mut values = Values::with_capacity(a.len());
        for (&a, &b) in a.iter().zip(b.iter()) {
            values.push(match row {
                OpMapping::Unary(op) => self.b.unary(op, a)?,
                OpMapping::Binary(op) => self.b.binary(op, a, b)?,
                OpMapping::Compare(op) => self.b.compare(op, a, b)?,
                OpMapping::Swapped(op) => self.b.compare(op, b, a)?,
                OpMapping::Test(op) => self.b.emit(op, &[a], Type::I1)?,
                OpMapping::Shift(op) => {
                    let count = self.resize(b, self.b.ty(a))?;
                    self.b.binary(op, a, count)?
                }
            });
        }
        self.define_typed(instruction, values)
    }

    /// An integer zero-extended or cut to another width.
    pub(super) fn resize(&mut self, value: Value, ty: Type) -> Result<Value, Error> {
        match self.b.ty(value) {
            from if from == ty => Ok(value),
            _ => self.b.emit(ir::Op::UConvert, &[value], ty),
        }
    }

    /// Operations that need several of the IR's.
    fn lower_composed(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        match instruction.opcode {
            Op::Select => self.lower_select(instruction),
            Op::FmaKHR => self.lower_elementwise(instruction, GLOp::Fma, operands),
            Op::Any | Op::All => {
                let op = if instruction.opcode == Op::Any {
                    ir::Op::Or
                } else {
                    ir::Op::And
                };
                let parts = self.leaves(operands[0])?;
                let mut result = parts.first().copied();
                for &part in parts.iter().skip(1) {
                    result = match result {
                        Some(result) => Some(self.b.binary(op, result, part)?),
                        None => Some(part),
                    };
                }
                self.define_typed(instruction, result.as_slice())
            }
            Op::BitCount => {
                let parts = self.leaves(operands[0])?;
                let ty = self.types.component(instruction.result_type)?;
                let mut values = Vec::new();
                for &part in parts.iter() {
                    let count = self.b.unary(ir::Op::BitCount, part)?;
                    values.push(self.resize(count, ty)?);
                }
                self.define_typed(instruction, values)
            }
            Op::BitFieldInsert | Op::BitFieldSExtract | Op::BitFieldUExtract => {
                self.lower_bit_field(instruction)
            }
            Op::IAddCarry | Op::ISubBorrow => {
                let carries = instruction.opcode == Op::IAddCarry;
                self.lower_pair(instruction, |lowerer, a, b| {
                    if carries {
                        let sum = lowerer.b.binary(ir::Op::IAdd, a, b)?;
                        Ok((sum, lowerer.b.compare(ir::Op::ULt, sum, a)?))
                    } else {
                        let difference = lowerer.b.binary(ir::Op::ISub, a, b)?;
                        Ok((difference, lowerer.b.compare(ir::Op::ULt, a, b)?))
                    }
                })
            }
            Op::UMulExtended | Op::SMulExtended => {
                let high = match instruction.opcode {
                    Op::UMulExtended => ir::Op::UMulHi,
                    _ => ir::Op::SMulHi,
                };
                self.lower_pair(instruction, |lowerer, a, b| {
                    let low = lowerer.b.binary(ir::Op::IMul, a, b)?;
                    Ok((low, lowerer.b.binary(high, a, b)?))
                })
            }
            Op::PtrEqual | Op::PtrNotEqual | Op::PtrDiff => {
                self.lower_pointer_comparison(instruction)
            }
            Op::Ordered | Op::Unordered => {
                let a = self.leaves(operands[0])?;
                let b = self.leaves(operands[1])?;
                let mut values = Vec::new();
                for (&a, &b) in a.iter().zip(b.iter()) {
                    let a = self.b.emit(ir::Op::FIsNan, &[a], Type::I1)?;
                    let b = self.b.emit(ir::Op::FIsNan, &[b], Type::I1)?;
                    let unordered = self.b.binary(ir::Op::Or, a, b)?;
                    values.push(match instruction.opcode {
                        Op::Ordered => self.b.unary(ir::Op::Not, unordered)?,
                        _ => unordered,
                    });
                }
                self.define_typed(instruction, values)
            }
            _ => Err(self.unsupported(instruction)),
        }
    }

    /// One condition selects a whole value, or each component has its own.
    fn lower_select(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        let conditions = self.leaves(operands[0])?;
        let a = self.leaves(operands[1])?;
        let b = self.leaves(operands[2])?;
        if a.len() != b.len() || (conditions.len() != 1 && conditions.len() != a.len()) {
            return Err(self
                .b
                .invalid("operands have different numbers of components"));
        }
        let mut values = Vec::with_capacity(a.len());
        for (index, (&a, &b)) in a.iter().zip(b.iter()).enumerate() {
            let condition = conditions[index.min(conditions.len() - 1)];
            values.push(self.b.select(condition, a, b)?);
        }
        self.define_typed(instruction, values)
    }

    fn lower_bit_field(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        let inserts = instruction.opcode == Op::BitFieldInsert;
        let base = self.leaves(operands[0])?;
        let insert = if inserts {
            Some(self.leaves(operands[1])?)
        } else {
            None
        };
        let first = 1 + inserts as usize;
        let offset = self.scalar(operands[first])?;
        let offset = self.b.i32_of(offset, false)?;
        let count = self.scalar(operands[first + 1])?;
        let count = self.b.i32_of(count, false)?;
        let mut values = Vec::new();
        for (index, &base) in base.iter().enumerate() {
            let ty = self.b.ty(base);
            values.push(match &insert {
                Some(insert) => {
                    let Some(&insert) = insert.get(index) else {
                        return Err(self
                            .b
                            .invalid("operands have different numbers of components"));
                    };
                    self.b
                        .emit(ir::Op::BitfieldInsert, &[base, insert, offset, count], ty)?
                }
                None => {
                    let op = match instruction.opcode {
                        Op::BitFieldSExtract => ir::Op::BitfieldSExtract,
                        _ => ir::Op::BitfieldUExtract,
                    };
                    self.b.emit(op, &[base, offset, count], ty)?
                }
            });
        }
        self.define_typed(instruction, values)
    }

    /// Operations whose result is a structure of two values: all first members, then all second
    /// ones.
    fn lower_pair(
        &mut self,
        instruction: &Instruction,
        compute: impl Fn(&mut Self, Value, Value) -> Result<(Value, Value), Error>,
    ) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        let a = self.leaves(operands[0])?;
        let b = self.leaves(operands[1])?;
        if a.len() != b.len() {
            return Err(self
                .b
                .invalid("operands have different numbers of components"));
        }
        let (mut firsts, mut seconds) = (Vec::new(), Vec::new());
        for (&a, &b) in a.iter().zip(b.iter()) {
            let ty = self.b.ty(a);
            let (first, second) = compute(self, a, b)?;
            firsts.push(first);
            // A carry is an integer.
            seconds.push(match self.b.ty(second) {
                Type::I1 => {
                    let (one, zero) = (self.b.constant(ty, 1), self.b.constant(ty, 0));
                    self.b.select(second, one, zero)?
                }
                _ => second,
            });
        }
        firsts.extend(seconds);
        self.define_typed(instruction, firsts)
    }

    fn lower_pointer_comparison(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        let a = self.leaves(operands[0])?;
        let b = self.leaves(operands[1])?;
        if a.len() != b.len() || a.is_empty() {
            return Err(self.b.invalid("these pointers cannot be compared"));
        }
        if instruction.opcode == Op::PtrDiff {
            return self.lower_pointer_difference(instruction, a[a.len() - 1], b[b.len() - 1]);
        }
        let mut equal = self.b.bool(true);
        for (&a, &b) in a.iter().zip(b.iter()) {
            let same = self.b.compare(ir::Op::IEq, a, b)?;
            equal = self.b.binary(ir::Op::And, equal, same)?;
        }
        if instruction.opcode == Op::PtrNotEqual {
            equal = self.b.unary(ir::Op::Not, equal)?;
        }
        self.define_typed(instruction, vec![equal])
    }

    /// `OpPtrDiff`: elements between two addresses or offsets.
    fn lower_pointer_difference(
        &mut self,
        instruction: &Instruction,
        a: Value,
        b: Value,
    ) -> Result<(), Error> {
        let pointer = self.type_of(self.module.operands(instruction)[0])?;
        let (class, pointee) = self.types.pointer(pointer)?;
        let stride = match class {
            // An array of bytes.
            _ if pointee == UNTYPED => 1,
            StorageClass::Workgroup => self.shared_layout().stride(pointer, pointee)?,
            _ if *self.types.pointer_leaves(class) == [Type::I32] => self.types.info(pointee)?.rows,
            _ => self.layout().stride(pointer, pointee)?,
        };
        // Offsets into a buffer may be more than 2³¹ apart.
        let [a, b] = [self.b.i64_of(a, false)?, self.b.i64_of(b, false)?];
        let bytes = self.b.binary(ir::Op::ISub, a, b)?;
        let stride = self.b.i64(stride.max(1));
        let elements = self.b.binary(ir::Op::SDiv, bytes, stride)?;
        let ty = self.types.scalar(instruction.result_type)?;
        let elements = match ty {
            Type::I64 => elements,
            _ => self.b.emit(ir::Op::SConvert, &[elements], ty)?,
        };
        self.define_typed(instruction, vec![elements])
    }

    /// `OpSDot` and its kin: integer products, widened, summed, and in the `AccSat` forms added
    /// with saturation.
    pub(super) fn lower_integer_dot(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        let (a_signed, b_signed) = match instruction.opcode {
            Op::SDot | Op::SDotAccSat => (true, true),
            Op::SUDot | Op::SUDotAccSat => (true, false),
            _ => (false, false),
        };
        let accumulates = matches!(
            instruction.opcode,
            Op::SDotAccSat | Op::UDotAccSat | Op::SUDotAccSat
        );
        let ty = self.types.scalar(instruction.result_type)?;
        let a = self.dot_factors(operands[0])?;
        let b = self.dot_factors(operands[1])?;
        if a.len() != b.len() {
            return Err(self.b.invalid("factors of a product do not match"));
        }
        // 64 bits hold the exact sum of products of up to 32 bits.
        let exact = if accumulates { Type::I64 } else { ty };
        let extend = |signed| {
            if signed {
                ir::Op::SConvert
            } else {
                ir::Op::UConvert
            }
        };
        let mut sum = self.b.constant(exact, 0);
        for (&a, &b) in a.iter().zip(&b) {
            let a = self.b.emit(extend(a_signed), &[a], exact)?;
            let b = self.b.emit(extend(b_signed), &[b], exact)?;
            let product = self.b.binary(ir::Op::IMul, a, b)?;
            sum = self.b.binary(ir::Op::IAdd, sum, product)?;
        }
        if accumulates {
            sum = self.accumulate(sum, operands[2], ty, a_signed)?;
        }
        self.define_typed(instruction, vec![sum])
    }

    fn accumulate(
        &mut self,
        sum: Value,
        accumulator: crate::parse::Id,
        ty: Type,
        signed: bool,
    ) -> Result<Value, Error> {
        let accumulator = self.scalar(accumulator)?;
        if ty == Type::I64 {
            let total = self.b.binary(ir::Op::IAdd, sum, accumulator)?;
            return self.saturate64(total, sum, accumulator, signed);
        }
        let wide = self.b.i64_of(accumulator, signed)?;
        let total = self.b.binary(ir::Op::IAdd, sum, wide)?;
        let bits = ty.bits();
        let clamped = if signed {
            let low = self.b.i64((-1i64 << (bits - 1)) as u64);
            let high = self.b.i64((1u64 << (bits - 1)) - 1);
            let total = self.b.binary(ir::Op::SMax, total, low)?;
            self.b.binary(ir::Op::SMin, total, high)?
        } else {
            let high = self.b.i64((1u64 << bits) - 1);
            self.b.binary(ir::Op::UMin, total, high)?
        };
        self.b.emit(ir::Op::UConvert, &[clamped], ty)
    }

    fn saturate64(
        &mut self,
        total: Value,
        a: Value,
        b: Value,
        signed: bool,
    ) -> Result<Value, Error> {
        if !signed {
            let wrapped = self.b.compare(ir::Op::ULt, total, a)?;
            let most = self.b.i64(u64::MAX);
            return self.b.select(wrapped, most, total);
        }
        // Overflow: both terms have the sign that the total lacks.
        let from_a = self.b.binary(ir::Op::Xor, total, a)?;
        let from_b = self.b.binary(ir::Op::Xor, total, b)?;
        let differs = self.b.binary(ir::Op::And, from_a, from_b)?;
        let zero = self.b.i64(0);
        let wrapped = self.b.compare(ir::Op::SLt, differs, zero)?;
        let negative = self.b.compare(ir::Op::SLt, a, zero)?;
        let (least, most) = (self.b.i64(i64::MIN as u64), self.b.i64(i64::MAX as u64));
        let bound = self.b.select(negative, least, most)?;
        self.b.select(wrapped, bound, total)
    }

    /// Components of a factor; a scalar is four packed bytes.
    fn dot_factors(&mut self, id: crate::parse::Id) -> Result<Vec<Value>, Error> {
        let values = self.leaves(id)?;
        let ty = self.type_of(id)?;
        if matches!(self.types.kind(ty)?, TypeKind::Vector { .. }) {
            return Ok(values.to_vec());
        }
        let packed = self.scalar(id)?;
        let mut parts = Vec::new();
        for index in 0..4 {
            let count = self.b.i32(8 * index);
            let shifted = self.b.binary(ir::Op::LShr, packed, count)?;
            parts.push(self.b.emit(ir::Op::UConvert, &[shifted], Type::I8)?);
        }
        Ok(parts)
    }
}
