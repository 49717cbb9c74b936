//! Building and updating structures.
//!
//! A build collects a box for each active primitive, sorts them into a binary tree (`tree`),
//! decides how that becomes an 8-wide one (`collapse`), and writes it (`emit`). All of its
//! working memory is the caller's scratch; the heap is not used. Where the tree would not fit the
//! size that was promised, or would be too deep, a packed one is written that always does.

mod collapse;
mod corners;
mod curve;
mod emit;
mod instance;
mod micromap;
mod motion;
mod primitive;
mod refit;
mod reinsert;
mod split;
mod sweep;
mod swept;
mod tree;
mod update;
mod vector;
mod vertex;

use crate::input::{BuildFlags, BuildInput, Geometries, GeometryFlags};
use crate::layout::{
    Bounds, GROUP, GeometryEntry, Header, LEAF_TRIANGLES, MAGIC, MAX_DEPTH, Node, Parts, VERSION,
    features, leaf_bytes, micromap_part_bytes,
};
use crate::structure::Kind;
use collapse::Costs;
use corners::Corners;
use emit::Target;
use primitive::Primitive;
use reinsert::Piece;
use split::SplitRules;
use tree::BinaryNode;
pub use update::update;

/// Memory for a build, in bytes: upper bounds that hold for any input of that shape.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BuildSizes {
    /// The blob.
    pub structure_bytes: u64,
    /// Scratch for [`build`].
    pub build_scratch_bytes: u64,
    /// Scratch for [`update`]; 0 if the flags do not allow updates.
    pub update_scratch_bytes: u64,
}

/// Why a build was refused. The destination's contents are undefined then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BuildError {
    /// The destination is smaller than [`build_sizes`] says, or not aligned to 256 bytes.
    Destination,
    /// The scratch memory is smaller than [`build_sizes`] says.
    Scratch,
    /// The source of an update is no structure of the same shape.
    Source,
    /// More than 2²⁴−1 geometries or instances, or 2²⁹−1 primitives.
    TooLarge,
    /// The heap gave no memory.
    OutOfMemory,
}

impl std::fmt::Display for BuildError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            BuildError::Destination => "the destination is too small or misaligned",
            BuildError::Scratch => "the scratch memory is too small",
            BuildError::Source => "the source does not fit the update",
            BuildError::TooLarge => "too many geometries or primitives",
            BuildError::OutOfMemory => "out of memory",
        })
    }
}

impl std::error::Error for BuildError {}

/// Geometries of one structure and instances of a top level, at most.
pub const MAX_GEOMETRIES: u64 = (1 << 24) - 1;
/// Primitives of a bottom level, at most.
pub const MAX_PRIMITIVES: u64 = (1 << 29) - 1;

/// Alignment that scratch memory is brought to inside; its size has room for that.
const SCRATCH_ALIGNMENT: usize = 64;

/// How much memory a build of `kind` needs whose geometry `i` has at most
/// `max_primitive_counts[i]` primitives. For instances, there is one geometry.
///
/// Never decreases when a count or the number of geometries increases.
pub fn build_sizes(kind: Kind, flags: BuildFlags, max_primitive_counts: &[u32]) -> BuildSizes {
    let count: u64 = max_primitive_counts.iter().map(|&c| u64::from(c)).sum();
    let scratch = Places::new(kind, flags, count).bytes();
    BuildSizes {
        structure_bytes: structure_bytes(kind, max_primitive_counts.len() as u64, count),
        build_scratch_bytes: scratch + SCRATCH_ALIGNMENT as u64,
        // A refit works in place; what it does not suit any more is built anew.
        update_scratch_bytes: if flags.contains(BuildFlags::ALLOW_UPDATE) {
            scratch + SCRATCH_ALIGNMENT as u64
        } else {
            0
        },
    }
}

/// How many places of each kind the scratch memory has.
struct Places {
    primitives: u64,
    nodes: u64,
    blocks: u64,
    pieces: u64,
}

impl Places {
    fn new(kind: Kind, flags: BuildFlags, count: u64) -> Places {
        let hurry = flags.contains(BuildFlags::PREFER_FAST_BUILD);
        let (pieces, spare_nodes) = match hurry {
            true => (0, 0),
            false => reinsert::places(kind, count),
        };
        Places {
            primitives: count,
            nodes: 2 * count + spare_nodes,
            blocks: if hurry { sweep::block_count(count) } else { 0 },
            pieces,
        }
    }

    fn bytes(&self) -> u64 {
        self.primitives * size_of::<Primitive>() as u64
            + self.nodes * size_of::<BinaryNode>() as u64
            + self.blocks * size_of::<Corners>() as u64
            + self.pieces * (size_of::<Piece>() + size_of::<u32>()) as u64
    }
}

/// What a structure takes beyond [`build_sizes`] if a geometry has a micromap.
pub fn micromap_bytes(max_primitive_counts: &[u32]) -> u64 {
    let count = max_primitive_counts.iter().map(|&c| u64::from(c)).sum();
    micromap_part_bytes(max_primitive_counts.len() as u64, count)
}

/// The promised size. Per primitive, each constant is well above what [`Target::write_packed`]
/// takes; few primitives may each have a leaf and a node of their own.
fn structure_bytes(kind: Kind, geometries: u64, primitives: u64) -> u64 {
    let node = size_of::<Node>() as u64;
    let leaf = leaf_bytes(kind);
    let (each, extra) = match kind {
        // 48 bytes in full groups, 256 / 56 of nodes; the rest is for sparser leaves.
        Kind::Triangles => (96, 3072),
        // 256 / 7 of nodes.
        _ => (leaf + 64, 3072),
    };
    let sparse = primitives * (leaf + node);
    let dense = primitives * each + extra;
    // What is there without nodes and leaves, with the reference table of all instances.
    let fixed = match kind {
        kind if kind.is_top() => Parts::new(kind, geometries, 0, primitives).leaves_offset,
        _ => Parts::new(kind, geometries, 0, 0).leaves_offset,
    };
    (fixed + sparse.min(dense).max(node)).next_multiple_of(256)
}

/// Builds a structure into `destination` (256-byte aligned) and returns how many of its bytes it
/// uses: the compacted size.
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
    // SAFETY: the caller's promise.
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
    let count = shape.primitives as usize;
    let Workspace {
        primitives,
        nodes,
        blocks,
        pieces,
        order,
    } = carve(scratch, &shape, input.flags).ok_or(BuildError::Scratch)?;
    let along_curve = input.flags.contains(BuildFlags::PREFER_FAST_BUILD);
    let collected = {
        let places = match along_curve {
            // They are sorted from there into their places.
            // SAFETY: nodes are larger and as aligned, and both are plain numbers.
            true => unsafe { std::slice::from_raw_parts_mut(nodes.as_mut_ptr().cast(), count) },
            false => &mut *primitives,
        };
        // SAFETY: the caller's promise.
        unsafe { primitive::collect(&input.geometries, input.flags, places) }
    };
    let active = collected.count;
    let primitives = &mut primitives[..active];

    let mut target = Target {
        base: destination.as_mut_ptr(),
        parts: Parts::new(shape.kind, shape.geometries, 1, 0),
        kind: shape.kind,
        geometries: &input.geometries,
    };
    let mut written = Written {
        node_count: 1,
        leaf_count: target.leaves_of(0),
        depth: 1,
        bounds: Bounds::EMPTY,
        cost: 0.0,
    };
    let leaves = |leaves: u32| match shape.kind {
        // One record an instance, active or not.
        kind if kind.is_top() => count as u32,
        _ => leaves,
    };
    if active == 0 {
        written.leaf_count = leaves(0);
        target.parts = Parts::new(shape.kind, shape.geometries, 1, written.leaf_count.into());
        // SAFETY: the promised size has room for a node.
        unsafe { target.write_node(0, &Node::EMPTY) };
    } else {
        let costs = grow(
            shape.kind,
            input.flags,
            primitives,
            &mut nodes[..2 * active - 1],
            blocks,
        );
        let nodes = reinsert::improve(primitives, nodes, (pieces, order), &costs);
        let fits = |nodes: u32, leaves: u32| {
            let parts = Parts::new(shape.kind, shape.geometries, nodes.into(), leaves.into());
            parts.size_bytes <= promised
        };
        let mut depth = collapse::plan(nodes, &costs);
        if !fits(nodes[0].wide_nodes, leaves(nodes[0].wide_leaves)) {
            // Fuller leaves, at some cost to the walk.
            depth = collapse::plan(
                nodes,
                &Costs {
                    leaf_forced: costs.leaf_max,
                    ..costs
                },
            );
        }
        let planned = (nodes[0].wide_nodes, leaves(nodes[0].wide_leaves));
        if depth <= max_depth && fits(planned.0, planned.1) {
            written = Written {
                node_count: planned.0,
                leaf_count: planned.1,
                depth,
                bounds: nodes[0].bounds(),
                cost: 0.0,
            };
            target.parts = written.parts(&shape);
            // SAFETY: the parts are inside the destination, and the plan fills exactly them.
            unsafe { target.write_tree(nodes, primitives, 0, 0) };
        } else {
            written = Written {
                node_count: target.packed_nodes(active),
                leaf_count: leaves(packed_leaves(&target, active)),
                depth: target.packed_depth(active),
                bounds: Bounds::EMPTY,
                cost: 0.0,
            };
            target.parts = written.parts(&shape);
            debug_assert!(target.parts.size_bytes <= promised);
            // SAFETY: as above.
            written.bounds = unsafe { target.write_packed(primitives, 0, 0) };
        }
    }
    let mut origin_error = 0.0;
    if let Geometries::Instances(source) = &input.geometries {
        // SAFETY: the caller's promise; the parts have a record for each instance.
        origin_error = unsafe { refit::write_instances(&target, source) };
    }
    let (nodes, leaves) = (written.node_count, written.leaf_count);
    if collected.limited {
        // SAFETY: the nodes and leaves are written.
        written.bounds = unsafe { refit::refit(&target, nodes, leaves) }.bounds;
    }
    if input.flags.contains(BuildFlags::ALLOW_UPDATE) {
        // SAFETY: as above.
        written.cost = unsafe { refit::measure(&target, nodes, leaves) };
    }
    if shape.micromap_bytes > 0 {
        // SAFETY: the destination has room for the part after the others; the caller's promise for the geometries.
        unsafe { write_micromaps(&target, shape.micromap_bytes) };
    }
    // SAFETY: the parts are inside the destination.
    unsafe { write_head(&target, input, &shape, &written, origin_error) };
    debug_assert_eq!(crate::validate(destination), Ok(()));
    Ok(target.parts.size_bytes + shape.micromap_bytes)
}

/// Writes the part for micromaps, which comes after the others.
///
/// # Safety
/// There are `bytes` after the target's parts, and the memory of the geometries is readable and unchanged.
unsafe fn write_micromaps(target: &Target<'_>, bytes: u64) {
    let list: Vec<_> = target.geometries.triangle_lists().collect();
    // SAFETY: the caller's promise.
    unsafe {
        let start = target.base.add(target.parts.size_bytes as usize);
        micromap::write(&list, std::slice::from_raw_parts_mut(start, bytes as usize));
    }
}

/// Leaves of a packed tree: only the last child is not full.
fn packed_leaves(target: &Target<'_>, count: usize) -> u32 {
    let full = target.leaf_max();
    (count / full) as u32 * target.leaves_of(full) + target.leaves_of(count % full)
}

/// Builds the binary tree and says what collapsing it costs.
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
    // What is tested at once stays together.
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
        true => curve::build(primitives, nodes, blocks, &rules, &extent),
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

/// What it costs to test the children of a node.
const NODE_COST: f32 = 1.0;

/// What it costs to test a block of what a leaf holds.
fn block_cost(kind: Kind) -> f32 {
    match kind {
        // Cheap blocks make fuller leaves; between 0.5 and 2 the walk does not feel the difference.
        Kind::Triangles => 0.3,
        Kind::Aabbs | Kind::Swept | Kind::Motion => 2.0,
        Kind::Instances | Kind::MotionInstances => 4.0,
    }
}

/// Whether memory suffices for a build, and not only for a refit.
fn has_room(input: &BuildInput<'_>, shape: &Shape, destination: &[u8], scratch: &mut [u8]) -> bool {
    let promised = structure_bytes(shape.kind, shape.geometries, shape.primitives);
    destination.len() as u64 >= promised + shape.micromap_bytes
        && carve(scratch, shape, input.flags).is_some()
}

/// What kind of structure an input makes, and how large.
pub(crate) struct Shape {
    pub kind: Kind,
    pub geometries: u64,
    pub primitives: u64,
    /// Of the part for micromaps; 0 without.
    pub micromap_bytes: u64,
}

impl Shape {
    pub fn of(geometries: &Geometries<'_>) -> Result<Shape, BuildError> {
        let count = |counts: &mut dyn Iterator<Item = u32>| counts.map(u64::from).sum();
        let mut shape = match geometries {
            Geometries::Triangles(list) => Shape {
                kind: Kind::Triangles,
                geometries: list.len() as u64,
                primitives: count(&mut list.iter().map(|g| g.primitive_count)),
                micromap_bytes: 0,
            },
            Geometries::Aabbs(list) => Shape {
                kind: Kind::Aabbs,
                geometries: list.len() as u64,
                primitives: count(&mut list.iter().map(|g| g.primitive_count)),
                micromap_bytes: 0,
            },
            Geometries::Swept(list) => Shape {
                kind: Kind::Swept,
                geometries: list.len() as u64,
                primitives: count(&mut list.iter().map(|g| g.primitive_count)),
                micromap_bytes: 0,
            },
            Geometries::Motion(list) => Shape {
                kind: Kind::Motion,
                geometries: list.len() as u64,
                primitives: count(&mut list.iter().map(|g| g.start.primitive_count)),
                micromap_bytes: 0,
            },
            Geometries::Instances(source) => Shape {
                kind: match source.array.is_motion() {
                    true => Kind::MotionInstances,
                    false => Kind::Instances,
                },
                geometries: 1,
                primitives: source.count.into(),
                micromap_bytes: 0,
            },
        };
        let most = match shape.kind {
            kind if kind.is_top() => MAX_GEOMETRIES,
            _ => MAX_PRIMITIVES,
        };
        if shape.geometries > MAX_GEOMETRIES || shape.primitives > most {
            return Err(BuildError::TooLarge);
        }
        if geometries
            .triangle_lists()
            .any(|list| list.micromap.is_some())
        {
            shape.micromap_bytes = micromap_part_bytes(shape.geometries, shape.primitives);
        }
        Ok(shape)
    }
}

struct Written {
    node_count: u32,
    leaf_count: u32,
    depth: u32,
    bounds: Bounds,
    /// [`Header::cost`].
    cost: f32,
}

impl Written {
    fn parts(&self, shape: &Shape) -> Parts {
        Parts::new(
            shape.kind,
            shape.geometries,
            self.node_count.into(),
            self.leaf_count.into(),
        )
    }
}

/// The scratch memory: places for primitives, for a binary tree over them, and for boxes beside it.
struct Workspace<'a> {
    primitives: &'a mut [Primitive],
    nodes: &'a mut [BinaryNode],
    blocks: &'a mut [Corners],
    pieces: &'a mut [Piece],
    /// As many numbers as pieces.
    order: &'a mut [u32],
}

fn carve<'a>(scratch: &'a mut [u8], shape: &Shape, flags: BuildFlags) -> Option<Workspace<'a>> {
    let start = scratch.as_ptr().align_offset(SCRATCH_ALIGNMENT);
    let places = Places::new(shape.kind, flags, shape.primitives);
    let mut rest = scratch.get_mut(start..)?;
    // SAFETY: all four types are plain numbers for which any bytes will do.
    unsafe {
        Some(Workspace {
            pieces: take(&mut rest, places.pieces)?,
            primitives: take(&mut rest, places.primitives)?,
            blocks: take(&mut rest, places.blocks)?,
            nodes: take(&mut rest, places.nodes)?,
            order: take(&mut rest, places.pieces)?,
        })
    }
}

/// Takes places for `count` of a type from the front of memory, which has to be aligned to them.
///
/// # Safety
/// Any bytes will do for a `T`.
unsafe fn take<'a, T>(memory: &mut &'a mut [u8], count: u64) -> Option<&'a mut [T]> {
    let count = count as usize;
    let (taken, rest) = std::mem::take(memory).split_at_mut_checked(count * size_of::<T>())?;
    *memory = rest;
    debug_assert!(taken.is_empty() || taken.as_ptr().cast::<T>().is_aligned());
    // SAFETY: long enough and nobody else's; every size before is a multiple of the alignment.
    Some(unsafe { std::slice::from_raw_parts_mut(taken.as_mut_ptr().cast(), count) })
}

/// Writes the header and the geometry table, and zeros in the gaps between parts.
///
/// # Safety
/// The target's parts are inside memory that is the caller's to write.
unsafe fn write_head(
    target: &Target<'_>,
    input: &BuildInput<'_>,
    shape: &Shape,
    written: &Written,
    origin_error: f32,
) {
    let parts = &target.parts;
    let gap = |start: u64, end: u64| {
        // SAFETY: inside the blob.
        unsafe {
            target
                .base
                .add(start as usize)
                .write_bytes(0, (end - start) as usize);
        }
    };
    let mut all_features = 0;
    let mut first_primitive = 0;
    let mut entry = |index: usize, primitive_count: u32, flags: GeometryFlags| {
        all_features |= if flags.contains(GeometryFlags::OPAQUE) {
            features::OPAQUE
        } else {
            features::NOT_OPAQUE
        };
        let entry = GeometryEntry {
            first_primitive,
            primitive_count,
            flags: flags.0,
        };
        first_primitive += u64::from(primitive_count);
        let offset = parts.geometries_offset as usize + index * size_of::<GeometryEntry>();
        // SAFETY: inside the geometry table; 16-byte aligned.
        unsafe { target.base.add(offset).cast::<GeometryEntry>().write(entry) };
    };
    match &input.geometries {
        Geometries::Triangles(list) => list
            .iter()
            .enumerate()
            .for_each(|(i, g)| entry(i, g.primitive_count, g.flags)),
        Geometries::Aabbs(list) => list
            .iter()
            .enumerate()
            .for_each(|(i, g)| entry(i, g.primitive_count, g.flags)),
        Geometries::Swept(list) => list
            .iter()
            .enumerate()
            .for_each(|(i, g)| entry(i, g.primitive_count, g.flags)),
        Geometries::Motion(list) => list
            .iter()
            .enumerate()
            .for_each(|(i, g)| entry(i, g.start.primitive_count, g.start.flags)),
        Geometries::Instances(source) => entry(0, source.count, source.flags),
    }
    if shape.micromap_bytes > 0 {
        all_features |= features::OPAQUE | features::NOT_OPAQUE;
    }
    let table_end = parts.geometries_offset + shape.geometries * size_of::<GeometryEntry>() as u64;
    gap(table_end, parts.references_offset);
    let references_end = parts.references_offset
        + match shape.kind {
            kind if kind.is_top() => u64::from(written.leaf_count) * 8,
            _ => 0,
        };
    gap(references_end, parts.nodes_offset);
    let leaves_end = parts.leaves_offset + u64::from(written.leaf_count) * leaf_bytes(shape.kind);
    gap(leaves_end, parts.size_bytes);
    let header = Header {
        magic: MAGIC,
        version: VERSION,
        kind: shape.kind as u32,
        flags: input.flags.0,
        geometry_count: shape.geometries as u32,
        primitive_count: shape.primitives,
        size_bytes: parts.size_bytes + shape.micromap_bytes,
        node_count: written.node_count,
        leaf_count: written.leaf_count,
        geometries_offset: parts.geometries_offset,
        references_offset: parts.references_offset,
        nodes_offset: parts.nodes_offset,
        leaves_offset: parts.leaves_offset,
        micromap_bytes: shape.micromap_bytes,
        bounds: written.bounds,
        origin_error,
        features: all_features,
        depth: written.depth,
        cost: written.cost,
        reserved: [0; 26],
    };
    // SAFETY: the blob begins with its header.
    unsafe { target.base.cast::<Header>().write(header) };
}

#[cfg(test)]
mod tests;
