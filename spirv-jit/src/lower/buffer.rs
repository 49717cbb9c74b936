//! Storage buffers: their locations, offsets of 64 bits (`SPV_EXT_shader_64bit_indexing`), and
//! lengths of runtime arrays.

use rspirv::spirv::StorageClass;

use super::Lowerer;
use super::pointer::{Elements, Index};
use super::values::MemoryLocation;
use crate::Error;
use crate::ir::{self, Type, Value};
use crate::parse::{Id, Instruction};

/// More bytes than any buffer has. Larger steps of 64-bit offsets are clamped to this, so that
/// their sum does not wrap.
const UNREACHABLE: u64 = 1 << 48;

impl Lowerer<'_> {
    /// Whether offsets in a variable have 64 bits. Storage buffers have them, also in the form
    /// before SPIR-V 1.3.
    pub(super) fn is_wide(&self, class: StorageClass, pointee: Id) -> Result<bool, Error> {
        let is_storage = match class {
            StorageClass::StorageBuffer => true,
            StorageClass::Uniform => !self.is_uniform_block(pointee)?,
            _ => false,
        };
        Ok(self.types.has_wide_offsets && is_storage)
    }

    /// The start of a buffer.
    pub(super) fn buffer_place(reference: Value, is_wide: bool) -> MemoryLocation {
        match is_wide {
            true => MemoryLocation::Buffer64 {
                reference,
                offset: None,
                constant: 0,
            },
            false => MemoryLocation::Buffer {
                reference,
                offset: None,
                constant: 0,
            },
        }
    }

    /// Adds `index * stride` to an offset of 64 bits and its constant part.
    pub(super) fn move_offset64(
        &mut self,
        (offset, constant): (&mut Option<Value>, &mut u64),
        index: Index,
        stride: u64,
        elements: Elements,
    ) -> Result<(), Error> {
        // An index past this limit stays past the end of every buffer, and no sum wraps.
        let limit = match elements {
            Elements::Around => u64::MAX,
            Elements::Open | Elements::Counted(_) if stride == 0 => u64::MAX,
            Elements::Open => UNREACHABLE.div_ceil(stride),
            Elements::Counted(count) => UNREACHABLE
                .div_ceil(stride)
                .max(count.saturating_sub(1).into()),
        };
        match index {
            Index::Constant(index) => {
                let step = limit.min(index as u64).wrapping_mul(stride);
                *constant = constant.wrapping_add(step);
            }
            Index::Value(index) => {
                let mut index = self.b.i64_of(index, true)?;
                if limit != u64::MAX {
                    let limit = self.b.i64(limit);
                    index = self.b.binary(ir::Op::UMin, index, limit)?;
                }
                let step = self.b.scale(index, stride)?;
                *offset = Some(self.add(*offset, step)?);
            }
        }
        Ok(())
    }

    /// `OpArrayLength` and `OpUntypedArrayLengthKHR`: elements of the runtime array at the end of a
    /// block.
    pub(super) fn lower_array_length(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        let (pointer, member) = match *operands {
            [block, pointer, member] => (self.pointer(pointer)?.retyped(block), member),
            _ => (self.pointer(operands[0])?, operands[1]),
        };
        let block = pointer.pointee;
        let array = self.types.element(block, Some(member))?;
        let stride = self.layout().array_stride(array)?.clamp(1, u32::MAX as u64);
        let first = self.layout().member_offset(block, member)? as u32;
        let (reference, before, ty) = match pointer.place {
            MemoryLocation::Buffer {
                reference,
                offset,
                constant,
            } => {
                let before = self.b.add_terms(offset, constant.wrapping_add(first))?;
                (reference, before, Type::I32)
            }
            MemoryLocation::Buffer64 {
                reference,
                offset,
                constant,
            } => {
                let constant = constant.wrapping_add(first.into());
                let before = self.b.add_terms64(offset, constant)?;
                (reference, before, Type::I64)
            }
            _ => {
                let message = "the length of an array is asked outside a buffer";
                return Err(self.b.invalid(message));
            }
        };
        let descriptor = self.b.descriptor(reference)?;
        let size = self.b.emit(ir::Op::BufferSize, &[descriptor], ty)?;
        // A buffer may end before the array starts.
        let before = self.b.binary(ir::Op::UMin, before, size)?;
        let bytes = self.b.binary(ir::Op::ISub, size, before)?;
        let stride = self.b.constant(ty, stride);
        let mut length = self.b.binary(ir::Op::UDiv, bytes, stride)?;
        let result = self.types.scalar(instruction.result_type)?;
        if self.types.has_wide_offsets && result != ty {
            if result == Type::I32 {
                let most = self.b.i64(u32::MAX.into());
                length = self.b.binary(ir::Op::UMin, length, most)?;
            }
            length = self.b.emit(ir::Op::UConvert, &[length], result)?;
        }
        self.define_typed(instruction, [length])
    }
}
