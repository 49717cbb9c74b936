//! The parts before nodes and leaves: the header and the geometry table.

use super::Shape;
use super::target::Target;
use crate::input::{BuildInput, Geometries, GeometryFlags};
use crate::layout::{Bounds, GeometryEntry, Header, MAGIC, VERSION, features, leaf_bytes};

/// The written parts of a structure.
pub(super) struct Written {
    pub node_count: u32,
    pub leaf_count: u32,
    pub depth: u32,
    pub bounds: Bounds,
    /// [`Header::cost`].
    pub cost: f32,
}

/// Writes the header and the geometry table, and zeros in the gaps between parts.
///
/// # Safety
/// The target's parts are inside memory that the caller may write.
pub(super) unsafe fn write_head(
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
    // SAFETY: the caller owns the target's parts.
    let mut all_features = unsafe { write_geometries(target, &input.geometries) };
    if shape.micromap_bytes > 0 {
        all_features |= features::OPAQUE | features::NOT_OPAQUE;
    }
    let table_end = parts.geometries_offset + shape.geometries * size_of::<GeometryEntry>() as u64;
    gap(size_of::<Header>() as u64, parts.geometries_offset);
    gap(table_end, parts.references_offset);
    let references_end = parts.references_offset
        + match shape.kind {
            kind if kind.is_top() => u64::from(written.leaf_count) * 8,
            _ => 0,
        };
    gap(references_end, parts.nodes_offset);
    let leaves_end =
        parts.leaves_offset + u64::from(written.leaf_count) * leaf_bytes(shape.kind, target.form);
    gap(leaves_end, parts.size_bytes);
    let header = Header {
        magic: MAGIC,
        version: VERSION,
        kind: shape.kind as u16,
        form: target.form as u16,
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
    };
    // SAFETY: the blob begins with its header.
    unsafe { target.base.cast::<Header>().write(header) };
}

/// Writes the geometry table and returns the [`features`] that follow from the geometries' flags.
///
/// # Safety
/// As [`write_head`].
unsafe fn write_geometries(target: &Target<'_>, geometries: &Geometries<'_>) -> u32 {
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
        let offset = target.parts.geometries_offset as usize + index * size_of::<GeometryEntry>();
        // SAFETY: the caller owns the geometry table, which has an entry for each geometry and is
        // aligned to 16 bytes.
        unsafe { target.base.add(offset).cast::<GeometryEntry>().write(entry) };
    };
    match geometries {
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
    all_features
}
