//! Where a structure's triangles find their opacity.

use super::Structure;
use crate::error::StructureError;
use crate::layout::{ALIGNMENT, Header, micromap_part_bytes, micromap_reference};
use crate::live::Live;
use crate::micromap::{TriangleOpacity, validate_micromap};

impl Structure {
    /// The opacity of a geometry's triangle by its micromap. Where the structure says nothing, a
    /// shader is asked.
    pub(crate) fn micromap_opacity(
        &self,
        geometry: u32,
        primitive: u32,
        live: &Live,
    ) -> TriangleOpacity {
        self.micromap_word(geometry, primitive).map_or(
            TriangleOpacity::UNKNOWN,
            |(address, word)| {
                // SAFETY: the contract of `at`.
                unsafe { TriangleOpacity::of_word(address, word, live) }
            },
        )
    }

    /// The word that says where a geometry's micromap is.
    pub(crate) fn micromap_reference(&self, geometry: u32) -> Option<u64> {
        if geometry >= self.geometry_count {
            return None;
        }
        // SAFETY: references are eight bytes.
        unsafe { self.read_part(8 * u64::from(geometry)) }
    }

    /// The address of a geometry's micromap, wherever it lies; 0 where there is none.
    pub(crate) fn micromap_address(&self, geometry: u32) -> Option<u64> {
        let reference = self.micromap_reference(geometry)?;
        if reference & micromap_reference::INSIDE == 0 {
            return Some(reference & !micromap_reference::LISTED);
        }
        let (part, bytes) = self.micromap_part()?;
        let offset = reference & !micromap_reference::INSIDE;
        (offset.is_multiple_of(ALIGNMENT) && offset < bytes)
            .then(|| part.expose_provenance() as u64 + offset)
    }

    /// Where the structure lies.
    pub(crate) fn addresses(&self) -> std::ops::Range<u64> {
        let start = self.base.expose_provenance() as u64;
        start..start.saturating_add(self.size_bytes())
    }

    /// Where a geometry's micromap lies, and a triangle's word.
    fn micromap_word(&self, geometry: u32, primitive: u32) -> Option<(u64, u32)> {
        let entry = self.geometry(geometry)?;
        if primitive >= entry.primitive_count {
            return None;
        }
        let index = entry.first_primitive.checked_add(primitive.into())?;
        let words = 8 * u64::from(self.geometry_count);
        let place = words.checked_add(index.checked_mul(4)?)?;
        // SAFETY: words are four bytes.
        let word: u32 = unsafe { self.read_part(place) }?;
        Some((self.micromap_address(geometry)?, word))
    }

    /// The part's start and its length; `None` without.
    fn micromap_part(&self) -> Option<(*const u8, u64)> {
        let bytes = self.micromap_bytes;
        let start = self.size_bytes.checked_sub(bytes)?;
        (bytes > 0).then(|| (self.base.wrapping_add(start as usize), bytes))
    }

    /// Reads from the part, if that is inside.
    ///
    /// # Safety
    /// Any bytes will do for `T`.
    unsafe fn read_part<T: Copy>(&self, place: u64) -> Option<T> {
        let (part, bytes) = self.micromap_part()?;
        let end = place.checked_add(size_of::<T>() as u64)?;
        // SAFETY: inside the part, which is inside the structure.
        (end <= bytes).then(|| unsafe { part.add(place as usize).cast::<T>().read_unaligned() })
    }
}

/// Checks the micromaps that a structure holds itself.
pub(super) fn check(
    structure: &Structure,
    header: &Header,
    blob: &[u8],
) -> Result<(), StructureError> {
    let bytes = structure.micromap_bytes();
    if bytes == 0 {
        return Ok(());
    }
    let end = header.size_bytes as usize;
    let part = &blob[end - bytes as usize..end];
    let own = micromap_part_bytes(header.geometry_count.into(), header.primitive_count);
    let (references, _) = part[..8 * header.geometry_count as usize].as_chunks::<8>();
    for &reference in references {
        let reference = u64::from_le_bytes(reference);
        if reference & micromap_reference::INSIDE == 0 {
            continue;
        }
        let offset = reference & !micromap_reference::INSIDE;
        if offset < own || !offset.is_multiple_of(ALIGNMENT) {
            return Err(StructureError::Corrupt);
        }
        let micromap = part.get(offset as usize..).ok_or(StructureError::Corrupt)?;
        validate_micromap(micromap)?;
    }
    Ok(())
}
