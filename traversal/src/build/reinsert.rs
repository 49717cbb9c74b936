//! Reinserts badly placed subtrees (Meister and Bittner 2018). The top of a binary tree, where
//! plane splits had to separate large primitives from near ones, is taken apart, and each piece is
//! inserted where it enlarges boxes least.
//!
//! This helps if sizes differ, as with walls around furniture. Otherwise nothing moves, at almost
//! no cost.

use rayon::join;

use super::collapse::Costs;
use super::corners::Corners;
use super::primitive::Primitive;
use super::tree::{BinaryNode, PARALLEL};
use crate::pool::in_pool;
use crate::structure::Kind;

/// A node of the top of the tree. A node without children represents a whole subtree.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
pub(crate) struct Piece {
    corners: Corners,
    area: f32,
    parent: u32,
    /// The root's index, which is never a child, if there are no children.
    children: [u32; 2],
    /// The nodes of a represented subtree.
    nodes: u32,
    /// Nodes below and including this one, packed.
    size: u32,
    /// The first primitive of a represented subtree.
    first: u32,
    /// Primitives below.
    count: u32,
}

const ROOT: u32 = 0;

/// Fewer primitives gain nothing.
const FEW: u64 = 64;
/// Largest number of pieces, since one thread moves them.
const MOST: u64 = 16384;
/// Largest number of rounds over all pieces.
const ROUNDS: usize = 3;
/// Rounds between searches of the tree's top for large nodes.
const FINER: f32 = 0.7;
/// Minimum share of the tree top's cost that is worth another round and a new tree layout.
const WORTHWHILE: f32 = 0.01;
/// Largest number of levels of the top.
const DEEPEST: usize = 128;
/// Largest number of levels of a binary tree: from [`super::tree::HEURISTIC_DEPTH`] its splits
/// halve.
const MOST_LEVELS: usize = super::tree::HEURISTIC_DEPTH as usize + 34;
const WRITTEN: &str = "the scratch memory was written during a build";
/// The depth for insertions. Nothing is inserted deeper, because large nodes would collect small
/// ones in long chains.
const DEEP: u32 = 40;

/// The number of pieces for a tree of this many primitives, and the number of nodes besides two for
/// each primitive.
pub(crate) fn places(kind: Kind, count: u64) -> (u64, u64) {
    match kind {
        _ if count < FEW => (0, 0),
        // Leaves hold several primitives, so two trees have room in the memory of one.
        Kind::Triangles => ((count / 32 + 16).min(MOST), 0),
        // Instances overlap more than anything else. All nodes are pieces.
        kind if kind.is_top() => ((2 * count).min(MOST), count.min(MOST / 2)),
        _ => (0, 0),
    }
}

/// Improves a tree over `primitives` in `nodes`, whose first node is its root. Returns the nodes of
/// the improved one.
pub(crate) fn improve<'a>(
    primitives: &mut [Primitive],
    nodes: &'a mut [BinaryNode],
    (pieces, order): (&mut [Piece], &mut [u32]),
    costs: &Costs,
) -> &'a mut [BinaryNode] {
    let count = primitives.len();
    let fits_twice = costs.leaf_max > 1 || nodes.len() >= 3 * count;
    if (count as u64) < FEW || pieces.is_empty() || nodes[0].is_leaf() || !fits_twice {
        return nodes;
    }
    let mut top = Top::of(nodes, pieces, costs.scale);
    let worthwhile = WORTHWHILE * top.pieces.iter().map(|piece| piece.area).sum::<f32>();
    let mut gained = 0.0;
    for _ in 0..ROUNDS {
        let gain: f32 = (1..top.pieces.len() as u32)
            .map(|piece| top.improve(piece))
            .sum();
        gained += gain;
        if gain <= worthwhile {
            break;
        }
    }
    if gained <= worthwhile || top.is_too_deep() {
        return nodes;
    }
    let size = top.measure((ROOT, 0), nodes) as usize;
    // The new tree goes to the end of the memory. Its parts, and then primitives, are collected
    // before it.
    let room = nodes.len() - size;
    if top.hanging_size() > room || count > room {
        return nodes;
    }
    top.pack(nodes, order);
    let (packed, improved) = nodes.split_at_mut(room);
    top.write_nodes((ROOT, 0), packed, improved);
    // SAFETY: nodes are larger than primitives, aligned as they are by [`super::carve`], and both
    // are plain numbers.
    let spare = unsafe { std::slice::from_raw_parts_mut(packed.as_mut_ptr().cast(), count) };
    top.write_primitives((ROOT, 0), primitives, spare);
    primitives.copy_from_slice(spare);
    improved
}

/// The top of a tree.
struct Top<'a> {
    pieces: &'a mut [Piece],
    scale: f32,
}

impl<'a> Top<'a> {
    /// Takes the largest nodes of a tree, the larger ones first, roughly.
    fn of(nodes: &[BinaryNode], pieces: &'a mut [Piece], scale: f32) -> Top<'a> {
        let piece = |at: u32, first: u32, parent: u32| {
            let node = &nodes[at as usize];
            let corners = Corners::of(&node.bounds());
            Piece {
                corners,
                area: corners.half_area(scale),
                parent,
                children: [ROOT; 2],
                nodes: at,
                size: 0,
                first,
                count: node.count,
            }
        };
        pieces[0] = piece(0, 0, ROOT);
        let mut length = 1;
        let mut least = pieces[0].area;
        let mut is_all = false;
        while length + 2 <= pieces.len() && !is_all {
            least *= FINER;
            is_all = true;
            let mut i = 0;
            while i < length && length + 2 <= pieces.len() {
                let Piece {
                    nodes: at, first, ..
                } = pieces[i];
                let node = &nodes[at as usize];
                if !pieces[i].has_children() && !node.is_leaf() {
                    if pieces[i].area > least {
                        let right = at + node.right() as u32;
                        pieces[length] = piece(at + 1, first, i as u32);
                        let middle = first + pieces[length].count;
                        pieces[length + 1] = piece(right, middle, i as u32);
                        pieces[i].children = [length as u32, length as u32 + 1];
                        length += 2;
                    }
                    is_all = false;
                }
                i += 1;
            }
            // Points and lines have zero area.
            is_all |= least < f32::MIN_POSITIVE;
        }
        Top {
            pieces: &mut pieces[..length],
            scale,
        }
    }

    fn at(&self, piece: u32) -> &Piece {
        &self.pieces[piece as usize]
    }

    fn at_mut(&mut self, piece: u32) -> &mut Piece {
        &mut self.pieces[piece as usize]
    }

    fn sibling(&self, piece: u32) -> u32 {
        let [left, right] = self.at(self.at(piece).parent).children;
        if left == piece { right } else { left }
    }

    /// Inserts a piece at the position of smallest cost. Returns the gain.
    fn improve(&mut self, piece: u32) -> f32 {
        let place = self.best_place(piece);
        if let Some((sibling, _)) = place {
            self.put(piece, sibling);
        }
        place.map_or(0.0, |(_, gain)| gain)
    }

    /// The best sibling for a piece, and the gain in surface of the boxes above.
    fn best_place(&self, piece: u32) -> Option<(u32, f32)> {
        let own = self.at(piece);
        let parent = own.parent;
        if parent == ROOT {
            return None;
        }
        let mut best = (ROOT, 0.0);
        // The search goes upwards from the piece, and from each node there down the other side. The
        // gain so far is that of the boxes that no longer contain the piece.
        let mut gained = self.at(parent).area;
        let mut pivot = parent;
        let mut other = self.sibling(piece);
        let mut without = self.at(other).corners;
        let mut level = self.levels_above(piece) as u32;
        let mut stack = [(0.0, ROOT, 0); DEEPEST];
        for _ in 0..self.pieces.len() {
            stack[0] = (gained, other, level);
            let mut length = 1;
            while length > 0 {
                length -= 1;
                let (gained, there, level) = stack[length];
                if gained - own.area <= best.1 || level > DEEP {
                    continue;
                }
                let target = self.at(there);
                let gain = gained - target.corners.join(&own.corners).half_area(self.scale);
                if gain > best.1 {
                    best = (there, gain);
                }
                let below = gain + target.area;
                if target.has_children() && below - own.area > best.1 && length + 2 <= stack.len() {
                    stack[length] = (below, target.children[0], level + 1);
                    stack[length + 1] = (below, target.children[1], level + 1);
                    length += 2;
                }
            }
            if pivot != parent {
                without = without.join(&self.at(other).corners);
                gained += self.at(pivot).area - without.half_area(self.scale);
            }
            if pivot == ROOT {
                break;
            }
            other = self.sibling(pivot);
            pivot = self.at(pivot).parent;
            level = level.saturating_sub(1);
        }
        (best.0 != ROOT && best.0 != self.sibling(piece)).then_some(best)
    }

    /// Makes a piece, with its parent, the sibling of another.
    fn put(&mut self, piece: u32, sibling: u32) {
        let parent = self.at(piece).parent;
        let (left_behind, above) = (self.sibling(piece), self.at(parent).parent);
        self.replace(above, parent, left_behind);
        let target = self.at(sibling).parent;
        self.replace(target, sibling, parent);
        self.at_mut(parent).children = [piece, sibling];
        self.at_mut(sibling).parent = parent;
        self.refit(above);
        self.refit(parent);
    }

    fn replace(&mut self, parent: u32, child: u32, other: u32) {
        let children = &mut self.at_mut(parent).children;
        children[usize::from(children[0] != child)] = other;
        self.at_mut(other).parent = parent;
    }

    /// Computes the boxes of a piece and those above it.
    fn refit(&mut self, mut piece: u32) {
        for _ in 0..self.pieces.len() {
            let [left, right] = self.at(piece).children;
            let corners = self.at(left).corners.join(&self.at(right).corners);
            let area = corners.half_area(self.scale);
            let own = self.at_mut(piece);
            (own.corners, own.area) = (corners, area);
            if piece == ROOT {
                return;
            }
            piece = own.parent;
        }
    }

    /// Pieces above one; beyond [`DEEPEST`], some more.
    fn levels_above(&self, piece: u32) -> usize {
        let mut above = 0;
        let mut at = piece;
        while at != ROOT && above <= DEEPEST {
            at = self.at(at).parent;
            above += 1;
        }
        above
    }

    fn is_too_deep(&self) -> bool {
        (1..self.pieces.len() as u32).any(|piece| self.levels_above(piece) > DEEPEST)
    }

    /// Fills in sizes and counts below a piece; returns its size.
    fn measure(&mut self, (piece, level): (u32, usize), nodes: &[BinaryNode]) -> u32 {
        check_depth(level);
        let Piece {
            children,
            nodes: at,
            ..
        } = *self.at(piece);
        let size = match self.at(piece).has_children() {
            true => {
                let size = 1 + children
                    .map(|child| self.measure((child, level + 1), nodes))
                    .iter()
                    .sum::<u32>();
                let counts = children.map(|child| self.at(child).count);
                self.at_mut(piece).count = counts.iter().sum();
                size
            }
            false => nodes[at as usize].wide_nodes,
        };
        self.at_mut(piece).size = size;
        size
    }

    /// Nodes of all that hangs there.
    fn hanging_size(&self) -> usize {
        let hanging = self.pieces.iter().filter(|piece| !piece.has_children());
        hanging.map(|piece| piece.size as usize).sum()
    }

    /// Moves the nodes of represented subtrees together at the front. `order` has an element for
    /// each piece.
    fn pack(&mut self, nodes: &mut [BinaryNode], order: &mut [u32]) {
        let hanging = (0..self.pieces.len() as u32).filter(|&piece| !self.at(piece).has_children());
        let mut length = 0;
        for (place, piece) in order.iter_mut().zip(hanging) {
            *place = piece;
            length += 1;
        }
        // Each subtree moves forward, over gaps before it.
        let order = &mut order[..length];
        order.sort_unstable_by_key(|&piece| self.at(piece).nodes);
        let mut end = 0;
        for &mut piece in order {
            let start = self.at(piece).nodes as usize;
            self.at_mut(piece).nodes = end as u32;
            end += pack(nodes, start, end, 0);
        }
    }

    /// Writes the subtree of a piece.
    fn write_nodes(
        &self,
        (piece, level): (u32, usize),
        packed: &[BinaryNode],
        to: &mut [BinaryNode],
    ) {
        check_depth(level);
        let piece = self.at(piece);
        if !piece.has_children() {
            to.copy_from_slice(&packed[piece.nodes as usize..][..piece.size as usize]);
            return;
        }
        let [left, right] = piece.children;
        let right_at = 1 + self.at(left).size;
        to[0] = BinaryNode::new(&piece.corners, piece.count as usize);
        to[0].set_right(right_at as usize);
        let (first, last) = to[1..].split_at_mut(right_at as usize - 1);
        both(
            piece.count,
            || self.write_nodes((left, level + 1), packed, first),
            || self.write_nodes((right, level + 1), packed, last),
        );
    }

    /// Copies the primitives of a piece.
    fn write_primitives(
        &self,
        (piece, level): (u32, usize),
        from: &[Primitive],
        to: &mut [Primitive],
    ) {
        check_depth(level);
        let piece = self.at(piece);
        if !piece.has_children() {
            to.copy_from_slice(&from[piece.first as usize..][..piece.count as usize]);
            return;
        }
        let [left, right] = piece.children;
        let (first, last) = to.split_at_mut(self.at(left).count as usize);
        both(
            piece.count,
            || self.write_primitives((left, level + 1), from, first),
            || self.write_primitives((right, level + 1), from, last),
        );
    }
}

impl Piece {
    fn has_children(&self) -> bool {
        self.children != [ROOT; 2]
    }
}

/// Pieces are in the application's memory. A write there during a build can make a cycle, which
/// must end in an error before the stack overflows. [`Top::is_too_deep`] has checked all of them
/// before.
fn check_depth(level: usize) {
    assert!(level <= DEEPEST, "{WRITTEN}");
}

/// Runs both, in parallel if that pays off.
fn both(count: u32, one: impl FnOnce() + Send, other: impl FnOnce() + Send) {
    if count > PARALLEL as u32 && in_pool() {
        join(one, other);
    } else {
        one();
        other();
    }
}

/// Moves a subtree to the front of where it is, without gaps. Returns its size.
fn pack(nodes: &mut [BinaryNode], from: usize, to: usize, level: usize) -> usize {
    assert!(level < MOST_LEVELS, "{WRITTEN}");
    let mut node = nodes[from];
    if node.count as usize <= PARALLEL {
        let size = node.wide_nodes as usize;
        nodes.copy_within(from..from + size, to);
        return size;
    }
    let mut size = 1;
    if !node.is_leaf() {
        let right = from + node.right();
        size += pack(nodes, from + 1, to + size, level + 1);
        node.set_right(size);
        size += pack(nodes, right, to + size, level + 1);
    }
    nodes[to] = node;
    size
}
