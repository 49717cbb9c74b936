//! The memory sizes of builds, and the layout of scratch memory.

use super::Shape;
use super::corners::Corners;
use super::primitive::Primitive;
use super::reinsert::{self, Piece};
use super::sah_sweep;
use super::tree::BinaryNode;
use crate::input::{BuildFlags, BuildInput};
use crate::layout::{Form, Node, Parts, leaf_bytes, micromap_part_bytes};
use crate::structure::Kind;

/// Memory for a build, in bytes: upper bounds that hold for any input of that shape.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BuildSizes {
    /// The blob.
    pub structure_bytes: u64,
    /// Scratch for [`build`](super::build()).
    pub build_scratch_bytes: u64,
    /// Scratch for [`update`](super::update()); 0 if the flags do not allow updates.
    pub update_scratch_bytes: u64,
}

/// Alignment inside of scratch memory. Its size has room for the alignment.
const SCRATCH_ALIGNMENT: usize = 64;

/// The memory of a build of `kind` whose geometry `i` has at most `max_primitive_counts[i]`
/// primitives. For instances, there is one geometry.
///
/// Never decreases when a count or the number of geometries increases.
pub fn build_sizes(kind: Kind, flags: BuildFlags, max_primitive_counts: &[u32]) -> BuildSizes {
    let count: u64 = max_primitive_counts.iter().map(|&c| u64::from(c)).sum();
    let scratch = Places::new(kind, flags, count).bytes();
    BuildSizes {
        structure_bytes: structure_bytes(kind, max_primitive_counts.len() as u64, count),
        build_scratch_bytes: scratch + SCRATCH_ALIGNMENT as u64,
        // A refit works in place. A worn structure is rebuilt.
        update_scratch_bytes: if flags.contains(BuildFlags::ALLOW_UPDATE) {
            scratch + SCRATCH_ALIGNMENT as u64
        } else {
            0
        },
    }
}

/// The number of elements of each kind in scratch memory.
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
            blocks: if hurry {
                sah_sweep::block_count(count)
            } else {
                0
            },
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

/// Memory that a structure needs beyond [`build_sizes`] if a geometry has a micromap.
pub fn micromap_bytes(max_primitive_counts: &[u32]) -> u64 {
    let count = max_primitive_counts.iter().map(|&c| u64::from(c)).sum();
    micromap_part_bytes(max_primitive_counts.len() as u64, count)
}

/// The promised size. Per primitive, each constant is well above what
/// [`Target::write_packed`](super::emit::Target::write_packed) takes; few primitives may each have
/// a leaf and a node of their own.
pub(super) fn structure_bytes(kind: Kind, geometries: u64, primitives: u64) -> u64 {
    let node = size_of::<Node>() as u64;
    let leaf = leaf_bytes(kind, Form::Groups);
    let (each, extra) = match kind {
        // 48 bytes in full groups and 256 / 56 of nodes; the rest is for sparser leaves.
        Kind::Triangles => (96, 3072),
        // 256 / 7 of nodes.
        _ => (leaf + 64, 3072),
    };
    let sparse = primitives * (leaf + node);
    let dense = primitives * each + extra;
    // The size without nodes and leaves, with the reference table of all instances.
    let fixed = match kind {
        kind if kind.is_top() => {
            Parts::new(kind, Form::Groups, geometries, 0, primitives).leaves_offset
        }
        _ => Parts::new(kind, Form::Groups, geometries, 0, 0).leaves_offset,
    };
    (fixed + sparse.min(dense).max(node)).next_multiple_of(256)
}

/// Whether memory suffices for a build, not only for a refit.
pub(super) fn has_room(
    input: &BuildInput<'_>,
    shape: &Shape,
    destination: &[u8],
    scratch: &mut [u8],
) -> bool {
    let promised = structure_bytes(shape.kind, shape.geometries, shape.primitives);
    destination.len() as u64 >= promised + shape.micromap_bytes
        && carve(scratch, shape, input.flags).is_some()
}

/// The scratch memory: primitives, a binary tree over them, and boxes.
pub(super) struct Workspace<'a> {
    pub primitives: &'a mut [Primitive],
    pub nodes: &'a mut [BinaryNode],
    pub blocks: &'a mut [Corners],
    pub pieces: &'a mut [Piece],
    /// As many numbers as pieces.
    pub order: &'a mut [u32],
}

pub(super) fn carve<'a>(
    scratch: &'a mut [u8],
    shape: &Shape,
    flags: BuildFlags,
) -> Option<Workspace<'a>> {
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

/// Takes `count` elements of a type from the front of memory, which must be aligned to the type.
///
/// # Safety
/// Any bytes are a valid `T`.
unsafe fn take<'a, T>(memory: &mut &'a mut [u8], count: u64) -> Option<&'a mut [T]> {
    let count = count as usize;
    let (taken, rest) = std::mem::take(memory).split_at_mut_checked(count * size_of::<T>())?;
    *memory = rest;
    debug_assert!(taken.is_empty() || taken.as_ptr().cast::<T>().is_aligned());
    // SAFETY: long enough and exclusive; every size before is a multiple of the alignment.
    Some(unsafe { std::slice::from_raw_parts_mut(taken.as_mut_ptr().cast(), count) })
}
