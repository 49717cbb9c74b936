//! The part of a bottom level with the references to its triangles' opacity.

use rayon::prelude::*;

use crate::input::TriangleGeometry;
use crate::pool::in_pool;

/// Number of words that one task writes.
const CHUNK: usize = 16384;

/// Writes the references and words of the geometries, which fill `part`. Geometries without a
/// micromap have a reference of 0 and unused words.
///
/// # Safety
/// The memory of the geometries is readable and unchanged.
pub(crate) unsafe fn write(list: &[&TriangleGeometry], part: &mut [u8]) {
    let (references, mut words) = part.split_at_mut(8 * list.len());
    for (geometry, reference) in list.iter().zip(references.chunks_exact_mut(8)) {
        let word = (geometry.micromap).map_or(0, |micromap| micromap.reference());
        reference.copy_from_slice(&word.to_le_bytes());
        let (own, rest) = words.split_at_mut(4 * geometry.primitive_count as usize);
        words = rest;
        let Some(micromap) = geometry.micromap else {
            own.fill(0);
            continue;
        };
        let fill = |(chunk, places): (usize, &mut [u8])| {
            for (i, place) in places.chunks_exact_mut(4).enumerate() {
                // SAFETY: the caller guarantees that the memory of the geometries is readable and
                // unchanged.
                let word = unsafe { micromap.word((chunk * CHUNK + i) as u32) };
                place.copy_from_slice(&word.to_le_bytes());
            }
        };
        if in_pool() && own.len() > 4 * CHUNK {
            own.par_chunks_mut(4 * CHUNK).enumerate().for_each(fill);
        } else {
            own.chunks_mut(4 * CHUNK).enumerate().for_each(fill);
        }
    }
    words.fill(0);
}
