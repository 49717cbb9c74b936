//! Pointers: locations of variables, and access chains.

use rspirv::spirv::{Decoration, Op, StorageClass};

use super::Lowerer;
use super::stage_interface::Evaluation;
use super::types::{TypeKind, UNTYPED};
use super::values::{Handles, MemoryLocation, Pointer, Shape, Val};
use crate::Error;
use crate::ir::op::{DescriptorBinding, MatrixProduct};
use crate::ir::{self, Type, Value};
use crate::parse::{Id, Instruction};

/// A binding that the pipeline layout lacks: every index is past its end, so every descriptor of it
/// is null.
const NO_BINDING: DescriptorBinding = DescriptorBinding {
    set: 0,
    first: 0,
    count: 0,
    dynamic: false,
};

/// Offsets into a buffer have 32 bits, and `maxStorageBufferRange` is 2³²−1 bytes.
const OFFSETS: u64 = 1 << 32;

/// An index of an access chain.
#[derive(Clone, Copy)]
pub(super) enum Index {
    Constant(i64),
    /// i32 or i64; narrower ones were extended.
    Value(Value),
}

/// The elements that an index selects from.
#[derive(Clone, Copy)]
pub(super) enum Elements {
    /// The elements of an array, a vector or a matrix of this many.
    Counted(u32),
    /// The elements of a runtime array.
    Open,
    /// Elements before and after a pointer, since `OpPtrAccessChain` steps in both directions.
    Around,
}

/// Upper bounds that keep an offset from wrapping: a wrapped offset would be inside the buffer.
#[derive(Default)]
struct Limits {
    index: Option<u64>,
    /// Limit of the computed part of the offset.
    offset: Option<u32>,
}

impl Limits {
    /// Returns the limits of an index into elements of `size` bytes, `stride` bytes apart. The
    /// elements start at `constant`, or `constant` bytes after a computed offset.
    fn of(
        is_computed: bool,
        constant: u32,
        (stride, size): (u64, u64),
        elements: Elements,
    ) -> Self {
        if stride == 0 {
            return Self::default();
        }
        // The start of the last element that ends at 2³² or below. A larger index is this one,
        // which is outside of every buffer, except one that ends in the last `size` bytes below
        // 2³².
        let end = OFFSETS.saturating_sub(size.saturating_add(constant.into()));
        match elements {
            // Two steps may lead out of the buffer and back.
            Elements::Around => Self::default(),
            Elements::Open => Self {
                index: Some(end / stride),
                offset: is_computed.then_some(end as u32),
            },
            // A valid index stays inside the enclosing element. Any other is undefined; this limit
            // leads it out of buffers of up to 2³¹ bytes.
            Elements::Counted(count) if is_computed => Self {
                index: Some(u64::from(count.saturating_sub(1)).max((OFFSETS / 2).div_ceil(stride))),
                offset: None,
            },
            Elements::Counted(_) => Self {
                index: Some(end / stride),
                offset: None,
            },
        }
    }
}

impl Lowerer<'_> {
    /// The pointer of a module variable.
    pub(super) fn module_pointer(&mut self, id: Id) -> Result<Pointer, Error> {
        let variable = self.variables[&id];
        let (class, pointee) = (variable.class, variable.pointee);
        if let Some(table) = self.heap_of(id) {
            let place = MemoryLocation::Heap {
                table,
                offset: None,
                constant: 0,
            };
            return Ok(Pointer::new(pointee, place));
        }
        if let Some(place) = self.patch_place(id)? {
            return Ok(Pointer::new(pointee, place));
        }
        let place = match class {
            StorageClass::UniformConstant | StorageClass::Uniform | StorageClass::StorageBuffer => {
                let find = |decoration| self.module.annotations.id(id, decoration);
                let set = find(Decoration::DescriptorSet).unwrap_or(0);
                let binding = find(Decoration::Binding).unwrap_or(0);
                let (handles, first) = match self.mapping(id, (class, pointee), (set, binding))? {
                    Some(at) => {
                        let first = binding - self.request.mappings[at].first_binding;
                        (Handles::Mapped(at), first)
                    }
                    None => {
                        let found = (self.request.bindings)(set, binding);
                        (Handles::Bound(found.unwrap_or(NO_BINDING)), 0)
                    }
                };
                let is_wide = self.is_wide(class, pointee)?;
                let mut pointer = self.handle_pointer(id, pointee, (handles, first), is_wide)?;
                pointer.constant = class == StorageClass::Uniform
                    && !matches!(pointer.place, MemoryLocation::Global { .. })
                    && find(Decoration::Aliased).is_none()
                    && self.is_uniform_block(pointee)?;
                return Ok(pointer);
            }
            StorageClass::PushConstant => MemoryLocation::Buffer {
                reference: self.b.push_constants(),
                offset: None,
                constant: 0,
            },
            StorageClass::Workgroup | StorageClass::TaskPayloadWorkgroupEXT => {
                MemoryLocation::Shared {
                    offset: None,
                    constant: self.shared_offset(id)?,
                }
            }
            StorageClass::Input => MemoryLocation::Input {
                variable: id,
                row: 0,
                index: None,
            },
            StorageClass::ShaderRecordBufferKHR => MemoryLocation::Global {
                address: self.shader_record_address()?,
                constant: 0,
            },
            StorageClass::Private
            | StorageClass::RayPayloadKHR
            | StorageClass::IncomingRayPayloadKHR
            | StorageClass::HitAttributeKHR
            | StorageClass::HitObjectAttributeNV
            | StorageClass::HitObjectAttributeEXT
            | StorageClass::CallableDataKHR
            | StorageClass::IncomingCallableDataKHR
            | StorageClass::Output => MemoryLocation::Local {
                local: self.module_local(id)?,
                row: 0,
            },
            other => {
                let message = format!("storage class {other:?} is not supported");
                return Err(Error::unsupported(self.b.source, message));
            }
        };
        Ok(Pointer::new(pointee, place))
    }

    /// Whether a variable of storage class `Uniform` holds uniform blocks, not storage buffers as
    /// SPIR-V had them before 1.3.
    pub(super) fn is_uniform_block(&self, mut pointee: Id) -> Result<bool, Error> {
        while let TypeKind::Array { element, .. } | TypeKind::RuntimeArray { element, .. } =
            self.types.kind(pointee)?
        {
            pointee = *element;
        }
        Ok((self.module.annotations.id(pointee, Decoration::BufferBlock)).is_none())
    }

    fn handle_pointer(
        &mut self,
        id: Id,
        pointee: Id,
        (binding, constant): (Handles, u32),
        is_wide: bool,
    ) -> Result<Pointer, Error> {
        let place = MemoryLocation::Handle {
            binding,
            index: None,
            constant,
        };
        let mut pointer = Pointer::new(pointee, place);
        let volatile = self.module.annotations.id(id, Decoration::Volatile);
        pointer.volatile = volatile.is_some();
        pointer.is_wide = is_wide;
        self.enter_block(pointer)
    }

    /// A pointer to a descriptor of a buffer becomes a pointer into the buffer.
    fn enter_block(&mut self, mut pointer: Pointer) -> Result<Pointer, Error> {
        let is_block = matches!(self.types.kind(pointer.pointee)?, TypeKind::Struct { .. });
        if !is_block {
            return Ok(pointer);
        }
        pointer.place = match pointer.place {
            MemoryLocation::Handle {
                binding: Handles::Mapped(at),
                index,
                constant,
            } => {
                let mapping = &self.request.mappings[at];
                match self.mapped_buffer(mapping, (index, constant))? {
                    MemoryLocation::Buffer {
                        reference,
                        offset: None,
                        constant: 0,
                    } => Self::buffer_place(reference, pointer.is_wide),
                    place => place,
                }
            }
            MemoryLocation::Handle { .. } => {
                Self::buffer_place(self.reference(&pointer)?, pointer.is_wide)
            }
            _ => return Ok(pointer),
        };
        Ok(pointer)
    }

    /// The reference to the descriptor that a handle selects.
    pub(super) fn reference(&mut self, pointer: &Pointer) -> Result<Value, Error> {
        match &pointer.place {
            MemoryLocation::Descriptor(value) => Ok(*value),
            &MemoryLocation::Heap {
                table,
                offset,
                constant,
            } => self.heap_entry(table, offset, constant),
            &MemoryLocation::Handle {
                binding: Handles::Mapped(at),
                index,
                constant,
            } => {
                let mapping = &self.request.mappings[at];
                self.mapped_scalar(mapping, pointer.pointee, (index, constant))
            }
            MemoryLocation::Handle {
                binding: Handles::Bound(binding),
                index: None,
                constant,
            } => Ok(self.b.constant_reference(*binding, *constant)),
            MemoryLocation::Handle {
                binding: Handles::Bound(binding),
                index,
                constant,
            } => {
                let index = self.b.add_terms(*index, *constant)?;
                self.b.reference(*binding, index)
            }
            _ => Err(self.b.invalid("this pointer leads to no descriptor")),
        }
    }

    /// The pointer with an id, as one to data of type `ty` if it is untyped.
    pub(super) fn pointer_to(&mut self, id: Id, ty: Id) -> Result<Pointer, Error> {
        let pointer = self.pointer(id)?;
        let (_, pointee) = self.types.pointer(self.type_of(id)?)?;
        Ok(match pointee {
            UNTYPED => pointer.retyped(ty),
            _ => pointer,
        })
    }

    /// `OpAccessChain` and its variants.
    pub(super) fn lower_access_chain(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let mut operands = self.module.operands(instruction);
        // The first operand of an untyped chain is the type at its base.
        let mut base_type = None;
        if matches!(
            instruction.opcode,
            Op::UntypedAccessChainKHR
                | Op::UntypedInBoundsAccessChainKHR
                | Op::UntypedPtrAccessChainKHR
                | Op::UntypedInBoundsPtrAccessChainKHR
        ) {
            (base_type, operands) = (Some(operands[0]), &operands[1..]);
        }
        let mut pointer = self.pointer(operands[0])?;
        if let Some(base_type) = base_type {
            pointer = pointer.retyped(base_type);
        }
        let mut indices = &operands[1..];
        if matches!(
            instruction.opcode,
            Op::PtrAccessChain
                | Op::InBoundsPtrAccessChain
                | Op::UntypedPtrAccessChainKHR
                | Op::UntypedInBoundsPtrAccessChainKHR
        ) {
            let base = self.type_of(operands[0])?;
            pointer = self.step_element(pointer, base, indices[0])?;
            indices = &indices[1..];
        }
        for &index in indices {
            pointer = self.step(pointer, index)?;
        }
        let (_, pointee) = self.types.pointer(instruction.result_type)?;
        if pointee == UNTYPED {
            return self.define(instruction.result, Val::Pointer(pointer));
        }
        if pointer.pointee != pointee && !self.same_shape(pointer.pointee, pointee)? {
            return Err(self
                .b
                .invalid("an access chain leads to another type than it says"));
        }
        pointer.pointee = pointee;
        self.define(instruction.result, Val::Pointer(pointer))
    }

    fn same_shape(&self, a: Id, b: Id) -> Result<bool, Error> {
        let (a, b) = (self.types.info(a)?, self.types.info(b)?);
        Ok(a.kind == b.kind)
    }

    /// Returns an index, extended as its type says, or as a signed one if `is_signed`.
    fn index(&mut self, id: Id, is_signed: bool) -> Result<Index, Error> {
        if self.constants.find(id).is_some() {
            let index = self.constants.integer(&self.types, id)?;
            let unused = match is_signed {
                true => 64 - self.types.scalar(self.type_of(id)?)?.bits(),
                false => 0,
            };
            return Ok(Index::Constant(index << unused >> unused));
        }
        let is_signed = is_signed || self.types.is_signed(self.type_of(id)?);
        let value = self.scalar(id)?;
        Ok(Index::Value(match self.b.ty(value) {
            Type::I32 | Type::I64 => value,
            _ => self.b.i32_of(value, is_signed)?,
        }))
    }

    /// Applies the element operand of `OpPtrAccessChain`, a signed count of elements.
    fn step_element(&mut self, pointer: Pointer, base: Id, index: Id) -> Result<Pointer, Error> {
        let index = self.index(index, true)?;
        let stride = match &pointer.place {
            MemoryLocation::Shared { .. }
            | MemoryLocation::Buffer { .. }
            | MemoryLocation::Buffer64 { .. }
            | MemoryLocation::Global { .. }
            | MemoryLocation::Heap { .. } => {
                let layout = self.layout_in(&pointer.place);
                layout.stride(base, pointer.pointee)?
            }
            MemoryLocation::Local { .. } | MemoryLocation::Private { .. } => {
                self.types.info(pointer.pointee)?.rows
            }
            _ => return Err(self.b.invalid("this pointer cannot be moved")),
        };
        self.advance(pointer, index, stride, Elements::Around)
    }

    /// One index of an access chain.
    fn step(&mut self, pointer: Pointer, index: Id) -> Result<Pointer, Error> {
        // SPIR-V: each index "is treated as signed". Logical pointers have no valid index below 0:
        // there a narrow unsigned index keeps its value.
        let is_signed = matches!(pointer.place, MemoryLocation::Global { .. })
            || matches!(pointer.place, MemoryLocation::Buffer64 { .. })
                && self.types.is_signed(self.type_of(index)?);
        let index = match self.index(index, is_signed)? {
            Index::Value(value) if matches!(pointer.place, MemoryLocation::Buffer64 { .. }) => {
                Index::Value(self.b.i64_of(value, is_signed)?)
            }
            index => index,
        };
        self.step_by(pointer, index)
    }

    /// Steps a pointer to an element, component or member of its pointee.
    pub(super) fn step_by(&mut self, mut pointer: Pointer, index: Index) -> Result<Pointer, Error> {
        let ty = pointer.pointee;
        let kind = self.types.kind(ty)?.clone();
        let member = match (&kind, index) {
            (TypeKind::Struct { .. }, Index::Constant(member)) => {
                Some(u32::try_from(member).unwrap_or(u32::MAX))
            }
            (TypeKind::Struct { .. }, _) => {
                return Err(self
                    .b
                    .invalid("a structure's member index must be constant"));
            }
            _ => None,
        };
        let element = self.types.element(ty, member)?;
        pointer.pointee = element;
        let elements = match kind {
            TypeKind::Vector { count, .. }
            | TypeKind::Matrix { count, .. }
            | TypeKind::Array { count, .. } => Elements::Counted(count),
            TypeKind::CooperativeMatrix { .. } => Elements::Counted(MatrixProduct::SIZE as u32),
            TypeKind::RuntimeArray { .. } => Elements::Open,
            // A member is one step of its offset.
            _ => Elements::Around,
        };
        match &mut pointer.place {
            MemoryLocation::Handle {
                index: at,
                constant,
                ..
            } => {
                // Arrays of arrays count in elements of the innermost.
                let width = self.handle_count(element)?;
                match index {
                    Index::Constant(index) => {
                        *constant = constant.wrapping_add((index as u32).wrapping_mul(width));
                    }
                    Index::Value(value) => {
                        let value = self.b.i32_of(value, false)?;
                        let value = self.b.scale(value, width as u64)?;
                        *at = Some(self.add(*at, value)?);
                    }
                }
                self.enter_block(pointer)
            }
            MemoryLocation::Local { .. }
            | MemoryLocation::Private { .. }
            | MemoryLocation::Input { .. } => {
                let (index, stride) = match member {
                    Some(member) => {
                        let rows = self.types.row_offset(ty, member)?;
                        (Index::Constant(1), rows)
                    }
                    None => (index, self.types.info(element)?.rows),
                };
                self.advance(pointer, index, stride, elements)
            }
            MemoryLocation::Shared { .. }
            | MemoryLocation::Buffer { .. }
            | MemoryLocation::Buffer64 { .. }
            | MemoryLocation::Global { .. }
            | MemoryLocation::Heap { .. } => {
                let (stride, index) = match member {
                    Some(member) => (
                        self.step_to_member(&mut pointer, ty, member)?,
                        Index::Constant(1),
                    ),
                    None => (self.element_stride(&mut pointer, ty, &kind)?, index),
                };
                self.advance(pointer, index, stride, elements)
            }
            MemoryLocation::Descriptor(_) | MemoryLocation::Texel { .. } => {
                Err(self.b.invalid("this pointer has no elements"))
            }
        }
    }

    /// The offset in bytes of a structure's member in memory. Gives the pointer the member's layout
    /// and decorations.
    fn step_to_member(&self, pointer: &mut Pointer, ty: Id, member: u32) -> Result<u64, Error> {
        let annotations = &self.module.annotations;
        let volatile = annotations.member(ty, member, Decoration::Volatile);
        pointer.volatile |= volatile.is_some();
        let layout = self.layout_in(&pointer.place);
        let offset = layout.member_offset(ty, member)?;
        pointer.shape = layout.member_shape(ty, member);
        Ok(offset)
    }

    /// The distance in bytes between elements of a composite in memory. Gives the pointer the
    /// layout of an element.
    fn element_stride(
        &mut self,
        pointer: &mut Pointer,
        ty: Id,
        kind: &TypeKind,
    ) -> Result<u64, Error> {
        let shape = pointer.shape;
        match kind {
            TypeKind::Vector { .. } => {
                let size = self.types.component(ty)?.size_bytes();
                let tight = shape.component_stride == 0;
                pointer.shape = Shape::default();
                let stride = if tight { size } else { shape.component_stride };
                Ok(stride as u64)
            }
            TypeKind::Matrix { .. } => {
                let stride = self.layout().matrix_stride(ty, shape)?;
                let size = self.types.component(ty)?.size_bytes();
                pointer.shape = Shape::default();
                if shape.row_major {
                    pointer.shape.component_stride = stride as u32;
                    Ok(size as u64)
                } else {
                    Ok(stride)
                }
            }
            _ => self.layout_in(&pointer.place).array_stride(ty),
        }
    }

    /// Descriptors in one element of an array of descriptors.
    fn handle_count(&self, ty: Id) -> Result<u32, Error> {
        let (mut ty, mut handles) = (ty, 1u32);
        while let TypeKind::Array { element, count } = *self.types.kind(ty)? {
            handles = handles.saturating_mul(count);
            ty = element;
        }
        Ok(handles)
    }

    /// Moves a pointer by `index * stride` bytes, or rows of per-lane memory.
    fn advance(
        &mut self,
        mut pointer: Pointer,
        index: Index,
        stride: u64,
        elements: Elements,
    ) -> Result<Pointer, Error> {
        match &mut pointer.place {
            MemoryLocation::Local { .. }
            | MemoryLocation::Private { .. }
            | MemoryLocation::Input { .. } => {
                return self.advance_rows(pointer, index, stride, elements);
            }
            MemoryLocation::Global { address, constant } => match index {
                Index::Constant(index) => {
                    *constant = constant.wrapping_add((index as u64).wrapping_mul(stride));
                }
                Index::Value(index) => {
                    let index = self.b.i64_of(index, true)?;
                    let step = self.b.scale(index, stride)?;
                    *address = self.b.binary(ir::Op::IAdd, *address, step)?;
                }
            },
            MemoryLocation::Shared { offset, constant }
            | MemoryLocation::Heap {
                offset, constant, ..
            } => {
                self.move_offset((offset, constant), index, stride, &Limits::default())?;
            }
            MemoryLocation::Buffer {
                offset, constant, ..
            } => {
                // In a row-major matrix the components of a column are apart.
                let size = stride + 3 * u64::from(pointer.shape.component_stride);
                let limits = Limits::of(offset.is_some(), *constant, (stride, size), elements);
                self.move_offset((offset, constant), index, stride, &limits)?;
            }
            MemoryLocation::Buffer64 {
                offset, constant, ..
            } => {
                self.move_offset64((offset, constant), index, stride, elements)?;
            }
            _ => return Err(self.b.invalid("this pointer cannot be moved")),
        }
        Ok(pointer)
    }

    /// [`Self::advance`] in per-lane memory. An access outside of the array is undefined; an index
    /// inside makes it harmless.
    fn advance_rows(
        &mut self,
        mut pointer: Pointer,
        index: Index,
        stride: u64,
        elements: Elements,
    ) -> Result<Pointer, Error> {
        let last = match elements {
            Elements::Counted(count) => Some(u64::from(count.saturating_sub(1))),
            _ => None,
        };
        let index = match index {
            Index::Constant(index) => {
                let index = last.map_or(index, |last| index.clamp(0, last as i64));
                let step = (index as u64).wrapping_mul(stride) as u32;
                match &mut pointer.place {
                    MemoryLocation::Local { row, .. } | MemoryLocation::Input { row, .. } => {
                        *row = row.wrapping_add(step);
                    }
                    MemoryLocation::Private { constant, .. } => {
                        *constant = constant.wrapping_add(step)
                    }
                    _ => return Err(self.b.invalid("this pointer cannot be moved")),
                }
                return Ok(pointer);
            }
            Index::Value(index) => index,
        };
        if !matches!(pointer.place, MemoryLocation::Input { .. }) {
            pointer = self.materialize(pointer)?;
        }
        let index = self.at_most(index, last)?;
        let step = self.b.scale(index, stride)?;
        match &mut pointer.place {
            MemoryLocation::Private { row, .. } => {
                *row = self.b.binary(ir::Op::IAdd, *row, step)?
            }
            MemoryLocation::Input { index, .. } => *index = Some(self.add(*index, step)?),
            _ => return Err(self.b.invalid("this pointer cannot be moved")),
        }
        Ok(pointer)
    }

    /// Adds `index * stride` to an offset and its constant part, modulo 2³².
    fn move_offset(
        &mut self,
        (offset, constant): (&mut Option<Value>, &mut u32),
        index: Index,
        stride: u64,
        limits: &Limits,
    ) -> Result<(), Error> {
        let index = match index {
            Index::Constant(index) => {
                let index = limits.index.unwrap_or(u64::MAX).min(index as u64);
                *constant = constant.wrapping_add(index.wrapping_mul(stride) as u32);
                return Ok(());
            }
            Index::Value(index) => index,
        };
        let index = self.at_most(index, limits.index)?;
        let mut step = self.b.scale(index, stride)?;
        if let (Some(end), Some(offset)) = (limits.offset, *offset) {
            let end = self.b.i32(end);
            let room = self.b.binary(ir::Op::ISub, end, offset)?;
            step = self.b.binary(ir::Op::UMin, step, room)?;
        }
        *offset = Some(self.add(*offset, step)?);
        Ok(())
    }

    /// Returns the lesser of an index and `last`, as an i32.
    fn at_most(&mut self, mut index: Value, last: Option<u64>) -> Result<Value, Error> {
        let ty = self.b.ty(index);
        if let Some(last) = last.filter(|&last| last < u64::MAX >> (64 - ty.bits())) {
            let last = self.b.constant(ty, last);
            index = self.b.binary(ir::Op::UMin, index, last)?;
        }
        self.b.i32_of(index, false)
    }

    pub(super) fn add(&mut self, sum: Option<Value>, term: Value) -> Result<Value, Error> {
        match sum {
            Some(sum) => self.b.binary(ir::Op::IAdd, sum, term),
            None => Ok(term),
        }
    }

    /// A pointer to per-lane memory as a computed row: what a computed index needs.
    fn materialize(&mut self, mut pointer: Pointer) -> Result<Pointer, Error> {
        if let MemoryLocation::Input {
            variable,
            row,
            index,
        } = pointer.place
        {
            pointer.place = self.input_place(variable, Evaluation::Decorated, row, index)?;
        }
        if let MemoryLocation::Local { local, row } = pointer.place {
            let (variable, row) = self.private.locals[local].find(row);
            let address = ir::Op::VarAddress(variable);
            pointer.place = MemoryLocation::Private {
                row: self.b.emit(address, &[], Type::I32)?,
                constant: row,
            };
        }
        Ok(pointer)
    }

    /// The value form of a pointer (see [`super::types::Types::pointer_leaves`]).
    pub(super) fn pointer_scalars(&mut self, pointer: &Pointer) -> Result<Vec<Value>, Error> {
        match pointer.place {
            MemoryLocation::Global { address, constant } => {
                let constant = match constant {
                    0 => return Ok(vec![address]),
                    constant => self.b.i64(constant),
                };
                Ok(vec![self.b.binary(ir::Op::IAdd, address, constant)?])
            }
            MemoryLocation::Buffer {
                reference,
                offset,
                constant,
            } => {
                let mut offset = self.b.add_terms(offset, constant)?;
                if self.types.has_wide_offsets {
                    offset = self.b.i64_of(offset, false)?;
                }
                Ok(vec![reference, offset])
            }
            MemoryLocation::Buffer64 {
                reference,
                offset,
                constant,
            } => Ok(vec![reference, self.b.add_terms64(offset, constant)?]),
            MemoryLocation::Shared { offset, constant } => {
                Ok(vec![self.b.add_terms(offset, constant)?])
            }
            MemoryLocation::Private { row, constant } => {
                Ok(vec![self.b.add_terms(Some(row), constant)?])
            }
            MemoryLocation::Handle { .. }
            | MemoryLocation::Descriptor(_)
            | MemoryLocation::Heap { .. } => Ok(vec![self.reference(pointer)?]),
            MemoryLocation::Local { .. } | MemoryLocation::Input { .. } => {
                let pointer = self.materialize(pointer.clone())?;
                self.pointer_scalars(&pointer)
            }
            MemoryLocation::Texel { .. } => {
                Err(self.b.invalid("a texel's pointer cannot be a value"))
            }
        }
    }

    /// The pointer of a value form.
    pub(super) fn pointer_from_scalars(
        &mut self,
        ty: Id,
        values: &[Value],
    ) -> Result<Pointer, Error> {
        let (class, pointee) = self.types.pointer(ty)?;
        let place = match (class, values) {
            (
                StorageClass::PhysicalStorageBuffer | StorageClass::ShaderRecordBufferKHR,
                &[address],
            ) => MemoryLocation::Global {
                address,
                constant: 0,
            },
            (_, &[reference, offset]) if self.types.has_wide_offsets => MemoryLocation::Buffer64 {
                reference,
                offset: Some(offset),
                constant: 0,
            },
            (_, &[reference, offset]) => MemoryLocation::Buffer {
                reference,
                offset: Some(offset),
                constant: 0,
            },
            (StorageClass::UniformConstant, &[reference]) => MemoryLocation::Descriptor(reference),
            (StorageClass::Workgroup | StorageClass::TaskPayloadWorkgroupEXT, &[offset]) => {
                MemoryLocation::Shared {
                    offset: Some(offset),
                    constant: 0,
                }
            }
            (StorageClass::Input | StorageClass::Output, &[offset])
                if self.is_control() || self.is_mesh() =>
            {
                MemoryLocation::Shared {
                    offset: Some(offset),
                    constant: 0,
                }
            }
            (_, &[row]) => MemoryLocation::Private { row, constant: 0 },
            _ => return Err(self.b.invalid("a value is used as a pointer")),
        };
        Ok(Pointer::new(pointee, place))
    }
}
