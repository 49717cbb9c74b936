//! Address space: reserved ranges of pages, and their mappings.
//!
//! A reserved page reads as zeros and is writable. It takes memory at its first write, so a large
//! reservation is free. [`reserve`] and [`release`] create and end a reservation; [`commit`],
//! [`discard`], [`replace_by_zeros`] and [`Section::map`](super::section::Section::map) change
//! parts of it.
//!
//! Addresses identify parts, since resources and shaders have nothing else. A system that needs the
//! mapping of each page keeps a table behind these functions: on Windows the section and offset of
//! each view, and the bounds of placeholders.
//!
//! A replacement is atomic for other threads: a concurrent access finds the old or the new pages
//! and never faults. Sparse binding relies on this, because it replaces pages that running shaders
//! may read.

use std::sync::OnceLock;

/// The system's page size, which is the alignment of mapped sections.
pub fn page_bytes() -> u64 {
    static BYTES: OnceLock<u64> = OnceLock::new();
    *BYTES.get_or_init(|| {
        // SAFETY: the query takes no pointer.
        let bytes = unsafe { libc::sysconf(libc::_SC_PAGESIZE) };
        u64::try_from(bytes).unwrap_or(64 << 10)
    })
}

/// The number of mappings that the process may have, in all libraries together.
pub fn max_mappings() -> u32 {
    /// Linux's default.
    const DEFAULT: u32 = 65530;
    let limit = std::fs::read_to_string("/proc/sys/vm/max_map_count").ok();
    let limit = limit.and_then(|text| text.trim().parse().ok());
    limit.unwrap_or(DEFAULT)
}

/// The size up to which a reservation costs little time and memory: any size.
pub const CHEAP_BYTES: u64 = u64::MAX;

/// Reserves address space aligned to `alignment_bytes`; `None` if the system has none left.
pub fn reserve(size_bytes: u64, alignment_bytes: u64) -> Option<u64> {
    let mapped = map_zero_pages(0, size_bytes.checked_add(alignment_bytes)?, 0)?;
    let address = mapped.next_multiple_of(alignment_bytes);
    let (before, after) = (address - mapped, mapped + alignment_bytes - address);
    for (start, bytes) in [(mapped, before), (address + size_bytes, after)] {
        if bytes != 0 {
            // SAFETY: the mapping was just made, and this part of it is not used.
            unsafe { release(start, bytes) };
        }
    }
    Some(address)
}

/// Reserves the address space at `address`; `None` if a part of it is in use.
pub fn reserve_at(address: u64, size_bytes: u64) -> Option<u64> {
    let mapped = map_zero_pages(address, size_bytes, libc::MAP_FIXED_NOREPLACE)?;
    if mapped != address {
        // Kernels before 4.17 ignore the flag and take the address as a hint. SAFETY: the mapping
        // was just made and is not used.
        unsafe { release(mapped, size_bytes) };
        return None;
    }
    Some(mapped)
}

/// Releases a whole reservation with all its mappings.
///
/// # Safety
/// The caller owns the reservation, and nothing accesses it any more.
pub unsafe fn release(address: u64, size_bytes: u64) {
    // SAFETY: the caller owns the reservation, and guarantees that nothing accesses it any more.
    unsafe { libc::munmap(address as *mut _, size_bytes as usize) };
}

/// Commits memory to a part of a reservation; false if the system refuses. Linux always succeeds:
/// it takes memory at the first write, and a control group or the machine may run out of it then.
#[must_use]
pub fn commit(_address: u64, _size_bytes: u64) -> bool {
    true
}

/// Discards the contents of a part of a reservation. It reads as zeros afterwards, and the system
/// gets its memory back.
///
/// # Safety
/// The part is the caller's, no section is mapped there, and no reference to it is alive.
pub unsafe fn discard(address: u64, size_bytes: u64) {
    // SAFETY: the caller guarantees that the part is the caller's, no section is mapped there, and
    // no reference to it is alive.
    unsafe { libc::madvise(address as *mut _, size_bytes as usize, libc::MADV_DONTNEED) };
}

/// Replaces the mappings in a part of a reservation with pages of zeros; false if the system
/// refuses.
///
/// # Safety
/// The part is the caller's, and no reference to it is alive.
pub unsafe fn replace_by_zeros(address: u64, size_bytes: u64) -> bool {
    map_zero_pages(address, size_bytes, libc::MAP_FIXED).is_some()
}

/// Whether all pages of a range are mapped, by any library of the process. Accesses no memory, so
/// any address is allowed.
pub fn is_mapped(address: u64, size_bytes: u64) -> bool {
    /// The smallest page size of any system. The call writes at most one byte for each such page.
    const PAGE: u64 = 4096;
    const CHUNK: u64 = PAGE << 12;
    let Some(end) = address.checked_add(size_bytes) else {
        return false;
    };
    let mut resident = [0u8; (CHUNK / PAGE) as usize];
    // The call requires addresses aligned to the system's pages, which may be larger.
    let mut at = address & !(page_bytes() - 1);
    while at < end {
        let bytes = (end - at).min(CHUNK);
        // SAFETY: the buffer has a byte for each page, and the call reads mappings, not memory.
        let found = unsafe { libc::mincore(at as *mut _, bytes as usize, resident.as_mut_ptr()) };
        if found != 0 {
            return false;
        }
        at += bytes;
    }
    address != 0
}

/// Maps private pages of zeros and returns their address, unless the system refuses.
fn map_zero_pages(address: u64, size_bytes: u64, flags: i32) -> Option<u64> {
    map_anonymous(address, size_bytes, libc::MAP_PRIVATE | flags)
}

/// Maps pages without a file. With `MAP_FIXED`, the caller owns a reservation with the range.
pub(super) fn map_anonymous(address: u64, size_bytes: u64, flags: i32) -> Option<u64> {
    // SAFETY: the system chooses the address, or it is free, or (`MAP_FIXED`) inside a reservation
    // of the caller.
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
    (mapped != libc::MAP_FAILED).then_some(mapped as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALIGNMENT: u64 = 64 << 10;

    #[test]
    fn places_of_the_systems_choice_are_aligned_too() {
        let maps = (0..20).map(|_| {
            // A page by itself, for the next mapping not to lie where the last did.
            let page = map_zero_pages(0, page_bytes(), 0).unwrap();
            let address = reserve(ALIGNMENT, ALIGNMENT).unwrap();
            assert!(address.is_multiple_of(ALIGNMENT), "{address:#x}");
            // SAFETY: all of it was just mapped.
            unsafe { *((address + ALIGNMENT - 8) as *mut u64) = address };
            (page, address)
        });
        for (page, address) in maps.collect::<Vec<_>>() {
            // SAFETY: the test's own mappings, which nothing else uses.
            unsafe {
                assert_eq!(*((address + ALIGNMENT - 8) as *const u64), address);
                release(page, page_bytes());
                release(address, ALIGNMENT);
            }
        }
    }
}
