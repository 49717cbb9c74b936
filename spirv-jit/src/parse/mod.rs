//! Parses SPIR-V words to a checked module.
//!
//! The words are split into instructions ([`framing`]) and checked against the grammar of `rspirv`
//! ([`consumer`]). Instructions are stored as offsets into the words, with the ids that they use,
//! and sorted into sections, functions and blocks ([`module`]).

#![forbid(unsafe_code)]

mod annotations;
mod consumer;
mod framing;
mod grammar;
mod instruction;
mod module;
pub(crate) mod newer;

pub use annotations::Annotations;
pub(crate) use grammar::{only_informs, opcode_name};
pub(crate) use instruction::decode_string;
pub use instruction::{Id, Instruction};
pub use module::{Block, EntryPoint, Function, Merge, ParsedModule};
pub use newer::NewerCapability;

use crate::Error;

/// Parses and checks a module.
///
/// # Errors
/// Malformed words, ids or structure; enumerants of no published SPIR-V.
pub fn parse(words: &[u32]) -> Result<ParsedModule, Error> {
    let frames = framing::check_framing(words)?;
    let instructions = consumer::check_grammar(words, &frames)?;
    module::sort_module(words, instructions)
}
