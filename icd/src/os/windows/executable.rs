//! Executable pages. No page is ever both writable and executable.

use std::ptr::NonNull;

use windows_sys::Win32::System::Diagnostics::Debug::FlushInstructionCache;
use windows_sys::Win32::System::Memory::{
    MEM_COMMIT, MEM_RELEASE, MEM_RESERVE, PAGE_EXECUTE_READ, PAGE_READWRITE, VirtualAlloc,
    VirtualFree, VirtualProtect,
};
use windows_sys::Win32::System::Threading::GetCurrentProcess;

/// Copies code into new pages, which are made read-only and executable then. `None` where the
/// system gives no such pages: too little memory, or a policy against them (dynamic code
/// prohibited).
pub fn map(code: &[u8]) -> Option<NonNull<u8>> {
    let length = code.len().max(1);
    // SAFETY: the pages are new, no other code uses them yet, and they are as long as the code.
    unsafe {
        let how = MEM_RESERVE | MEM_COMMIT;
        let start = VirtualAlloc(std::ptr::null(), length, how, PAGE_READWRITE);
        let start = NonNull::new(start.cast::<u8>())?;
        start.copy_from_nonoverlapping(NonNull::from(code).cast(), code.len());
        let mut before = 0;
        let pages = start.as_ptr().cast();
        if VirtualProtect(pages, length, PAGE_EXECUTE_READ, &mut before) == 0 {
            unmap(start, code.len());
            return None;
        }
        FlushInstructionCache(GetCurrentProcess(), pages, length);
        Some(start)
    }
}

/// Frees the pages of code.
///
/// # Safety
/// [`map`] gave them for code of this length, and nothing runs it any more.
pub unsafe fn unmap(start: NonNull<u8>, _length: usize) {
    // SAFETY: the caller guarantees that [`map`] gave them for code of this length, and nothing
    // runs it any more.
    unsafe { VirtualFree(start.as_ptr().cast(), 0, MEM_RELEASE) };
}
