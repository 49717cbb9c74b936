//! Headers, and whether they tell the truth about the parts.

use super::Kind;
use crate::error::StructureError;
use crate::layout::{
    ALIGNMENT, Form, GeometryEntry, Header, MAGIC, Node, Parts, VERSION, child, leaf_bytes,
    micromap_part_bytes,
};

/// Whether the header at `base` says of a structure's use what a copy of it says; of its bounds,
/// which no walk looks at, it may say something else.
///
/// # Safety
/// A header is readable there, and aligned.
#[inline(always)]
pub(super) unsafe fn is_still(base: *const u8, header: &Header) -> bool {
    let copy = std::ptr::from_ref(header).cast::<u8>();
    #[cfg(target_arch = "x86_64")]
    // SAFETY: SSE2 is part of x86-64; all vectors are inside the header, which is aligned.
    unsafe {
        use std::arch::x86_64::*;
        let equal = |i: usize| {
            let load = |start: *const u8| _mm_load_si128(start.cast::<__m128i>().add(i));
            _mm_cmpeq_epi8(load(base), load(copy))
        };
        let first = _mm_and_si128(_mm_and_si128(equal(0), equal(1)), equal(2));
        let second = _mm_and_si128(_mm_and_si128(equal(3), equal(4)), equal(5));
        _mm_movemask_epi8(_mm_and_si128(_mm_and_si128(first, second), equal(7))) == 0xFFFF
    }
    #[cfg(not(target_arch = "x86_64"))]
    // SAFETY: SSE2 is part of x86-64; all vectors are inside the header, which is aligned.
    unsafe {
        let words = |start: *const u8| start.cast::<[u64; size_of::<Header>() / 8]>();
        words(base).read_volatile() == words(copy).read()
    }
}

// The fields that are not compared.
const _: () = assert!(
    std::mem::offset_of!(Header, bounds) <= 96 && std::mem::offset_of!(Header, origin_error) == 112
);

/// Checks that a header has this layout and that all parts are inside its size, as reads of them
/// require.
#[inline(always)]
pub(super) fn check_header(header: &Header) -> Result<(Kind, Form), StructureError> {
    if header.magic != MAGIC || header.version != VERSION {
        return Err(StructureError::NotAStructure);
    }
    let kind = Kind::of(header.kind).ok_or(StructureError::NotAStructure)?;
    let form = Form::of(header.form).ok_or(StructureError::NotAStructure)?;
    let inside = |offset: u64, count: u32, bytes: u64| {
        offset.is_multiple_of(ALIGNMENT)
            && (offset.checked_add(u64::from(count) * bytes))
                .is_some_and(|end| end <= header.size_bytes)
    };
    let references = match kind {
        kind if kind.is_top() => header.leaf_count,
        _ => 0,
    };
    let (nodes, leaves) = (header.nodes_offset, header.leaves_offset);
    if inside(nodes, header.node_count, size_of::<Node>() as u64)
        && inside(leaves, header.leaf_count, leaf_bytes(kind, form))
        && inside(header.references_offset, references, 8)
        && inside(
            header.geometries_offset,
            header.geometry_count,
            size_of::<GeometryEntry>() as u64,
        )
        && header.micromap_bytes <= header.size_bytes
    {
        Ok((kind, form))
    } else {
        Err(StructureError::Corrupt)
    }
}

/// Checks that all parts lie exactly where their counts put them.
pub(super) fn check_parts(kind: Kind, form: Form, header: &Header) -> Result<(), StructureError> {
    let parts = Parts::new(
        kind,
        form,
        header.geometry_count.into(),
        header.node_count.into(),
        header.leaf_count.into(),
    );
    let stated = Parts {
        geometries_offset: header.geometries_offset,
        references_offset: header.references_offset,
        nodes_offset: header.nodes_offset,
        leaves_offset: header.leaves_offset,
        size_bytes: header.size_bytes.saturating_sub(header.micromap_bytes),
    };
    let micromaps = header.micromap_bytes == 0
        || matches!(kind, Kind::Triangles | Kind::Motion)
            && header.micromap_bytes
                >= micromap_part_bytes(header.geometry_count.into(), header.primitive_count);
    let good =
        parts == stated && micromaps && header.node_count > 0 && header.leaf_count <= child::INDEX;
    good.then_some(()).ok_or(StructureError::Corrupt)
}
