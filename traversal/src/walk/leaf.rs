//! Leaves of structures, and what becomes of them.
#![forbid(unsafe_code)]

use super::Event;
use super::facts::InstanceFacts;
use super::level::Level;

/// The outcome of a leaf.
pub(crate) enum Leaf {
    /// All of it is done.
    Finished,
    /// The walk ends.
    Over,
    /// The candidate in this lane (counted over the leaf's groups) is the caller's to decide.
    Ask(Event, u32),
}

/// A leaf of triangles.
pub(crate) struct Triangles<'a> {
    pub level: &'a Level,
    pub instance: &'a InstanceFacts,
    pub word: u32,
    /// First lane to look at, counted over the leaf's groups.
    pub first_lane: u32,
}
