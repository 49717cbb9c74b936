//! Checks instructions against `rspirv`'s grammar tables, in place.
//!
//! `rspirv`'s parser handles single instructions with other operand kinds, and those that this
//! check rejects.

use std::sync::OnceLock;

use foldhash::HashMap;

use rspirv::dr::Operand;
use rspirv::grammar::{
    INSTRUCTION_TABLE, Instruction as Entry, LogicalOperand, OperandKind, OperandQuantifier,
};
use rspirv::spirv::{self, Op};

use super::instruction::Id;
use super::newer;

/// Grammar entries by opcode.
struct Index {
    entries: Vec<&'static Entry<'static>>,
    /// Index in `entries`, plus one.
    places: Vec<u16>,
}

/// The grammar of an opcode; `rspirv` would search its whole table.
pub(super) fn entry(opcode: u32) -> Option<&'static Entry<'static>> {
    static INDEX: OnceLock<Index> = OnceLock::new();
    let index = INDEX.get_or_init(|| {
        let entries: Vec<_> = INSTRUCTION_TABLE.iter().collect();
        let last = entries.iter().map(|entry| entry.opcode as usize).max();
        let mut places = vec![0; last.map_or(0, |last| last + 1)];
        for (place, entry) in entries.iter().enumerate() {
            places[entry.opcode as usize] = place as u16 + 1;
        }
        Index { entries, places }
    });
    let place = *index.places.get(opcode as usize)?;
    index
        .entries
        .get(usize::from(place).checked_sub(1)?)
        .copied()
}

/// The specification's name of an opcode, without the prefix `Op`. It comes from the grammar,
/// because `Op`'s `Debug` adds 18 KB of code to each crate and codegen unit that uses it.
pub(crate) fn opcode_name(opcode: Op) -> &'static str {
    entry(opcode as u32).map_or("?", |entry| entry.opname)
}

/// The reason why a walk ended early.
pub(super) enum Stop {
    /// The operands do not match the grammar.
    Refused,
    /// An operand of a kind that only `rspirv` knows.
    Unknown,
}

/// Result type and result of an instruction, or 0.
#[derive(Clone, Copy, Default)]
pub(super) struct Head {
    pub result_type: Id,
    pub result: Id,
    /// The number of result words: 0 to 2.
    pub words: u32,
}

/// Whether a set of extended instructions is debug information or something else that changes no
/// result. Only those of the names `NonSemantic.` have ids for all their operands;
/// `OpenCL.DebugInfo.100` and `DebugInfo` mix ids and literals.
pub(crate) fn only_informs(set: &str) -> bool {
    set.starts_with("NonSemantic.") || set.contains("DebugInfo")
}

/// The bit widths on which literals depend: those of types and of the types of ids.
#[derive(Default)]
pub(super) struct Widths {
    types: HashMap<Id, u32>,
    /// Types of results; kept once there is a type of more than one word.
    results: HashMap<Id, Id>,
    has_wide: bool,
}

impl Widths {
    /// Records the widths of an instruction's definition.
    pub fn note(&mut self, opcode: Op, head: Head, operands: &[u32]) {
        if matches!(opcode, Op::TypeInt | Op::TypeFloat) {
            let width = operands.first().copied().unwrap_or(0);
            self.types.insert(head.result, width);
            self.has_wide |= width > 32;
        } else if self.has_wide && head.result_type != 0 {
            self.results.insert(head.result, head.result_type);
        }
    }

    /// The number of words of a type's literals, if it has literals.
    fn words_of_type(&self, ty: Id) -> Result<usize, Stop> {
        match self.types.get(&ty) {
            None | Some(8 | 16 | 32) => Ok(1),
            Some(64) => Ok(2),
            Some(_) => Err(Stop::Refused),
        }
    }

    fn words_of_value(&self, id: Id) -> Result<usize, Stop> {
        self.results
            .get(&id)
            .map_or(Ok(1), |&ty| self.words_of_type(ty))
    }
}

/// Walks the operands of one instruction and collects their ids.
pub(super) struct Walk<'a> {
    pub widths: &'a Widths,
    pub uses: &'a mut Vec<Id>,
    /// Operand words that are left.
    rest: &'a [u32],
    head: Head,
    /// The first operand: the selector of a switch.
    first: u32,
    readable: bool,
}

impl<'a> Walk<'a> {
    /// `operands`: all words behind the instruction's first.
    pub fn new(operands: &'a [u32], widths: &'a Widths, uses: &'a mut Vec<Id>) -> Self {
        Self {
            widths,
            uses,
            rest: operands,
            head: Head::default(),
            first: operands.first().copied().unwrap_or(0),
            readable: false,
        }
    }

    /// A whole instruction.
    pub fn instruction(mut self, entry: &Entry<'_>) -> Result<Head, Stop> {
        // Text for people may have any encoding.
        self.readable = matches!(
            entry.opcode,
            Op::Name
                | Op::MemberName
                | Op::String
                | Op::Source
                | Op::SourceContinued
                | Op::SourceExtension
                | Op::ModuleProcessed
        );
        self.operands(entry.operands)?;
        Ok(self.head)
    }

    /// `OpSpecConstantOp`: the result type and result precede the operation.
    pub fn specialized(mut self, nested: &Entry<'_>) -> Result<Head, Stop> {
        let [result_type, result, _, rest @ ..] = self.rest else {
            return Err(Stop::Refused);
        };
        let [first, second, operands @ ..] = nested.operands else {
            return Err(Stop::Unknown);
        };
        if first.kind != OperandKind::IdResultType || second.kind != OperandKind::IdResult {
            return Err(Stop::Unknown);
        }
        self.head = Head {
            result_type: *result_type,
            result: *result,
            words: 2,
        };
        self.rest = rest;
        self.operands(operands)?;
        Ok(self.head)
    }

    fn operands(&mut self, operands: &[LogicalOperand]) -> Result<(), Stop> {
        for operand in operands {
            match operand.quantifier {
                OperandQuantifier::One => self.operand(operand.kind)?,
                OperandQuantifier::ZeroOrOne => {
                    if !self.rest.is_empty() {
                        self.operand(operand.kind)?;
                    }
                }
                OperandQuantifier::ZeroOrMore if operand.kind == OperandKind::IdRef => {
                    self.uses.extend_from_slice(self.rest);
                    self.rest = &[];
                }
                OperandQuantifier::ZeroOrMore => {
                    while !self.rest.is_empty() {
                        self.operand(operand.kind)?;
                    }
                }
            }
        }
        match self.rest {
            [] => Ok(()),
            _ => Err(Stop::Refused),
        }
    }

    fn word(&mut self) -> Result<u32, Stop> {
        let (&word, rest) = self.rest.split_first().ok_or(Stop::Refused)?;
        self.rest = rest;
        Ok(word)
    }

    fn id(&mut self) -> Result<(), Stop> {
        let id = self.word()?;
        self.uses.push(id);
        Ok(())
    }

    fn skip(&mut self, words: usize) -> Result<(), Stop> {
        self.rest = self.rest.get(words..).ok_or(Stop::Refused)?;
        Ok(())
    }

    /// A word that must be an enumerant, or bits that must be known.
    fn enumerant<T>(&mut self, find: impl FnOnce(u32) -> Option<T>) -> Result<T, Stop> {
        find(self.word()?).ok_or(Stop::Refused)
    }

    fn operand(&mut self, kind: OperandKind) -> Result<(), Stop> {
        use OperandKind as Kind;
        match kind {
            Kind::IdRef | Kind::IdScope | Kind::IdMemorySemantics => self.id(),
            Kind::IdResultType => {
                self.head.result_type = self.word()?;
                self.head.words += 1;
                Ok(())
            }
            Kind::IdResult => {
                self.head.result = self.word()?;
                self.head.words += 1;
                Ok(())
            }
            Kind::LiteralInteger | Kind::LiteralFloat | Kind::LiteralExtInstInteger => self.skip(1),
            Kind::LiteralString => self.string(),
            Kind::PairIdRefLiteralInteger => {
                self.id()?;
                self.skip(1)
            }
            Kind::PairIdRefIdRef => {
                self.id()?;
                self.id()
            }
            Kind::PairLiteralIntegerIdRef => {
                self.skip(self.widths.words_of_value(self.first)?)?;
                self.id()
            }
            Kind::LiteralContextDependentNumber => {
                self.skip(self.widths.words_of_type(self.head.result_type)?)
            }
            Kind::StorageClass => self.enumerant(spirv::StorageClass::from_u32).map(drop),
            Kind::BuiltIn => self.enumerant(spirv::BuiltIn::from_u32).map(drop),
            Kind::Capability => {
                let find = |word| match newer::NewerCapability::from_u32(word) {
                    Some(_) => Some(()),
                    None => spirv::Capability::from_u32(word).map(drop),
                };
                self.enumerant(find)
            }
            Kind::ExecutionModel => self.enumerant(spirv::ExecutionModel::from_u32).map(drop),
            Kind::AddressingModel => self.enumerant(spirv::AddressingModel::from_u32).map(drop),
            Kind::MemoryModel => self.enumerant(spirv::MemoryModel::from_u32).map(drop),
            Kind::SourceLanguage => self.enumerant(spirv::SourceLanguage::from_u32).map(drop),
            Kind::GroupOperation => self.enumerant(spirv::GroupOperation::from_u32).map(drop),
            Kind::Dim => self.enumerant(spirv::Dim::from_u32).map(drop),
            Kind::ImageFormat => self.enumerant(spirv::ImageFormat::from_u32).map(drop),
            Kind::FunctionControl => self.enumerant(spirv::FunctionControl::from_bits).map(drop),
            Kind::SelectionControl => self.enumerant(spirv::SelectionControl::from_bits).map(drop),
            Kind::Decoration if self.rest.first() == Some(&newer::UTF_ENCODED) => self.skip(1),
            Kind::Decoration => {
                let found = self.enumerant(spirv::Decoration::from_u32)?;
                self.parameters(&Operand::Decoration(found))
            }
            Kind::ExecutionMode if self.rest.first() == Some(&newer::OPACITY_MICROMAP_ID) => {
                self.skip(1)?;
                self.id()
            }
            Kind::ExecutionMode => {
                let found = self.enumerant(spirv::ExecutionMode::from_u32)?;
                self.parameters(&Operand::ExecutionMode(found))
            }
            Kind::LoopControl => {
                let found = self.enumerant(spirv::LoopControl::from_bits)?;
                self.parameters(&Operand::LoopControl(found))
            }
            Kind::MemoryAccess => {
                let found = self.enumerant(spirv::MemoryAccess::from_bits)?;
                self.parameters(&Operand::MemoryAccess(found))
            }
            Kind::ImageOperands => {
                let found = self.enumerant(spirv::ImageOperands::from_bits)?;
                self.parameters(&Operand::ImageOperands(found))
            }
            _ => Err(Stop::Unknown),
        }
    }

    /// The additional operands of an enumerant or a set of bits.
    fn parameters(&mut self, of: &Operand) -> Result<(), Stop> {
        for parameter in of.additional_operands() {
            self.operand(parameter.kind)?;
        }
        Ok(())
    }

    /// A literal string, up to the word with the zero byte.
    fn string(&mut self) -> Result<(), Stop> {
        let ends = |word: &u32| word.to_le_bytes().contains(&0);
        let last = self.rest.iter().position(ends).ok_or(Stop::Refused)?;
        let (text, rest) = self.rest.split_at(last + 1);
        if !self.readable {
            let bytes: Vec<u8> = text.iter().flat_map(|word| word.to_le_bytes()).collect();
            let length = bytes.iter().position(|&byte| byte == 0).unwrap_or(0);
            std::str::from_utf8(&bytes[..length]).map_err(|_| Stop::Refused)?;
        }
        self.rest = rest;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opcodes_have_their_names() {
        for entry in INSTRUCTION_TABLE.iter() {
            let name = opcode_name(entry.opcode);
            assert_eq!(name, format!("{:?}", entry.opcode));
        }
    }
}
