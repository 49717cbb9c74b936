//! Pages of address space.

use std::sync::OnceLock;

/// Allocations are multiples of this, and start at multiples of it (at least a page;
/// `VkMemoryRequirements::alignment` is smaller).
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

/// Maps pages that read as zeros and are committed when written; the address, unless the system
/// refuses.
pub(super) fn map_zero_pages(address: u64, size_bytes: u64, flags: i32) -> Option<u64> {
    map_pages(address, size_bytes, libc::MAP_PRIVATE | flags)
}

/// As [`map_zero_pages`], at any place that is a multiple of [`GRANULE`]: the system knows only its
/// pages.
pub(super) fn map_aligned_zero_pages(size_bytes: u64) -> Option<u64> {
    let mapped = map_zero_pages(0, size_bytes.checked_add(GRANULE)?, 0)?;
    let address = mapped.next_multiple_of(GRANULE);
    let (before, after) = (address - mapped, mapped + GRANULE - address);
    for (start, bytes) in [(mapped, before), (address + size_bytes, after)] {
        if bytes != 0 {
            // SAFETY: the mapping was just made, and this part of it is not used.
            unsafe { libc::munmap(start as *mut _, bytes as usize) };
        }
    }
    Some(address)
}

pub(super) fn map_pages(address: u64, size_bytes: u64, flags: i32) -> Option<u64> {
    // SAFETY: either at a place of the system's choice, or one that is free, or (`MAP_FIXED`)
    // inside a window of ours.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_of_the_systems_choice_are_aligned_too() {
        let maps = (0..20).map(|_| {
            // A page by itself, for the next mapping not to lie where the last did.
            let page = map_zero_pages(0, page_bytes(), 0).unwrap();
            let address = map_aligned_zero_pages(GRANULE).unwrap();
            assert!(address.is_multiple_of(GRANULE), "{address:#x}");
            // SAFETY: all of it was just mapped.
            unsafe { *((address + GRANULE - 8) as *mut u64) = address };
            (page, address)
        });
        for (page, address) in maps.collect::<Vec<_>>() {
            // SAFETY: the test's own mappings, which nothing else uses.
            unsafe {
                assert_eq!(*((address + GRANULE - 8) as *const u64), address);
                libc::munmap(page as *mut _, page_bytes() as usize);
                libc::munmap(address as *mut _, GRANULE as usize);
            }
        }
    }
}
