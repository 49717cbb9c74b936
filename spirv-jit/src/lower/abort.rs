//! `OpAbortKHR`: ends the invocation and sends a message to the device.

use super::Lowerer;
use super::interface::Verdict;
use super::values::{MemoryLocation, Pointer, Shape};
use crate::Error;
use crate::abort::{MAX_MESSAGE_BYTES, NO_PLACE};
use crate::environment::reference;
use crate::ir::stage::Stage;
use crate::ir::{self, Node, Terminator, Type};
use crate::parse::NewerCapability;

impl Lowerer<'_> {
    /// Lowers `OpAbortKHR type, message`. The message is stored in its type's layout. Helper
    /// invocations, and those without room for a message, only end.
    pub(super) fn lower_abort(&mut self, operands: &[u32]) -> Result<Terminator, Error> {
        let declared = &self.module.newer_capabilities;
        if !declared.iter().any(|it| it.0 == NewerCapability::AbortKHR) {
            return Err(self.b.invalid("OpAbortKHR needs the capability AbortKHR"));
        }
        let &[ty, message] = operands else {
            return Err(self.b.invalid("the instruction lacks operands"));
        };
        let reference = self.b.i64(reference::of(reference::ABORTS, 0));
        let place = |offset| MemoryLocation::Buffer {
            reference,
            offset,
            constant: 0,
        };
        let bytes = self.layout_in(&place(None)).extent(ty, Shape::default())?;
        if bytes > MAX_MESSAGE_BYTES {
            let message = format!("an abort message of {bytes} bytes is not supported");
            return Err(Error::unsupported(self.b.source, message));
        }
        let size = self.b.i32(bytes as u32);
        let at = self.b.emit(ir::Op::AbortMessage, &[size], Type::I32)?;
        let none = self.b.i32(NO_PLACE);
        let has_place = self.b.compare(ir::Op::INe, at, none)?;
        let label = self.b.new_label();
        let outer = self.b.open();
        self.fill_from(Pointer::new(ty, place(Some(at))), message)?;
        self.b.emit_effect(ir::Op::Abort, &[at])?;
        let then_body = self.b.close(outer, Terminator::Br(label, Vec::new()));
        let outer = self.b.open();
        let else_body = self.b.close(outer, Terminator::Br(label, Vec::new()));
        self.b.push(Node::If {
            condition: has_place,
            label,
            results: Vec::new(),
            then_body,
            else_body,
        });
        if self.request.stage == Stage::Fragment {
            self.b.emit_effect(ir::Op::Demote, &[])?;
            return Ok(Terminator::Unreachable);
        }
        self.end_invocation(Verdict::Accept)
    }
}
