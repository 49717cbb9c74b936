//! Meters of a walk's work. Walks without one do nothing more.
#![forbid(unsafe_code)]

use crate::layout::NodeAt;
use crate::structure::Structure;

/// Hears of each part of a structure that a walk visits.
pub(crate) trait Meter {
    /// Whether it counts anything. Shortcuts that leave visits out are not taken then.
    const COUNTS: bool;

    fn visit_node(&mut self, node: NodeAt<'_>);

    /// `word`: a child's word of a leaf that may be none.
    fn visit_leaf(&mut self, structure: &Structure, word: u32);

    /// A leaf of triangles, whose count is known.
    fn visit_triangles(&mut self, count: u32);
}

/// Counts nothing.
pub(crate) struct Unmetered;

impl Meter for Unmetered {
    const COUNTS: bool = false;

    #[inline(always)]
    fn visit_node(&mut self, _: NodeAt<'_>) {}

    #[inline(always)]
    fn visit_leaf(&mut self, _: &Structure, _: u32) {}

    #[inline(always)]
    fn visit_triangles(&mut self, _: u32) {}
}
