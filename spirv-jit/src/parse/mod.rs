//! SPIR-V words to a checked module.
//!
//! The words are cut into instructions ([`framing`]) and held against the grammar of `rspirv`
//! ([`consumer`]). Instructions are then kept as offsets into the words, with the ids that they
//! use, and sorted into sections, functions and blocks ([`module`]).

#![forbid(unsafe_code)]

mod annotations;
mod consumer;
mod framing;
mod grammar;
mod instruction;
mod module;

pub use annotations::Annotations;
pub(crate) use grammar::{only_informs, opcode_name};
pub(crate) use instruction::decode_string;
pub use instruction::{Id, Instruction};
pub use module::{Block, EntryPoint, Function, Merge, ParsedModule};

use crate::Error;

/// Numbers of SPIR-V that the bindings lack.
pub(crate) mod newer {
    /// Execution mode of `SPV_KHR_opacity_micromap`; its operand is a boolean constant.
    pub const OPACITY_MICROMAP_ID: u32 = 6031;
    /// The capability of that.
    pub const OPACITY_MICROMAP_EXECUTION_MODE: u32 = 6032;
    /// Decoration of `SPV_KHR_constant_data`: the data are text. It changes no value.
    pub const UTF_ENCODED: u32 = 5145;
    /// Capability of `SPV_KHR_constant_data`.
    pub const CONSTANT_DATA_CAPABILITY: u32 = 5146;
    /// `OpConstantDataKHR`, parsed as an `OpConstant` of as many words as it has.
    pub const CONSTANT_DATA: u32 = 5147;
    /// `OpSpecConstantDataKHR`, parsed as an `OpSpecConstant`.
    pub const SPEC_CONSTANT_DATA: u32 = 5148;
}

/// Parses and checks a module.
///
/// # Errors
/// Malformed words, ids or structure; enumerants that no published SPIR-V has.
pub fn parse(words: &[u32]) -> Result<ParsedModule, Error> {
    let frames = framing::check_framing(words)?;
    let instructions = consumer::check_grammar(words, &frames)?;
    module::sort_module(words, instructions)
}
