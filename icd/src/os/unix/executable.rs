//! Executable pages. No page is ever both writable and executable.

use std::ptr::NonNull;

use spirv_jit::native::CodePages;

/// Where the compiler's native code lies.
// SAFETY: both functions' documentation promises it.
pub const CODE_PAGES: CodePages = unsafe { CodePages::new(map, unmap) };

/// Copies code into new pages, which are made read-only and executable then. `None` where the
/// system gives no such pages: too little memory, or a policy (SELinux, seccomp) against them.
pub fn map(code: &[u8]) -> Option<NonNull<u8>> {
    let length = code.len().max(1);
    // SAFETY: new pages, which no other code knows yet; they are as long as the copied code.
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

/// Gives the pages of code back.
///
/// # Safety
/// [`map`] gave them for code of this length, and nothing runs it any more.
pub unsafe fn unmap(start: NonNull<u8>, length: usize) {
    // SAFETY: the caller's promise.
    unsafe { libc::munmap(start.as_ptr().cast(), length.max(1)) };
}
