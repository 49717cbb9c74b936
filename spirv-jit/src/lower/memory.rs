//! Loads, stores and copies.

use rspirv::spirv::{MemoryAccess, Op};
use smallvec::SmallVec;

use super::Lowerer;
use super::stage_interface::Evaluation;
use super::types::{MAX_LEAVES, TypeKind, UNTYPED};
use super::values::{Handles, MemoryLocation, Pointer, Scalars, Val, Values};
use crate::Error;
use crate::ir::op::Access;
use crate::ir::{self, Space, Type, Value};
use crate::parse::{Id, Instruction, opcode_name};

/// Scalars that one load or store moves at most.
const MAX_RUN: usize = 16;

/// Consecutive scalars of one type: index of the first in the value, offset (bytes or rows) of the
/// first in memory.
struct Run {
    first: usize,
    count: usize,
    ty: Type,
    offset: u64,
}

/// Groups scalars that are consecutive in memory. `step` is a scalar's size in the memory's unit.
fn find_runs(leaves: &[(Type, u64)], step: impl Fn(Type) -> u64) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for (index, &(ty, offset)) in leaves.iter().enumerate() {
        if let Some(run) = runs.last_mut()
            && run.ty == ty
            && run.count < MAX_RUN
            && offset == run.offset.wrapping_add(run.count as u64 * step(ty))
        {
            run.count += 1;
        } else {
            runs.push(Run {
                first: index,
                count: 1,
                ty,
                offset,
            });
        }
    }
    runs
}

/// Row of each scalar of per-lane memory.
fn row_leaves(types: &[Type]) -> Vec<(Type, u64)> {
    let mut row = 0;
    let at = |&ty: &Type| {
        let leaf = (ty, row);
        row += ty.rows() as u64;
        leaf
    };
    types.iter().map(at).collect()
}

/// Booleans outside per-lane memory are words.
fn stored(ty: Type) -> Type {
    if ty == Type::I1 { Type::I32 } else { ty }
}

impl Lowerer<'_> {
    /// Loads the scalars of a pointee.
    pub(super) fn load(&mut self, pointer: &Pointer) -> Result<Values, Error> {
        let ty = pointer.pointee;
        match &pointer.place {
            MemoryLocation::Local { local, row } => {
                let types = self.types.leaves(ty)?;
                let mut values = Values::with_capacity(types.len());
                let mut at = *row;
                for &ty in types.iter() {
                    let (variable, row) = self.private.locals[*local].find(at);
                    let op = ir::Op::VarLoad(variable, row);
                    values.push(self.b.emit_one(op, &[], ty)?);
                    at += ty.rows();
                }
                Ok(values)
            }
            &MemoryLocation::Input {
                variable,
                row,
                index,
            } => {
                let at = Evaluation::of(pointer);
                self.load_input(variable, row, index, ty, at)
            }
            MemoryLocation::Handle { .. }
            | MemoryLocation::Descriptor(_)
            | MemoryLocation::Heap { .. } => self.load_handle(pointer).map(Values::from),
            MemoryLocation::Texel { .. } => {
                Err(self.b.invalid("a texel is not loaded through a pointer"))
            }
            MemoryLocation::Private { .. } => {
                let types = self.types.leaves(ty)?;
                let leaves = row_leaves(&types);
                self.load_runs(pointer, &leaves, |ty| ty.rows() as u64)
            }
            MemoryLocation::Shared { .. }
            | MemoryLocation::Buffer { .. }
            | MemoryLocation::Buffer64 { .. }
            | MemoryLocation::Global { .. } => {
                let leaves = self.layout_in(&pointer.place).leaves(ty, pointer.shape)?;
                self.load_runs(pointer, &leaves, |ty| ty.size_bytes() as u64)
            }
        }
    }

    pub(super) fn load_runs(
        &mut self,
        pointer: &Pointer,
        leaves: &[(Type, u64)],
        step: impl Fn(Type) -> u64,
    ) -> Result<Values, Error> {
        let mut values = Values::with_capacity(leaves.len());
        let space = space(pointer);
        for run in find_runs(leaves, step) {
            let address = self.address(pointer, run.offset)?;
            let ty = if space == Space::Private {
                run.ty
            } else {
                stored(run.ty)
            };
            let types: SmallVec<[Type; MAX_RUN]> = SmallVec::from_elem(ty, run.count);
            let loaded = self.b.load(access(pointer, run.offset), &address, &types)?;
            for value in loaded {
                values.push(if ty == run.ty {
                    value
                } else {
                    self.word_to_bool(value)?
                });
            }
        }
        Ok(values)
    }

    /// Stores to a pointee.
    pub(super) fn store(&mut self, pointer: &Pointer, values: &[Value]) -> Result<(), Error> {
        let ty = pointer.pointee;
        let types = self.types.leaves(ty)?;
        let fits = types.len() == values.len()
            && types
                .iter()
                .zip(values)
                .all(|(&ty, &value)| self.b.ty(value) == ty);
        if !fits {
            return Err(self
                .b
                .invalid("the stored object does not have the pointee's type"));
        }
        match &pointer.place {
            MemoryLocation::Local { local, row } => {
                let mut at = *row;
                for (&ty, &value) in types.iter().zip(values) {
                    let (variable, row) = self.private.locals[*local].find(at);
                    self.b
                        .emit_effect(ir::Op::VarStore(variable, row), &[value])?;
                    at += ty.rows();
                }
                Ok(())
            }
            MemoryLocation::Private { .. } => {
                let leaves = row_leaves(&types);
                self.store_runs(pointer, &leaves, values, |ty| ty.rows() as u64)
            }
            MemoryLocation::Shared { .. }
            | MemoryLocation::Buffer { .. }
            | MemoryLocation::Buffer64 { .. }
            | MemoryLocation::Global { .. } => {
                let leaves = self.layout_in(&pointer.place).leaves(ty, pointer.shape)?;
                self.store_runs(pointer, &leaves, values, |ty| ty.size_bytes() as u64)
            }
            _ => Err(self.b.invalid("this memory cannot be written")),
        }
    }

    fn store_runs(
        &mut self,
        pointer: &Pointer,
        leaves: &[(Type, u64)],
        values: &[Value],
        step: impl Fn(Type) -> u64,
    ) -> Result<(), Error> {
        let space = space(pointer);
        for run in find_runs(leaves, step) {
            let address = self.address(pointer, run.offset)?;
            let mut words: SmallVec<[Value; MAX_RUN]> = SmallVec::new();
            for &value in &values[run.first..run.first + run.count] {
                let keep = space == Space::Private || run.ty != Type::I1;
                words.push(if keep {
                    value
                } else {
                    self.bool_to_word(value)?
                });
            }
            let access = Access {
                constant: false,
                ..access(pointer, run.offset)
            };
            self.b.store(access, &address, &words)?;
        }
        Ok(())
    }

    /// Address operands of memory at an offset in bytes, or rows, from a pointer.
    pub(super) fn address(
        &mut self,
        pointer: &Pointer,
        more: u64,
    ) -> Result<SmallVec<[Value; 2]>, Error> {
        let more32 = more as u32;
        Ok(match pointer.place {
            MemoryLocation::Private { row, constant } => {
                let row = self.b.add_terms(Some(row), constant.wrapping_add(more32))?;
                SmallVec::from_slice(&[row])
            }
            MemoryLocation::Shared { offset, constant } => {
                let offset = self.b.add_terms(offset, constant.wrapping_add(more32))?;
                SmallVec::from_slice(&[offset])
            }
            MemoryLocation::Buffer {
                reference,
                offset,
                constant,
            } => {
                let descriptor = self.b.descriptor(reference)?;
                let offset = self.b.add_terms(offset, constant.wrapping_add(more32))?;
                SmallVec::from_slice(&[descriptor, offset])
            }
            MemoryLocation::Buffer64 {
                reference,
                offset,
                constant,
            } => {
                let descriptor = self.b.descriptor(reference)?;
                let offset = self.b.add_terms64(offset, constant.wrapping_add(more))?;
                SmallVec::from_slice(&[descriptor, offset])
            }
            MemoryLocation::Global { address, constant } => {
                let total = constant.wrapping_add(more);
                if total == 0 {
                    return Ok(SmallVec::from_slice(&[address]));
                }
                let total = self.b.i64(total);
                SmallVec::from_slice(&[self.b.binary(ir::Op::IAdd, address, total)?])
            }
            _ => return Err(self.b.invalid("this pointer has no address")),
        })
    }

    /// A descriptor as a value: references for images and samplers, a device address for an
    /// acceleration structure.
    fn load_handle(&mut self, pointer: &Pointer) -> Result<Vec<Value>, Error> {
        if let MemoryLocation::Handle {
            binding: Handles::Mapped(at),
            index,
            constant,
        } = pointer.place
        {
            let mapping = &self.request.mappings[at];
            return self.load_mapped(mapping, pointer.pointee, (index, constant));
        }
        let reference = self.reference(pointer)?;
        match self.types.kind(pointer.pointee)? {
            TypeKind::Image(_) | TypeKind::Sampler => Ok(vec![reference]),
            TypeKind::SampledImage { .. }
                if matches!(pointer.place, MemoryLocation::Descriptor(_)) =>
            {
                self.combined_references(reference)
            }
            TypeKind::SampledImage { .. } => Ok(vec![reference, reference]),
            TypeKind::AccelerationStructure => {
                let descriptor = self.b.descriptor(reference)?;
                let op = ir::Op::DescriptorAddress;
                Ok(vec![self.b.emit(op, &[descriptor], Type::I64)?])
            }
            _ => Err(self.b.invalid("this variable cannot be loaded")),
        }
    }

    pub(super) fn bool_to_word(&mut self, value: Value) -> Result<Value, Error> {
        let (one, zero) = (self.b.i32(1), self.b.i32(0));
        self.b.select(value, one, zero)
    }

    pub(super) fn word_to_bool(&mut self, word: Value) -> Result<Value, Error> {
        let zero = self.b.i32(0);
        self.b.compare(ir::Op::INe, word, zero)
    }

    /// A pointer as memory operands modify it.
    pub(super) fn with_access(&self, mut pointer: Pointer, operands: &[u32]) -> Pointer {
        let bits = operands.first().copied().unwrap_or(0);
        let access = MemoryAccess::from_bits_truncate(bits);
        pointer.volatile |= access.contains(MemoryAccess::VOLATILE);
        let is_checked = self.request.checks_alignment && space(&pointer) == Space::Global;
        if access.contains(MemoryAccess::ALIGNED) && is_checked {
            let bytes = operands.get(1).copied().unwrap_or(1);
            pointer.alignment = bytes.checked_ilog2().unwrap_or(0) as u8;
        }
        pointer
    }

    pub(super) fn lower_memory(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        match instruction.opcode {
            Op::Variable => self.lower_variable(instruction, operands),
            Op::Load => {
                let pointer = self.pointer_to(operands[0], instruction.result_type)?;
                let pointer = self.with_access(pointer, &operands[1..]);
                let values = self.load(&pointer)?;
                self.define_typed(instruction, values)
            }
            Op::Store => {
                let pointer = self.pointer_to(operands[0], self.moved_type(instruction)?)?;
                let pointer = self.with_access(pointer, &operands[2..]);
                self.check_opaque(operands[1], pointer.pointee)?;
                let values = self.leaves(operands[1])?;
                self.store(&pointer, &values)
            }
            Op::CopyMemory => {
                let (target, source) = self.copied(instruction)?;
                let values = self.load(&source)?;
                self.store(&target, &values)
            }
            Op::CopyMemorySized => {
                let target = self.pointer(operands[0])?;
                let target = self.with_access(target, &operands[3..]);
                let source = self.pointer(operands[1])?;
                let source = self.with_access(source, &operands[3..]);
                if self.constants.find(operands[2]).is_none() {
                    let message = "a copy of memory whose size is no constant is not supported";
                    return Err(Error::unsupported(instruction.offset, message));
                }
                let bytes = self.constants.unsigned(&self.types, operands[2])?;
                self.copy_bytes(&target, &source, bytes.into())
            }
            other => Err(self
                .b
                .invalid(format!("Op{} is no memory operation", opcode_name(other)))),
        }
    }

    /// The type of the data that `OpStore` or `OpCopyMemory` moves: the pointer's, or the data's if
    /// the pointer is untyped.
    pub(super) fn moved_type(&self, instruction: &Instruction) -> Result<Id, Error> {
        let operands = self.module.operands(instruction);
        let pointee = |id: Id| Ok::<_, Error>(self.types.pointer(self.type_of(id)?)?.1);
        match pointee(operands[0])? {
            UNTYPED if instruction.opcode == Op::Store => self.type_of(operands[1]),
            UNTYPED => pointee(operands[1]),
            pointee => Ok(pointee),
        }
    }

    /// Target and source of `OpCopyMemory`.
    pub(super) fn copied(
        &mut self,
        instruction: &Instruction,
    ) -> Result<(Pointer, Pointer), Error> {
        let operands = self.module.operands(instruction);
        let ty = self.moved_type(instruction)?;
        let target = self.pointer_to(operands[0], ty)?;
        let target = self.with_access(target, &operands[2..]);
        let source = self.pointer_to(operands[1], ty)?;
        let source = self.with_access(source, &operands[2..]);
        if target.pointee != source.pointee {
            self.refuse_opaque(target.pointee)?;
        }
        Ok((target, source))
    }

    /// Copies bytes, as whole words where possible.
    fn copy_bytes(&mut self, target: &Pointer, source: &Pointer, bytes: u64) -> Result<(), Error> {
        for pointer in [target, source] {
            if space(pointer) == Space::Private {
                return Err(self
                    .b
                    .invalid("bytes are copied to or from memory without a layout"));
            }
        }
        if bytes.div_ceil(4) > MAX_LEAVES {
            return Err(super::budget("a copy of that many bytes is not supported"));
        }
        let words = (0..bytes / 4).map(|word| (Type::I32, 4 * word));
        let rest = (bytes / 4 * 4..bytes).map(|byte| (Type::I8, byte));
        let leaves: Vec<_> = words.chain(rest).collect();
        let size = |ty: Type| ty.size_bytes() as u64;
        let values = self.load_runs(source, &leaves, size)?;
        self.store_runs(target, &leaves, &values, size)
    }

    fn lower_variable(&mut self, instruction: &Instruction, operands: &[u32]) -> Result<(), Error> {
        let (_, pointee) = self.types.pointer(instruction.result_type)?;
        if let Some(&initializer) = operands.get(1) {
            self.check_opaque(initializer, pointee)?;
        }
        let name = self.module.annotations.name(instruction.result).to_owned();
        let local = self.new_local(&name, pointee)?;
        let pointer = Pointer::new(pointee, MemoryLocation::Local { local, row: 0 });
        if let Some(&initializer) = operands.get(1) {
            let values = self.leaves(initializer)?;
            self.store(&pointer, &values)?;
        }
        self.define(instruction.result, Val::Pointer(pointer))
    }

    /// Defines an instruction's result, whose scalars must be those of its type.
    pub(super) fn define_typed(
        &mut self,
        instruction: &Instruction,
        values: impl AsRef<[Value]>,
    ) -> Result<(), Error> {
        let values = values.as_ref();
        let types = self.types.leaves(instruction.result_type)?;
        let fits = types.len() == values.len()
            && types
                .iter()
                .zip(values)
                .all(|(&ty, &value)| self.b.ty(value) == ty);
        if !fits {
            let name = opcode_name(instruction.opcode);
            let message = format!("the result of Op{name} has another type");
            return Err(self.b.invalid(message));
        }
        let scalars = match self.is_flushed(instruction.opcode) {
            true => self.flush_denormals(values)?,
            false => values.into(),
        };
        self.define(instruction.result, Val::Scalars(scalars))
    }

    /// The scalars of a variable's initializer.
    pub(super) fn initializer(&mut self, id: Id) -> Result<Scalars, Error> {
        if self.variables.contains_key(&id) {
            let pointer = self.module_pointer(id)?;
            return Ok(self.pointer_scalars(&pointer)?[..].into());
        }
        let constant = self.constants.find(id).map(|constant| constant.ty);
        let Some(ty) = constant else {
            return Err(self
                .b
                .invalid("an initializer must be a constant or a variable"));
        };
        let bits = self.constants.bits(&self.types, id)?;
        let types = self.types.leaves(ty)?;
        let pairs = types.iter().zip(bits.iter());
        Ok(pairs
            .map(|(&ty, &bits)| self.b.constant(ty, bits))
            .collect())
    }
}

/// The access at an offset from a pointer, with the alignment of the pointer and the offset.
pub(super) fn access(pointer: &Pointer, offset: u64) -> Access {
    Access {
        space: space(pointer),
        volatile: pointer.volatile,
        constant: pointer.constant && !pointer.volatile,
        alignment: pointer.alignment.min(offset.trailing_zeros() as u8),
        is_strided: false,
    }
}

pub(super) fn space(pointer: &Pointer) -> Space {
    match pointer.place {
        MemoryLocation::Shared { .. } => Space::Shared,
        MemoryLocation::Buffer { .. } => Space::Buffer,
        MemoryLocation::Buffer64 { .. } => Space::Buffer64,
        MemoryLocation::Global { .. } => Space::Global,
        _ => Space::Private,
    }
}
