//! Names and decorations by id, with decoration groups expanded.

use foldhash::HashMap;

use rspirv::spirv::{Decoration, Op};

use super::instruction::{Id, Instruction, InstructionTable, decode_string};
use crate::Error;

/// A decoration's enumerant and its first literal, or 0.
type Note = (u32, u32);

/// Decorations and names of ids and members (`OpName`, `OpDecorate` and others).
#[derive(Default)]
pub struct Annotations {
    names: HashMap<Id, String>,
    ids: HashMap<Id, Vec<Note>>,
    members: HashMap<(Id, u32), Vec<Note>>,
    /// Some id is decorated `Volatile`.
    pub has_volatile: bool,
}

impl Annotations {
    /// Limit of decorations after the expansion of groups, enough for any shader.
    const MAX_GROUPED: usize = 1 << 20;

    /// The first literal of a decoration on an id, or 0 for one without literals.
    pub fn id(&self, id: Id, decoration: Decoration) -> Option<u32> {
        find(self.ids.get(&id), decoration)
    }

    /// The first literal of a decoration on a structure's member.
    pub fn member(&self, structure: Id, member: u32, decoration: Decoration) -> Option<u32> {
        find(self.members.get(&(structure, member)), decoration)
    }

    /// The name of an id, or an empty string.
    pub fn name(&self, id: Id) -> &str {
        self.names.get(&id).map_or("", String::as_str)
    }

    pub(super) fn collect(words: &[u32], table: &InstructionTable) -> Result<Self, Error> {
        let mut out = Self::default();
        let mut grouped = 0;
        for instruction in &table.instructions {
            let operands = instruction.operands(words);
            match instruction.opcode {
                Op::Function => break,
                Op::Name => {
                    out.names.insert(operands[0], decode_string(&operands[1..]));
                }
                Op::Decorate | Op::DecorateId => {
                    let note = (operands[1], operands.get(2).copied().unwrap_or(0));
                    out.has_volatile |= note.0 == Decoration::Volatile as u32;
                    out.ids.entry(operands[0]).or_default().push(note);
                }
                Op::MemberDecorate | Op::MemberDecorateIdEXT => {
                    let note = (operands[2], operands.get(3).copied().unwrap_or(0));
                    let key = (operands[0], operands[1]);
                    out.members.entry(key).or_default().push(note);
                }
                Op::GroupDecorate | Op::GroupMemberDecorate => {
                    grouped += out.apply_group(instruction, operands);
                    if grouped > Self::MAX_GROUPED {
                        let at = instruction.offset;
                        return Err(Error::invalid(at, "too many grouped decorations"));
                    }
                }
                _ => {}
            }
        }
        Ok(out)
    }

    fn apply_group(&mut self, instruction: &Instruction, operands: &[u32]) -> usize {
        let notes = self.ids.get(&operands[0]).cloned().unwrap_or_default();
        let targets = &operands[1..];
        if instruction.opcode == Op::GroupDecorate {
            for &target in targets {
                self.ids.entry(target).or_default().extend(&notes);
            }
        } else {
            for pair in targets.chunks_exact(2) {
                let key = (pair[0], pair[1]);
                self.members.entry(key).or_default().extend(&notes);
            }
        }
        targets.len() * (1 + notes.len())
    }
}

fn find(notes: Option<&Vec<Note>>, decoration: Decoration) -> Option<u32> {
    let note = notes?.iter().find(|note| note.0 == decoration as u32)?;
    Some(note.1)
}
