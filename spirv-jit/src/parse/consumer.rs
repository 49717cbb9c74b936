//! The grammar check: `rspirv` parses, and this consumer notes what later steps need.

use rspirv::binary::{Consumer, DecodeError, ParseAction, ParseState, Parser};
use rspirv::dr;
use rspirv::spirv::Op;

use super::framing::Frame;
use super::module::{Instruction, InstructionTable};
use crate::Error;

struct Notes<'a> {
    frames: &'a [Frame],
    table: InstructionTable,
    words: &'a [u32],
    /// Instructions that come next and are padding that [`digestible`] made.
    padding: u16,
}

impl Consumer for Notes<'_> {
    fn initialize(&mut self) -> ParseAction {
        ParseAction::Continue
    }

    fn finalize(&mut self) -> ParseAction {
        ParseAction::Continue
    }

    fn consume_header(&mut self, _: dr::ModuleHeader) -> ParseAction {
        ParseAction::Continue
    }

    fn consume_instruction(&mut self, instruction: dr::Instruction) -> ParseAction {
        if self.padding > 0 {
            self.padding -= 1;
            return ParseAction::Continue;
        }
        let Some(frame) = self.frames.get(self.table.instructions.len()) else {
            return ParseAction::Stop;
        };
        let skipped =
            1 + instruction.result_type.is_some() as u32 + instruction.result_id.is_some() as u32;
        let first_use = self.table.uses.len() as u32;
        let used = instruction.operands.iter().filter_map(|o| o.id_ref_any());
        self.table.uses.extend(used);
        let end = frame.offset as usize + frame.count as usize;
        let newer = &self.words[end - frame.newer_ids as usize..end];
        self.table.uses.extend(newer);
        self.table.instructions.push(Instruction {
            opcode: match frame.is_specialized {
                true => Op::SpecConstantOp,
                false => instruction.class.opcode,
            },
            result_type: instruction.result_type.unwrap_or(0),
            result: instruction.result_id.unwrap_or(0),
            offset: frame.offset,
            first_operand: frame.offset + skipped,
            end: frame.offset + frame.count as u32,
            first_use,
            end_use: self.table.uses.len() as u32,
        });
        self.padding = frame.is_specialized as u16 + frame.newer_ids;
        ParseAction::Continue
    }
}

/// The words as `rspirv` can take them: it knows one operand of each kind in `OpSpecConstantOp`, so the operation stands there itself, and a
/// no-op behind it; no-ops stand in for operands that are newer than it; it insists on UTF-8 where only people read.
fn digestible(words: &[u32], frames: &[Frame]) -> Vec<u8> {
    let mut copy = words.to_vec();
    for frame in frames {
        let (at, count) = (frame.offset as usize, frame.count as usize);
        if frame.is_specialized {
            copy[at] = (count as u32 - 1) << 16 | words[at + 3] & 0xffff;
            copy.copy_within(at + 4..at + count, at + 3);
            copy[at + count - 1] = 1 << 16 | Op::Nop as u32;
        }
        if frame.newer_ids > 0 {
            let known = count - frame.newer_ids as usize;
            copy[at] = (known as u32) << 16 | words[at] & 0xffff;
            copy[at + known..at + count].fill(1 << 16 | Op::Nop as u32);
        }
        let text = match Op::from_u32(words[at] & 0xffff) {
            Some(Op::Name | Op::String) => 2,
            Some(Op::MemberName) => 3,
            Some(Op::Source) => 4,
            Some(Op::SourceContinued | Op::SourceExtension | Op::ModuleProcessed) => 1,
            _ => count,
        };
        for word in &mut copy[at..at + count][text.min(count)..] {
            let readable = |byte: u8| if byte < 0x80 { byte } else { b'?' };
            *word = u32::from_le_bytes(word.to_le_bytes().map(readable));
        }
    }
    copy.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// Holds framed words against the grammar.
pub(super) fn check_grammar(words: &[u32], frames: &[Frame]) -> Result<InstructionTable, Error> {
    let mut notes = Notes {
        frames,
        table: InstructionTable {
            instructions: Vec::with_capacity(frames.len()),
            uses: Vec::with_capacity(words.len() / 2),
        },
        words,
        padding: 0,
    };
    let bytes = digestible(words, frames);
    // The framing leaves rspirv no known way to panic; should it find another one, the module is at fault and not the process.
    let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        Parser::new(&bytes, &mut notes).parse()
    }));
    let offset = frames
        .get(notes.table.instructions.len())
        .map_or(words.len() as u32, |frame| frame.offset);
    match outcome {
        Ok(Ok(())) => Ok(notes.table),
        Ok(Err(state)) => Err(refuse(offset, &state)),
        Err(_) => Err(Error::invalid(offset, "the instruction cannot be decoded")),
    }
}

fn refuse(offset: u32, state: &ParseState) -> Error {
    match state {
        ParseState::OperandError(DecodeError::CapabilityUnknown(_, value)) => {
            Error::unsupported(offset, format!("capability {value} is not supported"))
        }
        ParseState::OpcodeUnknown(_, _, opcode) => {
            Error::unsupported(offset, format!("opcode {opcode} is not supported"))
        }
        other => Error::invalid(offset, other.to_string()),
    }
}
