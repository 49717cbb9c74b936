//! The fast builder. It sorts primitives along a Morton curve once (Lauterbach et al. 2009), and
//! each split is the cheapest cut of the curve by the surface area heuristic. Primitives do not
//! move after the sort. The binned builder handles primitives with equal codes.

#[cfg(target_arch = "x86_64")]
use lanes::Tier;
use rayon::prelude::*;

use super::corners::Corners;
use super::primitive::{CHUNK, Primitive};
use super::sah_sweep::{Blocks, Stretch};
use super::split::{Extent, SplitRules};
use super::tree::{self, BinaryNode, HEURISTIC_DEPTH, PARALLEL, Subtree};
use super::vector::{PortableBounds, Vector};
use crate::pool::in_pool;

#[cfg(target_arch = "x86_64")]
use super::vector::Avx2Bounds;

/// Bits of a code for each axis.
const BITS: u32 = 10;
/// Codes with this many equal leading bits count as equal.
const SHARED: u32 = 3 * BITS - 6;
/// Fewer primitives than this are not worth sorting.
const WORTH_SORTING: usize = 256;

/// Maps centers to codes.
#[derive(Clone, Copy)]
struct Curve {
    base: [f32; 4],
    factor: f32,
}

impl Curve {
    fn new(extent: &Extent) -> Curve {
        let [x, y, z, _] = extent.centers.edges();
        let size = x.max(y).max(z);
        let [a, b, c, ..] = extent.centers.0;
        // The same scale on all axes, so that cells are cubes; just below a power of two, so that
        // the last center is inside.
        let cells = (1 << BITS) as f32 * 0.9999;
        let factor = if size > 1.0e-36 { cells / size } else { 0.0 };
        Curve {
            base: [a, b, c, 0.0],
            factor,
        }
    }

    #[inline(always)]
    fn code(&self, primitive: &Primitive) -> u32 {
        let mut bits = [0u32; 4];
        for (axis, bits) in bits.iter_mut().enumerate().take(3) {
            let place = (primitive.center(axis) - self.base[axis]) * self.factor;
            // SAFETY: centers are inside the extent and everything is finite.
            *bits = unsafe { place.to_int_unchecked::<i32>() } as u32 & 0x3FF;
        }
        for (shift, mask) in [
            (16, 0x30000FF),
            (8, 0x300F00F),
            (4, 0x30C30C3),
            (2, 0x9249249),
        ] {
            for bits in &mut bits {
                *bits = (*bits | *bits << shift) & mask;
            }
        }
        bits[0] << 2 | bits[1] << 1 | bits[2]
    }
}

/// Bits of a digit of the sort: codes of 30 bits take three passes.
const DIGIT: u32 = 10;
const PLACES: usize = 1 << DIGIT;

/// Sorts keys with codes in their upper halves; returns them in one of both buffers.
fn sort<'a>(keys: &'a mut [u64], spare: &'a mut [u64]) -> &'a [u64] {
    if in_pool() && rayon::current_num_threads() > 1 {
        // No two are equal, so the order is the same.
        keys.par_sort_unstable();
        return keys;
    }
    let mut counts = [[0u32; PLACES]; 3];
    let digit = |key: u64, pass: usize| (key >> (32 + DIGIT * pass as u32)) as usize % PLACES;
    for &key in &*keys {
        for (pass, counts) in counts.iter_mut().enumerate() {
            counts[digit(key, pass)] += 1;
        }
    }
    let (mut from, mut to) = (keys, spare);
    for (pass, counts) in counts.iter_mut().enumerate() {
        let mut next = 0;
        for place in counts.iter_mut() {
            next += std::mem::replace(place, next);
        }
        for &key in &*from {
            let place = &mut counts[digit(key, pass)];
            to[*place as usize] = key;
            *place += 1;
        }
        std::mem::swap(&mut from, &mut to);
    }
    from
}

/// Copies primitives into the order of the curve. Both halves of `keys` have an element for each.
fn arrange(from: &[Primitive], to: &mut [Primitive], curve: &Curve, keys: [&mut [u64]; 2]) {
    let [keys, spare] = keys;
    let encode = |(chunk, (keys, from)): (usize, (&mut [u64], &[Primitive]))| {
        for (i, (key, primitive)) in keys.iter_mut().zip(from).enumerate() {
            *key = u64::from(curve.code(primitive)) << 32 | (chunk * CHUNK + i) as u64;
        }
    };
    let gather = |(to, keys): (&mut [Primitive], &[u64])| {
        for (place, key) in to.iter_mut().zip(keys) {
            *place = from[*key as u32 as usize];
        }
    };
    if in_pool() && from.len() > CHUNK {
        let chunks = keys.par_chunks_mut(CHUNK).zip(from.par_chunks(CHUNK));
        chunks.enumerate().for_each(encode);
        let keys = sort(keys, spare);
        let chunks = to.par_chunks_mut(CHUNK).zip(keys.par_chunks(CHUNK));
        chunks.for_each(gather);
    } else {
        encode((0, (keys, from)));
        let keys = sort(keys, spare);
        gather((to, keys));
    }
}

/// A tree under construction.
struct Growth<'a> {
    curve: Curve,
    blocks: Blocks<'a>,
    rules: &'a SplitRules,
}

/// Builds the tree of primitives into `nodes` (2n − 1 of them). The primitives are at the front of
/// the nodes' memory, and are sorted into `primitives`. `blocks` has
/// [`block_count`](super::sah_sweep::block_count) elements. The tree is the same on every machine.
pub(crate) fn build(
    primitives: &mut [Primitive],
    nodes: &mut [BinaryNode],
    blocks: &mut [Corners],
    rules: &SplitRules,
    extent: &Extent,
) {
    let curve = Curve::new(extent);
    let count = primitives.len();
    let start = nodes.as_mut_ptr();
    if count < WORTH_SORTING {
        // SAFETY: that is where they are.
        primitives.copy_from_slice(unsafe { std::slice::from_raw_parts(start.cast(), count) });
        return tree::build(primitives, nodes, rules, *extent);
    }
    // SAFETY: nodes have room for a primitive and two keys each, are aligned as primitives are by
    // [`super::carve`], and all three are plain numbers.
    unsafe {
        let from = std::slice::from_raw_parts(start.cast::<Primitive>(), count);
        let keys = start.cast::<Primitive>().add(count).cast::<u64>();
        let one = std::slice::from_raw_parts_mut(keys, count);
        let other = std::slice::from_raw_parts_mut(keys.add(count), count);
        arrange(from, primitives, &curve, [one, other]);
    }
    grow_all(primitives, nodes, blocks, rules, extent, true);
}

/// Builds the tree of sorted primitives, with `vectors` where the machine has them.
pub(crate) fn grow_all(
    primitives: &mut [Primitive],
    nodes: &mut [BinaryNode],
    blocks: &mut [Corners],
    rules: &SplitRules,
    extent: &Extent,
    vectors: bool,
) {
    let (curve, corners) = (Curve::new(extent), &extent.corners);
    #[cfg(target_arch = "x86_64")]
    if vectors && Tier::best() >= Tier::Avx2 {
        // SAFETY: the machine has it.
        return unsafe { build_avx2(primitives, nodes, blocks, rules, curve, corners) };
    }
    let blocks = Blocks::new::<PortableBounds>(primitives, blocks);
    #[cfg(not(target_arch = "x86_64"))]
    let _ = vectors;
    let growth = Growth {
        curve,
        blocks,
        rules,
    };
    grow_portable(&growth, primitives, 0, nodes, corners, 0);
}

/// # Safety
/// The machine has AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2")]
unsafe fn build_avx2(
    primitives: &mut [Primitive],
    nodes: &mut [BinaryNode],
    blocks: &mut [Corners],
    rules: &SplitRules,
    curve: Curve,
    corners: &Corners,
) {
    let blocks = Blocks::new::<Avx2Bounds>(primitives, blocks);
    let growth = Growth {
        curve,
        blocks,
        rules,
    };
    // SAFETY: the machine has AVX2.
    unsafe { grow_avx2(&growth, primitives, 0, nodes, corners, 0) };
}

/// One of the two instances of [`grow`].
///
/// # Safety
/// The machine has the instruction set.
type Grow = unsafe fn(&Growth<'_>, &mut [Primitive], usize, &mut [BinaryNode], &Corners, u32);

/// # Safety
/// The machine has AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2")]
unsafe fn grow_avx2(
    growth: &Growth<'_>,
    primitives: &mut [Primitive],
    first: usize,
    nodes: &mut [BinaryNode],
    corners: &Corners,
    depth: u32,
) {
    let instances = (grow_avx2 as Grow, tree::subtree_avx2 as Subtree);
    grow::<Avx2Bounds>(growth, primitives, first, nodes, corners, depth, instances);
}

fn grow_portable(
    growth: &Growth<'_>,
    primitives: &mut [Primitive],
    first: usize,
    nodes: &mut [BinaryNode],
    corners: &Corners,
    depth: u32,
) {
    let instances = (grow_portable as Grow, tree::subtree_portable as Subtree);
    grow::<PortableBounds>(growth, primitives, first, nodes, corners, depth, instances);
}

/// Builds the tree of the range from `first`. Inlined into a function for each instruction set,
/// which also builds the subtrees.
#[inline(always)]
fn grow<V: Vector>(
    growth: &Growth<'_>,
    primitives: &mut [Primitive],
    first: usize,
    nodes: &mut [BinaryNode],
    corners: &Corners,
    depth: u32,
    (again, binned): (Grow, Subtree),
) {
    let count = primitives.len();
    let leaf = count < growth.rules.stop.max(2);
    if !leaf && count > growth.rules.stop * 8 && depth < HEURISTIC_DEPTH {
        let ends = [&primitives[0], &primitives[count - 1]].map(|end| growth.curve.code(end));
        if (ends[0] ^ ends[1]) >> (3 * BITS - SHARED) == 0 {
            let extent = Extent::of::<V>(primitives);
            // SAFETY: the machine that runs this has the instruction set.
            unsafe { binned(primitives, nodes, growth.rules, extent, depth) };
            return;
        }
    }
    nodes[0] = BinaryNode::new(corners, count);
    if leaf {
        return;
    }
    let stretch = Stretch {
        blocks: &growth.blocks,
        primitives,
        first,
    };
    let cut = match depth >= HEURISTIC_DEPTH {
        true => stretch.halves::<V>(),
        false => stretch.cut::<V>(growth.rules),
    };
    let sides = [cut.sides[0].corners(), cut.sides[1].corners()];
    let middle = cut.at - first;
    nodes[0].set_right(2 * middle);
    let (left, right) = primitives.split_at_mut(middle);
    let (left_nodes, right_nodes) = nodes[1..].split_at_mut(2 * middle - 1);
    // SAFETY: the machine that runs this has the instruction set.
    let mut go_left = || unsafe { again(growth, left, first, left_nodes, &sides[0], depth + 1) };
    // SAFETY: the machine that runs this has the instruction set.
    let mut go_right =
        || unsafe { again(growth, right, cut.at, right_nodes, &sides[1], depth + 1) };
    if count > PARALLEL && in_pool() {
        rayon::join(go_left, go_right);
    } else {
        go_left();
        go_right();
    }
}

/// [`arrange`] with its own memory.
#[cfg(test)]
pub(crate) fn arrange_for_test(from: &[Primitive], to: &mut [Primitive]) {
    let (mut one, mut other) = (vec![0; from.len()], vec![0; from.len()]);
    let curve = Curve::new(&tree::extent(from));
    arrange(from, to, &curve, [&mut one, &mut other]);
}
