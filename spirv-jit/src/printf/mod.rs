//! Messages of shaders (`NonSemantic.DebugPrintf`).
//!
//! The compiler creates a [`Message`] for each instruction. An invocation that executes it adds a
//! [`Record`] of words to the dispatch's [`Prints`]. When the dispatch is complete, its records are
//! sorted by invocation and formatted ([`Message::text`]).

#![forbid(unsafe_code)]

mod buffer;
mod format;
mod message;

pub use buffer::{Prints, Record, Taken};
pub use message::{Argument, Message};

/// Largest number of words of an invocation's key: its stage's rank, then the words that identify
/// the invocation.
pub const MAX_KEY_WORDS: usize = 6;
