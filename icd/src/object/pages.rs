//! Pages of address space.

use std::sync::OnceLock;

/// Allocations are multiples of this, and start at multiples of it (at least a page; `VkMemoryRequirements::alignment` is smaller).
pub const GRANULE: u64 = 64 << 10;

/// Bytes of a page of the system.
pub fn page_bytes() -> u64 {
    static BYTES: OnceLock<u64> = OnceLock::new();
    *BYTES.get_or_init(|| {
        // SAFETY: a query without arguments of ours.
        let bytes = unsafe { libc::sysconf(libc::_SC_PAGESIZE) };
        u64::try_from(bytes).unwrap_or(GRANULE)
    })
}

/// Maps pages that read as zeros and are committed when written; the address, unless the system refuses.
pub(super) fn map_zero_pages(address: u64, size_bytes: u64, flags: i32) -> Option<u64> {
    map_pages(address, size_bytes, libc::MAP_PRIVATE | flags)
}

pub(super) fn map_pages(address: u64, size_bytes: u64, flags: i32) -> Option<u64> {
    // SAFETY: either at a place of the system's choice, or one that is free, or (`MAP_FIXED`) inside a window of ours.
    let mapped = unsafe {
        libc::mmap(
            address as *mut _,
            size_bytes as usize,
            libc::PROT_READ | libc::PROT_WRITE,
            libc::MAP_ANONYMOUS | libc::MAP_NORESERVE | flags,
            -1,
            0,
        )
    };
    if mapped == libc::MAP_FAILED {
        return None;
    }
    if flags & libc::MAP_FIXED_NOREPLACE != 0 && mapped as u64 != address {
        // Kernels before 4.17 take the flag for a hint.
        // SAFETY: the mapping was just made and is not used.
        unsafe { libc::munmap(mapped, size_bytes as usize) };
        return None;
    }
    Some(mapped as u64)
}
