//! `NonSemantic.DebugPrintf`: messages of shaders.

use rspirv::spirv::Op;

use super::Lowerer;
use super::types::TypeKind;
use super::values::Val;
use crate::Error;
use crate::ir::{self, InputRow, Type, Value};
use crate::parse::{Id, Instruction, decode_string};
use crate::printf::{Argument, Message};

/// The set's name.
pub(super) const SET: &str = "NonSemantic.DebugPrintf";

/// The only instruction of the set.
const DEBUG_PRINTF: u32 = 1;

impl Lowerer<'_> {
    /// Lowers `DebugPrintf format, arguments…`. Mistakes are reported in the message, since
    /// instructions of the set cannot make a module invalid.
    pub(super) fn lower_debug_printf(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        let (Some(&DEBUG_PRINTF), Some((&format, ids)), true) = (
            operands.get(1),
            operands.get(2..).and_then(|rest| rest.split_first()),
            self.request.prints,
        ) else {
            return Ok(());
        };
        let mut arguments = Vec::new();
        let mut words = self.invocation_key()?;
        for &id in ids {
            let argument = self.printed_type(id);
            if argument.ty.is_some() {
                let values = self.leaves(id)?;
                words.extend(self.scalars_to_words(&values)?);
            }
            arguments.push(argument);
        }
        let message = Message {
            format: self.string(format),
            arguments,
        };
        let tables = &mut self.b.function.tables;
        tables.push(message.to_table());
        let table = tables.len() as u32 - 1;
        self.b.emit_effect(ir::Op::DebugPrintf(table), &words)
    }

    /// The words that identify an invocation.
    fn invocation_key(&mut self) -> Result<Vec<Value>, Error> {
        let mut words = Vec::new();
        for &(builtin, component) in self.request.stage.key() {
            let row = InputRow::Builtin(builtin, component);
            let is_float = builtin == ir::stage::Builtin::FragCoord;
            let ty = if is_float { Type::F32 } else { Type::I32 };
            let word = self.input(row, ty)?;
            words.push(match is_float {
                true => self.b.emit(ir::Op::FToS, &[word], Type::I32)?,
                false => word,
            });
        }
        Ok(words)
    }

    /// The text of an `OpString`.
    fn string(&self, id: Id) -> Option<String> {
        let definition = self.module.instruction(self.module.definition(id)?);
        let is_string = definition.opcode == Op::String;
        is_string.then(|| decode_string(self.module.operands(definition)))
    }

    /// The printed form of an argument.
    fn printed_type(&mut self, id: Id) -> Argument {
        let none = Argument {
            ty: None,
            components: 1,
        };
        let scalar = |kind: &TypeKind| match kind {
            TypeKind::Scalar { ty, .. } => Some(*ty),
            _ => None,
        };
        let Ok(ty) = self.type_of(id) else {
            return none;
        };
        let found = match self.types.kind(ty) {
            Ok(TypeKind::Vector { component, count }) => {
                let (component, count) = (*component, *count);
                let kind = self.types.kind(component).ok();
                kind.and_then(scalar).map(|ty| (ty, count))
            }
            Ok(TypeKind::Pointer { .. }) => match self.value(id) {
                Ok(Val::Pointer(_) | Val::Scalars(_)) => self.address_type(id),
                _ => None,
            },
            Ok(kind) => scalar(kind).map(|ty| (ty, 1)),
            Err(_) => None,
        };
        found.map_or(none, |(ty, components)| Argument {
            ty: Some(ty),
            components,
        })
    }

    /// The type of a physical pointer's address; other pointers have none.
    fn address_type(&mut self, id: Id) -> Option<(Type, u32)> {
        match self.leaves(id).ok()?[..] {
            [address] if self.b.ty(address) == Type::I64 => Some((Type::I64, 1)),
            _ => None,
        }
    }
}
