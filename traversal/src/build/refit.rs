//! Refits a tree to new positions: writes leaves again, recomputes boxes, and measures the expected
//! cost of walks.
//!
//! The application may have written into the blob, so each node is checked before it is followed.

use rayon::prelude::*;

use super::motion::motion_bounds;
use super::swept_sphere::SweptPrimitive;
use super::target::Target;
use super::words::triangle_word;
use super::{NODE_COST, block_cost, instance, primitive};
use crate::input::{Geometries, InstanceSource, MotionGeometry, SweptGeometry, TriangleGeometry};
use crate::layout::{
    Bounds, Extent, GROUP, MAX_DEPTH, MotionEntry, Node, NodeAt, SweptEntry, TriangleGroup, WIDTH,
    child, geometry_word,
};
use crate::pool::in_pool;

/// Number of leaves or nodes of one task.
const FEW: usize = 1024;

/// Calls `write` with each index below `count`, in parallel if there are many.
fn for_each(count: u32, write: impl Fn(u32) + Send + Sync) {
    if in_pool() && count as usize > FEW {
        (0..count).into_par_iter().with_min_len(FEW).for_each(write);
    } else {
        (0..count).for_each(write);
    }
}

/// Reads the positions of every triangle again.
///
/// # Safety
/// The target has `count` valid groups, and the geometries' memory is readable.
pub(crate) unsafe fn write_triangles(target: &Target<'_>, count: u32, list: &[TriangleGeometry]) {
    for_each(count, |index| {
        // SAFETY: one of the `count` groups; the caller guarantees that the target has `count`
        // valid groups, and the geometries' memory is readable.
        unsafe { write_group(&mut *target.leaf_at::<TriangleGroup>(index), list) };
    });
}

/// Reads the positions of a group's triangles again.
///
/// # Safety
/// The geometries' memory is readable.
unsafe fn write_group(group: &mut TriangleGroup, list: &[TriangleGeometry]) {
    let mut extent = Extent::default();
    group.lanes = 0;
    for lane in 0..GROUP {
        // Lanes without a triangle, and leaves of no node, may hold any values.
        let number = group.geometries[lane] & geometry_word::INDEX;
        let Some(geometry) = list.get(number as usize) else {
            continue;
        };
        let primitive = group.primitives[lane];
        if primitive >= geometry.primitive_count {
            continue;
        }
        group.geometries[lane] = triangle_word(number, geometry);
        // SAFETY: the caller guarantees that the geometries' memory is readable.
        if let Some(triangle) = unsafe { geometry.triangle(primitive) } {
            group.set_triangle(lane, &triangle);
            group.lanes |= 1 << lane;
            extent.add(&triangle);
        }
    }
    group.margin = extent.margin();
}

/// Reads every sphere and swept sphere again.
///
/// # Safety
/// The target has `count` valid entries, and the geometries' memory is readable.
pub(crate) unsafe fn write_swept(target: &Target<'_>, count: u32, list: &[SweptGeometry]) {
    let write = |index| {
        // SAFETY: one of the `count` entries.
        let entry = unsafe { &mut *target.leaf_at::<SweptEntry>(index) };
        let number = entry.geometry & geometry_word::INDEX;
        let Some(geometry) = list.get(number as usize) else {
            return;
        };
        // SAFETY: the caller guarantees that the target has `count` valid entries, and the
        // geometries' memory is readable.
        let read = unsafe { geometry.primitive(entry.primitive) };
        *entry = read
            .unwrap_or(SweptPrimitive::NOTHING)
            .entry(entry.primitive, number, geometry);
    };
    for_each(count, write);
}

/// Reads every triangle that moves again.
///
/// # Safety
/// The target has `count` valid entries, and the geometries' memory is readable.
pub(crate) unsafe fn write_motion(target: &Target<'_>, count: u32, list: &[MotionGeometry]) {
    let write = |index| {
        // SAFETY: one of the `count` entries; the caller guarantees that the target has `count`
        // valid entries, and the geometries' memory is readable.
        unsafe {
            let entry = &mut *target.leaf_at::<MotionEntry>(index);
            let number = entry.geometry & geometry_word::INDEX;
            if let Some(geometry) = list.get(number as usize) {
                *entry = geometry.entry(entry.primitive, number);
            }
        }
    };
    for_each(count, write);
}

/// Writes a record and a reference for each instance. Returns the largest error factor.
///
/// # Safety
/// The target has a record for each instance; the source's memory is readable and its references
/// are 0 or built bottom levels.
pub(crate) unsafe fn write_instances(target: &Target<'_>, source: &InstanceSource<'_>) -> f32 {
    let write = |index| {
        // SAFETY: the caller guarantees that the target has a record for each instance; the
        // source's memory is readable and its references are 0 or built bottom levels.
        let instance = unsafe { instance::read(source, index) }.unwrap_or(instance::Instance {
            object_to_world: [0.0; 12],
            custom_index_and_mask: 0,
            sbt_offset_and_flags: 0,
            reference: 0,
            motion: None,
        });
        // SAFETY: the caller guarantees that the target has a record for each instance; the
        // source's memory is readable and its references are 0 or built bottom levels.
        let placed = unsafe { instance.place(source.live) };
        // SAFETY: there is a record and a table entry for each instance.
        unsafe {
            let record = instance.record(placed.as_ref());
            match source.array.is_motion() {
                true => target.write_leaf(index, instance.motion_record(record)),
                false => target.write_leaf(index, record),
            }
            target
                .base
                .add(target.parts.references_offset as usize)
                .cast::<u64>()
                .add(index as usize)
                .write(instance.reference);
        }
        placed.map_or(0.0, |placed| placed.origin_error)
    };
    match in_pool() && source.count as usize > FEW {
        true => (0..source.count)
            .into_par_iter()
            .with_min_len(FEW)
            .map(write)
            .reduce(|| 0.0, f32::max),
        false => (0..source.count).map(write).fold(0.0, f32::max),
    }
}

/// The box of a child's primitives as they are now.
///
/// # Safety
/// The leaf is valid and the geometries' memory is readable.
unsafe fn leaf_bounds(target: &Target<'_>, index: u32, groups: u32) -> Bounds {
    match target.geometries {
        Geometries::Triangles(_) => (index..index + groups)
            .map(|index| {
                // SAFETY: the caller guarantees that the leaf is valid and the geometries' memory
                // is readable.
                unsafe { &*target.leaf_at::<TriangleGroup>(index) }.bounds()
            })
            .fold(Bounds::EMPTY, Bounds::union),
        Geometries::Aabbs(list) => {
            // SAFETY: the caller guarantees that the leaf is valid and the geometries' memory is
            // readable.
            let entry = unsafe { *target.leaf_at::<crate::layout::BoxEntry>(index) };
            let Some(geometry) = list.get((entry.geometry & geometry_word::INDEX) as usize) else {
                return Bounds::EMPTY;
            };
            // SAFETY: the caller guarantees that the leaf is valid and the geometries' memory is
            // readable.
            unsafe { primitive::aabb(geometry, entry.primitive) }.unwrap_or(Bounds::EMPTY)
        }
        Geometries::Swept(list) => {
            // SAFETY: the caller guarantees that the leaf is valid and the geometries' memory is
            // readable.
            let entry = unsafe { *target.leaf_at::<SweptEntry>(index) };
            let Some(geometry) = list.get((entry.geometry & geometry_word::INDEX) as usize) else {
                return Bounds::EMPTY;
            };
            // SAFETY: the caller guarantees that the leaf is valid and the geometries' memory is
            // readable.
            unsafe { geometry.primitive(entry.primitive) }
                .map_or(Bounds::EMPTY, |primitive| primitive.bounds())
        }
        Geometries::Motion(list) => {
            // SAFETY: the caller guarantees that the leaf is valid and the geometries' memory is
            // readable.
            let entry = unsafe { *target.leaf_at::<MotionEntry>(index) };
            let Some(geometry) = list.get((entry.geometry & geometry_word::INDEX) as usize) else {
                return Bounds::EMPTY;
            };
            // SAFETY: the caller guarantees that the leaf is valid and the geometries' memory is
            // readable.
            unsafe { geometry.triangles(entry.primitive) }
                .map_or(Bounds::EMPTY, |both| motion_bounds(&both))
        }
        Geometries::Instances(source) => {
            // SAFETY: the caller guarantees that the leaf is valid and the geometries' memory is
            // readable.
            unsafe {
                instance::read(source, index)
                    .and_then(|instance| instance.place(source.live))
                    .map_or(Bounds::EMPTY, |placed| placed.bounds)
            }
        }
    }
}

/// Facts about a structure whose boxes were refitted.
#[derive(Clone, Copy)]
pub(crate) struct Refitted {
    pub bounds: Bounds,
    /// The expected cost of a ray that hits the bounds (surface area heuristic).
    pub cost: f32,
}

/// Recomputes every box, children before parents.
///
/// # Safety
/// The target has these numbers of nodes and leaves, no other thread uses them, and the geometries'
/// memory is readable.
pub(crate) unsafe fn refit(target: &Target<'_>, nodes: u32, leaves: u32) -> Refitted {
    // SAFETY: the caller guarantees that the target has so many nodes and leaves, no other thread
    // uses them, and the geometries' memory is readable.
    unsafe { visit::<true>(target, nodes, leaves) }
}

/// Measures every box without changing it.
///
/// # Safety
/// As for [`refit`].
pub(crate) unsafe fn measure(target: &Target<'_>, nodes: u32, leaves: u32) -> f32 {
    // SAFETY: the caller keeps the promises of `refit`.
    unsafe { visit::<false>(target, nodes, leaves) }.cost
}

/// # Safety
/// As for [`refit`].
unsafe fn visit<const REFIT: bool>(target: &Target<'_>, nodes: u32, leaves: u32) -> Refitted {
    let pass = Pass::<REFIT> {
        target,
        leaves,
        block_cost: block_cost(target.kind),
    };
    // SAFETY: the caller keeps the promises of `refit`.
    let (bounds, sum) = unsafe {
        pass.subtree(0, nodes, MAX_DEPTH).unwrap_or_else(|| {
            let mut sum = 0.0;
            for index in (0..nodes).rev() {
                sum += pass.node(index, nodes).0;
            }
            ((*pass.node_at(0)).all_bounds(), sum)
        })
    };
    let mut root = Node::EMPTY;
    root.set_bounds(0, bounds);
    let area = f64::from(weighted_area(&root, &[1.0; WIDTH]));
    let cost = if area > 0.0 { sum / area } else { 0.0 };
    Refitted {
        bounds,
        cost: cost as f32,
    }
}

/// A pass over all nodes, which refits or only measures them.
struct Pass<'a, const REFIT: bool> {
    target: &'a Target<'a>,
    leaves: u32,
    block_cost: f32,
}

impl<const REFIT: bool> Pass<'_, REFIT> {
    fn node_at(&self, index: u32) -> *mut Node {
        let nodes = self.target.parts.nodes_offset as usize;
        let start = self.target.base.wrapping_add(nodes).cast::<Node>();
        start.wrapping_add(index as usize)
    }

    /// Visits the nodes from `start` up to `end`, a subtree in the order in which builds write it.
    /// `None`, with some nodes visited, if it is no such subtree or has more levels than `depth`.
    /// The order of summation does not depend on the number of threads.
    ///
    /// # Safety
    /// As for [`refit`], for these nodes.
    unsafe fn subtree(&self, start: u32, end: u32, depth: u32) -> Option<(Bounds, f64)> {
        let deeper = depth.checked_sub(1)?;
        let mut sum = 0.0;
        if ((end - start) as usize) < FEW {
            for index in (start..end).rev() {
                // SAFETY: the caller keeps the promises of `refit` for these nodes.
                let (cost, inside) = unsafe { self.node(index, end) };
                sum += inside.then_some(cost)?;
            }
        } else {
            // SAFETY: the caller keeps the promises of `refit` for these nodes.
            let children = unsafe { NodeAt::new(self.node_at(start)) }.children();
            let mut parts = [(0, 0, None); WIDTH];
            let mut length = 0;
            let mut next = start + 1;
            for word in children {
                if word == child::NONE || word & child::LEAF != 0 {
                    continue;
                }
                if length > 0 {
                    parts[length - 1].1 = word;
                } else if word != next {
                    return None;
                }
                if word < next || word >= end {
                    return None;
                }
                parts[length] = (word, end, None);
                (length, next) = (length + 1, word + 1);
            }
            let visit = |part: &mut (u32, u32, Option<(Bounds, f64)>)| {
                // SAFETY: the ranges are disjoint; the caller keeps the contract of `refit`, for
                // these nodes.
                part.2 = unsafe { self.subtree(part.0, part.1, deeper) };
            };
            match in_pool() {
                true => parts[..length].par_iter_mut().for_each(visit),
                false => parts[..length].iter_mut().for_each(visit),
            }
            for part in &parts[..length] {
                sum += part.2?.1;
            }
            // SAFETY: the caller keeps the promises of `refit` for these nodes.
            let (cost, inside) = unsafe { self.node(start, end) };
            sum += inside.then_some(cost)?;
        }
        // SAFETY: the caller keeps the promises of `refit` for these nodes.
        Some((unsafe { (*self.node_at(start)).all_bounds() }, sum))
    }

    /// Visits a node after its children, which must be after it and before `end`; others count as
    /// empty. Returns the cost of its children and whether all of them were valid.
    ///
    /// # Safety
    /// As for [`refit`], for this node and those up to `end`.
    unsafe fn node(&self, index: u32, end: u32) -> (f64, bool) {
        // SAFETY: the caller keeps the promises of `refit` for this node and those up to `end`.
        let node = unsafe { &mut *self.node_at(index) };
        let (mut weights, mut inside) = ([0f32; WIDTH], true);
        for (lane, weight) in weights.iter_mut().enumerate() {
            // SAFETY: the node is inside the part. Its words may change meanwhile.
            let word = unsafe { NodeAt::new(node) }.child(lane);
            let mut bounds = Bounds::EMPTY;
            if word == child::NONE {
                // The child counts as empty.
            } else if word & child::LEAF != 0 {
                let groups = if word & child::TWO_GROUPS != 0 { 2 } else { 1 };
                let first = word & child::INDEX;
                *weight = self.block_cost * groups as f32;
                if REFIT && u64::from(first) + u64::from(groups) <= u64::from(self.leaves) {
                    // SAFETY: a leaf that there is.
                    bounds = unsafe { leaf_bounds(self.target, first, groups) };
                }
            } else if word <= index || word >= end {
                inside = false;
            } else {
                *weight = NODE_COST;
                if REFIT {
                    // SAFETY: another node that there is.
                    bounds = unsafe { (*self.node_at(word)).all_bounds() };
                }
            }
            if REFIT {
                node.set_bounds(lane, bounds);
            }
        }
        (weighted_area(node, &weights).into(), inside)
    }
}

/// The weighted sum of half the surfaces of a node's boxes. Infinite or 0 on overflow or underflow.
fn weighted_area(node: &Node, weights: &[f32; WIDTH]) -> f32 {
    let [x0, x1, y0, y1, z0, z1] = &node.bounds;
    let mut areas = [0f32; WIDTH];
    for (lane, area) in areas.iter_mut().enumerate() {
        let edge = |low: &[f32; WIDTH], high: &[f32; WIDTH]| {
            let edge = high[lane] - low[lane];
            // Except for empty boxes.
            if edge > 0.0 { edge } else { 0.0 }
        };
        let (x, y, z) = (edge(x0, x1), edge(y0, y1), edge(z0, z1));
        *area = weights[lane] * (x * y + y * z + z * x);
    }
    areas.iter().sum()
}
