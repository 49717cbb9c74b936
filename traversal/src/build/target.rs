//! The destination of a structure.

use crate::input::Geometries;
use crate::layout::{Form, Node, Parts};
use crate::structure::Kind;

/// The parts of a blob during a build. Tasks write disjoint ranges.
#[derive(Clone, Copy)]
pub(crate) struct Target<'a> {
    pub base: *mut u8,
    pub parts: Parts,
    pub kind: Kind,
    pub form: Form,
    pub geometries: &'a Geometries<'a>,
}

// SAFETY: tasks share the target, but each writes only its own nodes and leaves.
unsafe impl Send for Target<'_> {}
// SAFETY: as for `Send`.
unsafe impl Sync for Target<'_> {}

impl Target<'_> {
    /// # Safety
    /// `index` is inside the part, and no other thread reads or writes that node.
    pub unsafe fn write_node(&self, index: u32, node: &Node) {
        let offset = self.parts.nodes_offset as usize + index as usize * size_of::<Node>();
        // SAFETY: the caller guarantees that `index` is inside the part, and no other thread reads
        // or writes that node; nodes are aligned to 256 bytes as the blob is.
        unsafe { self.base.add(offset).cast::<Node>().write(*node) }
    }

    /// The address of a leaf.
    pub fn leaf_at<T>(&self, index: u32) -> *mut T {
        self.base
            .wrapping_add(self.parts.leaves_offset as usize)
            .cast::<T>()
            .wrapping_add(index as usize)
    }

    /// # Safety
    /// `index` is inside the part, `T` is the kind's leaf, and no other thread reads or writes it.
    pub unsafe fn write_leaf<T>(&self, index: u32, leaf: T) {
        // SAFETY: the caller guarantees that `index` is inside the part, `T` is the kind's leaf,
        // and no other thread reads or writes it; leaves are as aligned as their sizes ask, from
        // 256 on.
        unsafe { self.leaf_at::<T>(index).write(leaf) }
    }
}
