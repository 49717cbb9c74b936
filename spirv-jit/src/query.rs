//! Ray queries at the seam: how a query's object lies in per-lane memory.
//!
//! An object is a run of private rows, a word per lane each: those of [`row`], then the module's
//! [`QueryWord`]s, the words that its getters read. The shader writes the ray and what it decides
//! about candidates; at `ray_query_proceed` the executor reads them and writes the words.

use crate::facts::Fact;

/// Rows of an object, from its first one.
pub mod row {
    /// One of [`state`](super::state).
    pub const STATE: usize = 0;
    /// Device address of the top level, low word first.
    pub const STRUCTURE: usize = 1;
    pub const FLAGS: usize = 3;
    pub const CULL_MASK: usize = 4;
    /// Three words.
    pub const ORIGIN: usize = 5;
    pub const T_MIN: usize = 8;
    /// Three words.
    pub const DIRECTION: usize = 9;
    pub const T_MAX: usize = 12;
    /// In state `GENERATED`: the distance that the shader gave.
    pub const GENERATED_T: usize = 13;
    /// The first of the module's words.
    pub const WORDS: usize = 14;
}

/// In the row of flags: the shader's queries do not look at micromaps. SPIR-V has no such flag.
pub const IGNORE_OPACITY_MICROMAPS: u32 = 1 << 31;

/// Where a query stands.
pub mod state {
    /// Never initialised, terminated, or at its end: there is nothing to proceed with.
    pub const OVER: u32 = 0;
    /// Initialised: the walk is to be started.
    pub const READY: u32 = 1;
    /// Suspended at a candidate that the shader has not committed.
    pub const CANDIDATE: u32 = 2;
    /// Suspended at a triangle that the shader has committed.
    pub const CONFIRMED: u32 = 3;
    /// Suspended at a box in which the shader has committed a hit.
    pub const GENERATED: u32 = 4;
}

/// A word about the candidate or the committed intersection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct QueryWord {
    /// Of the committed intersection instead of the candidate.
    pub committed: bool,
    pub fact: Fact,
    /// Matrices count column-major, vertices by their coordinates.
    pub component: u8,
}

impl QueryWord {
    /// Every word of a fact, about the candidate or the committed intersection.
    pub fn all(fact: Fact, committed: bool) -> impl Iterator<Item = QueryWord> {
        (0..fact.words() as u8).map(move |component| QueryWord {
            committed,
            fact,
            component,
        })
    }
}
