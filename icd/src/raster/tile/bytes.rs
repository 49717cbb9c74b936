//! Texels of one byte of a row or a block, as words.

use lanes::vector::Vector;

use super::places::{Pattern, Places, quad};
use crate::raster::Target;

/// The bytes of the rows of a block from those of its quads, or those of quads from those of rows:
/// of two quads side by side.
#[inline(always)]
fn regroup([first, second]: [u32; 2]) -> [u32; 2] {
    let low = 0xffff;
    [first & low | second << 16, first >> 16 | second & !low]
}

/// Texels of a row or a block.
///
/// # Safety
/// The texels lie in the attachment, and no other thread writes there.
#[inline(always)]
pub unsafe fn load_bytes<V: Vector>(v: V, target: &Target, places: &Places, sample: u32) -> V::I {
    let first = quad(target, places, 0, sample);
    if places.pattern == Pattern::Row {
        // SAFETY: the caller guarantees that the texels lie in the attachment, and no other thread
        // writes there.
        return v.of_bytes(unsafe { first.cast::<[u64; 2]>().read_unaligned() });
    }
    let stride = target.surface.row_stride_bytes as usize;
    let row = |row: usize| first.wrapping_add(row * stride).cast::<u32>();
    // SAFETY: the caller guarantees that the texels lie in the attachment, and no other thread
    // writes there.
    let pairs = unsafe {
        [
            regroup([row(0).read_unaligned(), row(1).read_unaligned()]),
            regroup([row(2).read_unaligned(), row(3).read_unaligned()]),
        ]
    };
    v.of_bytes(pairs.map(|[left, right]| u64::from(left) | u64::from(right) << 32))
}

/// Stores all texels where [`load_bytes`] loads them.
///
/// # Safety
/// The texels lie in the attachment, and no other thread writes there.
#[inline(always)]
pub unsafe fn store_bytes<V: Vector>(
    v: V,
    target: &Target,
    places: &Places,
    sample: u32,
    words: V::I,
) {
    let first = quad(target, places, 0, sample);
    let bytes = v.to_bytes(words);
    if places.pattern == Pattern::Row {
        // SAFETY: the caller guarantees that the texels lie in the attachment, and no other thread
        // writes there.
        return unsafe { first.cast::<[u64; 2]>().write_unaligned(bytes) };
    }
    let stride = target.surface.row_stride_bytes as usize;
    for (pair, bytes) in bytes.into_iter().enumerate() {
        let [upper, lower] = regroup([bytes as u32, (bytes >> 32) as u32]);
        let row = first.wrapping_add(2 * pair * stride);
        // SAFETY: the caller guarantees that the texels lie in the attachment, and no other thread
        // writes there.
        unsafe {
            row.cast::<u32>().write_unaligned(upper);
            let below = row.wrapping_add(stride).cast::<u32>();
            below.write_unaligned(lower);
        }
    }
}
