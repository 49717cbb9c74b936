//! Building and updating structures.
//!
//! A build collects a box for each active primitive, sorts them into a binary tree (`tree`),
//! decides how that becomes an 8-wide one (`collapse`), and writes it (`emit`). All of its working
//! memory is the caller's scratch; the heap is not used. If the tree would exceed the promised size
//! or depth, a packed tree is written, which always fits.

mod collapse;
mod corners;
mod emit;
mod head;
mod instance;
mod micromap;
mod morton;
mod motion;
mod packed;
mod primitive;
mod refit;
mod reinsert;
mod sah_sweep;
mod shape;
mod sizes;
mod split;
mod swept_sphere;
mod target;
mod tree;
mod update;
mod vector;
mod vertex;
mod words;

use crate::error::BuildError;
use crate::input::{BuildFlags, BuildInput, Geometries};
use crate::layout::{
    BLOCK_UNITS, Bounds, Form, GROUP, LEAF_TRIANGLES, MAX_DEPTH, Node, Parts, child,
};
use crate::structure::Kind;
use collapse::Costs;
use corners::Corners;
use head::{Written, write_head};
use primitive::{Collected, Primitive};
pub(crate) use shape::Shape;
pub use sizes::{BuildSizes, build_sizes, micromap_bytes};
use sizes::{Workspace, carve, has_room, structure_bytes};
use split::SplitRules;
use target::Target;
use tree::BinaryNode;
pub use update::update;

/// Largest number of geometries of one structure, and of instances of a top level.
pub const MAX_GEOMETRIES: u64 = (1 << 24) - 1;
/// Largest number of primitives of a bottom level.
pub const MAX_PRIMITIVES: u64 = (1 << 29) - 1;

/// Builds a structure into `destination` (256-byte aligned) and returns its size, which is the
/// compacted size.
///
/// # Safety
/// The memory that `input` names must be readable and unchanged during the call, must not overlap
/// `destination` and `scratch`, and references of instances must be 0 or addresses of built
/// bottom levels.
///
/// # Errors
/// See [`BuildError`].
pub unsafe fn build(
    input: &BuildInput<'_>,
    destination: &mut [u8],
    scratch: &mut [u8],
) -> Result<u64, BuildError> {
    // SAFETY: the caller guarantees that the memory that `input` names is readable, unchanged and
    // apart from `destination` and `scratch`, and that references of instances are 0 or addresses
    // of built bottom levels.
    unsafe { build_to_depth(input, destination, scratch, MAX_DEPTH) }
}

/// Builds a structure with at most `max_depth` levels of nodes, or a packed one.
///
/// # Safety
/// As for [`build`].
unsafe fn build_to_depth(
    input: &BuildInput<'_>,
    destination: &mut [u8],
    scratch: &mut [u8],
    max_depth: u32,
) -> Result<u64, BuildError> {
    let shape = Shape::of(&input.geometries)?;
    let promised = structure_bytes(shape.kind, shape.geometries, shape.primitives);
    if (destination.len() as u64) < promised + shape.micromap_bytes
        || !(destination.as_ptr() as usize).is_multiple_of(256)
    {
        return Err(BuildError::Destination);
    }
    let mut workspace = carve(scratch, &shape, input.flags).ok_or(BuildError::Scratch)?;
    // SAFETY: the caller keeps the promises of `build`.
    let collected = unsafe { collect(input, &shape, &mut workspace) };
    let mut target = Target {
        base: destination.as_mut_ptr(),
        parts: Parts::new(shape.kind, Form::Groups, shape.geometries, 1, 0),
        kind: shape.kind,
        form: Form::Groups,
        geometries: &input.geometries,
    };
    // SAFETY: the caller keeps the geometries' memory readable; the destination has the promised
    // size.
    let mut written = unsafe {
        grow_and_write(
            &mut target,
            &shape,
            input.flags,
            &collected,
            workspace,
            max_depth,
        )
    };
    let mut origin_error = 0.0;
    if let Geometries::Instances(source) = &input.geometries {
        // SAFETY: the caller keeps the promises of `build`; the parts have a record for each
        // instance.
        origin_error = unsafe { refit::write_instances(&target, source) };
    }
    let (nodes, leaves) = (written.node_count, written.leaf_count);
    if collected.limited {
        // SAFETY: the nodes and leaves are written.
        written.bounds = unsafe { refit::refit(&target, nodes, leaves) }.bounds;
    }
    if input.flags.contains(BuildFlags::ALLOW_UPDATE) {
        // SAFETY: the nodes and leaves are written.
        written.cost = unsafe { refit::measure(&target, nodes, leaves) };
    }
    if shape.micromap_bytes > 0 {
        // SAFETY: the destination has room for the part after the others; the caller guarantees
        // that the geometries are readable.
        unsafe { write_micromaps(&target, shape.micromap_bytes) };
    }
    // SAFETY: the parts are inside the destination.
    unsafe { write_head(&target, input, &shape, &written, origin_error) };
    debug_assert_eq!(crate::validate(destination), Ok(()));
    Ok(target.parts.size_bytes + shape.micromap_bytes)
}

/// Collects the active primitives.
///
/// # Safety
/// As for [`build`].
unsafe fn collect(
    input: &BuildInput<'_>,
    shape: &Shape,
    workspace: &mut Workspace<'_>,
) -> Collected {
    let count = shape.primitives as usize;
    let places = match input.flags.contains(BuildFlags::PREFER_FAST_BUILD) {
        // The sort moves them from there to `primitives`. SAFETY: nodes are larger and as aligned,
        // and both are plain numbers.
        true => unsafe {
            std::slice::from_raw_parts_mut(workspace.nodes.as_mut_ptr().cast(), count)
        },
        false => &mut *workspace.primitives,
    };
    // SAFETY: the caller keeps the promises of `build`.
    unsafe { primitive::collect(&input.geometries, input.flags, places) }
}

/// Builds the tree over the collected primitives and writes it, or a packed one.
///
/// # Safety
/// The memory of the geometries is readable, and the destination has the promised size.
unsafe fn grow_and_write(
    target: &mut Target<'_>,
    shape: &Shape,
    flags: BuildFlags,
    collected: &Collected,
    workspace: Workspace<'_>,
    max_depth: u32,
) -> Written {
    let Workspace {
        primitives,
        nodes,
        blocks,
        pieces,
        order,
    } = workspace;
    let active = collected.count;
    let primitives = &mut primitives[..active];
    // A tree that is too deep with subtrees that moved is built again without moves.
    for moves in [true, false] {
        if active == 0 || (!moves && pieces.is_empty()) {
            continue;
        }
        let grown = &mut nodes[..2 * active - 1];
        let costs = grow(shape.kind, flags, primitives, grown, blocks);
        let tree = match moves {
            true => reinsert::improve(primitives, nodes, (&mut *pieces, &mut *order), &costs),
            false => &mut *nodes,
        };
        if takes_blocks(shape, flags, collected) {
            target.form = Form::Blocks;
        }
        // SAFETY: the caller guarantees that the memory of the geometries is readable, and the
        // destination has the promised size.
        let written = unsafe { write_wide(target, shape, tree, primitives, &costs, max_depth) };
        if let Some(written) = written {
            return written;
        }
    }
    // SAFETY: the destination has the promised size.
    unsafe { write_packed(target, shape, primitives) }
}

/// Collapses a binary tree and writes it. Writes nothing and returns `None` if it would be larger
/// than promised, or deeper than `max_depth`.
///
/// # Safety
/// The memory of the geometries is readable, and the destination has the promised size.
unsafe fn write_wide(
    target: &mut Target<'_>,
    shape: &Shape,
    tree: &mut [BinaryNode],
    primitives: &[Primitive],
    costs: &Costs,
    max_depth: u32,
) -> Option<Written> {
    // SAFETY: the caller keeps the memory of the geometries readable.
    let written = unsafe { plan(target, shape, tree, primitives, costs) }?;
    if written.depth > max_depth {
        return None;
    }
    // SAFETY: the plan has checked that the parts are inside the destination, and fills exactly
    // them.
    unsafe {
        target.write_tree(tree, primitives, 0, 0);
        target.end_blocks(tree[0].wide_leaves, written.leaf_count);
    }
    Some(written)
}

/// Writes a packed tree, which always fits; for no primitives one empty node.
///
/// # Safety
/// The destination has the promised size.
unsafe fn write_packed(
    target: &mut Target<'_>,
    shape: &Shape,
    primitives: &mut [Primitive],
) -> Written {
    let active = primitives.len();
    target.form = Form::Groups;
    let mut written = Written {
        node_count: 1,
        leaf_count: 0,
        depth: 1,
        bounds: Bounds::EMPTY,
        cost: 0.0,
    };
    if active > 0 {
        written.node_count = target.packed_nodes(active);
        written.leaf_count = target.packed_leaves(active);
        written.depth = target.packed_depth(active);
    }
    target.lay_out(shape, &mut written);
    debug_assert!(
        target.parts.size_bytes <= structure_bytes(shape.kind, shape.geometries, shape.primitives)
    );
    // SAFETY: the parts are inside the destination: the promised size has room for a packed tree.
    unsafe {
        match active {
            0 => target.write_node(0, &Node::EMPTY),
            _ => written.bounds = target.write_packed(primitives, 0, 0),
        }
    }
    written
}

/// Writes the part for micromaps, which comes after the others.
///
/// # Safety
/// There are `bytes` after the target's parts, and the memory of the geometries is readable and
/// unchanged.
unsafe fn write_micromaps(target: &Target<'_>, bytes: u64) {
    let list: Vec<_> = target.geometries.triangle_lists().collect();
    // SAFETY: the caller guarantees that There are `bytes` after the target's parts, and the memory
    // of the geometries is readable and unchanged.
    unsafe {
        let start = target.base.add(target.parts.size_bytes as usize);
        micromap::write(&list, std::slice::from_raw_parts_mut(start, bytes as usize));
    }
}

/// Whether a structure is written with [`Form::Blocks`]. Updates may separate shared vertices, so
/// they exclude it.
fn takes_blocks(shape: &Shape, flags: BuildFlags, collected: &Collected) -> bool {
    shape.kind == Kind::Triangles
        && flags.contains(BuildFlags::LOW_MEMORY)
        && !flags.contains(BuildFlags::ALLOW_UPDATE)
        && collected.count >= WORTH_BLOCKS
        && !collected.limited
}

/// Fewer triangles save no memory in blocks, since there must be room after the last block.
const WORTH_BLOCKS: usize = 32;

/// Plans the wide tree so that it fits in the promised size, preferably in the target's form;
/// `None` if no form fits.
///
/// # Safety
/// The memory of the geometries is readable.
unsafe fn plan(
    target: &mut Target<'_>,
    shape: &Shape,
    nodes: &mut [BinaryNode],
    primitives: &[Primitive],
    costs: &Costs,
) -> Option<Written> {
    let promised = structure_bytes(shape.kind, shape.geometries, shape.primitives);
    // Fuller leaves make walks slower.
    let full = Costs {
        leaf_forced: costs.leaf_max,
        ..*costs
    };
    let in_blocks = (target.form == Form::Blocks).then_some((Form::Blocks, costs));
    let in_groups = [(Form::Groups, costs), (Form::Groups, &full)];
    for (form, costs) in in_blocks.into_iter().chain(in_groups) {
        target.form = form;
        let depth = collapse::plan(nodes, costs, &|first, count| {
            let own = &primitives[first as usize..][..count as usize];
            // SAFETY: the caller guarantees that the memory of the geometries is readable.
            unsafe { target.leaves_for(own) }
        });
        let mut written = Written {
            node_count: nodes[0].wide_nodes,
            leaf_count: nodes[0].wide_leaves,
            depth,
            bounds: nodes[0].bounds(),
            cost: 0.0,
        };
        // The slots of triangles must fit in a child's index.
        let has_slots = form == Form::Groups || written.leaf_count < child::INDEX / 2 - BLOCK_UNITS;
        if form == Form::Blocks && has_slots {
            written.leaf_count += BLOCK_UNITS;
        }
        target.lay_out(shape, &mut written);
        if has_slots && target.parts.size_bytes <= promised {
            return Some(written);
        }
    }
    None
}

/// Builds the binary tree and returns the costs for its collapse.
fn grow(
    kind: Kind,
    flags: BuildFlags,
    primitives: &mut [Primitive],
    nodes: &mut [BinaryNode],
    blocks: &mut [Corners],
) -> Costs {
    let (block, leaf_max) = match kind {
        Kind::Triangles => (GROUP as u32, LEAF_TRIANGLES as u32),
        _ => (1, 1),
    };
    // Primitives that are tested at once stay together.
    let leaf_forced = if flags.contains(BuildFlags::LOW_MEMORY) {
        leaf_max
    } else {
        block
    };
    let hurry = flags.contains(BuildFlags::PREFER_FAST_BUILD);
    let extent = match hurry {
        // SAFETY: that is where they were collected.
        true => tree::extent(unsafe {
            std::slice::from_raw_parts(nodes.as_ptr().cast(), primitives.len())
        }),
        false => tree::extent(primitives),
    };
    let rules = SplitRules::new(block, leaf_forced as usize + 1, hurry, &extent);
    match hurry {
        true => morton::build(primitives, nodes, blocks, &rules, &extent),
        false => tree::build(primitives, nodes, &rules, extent),
    }
    Costs {
        node: NODE_COST,
        block: block_cost(kind),
        block_size: block,
        leaf_max,
        leaf_forced,
        scale: rules.scale,
    }
}

/// The cost of testing the children of a node.
const NODE_COST: f32 = 1.0;

/// The cost of testing a block of a leaf.
fn block_cost(kind: Kind) -> f32 {
    match kind {
        // Cheap blocks make fuller leaves. Values between 0.5 and 2 give the same speed of walks.
        Kind::Triangles => 0.3,
        Kind::Aabbs | Kind::Swept | Kind::Motion => 2.0,
        Kind::Instances | Kind::MotionInstances => 4.0,
    }
}

#[cfg(test)]
mod tests;
