//! Memory that the processor may run code from.

use std::ptr::NonNull;

/// Code at an address that does not move: written, then made read-only and executable. No page is
/// ever both writable and executable.
pub(crate) struct Executable {
    start: NonNull<libc::c_void>,
    length: usize,
}

// SAFETY: the pages are read-only until they are given back.
unsafe impl Send for Executable {}
// SAFETY: as above.
unsafe impl Sync for Executable {}

impl Executable {
    /// `None` where the system gives no such memory: too little of it, or a policy (SELinux,
    /// seccomp) against executable pages.
    pub fn new(code: &[u8]) -> Option<Executable> {
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
            let executable = Executable {
                start: NonNull::new(start)?,
                length,
            };
            start
                .cast::<u8>()
                .copy_from_nonoverlapping(code.as_ptr(), code.len());
            let allowed = libc::mprotect(start, length, libc::PROT_READ | libc::PROT_EXEC);
            (allowed == 0).then_some(executable)
        }
    }

    /// Where the code begins.
    pub fn start(&self) -> *const u8 {
        self.start.as_ptr().cast()
    }
}

impl Drop for Executable {
    fn drop(&mut self) {
        // SAFETY: mapped by `new`; the caller that runs the code holds the program that owns it.
        unsafe { libc::munmap(self.start.as_ptr(), self.length) };
    }
}
