//! The smallest and flattest tree, for inputs for which no better tree fits.

use super::primitive::Primitive;
use super::split;
use super::target::Target;
use crate::layout::{Bounds, Node, WIDTH};

impl Target<'_> {
    /// Leaves of [`Self::write_packed`]: only the last child is not full.
    pub fn packed_leaves(&self, count: usize) -> u32 {
        let full = self.leaf_max();
        (count / full) as u32 * self.leaves_of(full) + self.leaves_of(count % full)
    }

    /// Nodes of [`Self::write_packed`] for `count` primitives.
    pub fn packed_nodes(&self, count: usize) -> u32 {
        let size = self.packed_child(count);
        if size == self.leaf_max() {
            return 1;
        }
        let full = count / size;
        let rest = count % size;
        let mut sum = 1 + full as u32 * self.packed_nodes(size);
        if rest > 0 {
            sum += self.packed_nodes(rest);
        }
        sum
    }

    /// Levels of nodes of [`Self::write_packed`].
    pub fn packed_depth(&self, count: usize) -> u32 {
        let size = self.packed_child(count);
        if size == self.leaf_max() {
            1
        } else {
            1 + self.packed_depth(size)
        }
    }

    /// Primitives of each child except the last: the smallest full subtree of which eight suffice.
    fn packed_child(&self, count: usize) -> usize {
        let mut size = self.leaf_max();
        while size * WIDTH < count {
            size *= WIDTH;
        }
        size
    }

    /// Writes a tree of full nodes over full leaves, the smallest and flattest possible. Returns
    /// its box.
    ///
    /// # Safety
    /// As for [`Self::write_tree`].
    pub unsafe fn write_packed(
        &self,
        primitives: &mut [Primitive],
        node_index: u32,
        leaf_index: u32,
    ) -> Bounds {
        let size = self.packed_child(primitives.len());
        sort_chunks(primitives, size);
        let mut node = Node::EMPTY;
        let mut all = Bounds::EMPTY;
        let (mut next_node, mut next_leaf) = (node_index + 1, leaf_index);
        for (lane, own) in primitives.chunks_mut(size).enumerate() {
            let bounds = if size == self.leaf_max() {
                // SAFETY: chunks before this one took the leaves before these.
                (node.children[lane], _) = unsafe { self.write_primitives(own, next_leaf) };
                own.iter().fold(Bounds::EMPTY, |sum, primitive| {
                    sum.union(primitive.bounds())
                })
            } else {
                node.children[lane] = next_node;
                let nodes = self.packed_nodes(own.len());
                // SAFETY: chunks before this one took the leaves before these.
                let bounds = unsafe { self.write_packed(own, next_node, next_leaf) };
                next_node += nodes;
                bounds
            };
            next_leaf += self.leaves_of(own.len());
            node.set_bounds(lane, bounds);
            all = all.union(bounds);
        }
        // SAFETY: the caller keeps the promises of `Self::write_tree`.
        unsafe { self.write_node(node_index, &node) };
        all
    }
}

/// Orders primitives so that each chunk of `size` is close together.
fn sort_chunks(primitives: &mut [Primitive], size: usize) {
    let chunks = primitives.len().div_ceil(size);
    if chunks > 1 {
        let middle = chunks / 2 * size;
        split::divide(primitives, middle);
        let (left, right) = primitives.split_at_mut(middle);
        sort_chunks(left, size);
        sort_chunks(right, size);
    }
}
