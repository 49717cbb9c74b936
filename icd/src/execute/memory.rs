//! Copies and fills of buffers.

/// Bytes from which a copy or fill is worth several workers.
const PARALLEL_BYTES: u64 = 1 << 20;

use rayon::prelude::*;

use super::Engine;

/// Copies between buffers. Source and destination do not overlap (VUID-vkCmdCopyBuffer-pRegions-00117).
pub fn copy_buffer(engine: &Engine, source: u64, destination: u64, size_bytes: u64) {
    in_parts(engine, size_bytes, |offset, count| {
        // SAFETY: both ranges are inside bound buffers, which the recording has checked.
        unsafe {
            std::ptr::copy(
                (source + offset) as *const u8,
                (destination + offset) as *mut u8,
                count as usize,
            );
        }
    });
}

/// Fills with a word. Address and size are multiples of four.
pub fn fill_buffer(engine: &Engine, address: u64, size_bytes: u64, word: u32) {
    in_parts(engine, size_bytes, |offset, count| {
        // SAFETY: as above.
        unsafe {
            let words =
                std::slice::from_raw_parts_mut((address + offset) as *mut u32, count as usize / 4);
            words.fill(word);
        }
    });
}

/// Writes recorded bytes.
pub fn update_buffer(address: u64, bytes: &[u8]) {
    // SAFETY: the range is inside a bound buffer, which the recording has checked.
    unsafe { (address as *mut u8).copy_from(bytes.as_ptr(), bytes.len()) };
}

fn in_parts(engine: &Engine, size_bytes: u64, part: impl Fn(u64, u64) + Sync) {
    if size_bytes < 2 * PARALLEL_BYTES {
        return part(0, size_bytes);
    }
    engine.install(|| {
        (0..size_bytes.div_ceil(PARALLEL_BYTES) as usize)
            .into_par_iter()
            .for_each(|index| {
                let offset = index as u64 * PARALLEL_BYTES;
                part(offset, PARALLEL_BYTES.min(size_bytes - offset));
            });
    });
}
