//! Where a program comes from, for reports of what went wrong in it: names, and the lines of its
//! source.

#![forbid(unsafe_code)]

use std::fmt;
use std::sync::{Arc, Mutex};

use foldhash::HashMap;
use rspirv::spirv::Op;

use crate::ir::stage::Stage;

/// A name that an application gives to something, at any time.
#[derive(Debug, Default)]
pub struct Name(Mutex<Option<Arc<str>>>);

impl Name {
    /// Replaces the name; an empty one is none.
    pub fn set(&self, name: &str) {
        let name = (!name.is_empty()).then(|| name.into());
        *self.0.lock().unwrap_or_else(|it| it.into_inner()) = name;
    }

    /// The name, if there is one.
    pub fn text(&self) -> Option<Arc<str>> {
        (self.0.lock().unwrap_or_else(|it| it.into_inner())).clone()
    }
}

/// The origin of a program.
#[derive(Debug)]
pub struct Origin {
    pub entry_point: String,
    /// Of the module or shader.
    pub name: Arc<Name>,
    /// Of the pipeline.
    pub pipeline: Name,
    /// The module's words, if they say which file or lines they come from.
    pub words: Option<Arc<[u32]>>,
}

impl Origin {
    /// The file that the program was compiled from, if its module says so.
    pub fn file(&self) -> Option<String> {
        file_of(self.words.as_ref()?)
    }
}

/// A place in a program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CodeLocation {
    pub stage: Stage,
    pub entry_point: Option<String>,
    /// The name of the module or shader.
    pub name: Option<Arc<str>>,
    pub pipeline: Option<Arc<str>>,
    pub line: Option<SourceLine>,
}

/// A line of a source file, as debug information has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceLine {
    pub file: String,
    pub line: u32,
    /// 0 where it is not known.
    pub column: u32,
}

impl fmt::Display for SourceLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.file, self.line)?;
        match self.column {
            0 => Ok(()),
            column => write!(f, ":{column}"),
        }
    }
}

impl fmt::Display for CodeLocation {
    /// `RayGeneration shader "name", entry point "main", pipeline "name", file.rgen:12:3`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?} shader", self.stage)?;
        if let Some(name) = &self.name {
            write!(f, " \"{name}\"")?;
        }
        if let Some(entry_point) = &self.entry_point {
            write!(f, ", entry point \"{entry_point}\"")?;
        }
        if let Some(pipeline) = &self.pipeline {
            write!(f, ", pipeline \"{pipeline}\"")?;
        }
        match &self.line {
            Some(line) => write!(f, ", {line}"),
            None => Ok(()),
        }
    }
}

/// Words of a module's header.
const HEADER_WORDS: usize = 5;

/// `NonSemantic.Shader.DebugInfo.100`: its instructions that lines follow from.
const DEBUG_SOURCE: u32 = 35;
const DEBUG_LINE: u32 = 103;
const DEBUG_NO_LINE: u32 = 104;

/// Whether a module says which lines of which files it comes from.
pub fn has_lines(words: &[u32]) -> bool {
    let mut lines = Lines::default();
    instructions(words).any(|(_, instruction)| {
        lines.see(instruction);
        lines.current.is_some()
    })
}

/// The file that a module names: as its source (`OpSource`), else with its first line. Words may be
/// anything.
pub fn file_of(words: &[u32]) -> Option<String> {
    let mut lines = Lines::default();
    let mut first = None;
    for (_, instruction) in instructions(words) {
        lines.see(instruction);
        if let (Some(Op::Source), [_, _, file, ..]) =
            (Op::from_u32(instruction[0] & 0xffff), &instruction[1..])
        {
            return lines.strings.get(file).cloned();
        }
        first = first.or(lines.current.map(|(file, ..)| file));
    }
    lines.strings.get(&first?).cloned()
}

/// The line that the instruction at a word offset comes from: the last one stated before it in its
/// function. Words may be anything.
pub fn line_at(words: &[u32], offset: u32) -> Option<SourceLine> {
    let mut lines = Lines::default();
    (instructions(words).take_while(|&(at, _)| at <= offset as usize))
        .for_each(|(_, instruction)| lines.see(instruction));
    let (file, line, column) = lines.current?;
    Some(SourceLine {
        file: lines.strings.get(&file)?.clone(),
        line,
        column,
    })
}

/// Offsets and words of instructions, up to one that does not fit.
fn instructions(words: &[u32]) -> impl Iterator<Item = (usize, &[u32])> {
    let mut at = HEADER_WORDS;
    std::iter::from_fn(move || {
        let count = (words.get(at)? >> 16) as usize;
        let instruction = words.get(at..at.checked_add(count.max(1))?)?;
        let place = at;
        at += instruction.len();
        Some((place, instruction))
    })
}

/// Debug information that was seen so far.
#[derive(Default)]
struct Lines {
    strings: HashMap<u32, String>,
    constants: HashMap<u32, u32>,
    debug_set: Option<u32>,
    /// Files by `DebugSource`.
    sources: HashMap<u32, u32>,
    /// The file's id, line and column.
    current: Option<(u32, u32, u32)>,
}

impl Lines {
    fn see(&mut self, words: &[u32]) {
        let Some(opcode) = Op::from_u32(words[0] & 0xffff) else {
            return;
        };
        match (opcode, &words[1..]) {
            (Op::String, [id, text @ ..]) => {
                self.strings.insert(*id, text_of(text));
            }
            (Op::Constant, [_, id, value, ..]) => {
                self.constants.insert(*id, *value);
            }
            (Op::ExtInstImport, [id, name @ ..])
                if text_of(name).starts_with("NonSemantic.Shader.DebugInfo.") =>
            {
                self.debug_set = Some(*id);
            }
            (Op::Line, &[file, line, column]) => self.current = Some((file, line, column)),
            (Op::NoLine | Op::Function, _) => self.current = None,
            (Op::ExtInst, [_, id, set, instruction, operands @ ..])
                if Some(*set) == self.debug_set =>
            {
                self.see_debug(*id, *instruction, operands);
            }
            _ => {}
        }
    }

    fn see_debug(&mut self, id: u32, instruction: u32, operands: &[u32]) {
        let number = |id: &u32| self.constants.get(id).copied().unwrap_or(0);
        match (instruction, operands) {
            (DEBUG_SOURCE, [file, ..]) => {
                self.sources.insert(id, *file);
            }
            (DEBUG_LINE, [source, line, _, column, ..]) => {
                let file = self.sources.get(source).copied().unwrap_or(0);
                self.current = Some((file, number(line), number(column)));
            }
            (DEBUG_NO_LINE, _) => self.current = None,
            _ => {}
        }
    }
}

/// A literal string.
fn text_of(words: &[u32]) -> String {
    let bytes = words.iter().flat_map(|word| word.to_le_bytes());
    let bytes: Vec<u8> = bytes.take_while(|&byte| byte != 0).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn instruction(opcode: Op, operands: &[u32]) -> Vec<u32> {
        let head = (operands.len() as u32 + 1) << 16 | opcode as u32;
        [&[head], operands].concat()
    }

    fn text(text: &str) -> Vec<u32> {
        let mut bytes = text.as_bytes().to_vec();
        bytes.resize(text.len() / 4 * 4 + 4, 0);
        let words = bytes.chunks_exact(4);
        words
            .map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]))
            .collect()
    }

    #[test]
    fn lines_hold_until_the_next_in_their_function() {
        let head = [&[0; HEADER_WORDS][..]].concat();
        let file = instruction(Op::String, &[&[7][..], &text("a.comp")].concat());
        let function = instruction(Op::Function, &[1, 2, 0, 3]);
        let line = instruction(Op::Line, &[7, 12, 3]);
        let nop = instruction(Op::Nop, &[]);
        let none = instruction(Op::NoLine, &[]);
        let parts = [&head, &file, &function, &line, &nop, &none, &nop, &function];
        let words: Vec<u32> = parts.into_iter().flatten().copied().collect();
        let at = |part: usize| parts[..part].iter().map(|p| p.len() as u32).sum::<u32>();
        assert!(has_lines(&words));
        assert_eq!(line_at(&words, at(2)), None);
        let found = line_at(&words, at(4)).unwrap();
        assert_eq!(found.to_string(), "a.comp:12:3");
        assert_eq!(line_at(&words, at(6)), None);
        assert_eq!(line_at(&words, u32::MAX), None);
        assert!(!has_lines(&head) && !has_lines(&[]));
        assert_eq!(file_of(&words).as_deref(), Some("a.comp"));
        assert_eq!((file_of(&head), file_of(&[])), (None, None));
    }

    #[test]
    fn sources_name_their_file_without_lines() {
        let head = vec![0; HEADER_WORDS];
        let file = instruction(Op::String, &[&[7][..], &text("b.rgen")].concat());
        let with = instruction(Op::Source, &[2, 460, 7]);
        let without = instruction(Op::Source, &[2, 460]);
        let words = |source: &[u32]| [&head[..], &file, source].concat();
        assert_eq!(file_of(&words(&with)).as_deref(), Some("b.rgen"));
        assert_eq!(file_of(&words(&without)), None);
    }

    #[test]
    fn debug_info_names_lines_by_constants() {
        let set = [&[1][..], &text("NonSemantic.Shader.DebugInfo.100")].concat();
        let words = [
            vec![0; HEADER_WORDS],
            instruction(Op::ExtInstImport, &set),
            instruction(Op::String, &[&[2][..], &text("b.glsl")].concat()),
            instruction(Op::Constant, &[3, 4, 99]),
            instruction(Op::Constant, &[3, 5, 8]),
            instruction(Op::ExtInst, &[3, 6, 1, DEBUG_SOURCE, 2]),
            instruction(Op::ExtInst, &[3, 7, 1, DEBUG_LINE, 6, 4, 4, 5, 5]),
            // Cut off.
            vec![9 << 16 | Op::Line as u32, 1],
        ]
        .concat();
        let found = line_at(&words, u32::MAX).unwrap();
        assert_eq!(found.to_string(), "b.glsl:99:8");
    }
}
