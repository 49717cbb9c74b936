//! Headers, and whether they tell the truth about the parts.

use super::{Kind, StructureError};
use crate::layout::{
    ALIGNMENT, Form, Header, MAGIC, Node, Parts, VERSION, child, leaf_bytes, micromap_part_bytes,
};

/// What a header says of where things are.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub(crate) struct Key([u64; 10]);

const _: () = assert!(std::mem::offset_of!(Header, leaves_offset) == 72);

impl Key {
    pub const NONE: Key = Key([0; 10]);
}

impl PartialEq for Key {
    #[inline(always)]
    fn eq(&self, other: &Key) -> bool {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: SSE2 is part of x86-64; five vectors each.
        unsafe {
            use std::arch::x86_64::*;
            let equal = |i: usize| {
                let load = |key: &Key| _mm_loadu_si128(key.0.as_ptr().add(2 * i).cast());
                _mm_cmpeq_epi8(load(self), load(other))
            };
            let most = _mm_and_si128(_mm_and_si128(equal(0), equal(1)), equal(2));
            let rest = _mm_and_si128(equal(3), equal(4));
            _mm_movemask_epi8(_mm_and_si128(most, rest)) == 0xFFFF
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            self.0 == other.0
        }
    }
}

/// Checks that a header is one of ours and that its nodes and leaves are inside its size: what
/// reading them relies on.
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
    if inside(
        header.nodes_offset,
        header.node_count,
        size_of::<Node>() as u64,
    ) && inside(
        header.leaves_offset,
        header.leaf_count,
        leaf_bytes(kind, form),
    ) && inside(header.references_offset, references, 8)
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
