//! Executable pages. No page is ever both writable and executable.

use std::ptr::NonNull;

/// Copies code into new pages and makes them read-only and executable. `None` if the system refuses
/// such pages: too little memory, or a policy (SELinux, seccomp) against them.
pub fn map(code: &[u8]) -> Option<NonNull<u8>> {
    let length = code.len().max(1);
    // SAFETY: the pages are new, no other code uses them yet, and they are as long as the code.
    unsafe {
        let start = libc::mmap(
            std::ptr::null_mut(),
            length,
            libc::PROT_READ | libc::PROT_WRITE,
            libc::MAP_PRIVATE | libc::MAP_ANONYMOUS,
            -1,
            0,
        );
        if start == libc::MAP_FAILED {
            return None;
        }
        let start = NonNull::new(start.cast::<u8>())?;
        start.copy_from_nonoverlapping(NonNull::from(code).cast(), code.len());
        let rights = libc::PROT_READ | libc::PROT_EXEC;
        if libc::mprotect(start.as_ptr().cast(), length, rights) != 0 {
            unmap(start, code.len());
            return None;
        }
        Some(start)
    }
}

/// Frees the pages of code.
///
/// # Safety
/// [`map`] gave them for code of this length, and nothing runs it any more.
pub unsafe fn unmap(start: NonNull<u8>, length: usize) {
    // SAFETY: the caller guarantees that [`map`] gave them for code of this length, and nothing
    // runs it any more.
    unsafe { libc::munmap(start.as_ptr().cast(), length.max(1)) };
}
