//! The entry's variables: what comes in with an invocation, what leaves with it, and how payloads, attributes and callable data are words.
//!
//! A scalar of 32 bits is a word, of 64 bits two (low first), a narrower one or a boolean the low bits of one; aggregates are their scalars in
//! order. Caller and callee agree because both derive it from the same declaration.

use rspirv::spirv::{Decoration, StorageClass};

use super::types::MAX_LEAVES;
use super::values::{Place, Pointer};
use super::{Lowerer, budget};
use crate::Error;
use crate::ir::{self, InputRow, Terminator, Type, Value};
use crate::parse::Id;
use crate::program::Stage;

/// How an any-hit invocation ends; the values are those of `ir::Module::output_rows`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    Accept = 0,
    Ignore = 1,
    Terminate = 2,
}

impl Lowerer<'_> {
    /// Notes how many words the invocation leaves.
    pub(super) fn declare_interface(&mut self) -> Result<(), Error> {
        let words = match self.output_variable() {
            Some(id) => self.variable_words(id)?,
            None => 0,
        };
        self.output_rows = words + (self.request.stage == Stage::AnyHit) as u32;
        self.place_shared()
    }

    /// The variable that goes back to the caller.
    fn output_variable(&self) -> Option<Id> {
        match self.request.stage {
            Stage::AnyHit | Stage::ClosestHit | Stage::Miss => {
                self.interface_variable(StorageClass::IncomingRayPayloadKHR)
            }
            Stage::Callable => self.interface_variable(StorageClass::IncomingCallableDataKHR),
            _ => None,
        }
    }

    /// The entry's variable of a storage class of which there is one at most.
    pub(super) fn interface_variable(&self, class: StorageClass) -> Option<Id> {
        let is_it = |id: &&Id| self.variables.get(id).is_some_and(|v| v.class == class);
        self.entry.interface.iter().find(is_it).copied()
    }

    fn variable_words(&self, id: Id) -> Result<u32, Error> {
        let rows = self.types.info(self.variables[&id].pointee)?.rows;
        if rows > MAX_LEAVES {
            return Err(budget("payloads this large are not supported"));
        }
        Ok(rows as u32)
    }

    /// Per-lane memory of a module variable; its first contents are stored in the function's prologue.
    pub(super) fn module_local(&mut self, id: Id) -> Result<usize, Error> {
        if let Some(&local) = self.module_locals.get(&id) {
            return Ok(local);
        }
        let variable = self.variables[&id];
        let name = self.module.annotations.name(id).to_owned();
        let local = self.new_local(&name, variable.pointee)?;
        self.module_locals.insert(id, local);
        let pointer = Pointer::new(variable.pointee, Place::Local { local, row: 0 });
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
            let values = self.initializer(initializer)?;
            self.store(pointer, &values)?;
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
        let next = self.inputs.len() as u32;
        let index = *self.input_index.entry(row).or_insert(next);
        if index == next {
            self.inputs.push(row);
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
                    words.push(self.b.to_i32(bits, false)?);
                }
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
            });
        }
        Ok(values)
    }

    /// Ends the invocation with its output words.
    pub(super) fn end_invocation(&mut self, verdict: Verdict) -> Result<Terminator, Error> {
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

    /// Gives each variable of workgroup memory that the entry may use its place. Blocks with an explicit layout share theirs.
    fn place_shared(&mut self) -> Result<(), Error> {
        let mut ids: Vec<Id> = self.variables.keys().copied().collect();
        ids.sort_unstable();
        let listed = self.module.version >= (1, 4);
        let mut end = 0u64;
        let mut blocks = 0u64;
        for id in ids {
            let variable = self.variables[&id];
            let unused = listed && !self.entry.interface.contains(&id);
            if variable.class != StorageClass::Workgroup || unused {
                continue;
            }
            let (size, align) = self.layout().natural(variable.pointee)?;
            let block = self
                .module
                .annotations
                .id(variable.pointee, Decoration::Block);
            if block.is_some() {
                self.shared.insert(id, 0);
                blocks = blocks.max(size);
            } else {
                let align = align.max(16);
                end = end.next_multiple_of(align);
                self.shared.insert(id, end as u32);
                end = end.saturating_add(size);
            }
            if end.max(blocks) > MAX_SHARED {
                return Err(budget("the shader has too much workgroup memory"));
            }
        }
        self.shared_size_bytes = end.max(blocks).next_multiple_of(16) as u32;
        Ok(())
    }

    /// Byte offset of a variable of workgroup memory.
    pub(super) fn shared_offset(&self, id: Id) -> Result<u32, Error> {
        let found = self.shared.get(&id).copied();
        found.ok_or_else(|| {
            self.b
                .invalid("the entry point does not list this variable")
        })
    }
}

/// Workgroup memory in bytes that lowering accepts; the device's limit is below.
const MAX_SHARED: u64 = 1 << 24;
