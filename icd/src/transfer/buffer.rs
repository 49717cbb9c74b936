//! Copies, fills and updates of buffers. Recording has checked ranges of buffers; ranges given by
//! address are ignored if there is no memory.

use spirv_jit::reach::Reach;

use super::pattern::Pattern;

/// `vkCmdCopyBuffer`, one region. Overlapping regions are invalid, but still give well-defined
/// bytes.
pub fn copy(reach: &Reach, source: u64, destination: u64, size_bytes: u64) {
    if !reach.contains(source, size_bytes) || !reach.contains(destination, size_bytes) {
        return;
    }
    // SAFETY: both ranges are in reach, and the application keeps their memory during execution.
    unsafe {
        std::ptr::copy(
            source as *const u8,
            destination as *mut u8,
            size_bytes as usize,
        );
    }
}

/// `vkCmdFillBuffer`: whole words only.
pub fn fill(reach: &Reach, address: u64, size_bytes: u64, word: u32) {
    if !reach.contains(address, size_bytes) || !address.is_multiple_of(4) {
        return;
    }
    let pattern = Pattern::new(&word.to_ne_bytes());
    // SAFETY: as for `copy`.
    unsafe { pattern.fill(address as *mut u8, size_bytes as usize & !3) };
}

/// `vkCmdUpdateBuffer`.
pub fn update(reach: &Reach, address: u64, bytes: &[u8]) {
    if !reach.contains(address, bytes.len() as u64) {
        return;
    }
    // SAFETY: as for `copy`.
    unsafe {
        std::ptr::copy_nonoverlapping(bytes.as_ptr(), address as *mut u8, bytes.len());
    }
}
