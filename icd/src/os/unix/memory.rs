//! The machine's memory, and the process's heap.

/// The machine's memory in bytes; `None` if it is unknown.
pub fn total_bytes() -> Option<u64> {
    pages_bytes(libc::_SC_PHYS_PAGES)
}

/// The machine's free memory in bytes; `None` if it is unknown. A sandbox that allows sysinfo(2)
/// allows this.
pub fn free_bytes() -> Option<u64> {
    pages_bytes(libc::_SC_AVPHYS_PAGES)
}

/// The bytes of the page count that the system returns for `name`.
fn pages_bytes(name: i32) -> Option<u64> {
    // SAFETY: the calls take no pointers.
    let (pages, page_bytes) = unsafe { (libc::sysconf(name), libc::sysconf(libc::_SC_PAGESIZE)) };
    let (pages, page_bytes) = (u64::try_from(pages).ok()?, u64::try_from(page_bytes).ok()?);
    Some(pages.saturating_mul(page_bytes))
}

/// Returns freed memory, which the allocator would keep, to the system.
pub fn trim_heap() {
    // SAFETY: the call takes no pointer; it locks what it works on.
    #[cfg(target_env = "gnu")]
    unsafe {
        libc::malloc_trim(0);
    }
}
