//! Messages of shaders (`NonSemantic.DebugPrintf`).
//!
//! The compiler makes a [`Message`] of each instruction; an invocation that executes it adds a
//! [`Record`] of words to the dispatch's [`Prints`]; when the dispatch is complete, its records are
//! sorted by invocation and become text ([`Message::text`]).

#![forbid(unsafe_code)]

mod buffer;
mod format;
mod message;

pub use buffer::{Prints, Record, Taken};
pub use message::{Argument, Message};

/// Words of the key of an invocation, at most: its stage's rank, then the words that tell its
/// invocations apart.
pub const MAX_KEY_WORDS: usize = 6;
