//! Pages that the processor may run code from. The caller of this crate gives them.

use std::ptr::NonNull;
use std::sync::{PoisonError, RwLock};

/// Pages of native code, as the caller's system has them. No page is ever both writable and
/// executable.
#[derive(Clone, Copy, Debug)]
pub struct CodePages {
    map: fn(&[u8]) -> Option<NonNull<u8>>,
    unmap: unsafe fn(NonNull<u8>, usize),
}

impl CodePages {
    /// `map` copies code into new pages, which are made read-only and executable then; `None` where
    /// the system refuses that. `unmap` gives the pages back: it is passed the address from `map`
    /// and the code's length in bytes, once, when nothing runs the code any more.
    ///
    /// # Safety
    /// The functions do so: the code can be run, and does not change, until it is unmapped.
    pub const unsafe fn new(
        map: fn(&[u8]) -> Option<NonNull<u8>>,
        unmap: unsafe fn(NonNull<u8>, usize),
    ) -> Self {
        Self { map, unmap }
    }
}

#[cfg(not(test))]
const AT_FIRST: Option<CodePages> = None;
#[cfg(test)]
const AT_FIRST: Option<CodePages> = {
    use shaders::code_pages::{map, unmap};
    // SAFETY: the functions' documentation promises it.
    Some(unsafe { CodePages::new(map, unmap) })
};

static PAGES: RwLock<Option<CodePages>> = RwLock::new(AT_FIRST);

/// The pages of native code in programs that are made from now on; none have it with `None`, as
/// before the first call. The results are the same bits with and without.
pub fn provide(pages: Option<CodePages>) {
    *PAGES.write().unwrap_or_else(PoisonError::into_inner) = pages;
}

/// The pages that were provided last.
pub(super) fn provided() -> Option<CodePages> {
    *PAGES.read().unwrap_or_else(PoisonError::into_inner)
}

/// Code at an address that does not move.
pub(crate) struct Executable {
    start: NonNull<u8>,
    length: usize,
    unmap: unsafe fn(NonNull<u8>, usize),
}

// SAFETY: the pages are read-only until they are given back.
unsafe impl Send for Executable {}
// SAFETY: the pages are read-only until they are given back.
unsafe impl Sync for Executable {}

impl Executable {
    /// `None` where no pages are provided, or the system refuses them.
    pub fn new(code: &[u8]) -> Option<Executable> {
        let pages = provided()?;
        Some(Executable {
            start: (pages.map)(code)?,
            length: code.len(),
            unmap: pages.unmap,
        })
    }

    /// Where the code begins.
    pub fn start(&self) -> *const u8 {
        self.start.as_ptr()
    }

    /// The code.
    pub fn bytes(&self) -> &[u8] {
        // SAFETY: mapped by `new`, which copied so many bytes there; readable, and unchanged while
        // it lives.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), self.length) }
    }
}

impl Drop for Executable {
    fn drop(&mut self) {
        // SAFETY: mapped by `new`; the caller that runs the code holds the program that owns it.
        unsafe { (self.unmap)(self.start, self.length) };
    }
}
