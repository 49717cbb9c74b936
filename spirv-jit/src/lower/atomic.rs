//! Atomics on memory and texels.

use rspirv::spirv::Op;

use super::Lowerer;
use super::values::{MemoryLocation, Pointer};
use crate::Error;
use crate::ir::op::{Access, AtomicOp};
use crate::ir::{self, Space, Type, Value};
use crate::parse::Instruction;

impl Lowerer<'_> {
    pub(super) fn lower_atomic(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        let data = match instruction.opcode {
            Op::AtomicStore => self.type_of(operands[3])?,
            _ => instruction.result_type,
        };
        let pointer = self.pointer_to(operands[0], data)?;
        let ty = self.types.scalar(pointer.pointee)?;
        let (op, arguments) = match instruction.opcode {
            Op::AtomicLoad => (AtomicOp::Load, vec![]),
            Op::AtomicCompareExchange | Op::AtomicCompareExchangeWeak => {
                let (value, comparator) = (self.scalar(operands[4])?, self.scalar(operands[5])?);
                (AtomicOp::CompareExchange, vec![value, comparator])
            }
            Op::AtomicIIncrement => (AtomicOp::IAdd, vec![self.b.constant(ty, 1)]),
            Op::AtomicIDecrement => (AtomicOp::ISub, vec![self.b.constant(ty, 1)]),
            opcode => {
                let op = match opcode {
                    Op::AtomicStore => AtomicOp::Store,
                    Op::AtomicExchange => AtomicOp::Exchange,
                    Op::AtomicIAdd => AtomicOp::IAdd,
                    Op::AtomicISub => AtomicOp::ISub,
                    Op::AtomicSMin => AtomicOp::SMin,
                    Op::AtomicUMin => AtomicOp::UMin,
                    Op::AtomicSMax => AtomicOp::SMax,
                    Op::AtomicUMax => AtomicOp::UMax,
                    Op::AtomicAnd => AtomicOp::And,
                    Op::AtomicOr => AtomicOp::Or,
                    Op::AtomicXor => AtomicOp::Xor,
                    Op::AtomicFAddEXT => AtomicOp::FAdd,
                    Op::AtomicFMinEXT => AtomicOp::FMin,
                    _ => AtomicOp::FMax,
                };
                (op, vec![self.scalar(operands[3])?])
            }
        };
        let integer = !matches!(
            op,
            AtomicOp::Load
                | AtomicOp::Store
                | AtomicOp::Exchange
                | AtomicOp::FAdd
                | AtomicOp::FMin
                | AtomicOp::FMax
        );
        let needs_float = matches!(op, AtomicOp::FAdd | AtomicOp::FMin | AtomicOp::FMax);
        let wrong = arguments.iter().any(|&value| self.b.ty(value) != ty)
            || matches!(ty, Type::I1 | Type::I8)
            || (integer && ty.is_float())
            || (needs_float && !ty.is_float());
        if wrong {
            return Err(self.b.invalid("an atomic operation has the wrong type"));
        }
        let op = match self.is_flushed(instruction.opcode) && ty == Type::F32 {
            true => op.flushed(),
            false => op,
        };
        let result = match &pointer.place {
            MemoryLocation::Texel { .. } => self.texel_atomic(&pointer, op, &arguments)?,
            _ => self.memory_atomic(&pointer, op, &arguments, ty)?,
        };
        match result {
            Some(value) if instruction.result != 0 => self.define_typed(instruction, vec![value]),
            _ => Ok(()),
        }
    }

    fn memory_atomic(
        &mut self,
        pointer: &Pointer,
        op: AtomicOp,
        arguments: &[Value],
        ty: Type,
    ) -> Result<Option<Value>, Error> {
        let space = match pointer.place {
            MemoryLocation::Shared { .. } => Space::Shared,
            MemoryLocation::Buffer { .. } => Space::Buffer,
            MemoryLocation::Buffer64 { .. } => Space::Buffer64,
            MemoryLocation::Global { .. } => Space::Global,
            // Memory of one lane: no other lane can intervene.
            MemoryLocation::Local { .. } | MemoryLocation::Private { .. } => {
                return self.private_atomic(pointer, op, arguments).map(Some);
            }
            _ => return Err(self.b.invalid("this memory has no atomics")),
        };
        let mut operands = self.address(pointer, 0)?;
        operands.extend_from_slice(arguments);
        let access = Access {
            space,
            volatile: true,
            constant: false,
            alignment: 0,
            is_strided: false,
        };
        let results: &[Type] = if op == AtomicOp::Store { &[] } else { &[ty] };
        let op = ir::Op::Atomic(op, access);
        Ok(self
            .b
            .emit_unchecked(op, &operands, results)?
            .first()
            .copied())
    }

    fn private_atomic(
        &mut self,
        pointer: &Pointer,
        op: AtomicOp,
        arguments: &[Value],
    ) -> Result<Value, Error> {
        let old = self.load(pointer)?[0];
        let binary = match op {
            AtomicOp::Load => return Ok(old),
            AtomicOp::Store | AtomicOp::Exchange => None,
            AtomicOp::CompareExchange => {
                let equal = self.b.compare(ir::Op::IEq, old, arguments[1])?;
                let new = self.b.select(equal, arguments[0], old)?;
                self.store(pointer, &[new])?;
                return Ok(old);
            }
            AtomicOp::IAdd => Some(ir::Op::IAdd),
            AtomicOp::ISub => Some(ir::Op::ISub),
            AtomicOp::SMin => Some(ir::Op::SMin),
            AtomicOp::SMax => Some(ir::Op::SMax),
            AtomicOp::UMin => Some(ir::Op::UMin),
            AtomicOp::UMax => Some(ir::Op::UMax),
            AtomicOp::And => Some(ir::Op::And),
            AtomicOp::Or => Some(ir::Op::Or),
            AtomicOp::Xor => Some(ir::Op::Xor),
            AtomicOp::FAdd | AtomicOp::FAddFlushed => Some(ir::Op::FAdd),
            AtomicOp::FMin | AtomicOp::FMinFlushed => Some(ir::Op::FMin),
            AtomicOp::FMax | AtomicOp::FMaxFlushed => Some(ir::Op::FMax),
        };
        let new = match binary {
            Some(op) => self.b.binary(op, old, arguments[0])?,
            None => arguments[0],
        };
        let new = match op.unflushed() {
            Some(_) => self.b.unary(ir::Op::FFlushDenormal, new)?,
            None => new,
        };
        self.store(pointer, &[new])?;
        Ok(old)
    }
}
