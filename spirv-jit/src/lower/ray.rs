//! Ray tracing instructions: the ones that suspend.

use rspirv::spirv::{Decoration, Op, StorageClass};
use smallvec::SmallVec;

use super::Lowerer;
use crate::Error;
use crate::ir::op::Trace;
use crate::ir::{self, Type, Value};
use crate::parse::{Id, Instruction};

impl Lowerer<'_> {
    pub(super) fn lower_ray(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        match instruction.opcode {
            Op::TraceRayKHR | Op::TraceNV => {
                let words = self.ray_words(operands)?;
                let payload = match instruction.opcode {
                    Op::TraceNV => self.payload_at(operands[10])?,
                    _ => operands[10],
                };
                self.call_out(ir::Op::TraceRay(Trace::new(false, false)), words, payload)
            }
            Op::TraceRayMotionNV | Op::TraceMotionNV => {
                let mut words = self.ray_words(operands)?;
                words.push(self.ray_time(operands[10])?);
                let payload = match instruction.opcode {
                    Op::TraceMotionNV => self.payload_at(operands[11])?,
                    _ => operands[11],
                };
                self.call_out(ir::Op::TraceRay(Trace::new(false, true)), words, payload)
            }
            Op::ExecuteCallableKHR | Op::ExecuteCallableNV => {
                let index = self.word(operands[0])?;
                let data = match instruction.opcode {
                    Op::ExecuteCallableNV => self.callable_data_at(operands[1])?,
                    _ => operands[1],
                };
                self.call_out(ir::Op::ExecuteCallable, vec![index], data)
            }
            _ => self.lower_report(instruction, operands),
        }
    }

    /// Only the low bits of some operands count (SPIR-V specification, `OpTraceRayKHR`): 8 of the
    /// cull mask, 4 of SBT offset and stride, 16 of the miss index.
    pub(super) fn ray_words(&mut self, operands: &[Id]) -> Result<Vec<Value>, Error> {
        let structure = self.scalar(operands[0])?;
        let mut words: Vec<Value> = self.b.unpack64(structure)?.to_vec();
        words.push(self.word(operands[1])?);
        for (&id, bits) in operands[2..6].iter().zip([8, 4, 4, 16]) {
            let word = self.word(id)?;
            let mask = self.b.i32((1 << bits) - 1);
            words.push(self.b.binary(ir::Op::And, word, mask)?);
        }
        for &id in &operands[6..10] {
            words.extend_from_slice(&self.leaves(id)?);
        }
        let floats = words[7..].iter().all(|&word| self.b.ty(word) == Type::F32);
        if words.len() != 15 || !floats {
            return Err(self.b.invalid("a ray is made of 32-bit floats"));
        }
        Ok(words)
    }

    /// The operand `Time`.
    pub(super) fn ray_time(&mut self, id: Id) -> Result<Value, Error> {
        let time = self.scalar(id)?;
        match self.b.ty(time) {
            Type::F32 => Ok(time),
            _ => Err(self.b.invalid("the time must be a 32-bit float")),
        }
    }

    /// The payload whose `Location` is a constant (`OpTraceNV`, `OpTraceMotionNV`).
    fn payload_at(&self, location: Id) -> Result<Id, Error> {
        self.variable_at(
            location,
            [
                StorageClass::RayPayloadKHR,
                StorageClass::IncomingRayPayloadKHR,
            ],
        )
    }

    /// The callable data whose `Location` is a constant (`OpExecuteCallableNV`).
    fn callable_data_at(&self, location: Id) -> Result<Id, Error> {
        self.variable_at(
            location,
            [
                StorageClass::CallableDataKHR,
                StorageClass::IncomingCallableDataKHR,
            ],
        )
    }

    /// The entry's variable at a location, in the first of two storage classes that has one.
    fn variable_at(&self, location: Id, classes: [StorageClass; 2]) -> Result<Id, Error> {
        let location = self.constants.unsigned(&self.types, location)?;
        let is_there =
            |id: Id| self.module.annotations.id(id, Decoration::Location) == Some(location);
        let of_class = |class| {
            let ids = self
                .variables
                .iter()
                .filter(move |(_, it)| it.class == class);
            ids.map(|(&id, _)| id)
                .filter(|&id| self.is_listed(id) && is_there(id))
                .min()
        };
        classes
            .into_iter()
            .find_map(of_class)
            .ok_or_else(|| self.b.invalid("no variable has this location"))
    }

    /// A yield that passes the words of a variable and receives them back.
    fn call_out(&mut self, op: ir::Op, mut words: Vec<Value>, data: Id) -> Result<(), Error> {
        let pointer = self.pointer(data)?;
        let types = self.types.leaves(pointer.pointee)?;
        let values = self.load(&pointer)?;
        let taken = self.scalars_to_words(&values)?;
        let word_types: SmallVec<[Type; 16]> = taken.iter().map(|&word| self.b.ty(word)).collect();
        words.extend(taken);
        let returned = self.b.emit_unchecked(op, &words, &word_types)?;
        let values = self.words_to_scalars(&returned, &types)?;
        self.store(&pointer, &values)
    }

    fn lower_report(&mut self, instruction: &Instruction, operands: &[Id]) -> Result<(), Error> {
        let t = self.scalar(operands[0])?;
        if self.b.ty(t) != Type::F32 {
            return Err(self.b.invalid("the hit's t must be a 32-bit float"));
        }
        let mut words = vec![t, self.word(operands[1])?];
        if let Some(attribute) = self.interface_variable(StorageClass::HitAttributeKHR) {
            let pointer = self.module_pointer(attribute)?;
            let values = self.load(&pointer)?;
            words.extend(self.scalars_to_words(&values)?);
        }
        let op = ir::Op::ReportIntersection;
        let accepted = self.b.emit_unchecked(op, &words, &[Type::I1])?;
        if let Some(variable) = self.stage.ray_tmax {
            let before = self.load_rows(variable, &[Type::F32])?[0];
            let after = self.b.select(accepted[0], t, before)?;
            self.store_rows(variable, &[after])?;
        }
        self.define_typed(instruction, vec![accepted[0]])
    }

    /// A 32-bit integer operand.
    pub(super) fn word(&mut self, id: Id) -> Result<Value, Error> {
        let value = self.scalar(id)?;
        match self.b.ty(value) {
            Type::I32 => Ok(value),
            _ => Err(self.b.invalid("a 32-bit integer is expected")),
        }
    }
}
