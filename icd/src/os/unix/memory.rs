//! The machine's memory, and the process's heap.

/// Bytes of the machine's memory; `None` if the system does not say.
pub fn total_bytes() -> Option<u64> {
    pages_bytes(libc::_SC_PHYS_PAGES)
}

/// Bytes of the machine's memory that nothing uses; `None` if the system does not say. A sandbox
/// that allows sysinfo(2) allows this.
pub fn free_bytes() -> Option<u64> {
    pages_bytes(libc::_SC_AVPHYS_PAGES)
}

/// The bytes of so many pages as the system answers to `name`.
fn pages_bytes(name: i32) -> Option<u64> {
    // SAFETY: plain system calls.
    let (pages, page_bytes) = unsafe { (libc::sysconf(name), libc::sysconf(libc::_SC_PAGESIZE)) };
    let (pages, page_bytes) = (u64::try_from(pages).ok()?, u64::try_from(page_bytes).ok()?);
    Some(pages.saturating_mul(page_bytes))
}

/// Gives freed memory back to the system, which the allocator would keep.
pub fn trim_heap() {
    // SAFETY: the call takes no pointer; it locks what it works on.
    #[cfg(target_env = "gnu")]
    unsafe {
        libc::malloc_trim(0);
    }
}
