//! Why a module was refused.

use std::fmt;

/// A SPIR-V module that cannot be compiled, and where it went wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Error {
    /// The kind of refusal, which determines the `VkResult`.
    pub kind: ErrorKind,
    /// Offset of the offending instruction from the module's first word, in words, where known.
    pub word_offset: Option<u32>,
    /// One sentence for the application's author.
    pub message: String,
}

/// The kinds of refusal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorKind {
    /// Malformed: not SPIR-V, truncated, ill-typed, dangling ids.
    Invalid,
    /// Well-formed, but asks for a capability, extension or construct that is not advertised.
    Unsupported,
    /// No entry point of that name and execution model.
    EntryPoint,
    /// Compiling it would need more memory or time than its size justifies.
    Budget,
}

impl Error {
    /// A malformed module, at an instruction.
    pub fn invalid(word_offset: u32, message: impl Into<String>) -> Self {
        Self {
            kind: ErrorKind::Invalid,
            word_offset: Some(word_offset),
            message: message.into(),
        }
    }

    /// A module that came as bytes and is none.
    pub fn not_a_module(message: String) -> Self {
        Self {
            kind: ErrorKind::Invalid,
            word_offset: None,
            message,
        }
    }

    /// A construct that is not advertised, at an instruction.
    pub fn unsupported(word_offset: u32, message: impl Into<String>) -> Self {
        Self {
            kind: ErrorKind::Unsupported,
            word_offset: Some(word_offset),
            message: message.into(),
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.word_offset {
            Some(offset) => write!(f, "SPIR-V word {offset}: {}", self.message),
            None => f.write_str(&self.message),
        }
    }
}

impl std::error::Error for Error {}
