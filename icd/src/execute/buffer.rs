//! Copying, filling and updating buffers. Ranges were checked against their buffers when they were recorded.

/// `vkCmdCopyBuffer`, one region. Source and destination may overlap only by mistake; the bytes are well defined even then.
pub fn copy(source: u64, destination: u64, size_bytes: u64) {
    // SAFETY: both ranges are inside buffers that are bound to memory, which the application keeps for the time of execution.
    unsafe {
        std::ptr::copy(
            source as *const u8,
            destination as *mut u8,
            size_bytes as usize,
        );
    }
}

/// `vkCmdFillBuffer`: whole words only.
pub fn fill(address: u64, size_bytes: u64, word: u32) {
    // SAFETY: as for `copy`; buffers and the offset are aligned to words.
    let words =
        unsafe { std::slice::from_raw_parts_mut(address as *mut u32, (size_bytes / 4) as usize) };
    words.fill(word);
}

/// `vkCmdUpdateBuffer`.
pub fn update(address: u64, bytes: &[u8]) {
    // SAFETY: as for `copy`.
    unsafe {
        std::ptr::copy_nonoverlapping(bytes.as_ptr(), address as *mut u8, bytes.len());
    }
}

/// The `VkDispatchIndirectCommand` at an address.
pub fn read_dispatch_size(address: u64) -> [u32; 3] {
    // SAFETY: as for `copy`; the offset is a multiple of four.
    unsafe { std::ptr::read_unaligned(address as *const [u32; 3]) }
}
