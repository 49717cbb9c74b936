//! Collapses the binary tree to an 8-wide one with the smallest expected cost.
//!
//! Dynamic programming from the leaves up (Ylitie, Karras, Laine 2017, section 3.2): for each
//! subtree, the smallest cost as 1 … 7 children of a parent follows from those of its two halves.
//! Nodes keep the decisions; costs exist only on the way up.

use rayon::prelude::*;

use super::tree::{BinaryNode, children, children_mut};
use crate::layout::WIDTH;
use crate::pool::in_pool;

/// The costs of steps of the walk.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Costs {
    /// Testing the children of a node.
    pub node: f32,
    /// Testing a block of primitives.
    pub block: f32,
    /// Primitives of a block.
    pub block_size: u32,
    /// Largest number of primitives of a leaf.
    pub leaf_max: u32,
    /// Subtrees of at most this many primitives always become leaves.
    pub leaf_forced: u32,
    /// Scale of areas; see [`super::tree::SplitRules`].
    pub scale: f32,
}

/// The decision for a subtree as one child: a leaf.
const LEAF: u8 = 0x80;
/// The decision for a subtree as i > 1 children: use i − 1.
const FEWER: u8 = 0x80;

/// Subtrees with more primitives than this are planned in parallel.
const PARALLEL: u32 = 8192;

/// Plans the whole tree: fills in decisions, then sizes. `leaves` returns the number of the blob's
/// leaves for consecutive primitives as one child, from the first primitive and their number.
/// Returns the levels of nodes.
pub(crate) fn plan(
    nodes: &mut [BinaryNode],
    costs: &Costs,
    leaves: &(impl Fn(u32, u32) -> u32 + Sync),
) -> u32 {
    decide(nodes, costs);
    measure(nodes, 0, leaves)
}

/// `result[i]`: smallest cost of the subtree as up to i + 1 children.
fn decide(nodes: &mut [BinaryNode], costs: &Costs) -> [f32; 7] {
    let area = nodes[0].area(costs.scale);
    let count = nodes[0].count;
    let leaf_cost = if count <= costs.leaf_max {
        area * costs.block * count.div_ceil(costs.block_size) as f32
    } else {
        f32::INFINITY
    };
    if nodes[0].is_leaf() {
        nodes[0].decisions = [LEAF; 7];
        return [leaf_cost; 7];
    }
    let (root, left, right) = children_mut(nodes);
    let is_leaf = [left[0].is_leaf(), right[0].is_leaf()];
    let (left, right) = if count > PARALLEL && in_pool() {
        rayon::join(|| decide(left, costs), || decide(right, costs))
    } else {
        (decide(left, costs), decide(right, costs))
    };
    // The best division of i + 2 children between both halves. A leaf costs the same for any number
    // of children; other subtrees cost less with more children.
    let share = |i: usize| {
        if is_leaf[0] {
            return (left[0] + right[i], 0);
        } else if is_leaf[1] {
            return (left[i] + right[0], i as u8);
        }
        let mut best = (left[0] + right[i], 0);
        for k in 1..=i {
            let cost = left[k] + right[i - k];
            if cost < best.0 {
                best = (cost, k as u8);
            }
        }
        best
    };
    let (inner_cost, split) = share(WIDTH - 2);
    let inner_cost = inner_cost + area * costs.node;
    let mut result = [0.0; 7];
    let as_leaf = leaf_cost <= inner_cost || count <= costs.leaf_forced;
    result[0] = if as_leaf { leaf_cost } else { inner_cost };
    root.decisions[0] = if as_leaf { LEAF | split } else { split };
    for i in 1..7 {
        let (cost, split) = share(i - 1);
        if cost < result[i - 1] && count > costs.leaf_forced {
            result[i] = cost;
            root.decisions[i] = split;
        } else {
            result[i] = result[i - 1];
            root.decisions[i] = FEWER;
        }
    }
    result
}

/// Up to eight subtrees.
pub(crate) struct Children<'a> {
    list: [&'a [BinaryNode]; WIDTH],
    /// First primitive of each, counted from the parent's first.
    firsts: [u32; WIDTH],
    length: usize,
}

impl<'a> Children<'a> {
    /// The children of a subtree's wide node; the subtree itself if it is a leaf.
    pub fn of(nodes: &'a [BinaryNode]) -> Children<'a> {
        let mut found = Children {
            list: [&[]; WIDTH],
            firsts: [0; WIDTH],
            length: 0,
        };
        if is_leaf(nodes) {
            found.push(nodes, 0);
        } else {
            found.distribute(nodes, nodes[0].decisions[0], WIDTH - 2, 0);
        }
        found
    }

    /// Each child's subtree and its first primitive.
    pub fn iter(&self) -> impl Iterator<Item = (&'a [BinaryNode], u32)> + '_ {
        (0..self.length).map(|i| (self.list[i], self.firsts[i]))
    }

    fn push(&mut self, nodes: &'a [BinaryNode], first: u32) {
        self.list[self.length] = nodes;
        self.firsts[self.length] = first;
        self.length += 1;
    }

    /// Adds both halves, with i + 2 children together and k + 1 for the left one.
    fn distribute(&mut self, nodes: &'a [BinaryNode], k: u8, i: usize, first: u32) {
        let (left, right) = children(nodes);
        let k = usize::from(k);
        self.hand_up(left, k, first);
        self.hand_up(right, i - k, first + left[0].count);
    }

    /// Adds a subtree as up to i + 1 children.
    fn hand_up(&mut self, nodes: &'a [BinaryNode], i: usize, first: u32) {
        let decisions = &nodes[0].decisions;
        let i = (1..=i)
            .rev()
            .find(|&i| decisions[i] & FEWER == 0)
            .unwrap_or(0);
        if i == 0 {
            self.push(nodes, first);
        } else {
            self.distribute(nodes, decisions[i], i - 1, first);
        }
    }
}

/// Whether a planned subtree, as one child, is a leaf.
pub(crate) fn is_leaf(nodes: &[BinaryNode]) -> bool {
    nodes[0].decisions[0] & LEAF != 0
}

/// Fills in the numbers of nodes and leaves of each wide subtree. Returns its levels of nodes.
fn measure(
    nodes: &mut [BinaryNode],
    first: u32,
    leaves: &(impl Fn(u32, u32) -> u32 + Sync),
) -> u32 {
    // Offsets are computed first, because the children borrow the slice that is written.
    let mut offsets = [(0, 0, 0); WIDTH];
    let mut length = 0;
    for (child, own_first) in Children::of(nodes).iter() {
        // SAFETY: a child is a part of `nodes`.
        let offset = unsafe { child.as_ptr().offset_from_unsigned(nodes.as_ptr()) };
        offsets[length] = (offset, child.len(), first + own_first);
        length += 1;
    }
    let (root_is_leaf, count) = (is_leaf(nodes), nodes[0].count);
    let mut parts = [const { (Sizes::LEAF, None) }; WIDTH];
    let (mut rest, mut start) = (&mut *nodes, 0);
    for (part, &(offset, length, first)) in parts.iter_mut().zip(&offsets[..length]) {
        let (child, after) = rest[offset - start..].split_at_mut(length);
        (rest, start) = (after, offset + length);
        part.1 = Some((child, first));
    }
    let measure = |part: &mut (Sizes, Option<(&mut [BinaryNode], u32)>)| {
        let Some((child, first)) = &mut part.1 else {
            return;
        };
        if root_is_leaf || is_leaf(child) {
            part.0.leaves = leaves(*first, child[0].count);
        } else {
            let depth = measure(child, *first, leaves);
            part.0 = Sizes {
                nodes: child[0].wide_nodes,
                leaves: child[0].wide_leaves,
                depth,
            };
        }
    };
    match count > PARALLEL && in_pool() {
        true => parts[..length].par_iter_mut().for_each(measure),
        false => parts[..length].iter_mut().for_each(measure),
    }
    let sizes = parts.map(|part| part.0);
    let depth = sizes.iter().map(|child| child.depth).max().unwrap_or(0);
    nodes[0].wide_nodes = 1 + sizes.iter().map(|child| child.nodes).sum::<u32>();
    nodes[0].wide_leaves = sizes.iter().map(|child| child.leaves).sum();
    1 + depth
}

/// The sizes of a wide node's children.
#[derive(Clone, Copy)]
struct Sizes {
    nodes: u32,
    leaves: u32,
    /// Levels of nodes.
    depth: u32,
}

impl Sizes {
    const LEAF: Sizes = Sizes {
        nodes: 0,
        leaves: 0,
        depth: 0,
    };
}
