//! Joins of branches without a merge instruction: cases with fallthrough, and arms of a selection
//! with a common tail. SPIR-V requires only that the header of the construct dominates such a
//! block.
//!
//! A join block is lowered once, after all blocks that branch to it and inside the construct of its
//! immediate dominator, since all paths to it lead through that block. In the reverse postorder of
//! a reducible graph a block comes after all forward branches to it, so one pass finds all
//! dominators. In an irreducible graph the pass finds wrong ones; then some branch finds no label,
//! and the function is refused.

use foldhash::HashMap;

use super::flow::{BlockIndex, Flow};
use crate::parse::Merge;

/// Blocks by their immediate dominators, in the order of control flow.
pub(super) fn find_join_points(flow: Flow<'_>) -> HashMap<BlockIndex, Vec<BlockIndex>> {
    let mut join_points: HashMap<BlockIndex, Vec<BlockIndex>> = HashMap::default();
    let announced = find_announced(flow);
    if !may_join(flow, &announced) {
        return join_points;
    }
    let order = reverse_postorder(flow);
    let mut place = vec![usize::MAX; announced.len()];
    for (at, &block) in order.iter().enumerate() {
        place[block] = at;
    }
    let mut tree = DominatorTree::default();
    // By position in the order: the nearest dominator so far, and the number of branching blocks.
    let mut dominators: Vec<Option<usize>> = vec![None; order.len()];
    let mut branches = vec![0; order.len()];
    for (at, &block) in order.iter().enumerate() {
        tree.push(dominators[at]);
        let successors = flow.successors(block);
        let real = successors.len();
        let others = successors.into_iter().chain(announced_by(flow, block));
        for (index, to) in others.enumerate() {
            let to = place[to];
            if to > at {
                let so_far = dominators[to].map_or(at, |other| tree.common(other, at));
                dominators[to] = Some(so_far);
                branches[to] += usize::from(index < real);
            }
        }
    }
    for (at, &block) in order.iter().enumerate() {
        if branches[at] > 1
            && !announced[block]
            && let Some(dominator) = dominators[at]
        {
            join_points.entry(order[dominator]).or_default().push(block);
        }
    }
    join_points
}

/// The blocks that a block's merge instruction names.
fn announced_by(flow: Flow<'_>, block: BlockIndex) -> impl Iterator<Item = BlockIndex> {
    let (merge, target) = match flow.block(block).merge {
        Some(Merge::Selection(merge)) => (Some(merge), None),
        Some(Merge::Loop(merge, target)) => (Some(merge), Some(target)),
        None => (None, None),
    };
    let labels = target.into_iter().chain(merge);
    labels.filter_map(move |label| flow.index(label))
}

/// Whether a merge instruction names each block.
fn find_announced(flow: Flow<'_>) -> Vec<bool> {
    let mut announced = vec![false; flow.function.blocks.len()];
    for block in 0..announced.len() {
        announced_by(flow, block).for_each(|named| announced[named] = true);
    }
    announced
}

/// Whether a block without a merge instruction has several predecessors, which is rare.
fn may_join(flow: Flow<'_>, announced: &[bool]) -> bool {
    let mut branches = vec![0; announced.len()];
    for block in 0..announced.len() {
        for to in flow.successors(block) {
            branches[to] += 1;
        }
    }
    (branches.iter().zip(announced).enumerate()).any(|(block, (&branches, &announced))| {
        let is_loop = matches!(flow.block(block).merge, Some(Merge::Loop(..)));
        !announced && branches > 1 + usize::from(is_loop)
    })
}

/// The blocks reachable from the first, with those that merge instructions name, in topological
/// order except back-edges.
fn reverse_postorder(flow: Flow<'_>) -> Vec<BlockIndex> {
    let next = |block| {
        let mut next = flow.successors(block);
        next.extend(announced_by(flow, block));
        next
    };
    let mut seen = vec![false; flow.function.blocks.len()];
    seen[0] = true;
    let mut order = Vec::new();
    let mut open = vec![(0, next(0))];
    while let Some((block, rest)) = open.last_mut() {
        match rest.pop() {
            Some(to) => {
                if !std::mem::replace(&mut seen[to], true) {
                    open.push((to, next(to)));
                }
            }
            None => {
                order.push(*block);
                open.pop();
            }
        }
    }
    order.reverse();
    order
}

/// A tree to which leaves are added. Each node has a pointer that skips some of the nodes above it,
/// so that common ancestors are found in logarithmic time (Myers 1983, "An applicative
/// random-access stack").
#[derive(Default)]
struct DominatorTree {
    nodes: Vec<Node>,
}

#[derive(Clone, Copy)]
struct Node {
    depth: u32,
    parent: usize,
    skip: usize,
}

impl DominatorTree {
    /// Adds a node; one without a parent is a root.
    fn push(&mut self, parent: Option<usize>) {
        let own = self.nodes.len();
        let Some(parent) = parent else {
            self.nodes.push(Node {
                depth: 0,
                parent: own,
                skip: own,
            });
            return;
        };
        let above = self.nodes[parent];
        let skipped = self.nodes[above.skip];
        let further = self.nodes[skipped.skip];
        let same = above.depth - skipped.depth == skipped.depth - further.depth;
        self.nodes.push(Node {
            depth: above.depth + 1,
            parent,
            skip: if same { skipped.skip } else { parent },
        });
    }

    /// The nearest node that is above both, or one of them.
    fn common(&self, a: usize, b: usize) -> usize {
        let (mut a, mut b) = (a, b);
        if self.nodes[a].depth < self.nodes[b].depth {
            (a, b) = (b, a);
        }
        let depth = self.nodes[b].depth;
        while self.nodes[a].depth > depth {
            let node = self.nodes[a];
            a = match self.nodes[node.skip].depth >= depth {
                true => node.skip,
                false => node.parent,
            };
        }
        while a != b {
            let (x, y) = (self.nodes[a], self.nodes[b]);
            (a, b) = match x.skip != y.skip {
                true => (x.skip, y.skip),
                false => (x.parent, y.parent),
            };
        }
        a
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn common_ancestors_are_the_nearest() {
        let mut random = fastrand::Rng::with_seed(7);
        let mut tree = DominatorTree::default();
        let mut parents: Vec<usize> = vec![0];
        tree.push(None);
        for node in 1..2_000 {
            // The tree alternates between deep and bushy.
            let parent = match random.bool() {
                true => node - 1,
                false => random.usize(0..node),
            };
            tree.push(Some(parent));
            parents.push(parent);
        }
        let above = |mut node: usize| {
            let mut path = vec![node];
            while node != 0 {
                node = parents[node];
                path.push(node);
            }
            path
        };
        for _ in 0..2_000 {
            let (a, b) = (random.usize(0..2_000), random.usize(0..2_000));
            let of_a = above(a);
            let expected = above(b).into_iter().find(|node| of_a.contains(node));
            assert_eq!(Some(tree.common(a, b)), expected, "{a} {b}");
        }
    }
}
