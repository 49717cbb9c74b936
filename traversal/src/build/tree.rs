//! A binary tree over primitives by the surface area heuristic, in the caller's scratch memory.
//!
//! Binned splits over the primitives' centers (Wald 2007), top down. A subtree of n primitives
//! occupies the 2n − 1 nodes from its root on, whatever its shape: the place of a node depends on
//! the primitives alone and never on which thread came first.

use glam::Vec3A;

use super::primitive::{Primitive, in_pool};
use crate::layout::Bounds;

/// A node of the binary tree. The left child is the next node, the right child comes after the
/// left one's 2n − 1; primitives of a subtree are consecutive.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(16))]
pub(crate) struct BinaryNode {
    min: [f32; 3],
    /// Primitives below.
    pub count: u32,
    max: [f32; 3],
    /// Nodes of the wide tree below and including this one, once planned.
    pub wide_nodes: u32,
    /// Leaves of the blob below, once planned.
    pub wide_leaves: u32,
    /// What [`super::collapse`] decided.
    pub decisions: [u8; 7],
    /// 1: no children.
    leaf: u8,
    reserved: u32,
}

impl BinaryNode {
    /// The box.
    pub fn bounds(&self) -> Bounds {
        Bounds {
            min: self.min,
            max: self.max,
        }
    }

    /// Whether it has no children.
    pub fn is_leaf(&self) -> bool {
        self.leaf != 0
    }

    /// Half the surface of the box, in units that keep it finite.
    #[inline]
    pub fn area(&self, scale: f32) -> f32 {
        half_area(Vec3A::from(self.min), Vec3A::from(self.max), scale)
    }
}

/// The subtrees of an inner node's slice.
pub(crate) fn children_mut(
    nodes: &mut [BinaryNode],
) -> (&mut BinaryNode, &mut [BinaryNode], &mut [BinaryNode]) {
    let (root, rest) = nodes.split_first_mut().expect("a subtree has a root");
    let left = 2 * rest[0].count as usize - 1;
    let (left, right) = rest.split_at_mut(left);
    (root, left, right)
}

/// The subtrees of an inner node's slice.
pub(crate) fn children(nodes: &[BinaryNode]) -> (&[BinaryNode], &[BinaryNode]) {
    nodes[1..].split_at(2 * nodes[1].count as usize - 1)
}

/// How splits are chosen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SplitRules {
    /// Primitives that one step of the walk tests at once.
    pub block: u32,
    /// Fewer primitives than this are not split.
    pub stop: usize,
    /// One over the extent of everything, so that areas neither over- nor underflow.
    pub scale: f32,
}

impl SplitRules {
    pub fn new(block: u32, stop: usize, primitives: &[Primitive]) -> SplitRules {
        let extent = Extent::of(primitives);
        let size = (extent.max - extent.min).max_element();
        let scale = if size > TINY { 1.0 / size } else { 1.0 };
        SplitRules { block, stop, scale }
    }
}

/// An extent below this is none: its reciprocal could overflow.
const TINY: f32 = 1.0e-36;
/// Bins of an axis, for many, some and few primitives.
const BINS: [usize; 3] = [32, 16, 8];
/// More primitives than this are many.
const MANY: usize = 512;
/// So many primitives are few.
const FEW: usize = 24;
/// From this depth on, splits halve the number of primitives: bounds the depth of the recursion.
const HEURISTIC_DEPTH: u32 = 64;
/// Subtrees with more primitives than this are built side by side.
const PARALLEL: usize = 2048;

/// Half the surface of a box whose edges are multiplied by `scale`.
#[inline]
fn half_area(min: Vec3A, max: Vec3A, scale: f32) -> f32 {
    let edges = (max - min) * scale;
    edges.x * edges.y + edges.y * edges.z + edges.z * edges.x
}

/// The box of some primitives and the box of their centers.
#[derive(Clone, Copy)]
struct Extent {
    min: Vec3A,
    max: Vec3A,
    center_min: Vec3A,
    center_max: Vec3A,
}

impl Extent {
    const EMPTY: Extent = Extent {
        min: Vec3A::INFINITY,
        max: Vec3A::NEG_INFINITY,
        center_min: Vec3A::INFINITY,
        center_max: Vec3A::NEG_INFINITY,
    };

    #[inline]
    fn add(&mut self, primitive: &Primitive) {
        self.min = self.min.min(primitive.min());
        self.max = self.max.max(primitive.max());
        let center = primitive.center();
        self.center_min = self.center_min.min(center);
        self.center_max = self.center_max.max(center);
    }

    fn of(primitives: &[Primitive]) -> Extent {
        let mut extent = Extent::EMPTY;
        for primitive in primitives {
            extent.add(primitive);
        }
        extent
    }
}

/// Builds the tree of `primitives` into `nodes` (2n − 1 of them) and sorts the primitives into the
/// order of its leaves.
pub(crate) fn build(primitives: &mut [Primitive], nodes: &mut [BinaryNode], rules: &SplitRules) {
    let extent = Extent::of(primitives);
    subtree(primitives, nodes, rules, extent, 0);
}

fn subtree(
    primitives: &mut [Primitive],
    nodes: &mut [BinaryNode],
    rules: &SplitRules,
    extent: Extent,
    depth: u32,
) {
    let count = primitives.len();
    let leaf = count < rules.stop.max(2);
    nodes[0] = BinaryNode {
        min: extent.min.to_array(),
        count: count as u32,
        max: extent.max.to_array(),
        wide_nodes: 0,
        wide_leaves: 0,
        decisions: [0; 7],
        leaf: leaf.into(),
        reserved: 0,
    };
    if leaf {
        return;
    }
    let chosen = if depth < HEURISTIC_DEPTH {
        if count > MANY {
            choose::<{ BINS[0] }>(primitives, rules, &extent)
        } else if count > FEW {
            choose::<{ BINS[1] }>(primitives, rules, &extent)
        } else {
            choose::<{ BINS[2] }>(primitives, rules, &extent)
        }
    } else {
        None
    };
    let (middle, left_extent, right_extent) = match chosen {
        Some(split) => partition(primitives, &split),
        None => halve(primitives, &extent),
    };
    let (left, right) = primitives.split_at_mut(middle);
    let (left_nodes, right_nodes) = nodes[1..].split_at_mut(2 * middle - 1);
    let mut go_left = || subtree(left, left_nodes, rules, left_extent, depth + 1);
    let mut go_right = || subtree(right, right_nodes, rules, right_extent, depth + 1);
    if count > PARALLEL && in_pool() {
        rayon::join(go_left, go_right);
    } else {
        go_left();
        go_right();
    }
}

/// A plane between two bins.
struct Split {
    axis: usize,
    /// First bin of the right side.
    bin: usize,
    binning: Binning,
}

/// Maps centers to bins.
#[derive(Clone, Copy)]
struct Binning {
    base: Vec3A,
    factor: Vec3A,
}

impl Binning {
    fn new(extent: &Extent, bins: usize) -> Binning {
        let size = extent.center_max - extent.center_min;
        Binning {
            base: extent.center_min,
            // Just below the number of bins, so that the last center is inside the last bin.
            // An axis without extent maps to bin 0.
            factor: Vec3A::select(
                size.cmpgt(Vec3A::splat(TINY)),
                Vec3A::splat(bins as f32 * 0.99999) / size,
                Vec3A::ZERO,
            ),
        }
    }

    #[inline]
    fn bins<const BINS: usize>(&self, center: Vec3A) -> [usize; 3] {
        let bins = (center - self.base) * self.factor;
        bins.to_array().map(|bin| {
            // SAFETY: centers are inside the extent and everything is finite, so this is between 0
            // and `BINS`.
            let bin = unsafe { bin.to_int_unchecked::<i32>() };
            bin as usize % BINS
        })
    }
}

/// The cheapest plane; `None` if all centers fall into one bin.
fn choose<const BINS: usize>(
    primitives: &[Primitive],
    rules: &SplitRules,
    extent: &Extent,
) -> Option<Split> {
    #[derive(Clone, Copy)]
    struct Bin {
        min: Vec3A,
        max: Vec3A,
    }
    let empty = Bin {
        min: Vec3A::INFINITY,
        max: Vec3A::NEG_INFINITY,
    };
    let binning = Binning::new(extent, BINS);
    let mut boxes = [[empty; BINS]; 3];
    let mut counts = [[0u32; BINS]; 3];
    for primitive in primitives {
        let bins = binning.bins::<BINS>(primitive.center());
        let (min, max) = (primitive.min(), primitive.max());
        for axis in 0..3 {
            let bin = &mut boxes[axis][bins[axis]];
            bin.min = bin.min.min(min);
            bin.max = bin.max.max(max);
            counts[axis][bins[axis]] += 1;
        }
    }
    let blocks = |count: u32| count.div_ceil(rules.block) as f32;
    let mut best = (f32::INFINITY, 0, 0);
    for axis in 0..3 {
        if binning.factor[axis] == 0.0 {
            continue;
        }
        let mut right_cost = [f32::INFINITY; BINS];
        let mut sum = empty;
        let mut count = 0;
        for i in (1..BINS).rev() {
            sum.min = sum.min.min(boxes[axis][i].min);
            sum.max = sum.max.max(boxes[axis][i].max);
            count += counts[axis][i];
            if count > 0 {
                right_cost[i] = half_area(sum.min, sum.max, rules.scale) * blocks(count);
            }
        }
        let mut sum = empty;
        let mut count = 0;
        for i in 1..BINS {
            sum.min = sum.min.min(boxes[axis][i - 1].min);
            sum.max = sum.max.max(boxes[axis][i - 1].max);
            count += counts[axis][i - 1];
            if count > 0 {
                let cost = half_area(sum.min, sum.max, rules.scale) * blocks(count) + right_cost[i];
                if cost < best.0 {
                    best = (cost, axis, i);
                }
            }
        }
    }
    let (cost, axis, bin) = best;
    (cost < f32::INFINITY).then_some(Split { axis, bin, binning })
}

/// Moves the primitives left of the plane to the front; returns how many and both extents.
fn partition(primitives: &mut [Primitive], split: &Split) -> (usize, Extent, Extent) {
    let axis = split.axis;
    let (base, factor) = (split.binning.base[axis], split.binning.factor[axis]);
    let plane = split.bin as f32;
    // Half of the primitives are left in no order, so a branch here would be guessed wrong often.
    let mut extents = [Extent::EMPTY; 2];
    let mut middle = 0;
    for i in 0..primitives.len() {
        let primitive = primitives[i];
        let is_left = (primitive.center()[axis] - base) * factor < plane;
        extents[usize::from(!is_left)].add(&primitive);
        primitives.swap(i, middle);
        middle += usize::from(is_left);
    }
    let [left, right] = extents;
    (middle, left, right)
}

/// Splits in the middle of the longest axis' order; where centers coincide, in the middle of the
/// order there is.
fn halve(primitives: &mut [Primitive], extent: &Extent) -> (usize, Extent, Extent) {
    let middle = primitives.len() / 2;
    let size = extent.center_max - extent.center_min;
    if size.max_element() > 0.0 {
        sort_middle(primitives, middle, longest(size));
    }
    let (left, right) = primitives.split_at(middle);
    (middle, Extent::of(left), Extent::of(right))
}

fn longest(size: Vec3A) -> usize {
    if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    }
}

/// Puts the primitives before position `middle` of the order along `axis` in front of it.
fn sort_middle(primitives: &mut [Primitive], middle: usize, axis: usize) {
    primitives.select_nth_unstable_by(middle, |a, b| {
        (a.center()[axis].total_cmp(&b.center()[axis]))
            .then(a.geometry.cmp(&b.geometry))
            .then(a.index.cmp(&b.index))
    });
}

/// Orders primitives into two halves at `middle` along the longest axis of their centers.
pub(crate) fn divide(primitives: &mut [Primitive], middle: usize) {
    let extent = Extent::of(primitives);
    let size = extent.center_max - extent.center_min;
    if middle > 0 && middle < primitives.len() && size.max_element() > 0.0 {
        sort_middle(primitives, middle, longest(size));
    }
}
