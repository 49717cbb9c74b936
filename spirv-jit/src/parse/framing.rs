//! Checks before the grammar: header, word counts, and the operations of specialization constants.

use rspirv::spirv::{self, Op};

use crate::Error;

/// Words of a module's header.
const HEADER_WORDS: usize = 5;

/// Largest result-id bound (SPIR-V specification, section Universal Limits).
const MAX_BOUND: u32 = 0x3f_ffff;

/// An instruction's offset and number of words.
#[derive(Clone, Copy)]
pub(super) struct InstructionSpan {
    pub offset: u32,
    pub count: u16,
    /// `OpSpecConstantOp` with an allowed operation.
    pub is_specialized: bool,
    /// Trailing ids that `rspirv`'s grammar lacks.
    pub newer_ids: u16,
}

/// Operands that `rspirv`'s grammar lacks: the hit kind of `OpHitObjectRecordFromQueryEXT`
/// (revision 3 of `SPV_EXT_shader_invocation_reorder`).
fn newer_ids(opcode: u32, count: u16) -> u16 {
    (opcode == Op::HitObjectRecordFromQueryEXT as u32 && count == 6) as u16
}

/// Splits the words into instructions.
pub(super) fn check_framing(words: &[u32]) -> Result<Vec<InstructionSpan>, Error> {
    if words.len() < HEADER_WORDS || words[0] != spirv::MAGIC_NUMBER {
        return Err(Error::invalid(0, "this is not a SPIR-V module"));
    }
    if words.len() > u32::MAX as usize / 8 {
        return Err(Error::invalid(0, "the module is too large"));
    }
    let (major, minor) = version(words);
    if major != 1 || minor > 6 {
        return Err(Error::unsupported(
            1,
            format!("SPIR-V {major}.{minor} is not supported"),
        ));
    }
    let bound = words[3];
    // The bound determines the size of tables, with 4 bytes for each id.
    if bound == 0 || bound > MAX_BOUND {
        return Err(Error::invalid(
            3,
            format!("id bound {bound} is out of range"),
        ));
    }
    let mut frames = Vec::with_capacity(words.len() / 4);
    let mut offset = HEADER_WORDS;
    while offset < words.len() {
        let count = (words[offset] >> 16) as u16;
        if count == 0 || offset + count as usize > words.len() {
            return Err(Error::invalid(
                offset as u32,
                format!("instruction of {count} words does not fit"),
            ));
        }
        let opcode = words[offset] & 0xffff;
        check_nested_opcode(words, offset, opcode)?;
        frames.push(InstructionSpan {
            offset: offset as u32,
            count,
            is_specialized: opcode == Op::SpecConstantOp as u32,
            newer_ids: newer_ids(opcode, count),
        });
        offset += count as usize;
    }
    Ok(frames)
}

/// Major and minor version of the module.
pub(super) fn version(words: &[u32]) -> (u8, u8) {
    ((words[1] >> 16) as u8, (words[1] >> 8) as u8)
}

/// Checks the operation of `OpSpecConstantOp`, whose operands `rspirv` decodes unchecked.
fn check_nested_opcode(words: &[u32], offset: usize, opcode: u32) -> Result<(), Error> {
    if opcode != Op::SpecConstantOp as u32 {
        return Ok(());
    }
    let count = (words[offset] >> 16) as usize;
    let nested = if count > 3 {
        Op::from_u32(words[offset + 3])
    } else {
        None
    };
    match nested {
        Some(nested) if may_be_specialized(nested) => Ok(()),
        _ => Err(Error::invalid(
            offset as u32,
            "this operation is not allowed in a specialization constant",
        )),
    }
}

/// Operations of `OpSpecConstantOp` (SPIR-V specification, section Constant-Creation Instructions;
/// the ones for kernels left out).
fn may_be_specialized(opcode: Op) -> bool {
    matches!(
        opcode,
        Op::SConvert
            | Op::UConvert
            | Op::FConvert
            | Op::QuantizeToF16
            | Op::SNegate
            | Op::Not
            | Op::IAdd
            | Op::ISub
            | Op::IMul
            | Op::UDiv
            | Op::SDiv
            | Op::UMod
            | Op::SRem
            | Op::SMod
            | Op::ShiftRightLogical
            | Op::ShiftRightArithmetic
            | Op::ShiftLeftLogical
            | Op::BitwiseOr
            | Op::BitwiseXor
            | Op::BitwiseAnd
            | Op::VectorShuffle
            | Op::CompositeExtract
            | Op::CompositeInsert
            | Op::LogicalOr
            | Op::LogicalAnd
            | Op::LogicalNot
            | Op::LogicalEqual
            | Op::LogicalNotEqual
            | Op::Select
            | Op::IEqual
            | Op::INotEqual
            | Op::ULessThan
            | Op::SLessThan
            | Op::UGreaterThan
            | Op::SGreaterThan
            | Op::ULessThanEqual
            | Op::SLessThanEqual
            | Op::UGreaterThanEqual
            | Op::SGreaterThanEqual
    )
}
