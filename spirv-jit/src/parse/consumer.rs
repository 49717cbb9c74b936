//! Checks instructions against the grammar and extracts the data that later steps need. `rspirv`
//! parses the instructions that [`grammar`] cannot.

use rspirv::binary::{Consumer, DecodeError, ParseAction, ParseState, Parser};
use rspirv::dr;
use rspirv::spirv::{MAGIC_NUMBER, Op};

use super::framing::InstructionSpan;
use super::grammar::{self, Head, Stop, Walk, Widths, only_informs};
use super::instruction::{Id, Instruction, InstructionTable, decode_string};
use super::newer;
use crate::Error;

/// Checks framed words against the grammar.
pub(super) fn check_grammar(
    words: &[u32],
    frames: &[InstructionSpan],
) -> Result<InstructionTable, Error> {
    let mut table = InstructionTable {
        instructions: Vec::with_capacity(frames.len()),
        uses: Vec::with_capacity(words.len() / 2),
    };
    let mut widths = Widths::default();
    let mut informing: Vec<Id> = Vec::new();
    for frame in frames {
        let first_use = table.uses.len() as u32;
        let (offset, end) = (frame.offset, frame.offset + u32::from(frame.count));
        let (opcode, head) = check_instruction(words, *frame, &widths, &mut table.uses)?;
        let newer = end as usize - usize::from(frame.newer_ids);
        table.uses.extend(&words[newer..end as usize]);
        let first_operand = offset + 1 + head.words;
        let operands = &words[first_operand as usize..end as usize];
        widths.note(opcode, head, operands);
        match (opcode, operands) {
            (Op::ExtInstImport, name) if only_informs(&decode_string(name)) => {
                informing.push(head.result);
            }
            // Such operands may be literals and have no effect, so only the set counts as a use.
            (Op::ExtInst | Op::ExtInstWithForwardRefsKHR, [set, ..]) if informing.contains(set) => {
                table.uses.truncate(first_use as usize + 1);
            }
            _ => {}
        }
        table.instructions.push(Instruction {
            opcode,
            result_type: head.result_type,
            result: head.result,
            offset,
            first_operand,
            end,
            first_use,
            end_use: table.uses.len() as u32,
        });
    }
    Ok(table)
}

/// Parses one instruction: its opcode and head. Appends the ids that it uses to `uses`.
fn check_instruction(
    words: &[u32],
    frame: InstructionSpan,
    widths: &Widths,
    uses: &mut Vec<Id>,
) -> Result<(Op, Head), Error> {
    let at = frame.offset as usize;
    let known = &words[at + 1..at + usize::from(frame.count - frame.newer_ids)];
    let used = uses.len();
    let opcode = match frame.is_specialized {
        true => words[at + 3],
        false => words[at] & 0xffff,
    };
    let walk = Walk::new(known, widths, uses);
    let stop = match grammar::entry(opcode) {
        Some(entry) if frame.is_specialized => match walk.specialized(entry) {
            Ok(head) => return Ok((Op::SpecConstantOp, head)),
            Err(stop) => stop,
        },
        Some(entry) => match walk.instruction(entry) {
            Ok(head) => return Ok((entry.opcode, head)),
            Err(stop) => stop,
        },
        None => match newer_instruction(opcode, known) {
            Some((stands_for, head)) => {
                uses.extend(&known[head.words as usize..][..ids(stands_for)]);
                return Ok((stands_for, head));
            }
            None => Stop::Refused,
        },
    };
    uses.truncate(used);
    let parsed = parse(words, frame)?;
    if let Stop::Refused = stop {
        // `rspirv` does not see the types that literals depend on.
        let message = "the operands do not fit the instruction";
        return Err(Error::invalid(frame.offset, message));
    }
    uses.extend(parsed.operands.iter().filter_map(|o| o.id_ref_any()));
    let head = Head {
        result_type: parsed.result_type.unwrap_or(0),
        result: parsed.result_id.unwrap_or(0),
        words: u32::from(parsed.result_type.is_some()) + u32::from(parsed.result_id.is_some()),
    };
    Ok(match frame.is_specialized {
        true => (Op::SpecConstantOp, head),
        false => (parsed.class.opcode, head),
    })
}

/// An instruction that the bindings lack: the opcode of its substitute, and its head.
fn newer_instruction(opcode: u32, operands: &[u32]) -> Option<(Op, Head)> {
    let stands_for = match opcode {
        newer::CONSTANT_DATA => Op::Constant,
        newer::SPEC_CONSTANT_DATA => Op::SpecConstant,
        newer::ABORT if operands.len() == 2 => {
            let head = Head {
                result_type: 0,
                result: 0,
                words: 0,
            };
            return Some((Op::TerminateInvocation, head));
        }
        _ => return None,
    };
    // A type, a result and words.
    let &[result_type, result, ..] = operands else {
        return None;
    };
    let head = Head {
        result_type,
        result,
        words: 2,
    };
    Some((stands_for, head))
}

/// The ids after the head of such an instruction.
fn ids(stands_for: Op) -> usize {
    match stands_for {
        Op::TerminateInvocation => 2,
        _ => 0,
    }
}

/// Keeps the only instruction of a module.
struct Keeper(Option<dr::Instruction>);

impl Consumer for Keeper {
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
        self.0 = Some(instruction);
        ParseAction::Continue
    }
}

/// Parses an instruction with `rspirv`. `OpSpecConstantOp` is replaced by its operation, since
/// `rspirv` accepts one operand of each kind there, and operands that `rspirv` lacks are removed.
fn parse(words: &[u32], frame: InstructionSpan) -> Result<dr::Instruction, Error> {
    let at = frame.offset as usize;
    let count = usize::from(frame.count - frame.newer_ids);
    let mut module = vec![MAGIC_NUMBER, words[1], 0, words[3], 0];
    if frame.is_specialized {
        module.push((count as u32 - 1) << 16 | words[at + 3] & 0xffff);
        module.extend(&words[at + 1..at + 3]);
        module.extend(&words[at + 4..at + count]);
    } else {
        module.push((count as u32) << 16 | words[at] & 0xffff);
        module.extend(&words[at + 1..at + count]);
    }
    let bytes: Vec<u8> = module.iter().flat_map(|word| word.to_le_bytes()).collect();
    let mut keeper = Keeper(None);
    // The framing excludes the known panics of rspirv. Any other panic becomes an error of the
    // module.
    let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        Parser::new(&bytes, &mut keeper).parse()
    }));
    match (outcome, keeper.0) {
        (Ok(Ok(())), Some(instruction)) => Ok(instruction),
        (Ok(Err(state)), _) => Err(refuse(frame.offset, &state)),
        _ => {
            let message = "the instruction cannot be decoded";
            Err(Error::invalid(frame.offset, message))
        }
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
        ParseState::OperandExpected(..)
        | ParseState::OperandError(DecodeError::LimitReached(_)) => {
            Error::invalid(offset, "the instruction lacks operands")
        }
        ParseState::OperandExceeded(..) => {
            Error::invalid(offset, "the instruction has too many operands")
        }
        other => Error::invalid(offset, other.to_string()),
    }
}
