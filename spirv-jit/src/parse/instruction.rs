//! Instructions as offsets into a module's words.

#![forbid(unsafe_code)]

use rspirv::spirv::Op;

/// A SPIR-V id; 0 is none.
pub type Id = u32;

/// An instruction as offsets into the module's words.
#[derive(Clone, Copy, Debug)]
pub struct Instruction {
    pub opcode: Op,
    /// 0 if the instruction has none.
    pub result_type: Id,
    /// 0 if the instruction has none.
    pub result: Id,
    /// Offset of the instruction's first word.
    pub offset: u32,
    /// Offset of the first operand after result type and result.
    pub(super) first_operand: u32,
    pub(super) end: u32,
    pub(super) first_use: u32,
    pub(super) end_use: u32,
}

impl Instruction {
    /// Operand words after result type and result.
    pub fn operands<'w>(&self, words: &'w [u32]) -> &'w [u32] {
        &words[self.first_operand as usize..self.end as usize]
    }
}

/// All instructions in order, and the ids they use.
pub(super) struct InstructionTable {
    pub instructions: Vec<Instruction>,
    pub uses: Vec<Id>,
}

/// A literal string of operand words: UTF-8, low byte first, up to its zero byte.
pub(crate) fn decode_string(words: &[u32]) -> String {
    let bytes: Vec<u8> = words
        .iter()
        .flat_map(|word| word.to_le_bytes())
        .take_while(|&byte| byte != 0)
        .collect();
    String::from_utf8_lossy(&bytes).into_owned()
}
