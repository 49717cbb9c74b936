//! Function calls.

use super::Lowerer;
use super::values::Val;
use crate::Error;
use crate::parse::Instruction;

impl Lowerer<'_> {
    /// Lowers a call in place: logical pointers stay known, and memory of the caller stays promotable.
    pub(super) fn lower_call(&mut self, instruction: &Instruction) -> Result<(), Error> {
        let operands = self.module.operands(instruction);
        let arguments: Vec<Val> = operands[1..]
            .iter()
            .map(|&id| self.value(id))
            .collect::<Result<_, _>>()?;
        let results = self.lower_inline(operands[0], arguments)?;
        self.b.source = instruction.offset;
        self.define_typed(instruction, results)
    }
}
