//! A binary tree over primitives by the surface area heuristic, in the caller's scratch memory.
//!
//! Top down, with the splits of [`super::split`]. A subtree of n primitives has room for 2n − 1
//! nodes from its root, for any shape. So the position of a node depends only on the primitives,
//! not on the timing of threads.

#[cfg(target_arch = "x86_64")]
use lanes::Tier;

use super::corners::Corners;
use super::primitive::Primitive;
use super::split::{Extent, SplitRules, choose, choose_quickly, halve, partition};
#[cfg(target_arch = "x86_64")]
use super::vector::Avx2Bounds;
use super::vector::{PortableBounds, Vector};
use crate::layout::Bounds;
use crate::pool::in_pool;

/// A node of the binary tree. The left child is the next node; the nodes of a subtree are
/// contiguous, and so are its primitives. Subtrees of up to [`PARALLEL`] primitives from [`build`]
/// have no gaps between their nodes.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(16))]
pub(crate) struct BinaryNode {
    min: [f32; 3],
    /// Primitives below.
    pub count: u32,
    max: [f32; 3],
    /// Nodes below and including this one; once planned, those of the wide tree.
    pub wide_nodes: u32,
    /// Leaves of the blob below, once planned.
    pub wide_leaves: u32,
    /// The decisions of [`super::collapse`].
    pub decisions: [u8; 7],
    reserved: u8,
    /// Distance to the right child; 0 without children.
    right: u32,
}

impl BinaryNode {
    /// A node without children.
    pub fn new(corners: &Corners, count: usize) -> BinaryNode {
        let bounds = corners.bounds();
        BinaryNode {
            min: bounds.min,
            count: count as u32,
            max: bounds.max,
            wide_nodes: 1,
            ..BinaryNode::default()
        }
    }

    /// The box.
    pub fn bounds(&self) -> Bounds {
        Bounds {
            min: self.min,
            max: self.max,
        }
    }

    /// Whether it has no children.
    pub fn is_leaf(&self) -> bool {
        self.right == 0
    }

    /// Distance to the right child.
    pub fn right(&self) -> usize {
        self.right as usize
    }

    /// Sets the children: the next node, and the node at this distance.
    pub fn set_right(&mut self, distance: usize) {
        self.right = distance as u32;
    }

    /// Half the surface of the box, in units that keep it finite.
    #[inline]
    pub fn area(&self, scale: f32) -> f32 {
        Corners::of(&self.bounds()).half_area(scale)
    }
}

/// The subtrees of an inner node's slice.
pub(crate) fn children_mut(
    nodes: &mut [BinaryNode],
) -> (&mut BinaryNode, &mut [BinaryNode], &mut [BinaryNode]) {
    let (root, rest) = nodes.split_first_mut().expect("a subtree has a root");
    let (left, right) = rest.split_at_mut(root.right() - 1);
    (root, left, right)
}

/// The subtrees of an inner node's slice.
pub(crate) fn children(nodes: &[BinaryNode]) -> (&[BinaryNode], &[BinaryNode]) {
    nodes[1..].split_at(nodes[0].right() - 1)
}

/// The depth from which splits halve the number of primitives, to bound the recursion.
pub(super) const HEURISTIC_DEPTH: u32 = 64;
/// Subtrees with more primitives than this are built in parallel.
pub(crate) const PARALLEL: usize = 2048;

/// Builds the tree of `primitives`, with this extent, into `nodes` (2n − 1 of them), and sorts the
/// primitives into the order of its leaves. The tree is the same on every machine.
pub(crate) fn build(
    primitives: &mut [Primitive],
    nodes: &mut [BinaryNode],
    rules: &SplitRules,
    extent: Extent,
) {
    #[cfg(target_arch = "x86_64")]
    if Tier::best() >= Tier::Avx2 {
        // SAFETY: the machine has it.
        unsafe { subtree_avx2(primitives, nodes, rules, extent, 0) };
        return;
    }
    build_portable(primitives, nodes, rules, extent);
}

/// The same on any machine.
pub(crate) fn build_portable(
    primitives: &mut [Primitive],
    nodes: &mut [BinaryNode],
    rules: &SplitRules,
    extent: Extent,
) {
    subtree_portable(primitives, nodes, rules, extent, 0);
}

/// The extent of all primitives.
pub(crate) fn extent(primitives: &[Primitive]) -> Extent {
    #[cfg(target_arch = "x86_64")]
    if Tier::best() >= Tier::Avx2 {
        // SAFETY: the machine has it.
        return unsafe { extent_avx2(primitives) };
    }
    Extent::of::<PortableBounds>(primitives)
}

/// # Safety
/// The machine has AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
unsafe fn extent_avx2(primitives: &[Primitive]) -> Extent {
    Extent::of::<Avx2Bounds>(primitives)
}

/// One of the two instances of [`subtree`]; returns the number of nodes.
///
/// # Safety
/// The machine has the instruction set.
pub(crate) type Subtree =
    unsafe fn(&mut [Primitive], &mut [BinaryNode], &SplitRules, Extent, u32) -> usize;

/// # Safety
/// The machine has AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2")]
pub(crate) unsafe fn subtree_avx2(
    primitives: &mut [Primitive],
    nodes: &mut [BinaryNode],
    rules: &SplitRules,
    extent: Extent,
    depth: u32,
) -> usize {
    subtree::<Avx2Bounds>(primitives, nodes, rules, extent, depth, subtree_avx2)
}

pub(crate) fn subtree_portable(
    primitives: &mut [Primitive],
    nodes: &mut [BinaryNode],
    rules: &SplitRules,
    extent: Extent,
    depth: u32,
) -> usize {
    subtree::<PortableBounds>(primitives, nodes, rules, extent, depth, subtree_portable)
}

/// Inlined into a function for each instruction set, `again`, which also builds the subtrees.
#[inline(always)]
fn subtree<V: Vector>(
    primitives: &mut [Primitive],
    nodes: &mut [BinaryNode],
    rules: &SplitRules,
    extent: Extent,
    depth: u32,
    again: Subtree,
) -> usize {
    let count = primitives.len();
    let leaf = count < rules.stop.max(2);
    nodes[0] = BinaryNode::new(&extent.corners, count);
    if leaf {
        return 1;
    }
    // Few primitives need few bins.
    let chosen = if depth >= HEURISTIC_DEPTH {
        None
    } else if rules.hurry && count > 32 {
        choose_quickly::<V, 16>(primitives, rules, &extent)
    } else if rules.hurry {
        choose_quickly::<V, 8>(primitives, rules, &extent)
    } else if count > 240 {
        choose::<V, 32>(primitives, rules, &extent)
    } else if count > 80 {
        choose::<V, 16>(primitives, rules, &extent)
    } else {
        choose::<V, 8>(primitives, rules, &extent)
    };
    let (middle, left_extent, right_extent) = match chosen {
        Some(split) => partition::<V>(primitives, &split),
        None => halve::<V>(primitives, &extent),
    };
    let (left, right) = primitives.split_at_mut(middle);
    let sizes = if count > PARALLEL {
        // Each side has room for any shape.
        nodes[0].set_right(2 * middle);
        let (left_nodes, right_nodes) = nodes[1..].split_at_mut(2 * middle - 1);
        // SAFETY: the machine that runs this has the instruction set.
        let mut go_left = || unsafe { again(left, left_nodes, rules, left_extent, depth + 1) };
        // SAFETY: the machine that runs this has the instruction set.
        let mut go_right = || unsafe { again(right, right_nodes, rules, right_extent, depth + 1) };
        match in_pool() {
            true => rayon::join(go_left, go_right),
            false => (go_left(), go_right()),
        }
    } else {
        // SAFETY: the machine that runs this has the instruction set.
        unsafe {
            let size = again(left, &mut nodes[1..], rules, left_extent, depth + 1);
            nodes[0].set_right(1 + size);
            let rest = &mut nodes[1 + size..];
            (size, again(right, rest, rules, right_extent, depth + 1))
        }
    };
    let size = 1 + sizes.0 + sizes.1;
    nodes[0].wide_nodes = size as u32;
    size
}
