//! The entry's variables: inputs and outputs of an invocation, and the word form of payloads,
//! attributes and callable data.
//!
//! A scalar of 32 bits is one word, of 64 bits two words (low first); narrower scalars and booleans
//! are the low bits of a word. Aggregates are their scalars in order. Caller and callee agree
//! because both derive the form from the same declaration.

use rspirv::spirv::{BuiltIn, Decoration, StorageClass};

use super::types::MAX_LEAVES;
use super::values::{MemoryLocation, Pointer};
use super::{Lowerer, budget};
use crate::Error;
use crate::ir::op::Access;
use crate::ir::stage::{Builtin, Stage};
use crate::ir::{self, InputRow, Space, Terminator, Type, Value};
use crate::parse::Id;

/// The outcome of an any-hit invocation, as in `ir::Module::output_rows`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    Accept = 0,
    Ignore = 1,
    Terminate = 2,
}

impl Lowerer<'_> {
    /// Sets the number of words that the invocation returns.
    pub(super) fn declare_interface(&mut self) -> Result<(), Error> {
        let words = match self.output_variable() {
            Some(id) => self.variable_words(id)?,
            None => 0,
        };
        self.interface.output_rows = words + (self.request.stage == Stage::AnyHit) as u32;
        if self.is_rasterized() {
            if !self.is_control() && !self.is_mesh() {
                self.declare_outputs()?;
            }
            self.declare_tessellation()?;
            self.declare_emission()?;
        }
        self.declare_mesh()?;
        self.declare_ray_tmax()?;
        self.place_shared()?;
        self.clear_shared()
    }

    /// The variable that the invocation returns to the caller.
    pub(super) fn output_variable(&self) -> Option<Id> {
        match self.request.stage {
            Stage::AnyHit | Stage::ClosestHit | Stage::Miss => {
                self.interface_variable(StorageClass::IncomingRayPayloadKHR)
            }
            Stage::Callable => self.interface_variable(StorageClass::IncomingCallableDataKHR),
            _ => None,
        }
    }

    /// The entry's variable of a storage class with at most one variable.
    pub(super) fn interface_variable(&self, class: StorageClass) -> Option<Id> {
        let of_class = self.variables.iter().filter(|(_, v)| v.class == class);
        of_class
            .map(|(&id, _)| id)
            .filter(|&id| self.is_listed(id))
            .min()
    }

    /// Whether the entry point may use a variable. Before SPIR-V 1.4 only inputs and outputs are
    /// listed.
    pub(super) fn is_listed(&self, id: Id) -> bool {
        self.module.version < (1, 4) || self.entry.interface.contains(&id)
    }

    /// `RayTmaxKHR` of an intersection shader shrinks with each hit that it reports (SPIR-V's
    /// `Volatile` decoration says so).
    fn declare_ray_tmax(&mut self) -> Result<(), Error> {
        let is_ray_tmax = |id: &Id| {
            let built_in = self.module.annotations.id(*id, Decoration::BuiltIn);
            built_in == Some(BuiltIn::RayTmaxKHR as u32)
        };
        let read = self.entry.interface.iter().any(is_ray_tmax);
        if self.request.stage != Stage::Intersection || !read {
            return Ok(());
        }
        let variable = self.new_rows("ray_tmax", 1)?;
        let first = self.input(InputRow::Builtin(Builtin::RayTmax, 0), Type::F32)?;
        self.store_rows(variable, &[first])?;
        self.stage.ray_tmax = Some(variable);
        Ok(())
    }

    fn variable_words(&self, id: Id) -> Result<u32, Error> {
        let rows = self.types.info(self.variables[&id].pointee)?.rows;
        if rows > MAX_LEAVES {
            return Err(budget("payloads this large are not supported"));
        }
        Ok(rows as u32)
    }

    /// Per-lane memory of a module variable; its first contents are stored in the function's
    /// prologue.
    pub(super) fn module_local(&mut self, id: Id) -> Result<usize, Error> {
        if let Some(&local) = self.private.module_locals.get(&id) {
            return Ok(local);
        }
        let variable = self.variables[&id];
        let name = self.module.annotations.name(id).to_owned();
        let local = self.new_local(&name, variable.pointee)?;
        self.private.module_locals.insert(id, local);
        let pointer = Pointer::new(variable.pointee, MemoryLocation::Local { local, row: 0 });
        let incoming: Option<fn(u32) -> InputRow> = match variable.class {
            StorageClass::IncomingRayPayloadKHR => Some(InputRow::Payload),
            StorageClass::IncomingCallableDataKHR => Some(InputRow::CallableData),
            StorageClass::HitAttributeKHR if self.request.stage != Stage::Intersection => {
                Some(InputRow::HitAttribute)
            }
            _ => None,
        };
        let nodes = self.b.enter_prologue();
        let stored = self.initialize_module_local(&pointer, variable.initializer, incoming);
        self.b.leave_prologue(nodes);
        stored?;
        Ok(local)
    }

    fn initialize_module_local(
        &mut self,
        pointer: &Pointer,
        initializer: Option<Id>,
        incoming: Option<fn(u32) -> InputRow>,
    ) -> Result<(), Error> {
        if let Some(initializer) = initializer {
            self.check_opaque(initializer, pointer.pointee)?;
            if self.is_large(pointer.pointee) {
                self.fill_from(pointer.clone(), initializer)?;
            } else {
                let values = self.initializer(initializer)?;
                self.store(pointer, &values)?;
            }
        }
        if let Some(row) = incoming {
            let types = self.types.leaves(pointer.pointee)?;
            let mut words = Vec::new();
            for index in 0..types.iter().map(|ty| ty.rows()).sum() {
                words.push(self.input(row(index), Type::I32)?);
            }
            let values = self.words_to_scalars(&words, &types)?;
            self.store(pointer, &values)?;
        }
        Ok(())
    }

    /// A row of the input record.
    pub(super) fn input(&mut self, row: InputRow, ty: Type) -> Result<Value, Error> {
        let next = self.interface.inputs.len() as u32;
        let index = *self.interface.input_index.entry(row).or_insert(next);
        if index == next {
            self.interface.inputs.push(row);
        }
        Ok(self.b.emit_unchecked(ir::Op::Input(index), &[], &[ty])?[0])
    }

    /// Scalars as 32-bit words.
    pub(super) fn scalars_to_words(&mut self, values: &[Value]) -> Result<Vec<Value>, Error> {
        let mut words = Vec::with_capacity(values.len());
        for &value in values {
            match self.b.ty(value) {
                Type::I32 | Type::F32 => words.push(value),
                Type::I64 | Type::F64 => words.extend(self.b.unpack64(value)?),
                Type::I1 => words.push(self.bool_to_word(value)?),
                Type::I8 | Type::I16 | Type::F16 => {
                    let bits = self.b.as_integer(value)?;
                    words.push(self.b.i32_of(bits, false)?);
                }
                Type::Descriptor => return Err(self.b.invalid("a descriptor is no word")),
            }
        }
        Ok(words)
    }

    /// 32-bit words as scalars of the given types.
    pub(super) fn words_to_scalars(
        &mut self,
        words: &[Value],
        types: &[Type],
    ) -> Result<Vec<Value>, Error> {
        let mut words = words.iter().copied();
        let mut next = |lowerer: &Self| {
            let word = words.next();
            word.ok_or_else(|| lowerer.b.invalid("a value lacks words"))
        };
        let mut values = Vec::with_capacity(types.len());
        for &ty in types {
            let word = next(self)?;
            values.push(match ty {
                Type::I32 | Type::F32 if self.b.ty(word) == ty => word,
                Type::I32 | Type::F32 => self.b.emit(ir::Op::Bitcast, &[word], ty)?,
                Type::I64 | Type::F64 => {
                    let high = next(self)?;
                    self.b.pack64(word, high, ty)?
                }
                Type::I1 => self.word_to_bool(word)?,
                Type::I8 | Type::I16 => self.b.emit(ir::Op::UConvert, &[word], ty)?,
                Type::F16 => {
                    let bits = self.b.emit(ir::Op::UConvert, &[word], Type::I16)?;
                    self.b.emit(ir::Op::Bitcast, &[bits], ty)?
                }
                Type::Descriptor => return Err(self.b.invalid("a descriptor is no word")),
            });
        }
        Ok(values)
    }

    /// Ends the invocation with its output words.
    pub(super) fn end_invocation(&mut self, verdict: Verdict) -> Result<Terminator, Error> {
        if let Some(emission) = &self.stage.emission {
            let count = ir::Op::VarLoad(emission.variable, 0);
            let count = self.b.emit(count, &[], Type::I32)?;
            return Ok(Terminator::End(vec![count]));
        }
        if self.is_rasterized() {
            return self.output_words().map(Terminator::End);
        }
        let mut words = Vec::new();
        if self.request.stage == Stage::AnyHit {
            words.push(self.b.i32(verdict as u32));
        }
        if let Some(id) = self.output_variable() {
            let pointer = self.module_pointer(id)?;
            let values = self.load(&pointer)?;
            words.extend(self.scalars_to_words(&values)?);
        }
        Ok(Terminator::End(words))
    }

    /// Assigns an offset to each workgroup variable of the entry. `Aliased` blocks share one. They
    /// follow the interface of a mesh shader.
    fn place_shared(&mut self) -> Result<(), Error> {
        if !self.request.stage.has_workgroups() {
            return Ok(());
        }
        let base = u64::from(self.workgroup.size_bytes);
        self.workgroup.base = self.workgroup.size_bytes;
        let mut ids: Vec<Id> = self.variables.keys().copied().collect();
        ids.sort_unstable();
        ids.retain(|&id| {
            self.variables[&id].class == StorageClass::Workgroup && self.is_listed(id)
        });
        let annotations = &self.module.annotations;
        let is_block = |pointee| annotations.id(pointee, Decoration::Block).is_some();
        self.workgroup.has_layout = (ids.iter()).any(|id| is_block(self.variables[id].pointee));
        let is_aliased = |id: Id| {
            let is_aliased = annotations.id(id, Decoration::Aliased).is_some();
            is_aliased && is_block(self.variables[&id].pointee)
        };
        // Other variables follow the shared ones.
        ids.sort_by_key(|&id| !is_aliased(id));
        let mut end = base;
        for id in ids {
            let (size, align) = (self.shared_layout()).natural(self.variables[&id].pointee)?;
            let start = match is_aliased(id) {
                true => base,
                false => end.next_multiple_of(align.max(16)),
            };
            self.workgroup.offsets.insert(id, start as u32);
            end = end.max(start.saturating_add(size));
            if end > ir::MAX_SHARED_BYTES.into() {
                return Err(budget("the shader has too much workgroup memory"));
            }
        }
        self.workgroup.size_bytes = end.next_multiple_of(16) as u32;
        Ok(())
    }

    /// Workgroup memory with a (null) initializer is cleared by all invocations together before the
    /// shader starts.
    fn clear_shared(&mut self) -> Result<(), Error> {
        let initialized = |id: &Id| {
            let variable = &self.variables[id];
            variable.class == StorageClass::Workgroup && variable.initializer.is_some()
        };
        if !self.workgroup.offsets.keys().any(initialized) {
            return Ok(());
        }
        let size: u32 = self.local_size()?.iter().product();
        let index = InputRow::Builtin(Builtin::LocalInvocationIndex, 0);
        let index = self.input(index, Type::I32)?;
        let first = self.b.scale(index, 16)?;
        let base = self.b.i32(self.workgroup.base);
        let first = self.b.binary(ir::Op::IAdd, first, base)?;
        let (step, end) = (self.b.i32(16 * size), self.b.i32(self.workgroup.size_bytes));
        let zero = self.b.i32(0);
        let counted = self.b.open_loop(first);
        let at = counted.number;
        let inside = self.b.compare(ir::Op::ULt, at, end)?;
        self.b.leave_unless(&counted, inside);
        self.b
            .store(Access::plain(Space::Shared), &[at], &[zero; 4])?;
        self.b.close_loop(counted, step)?;
        self.b.emit_effect(ir::Op::MemoryBarrier, &[])?;
        self.b.emit_effect(ir::Op::Barrier, &[])
    }

    /// Byte offset of a variable of workgroup memory.
    pub(super) fn shared_offset(&self, id: Id) -> Result<u32, Error> {
        let stage = self.request.stage;
        if !stage.has_workgroups() {
            let message = format!("there is no workgroup memory in a {stage:?} shader");
            return Err(self.b.invalid(message));
        }
        let found = self.workgroup.offsets.get(&id).copied();
        found.ok_or_else(|| {
            self.b
                .invalid("the entry point does not list this variable")
        })
    }
}
