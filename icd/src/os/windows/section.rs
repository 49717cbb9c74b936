//! Sections: memory that is mapped at several addresses, of this process or of others.

use std::sync::{Arc, OnceLock};

use windows_sys::Win32::Foundation::{
    ERROR_NO_SYSTEM_RESOURCES, ERROR_TOO_MANY_OPEN_FILES, GetLastError, INVALID_HANDLE_VALUE,
};
use windows_sys::Win32::System::Memory::{
    CreateFileMappingW, FILE_MAP_WRITE, MapViewOfFile, PAGE_READWRITE, UnmapViewOfFile,
};

use super::address_space::{page_bytes, replace_by_view};
use super::handle::Handle;

/// The resource that the system refuses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// The process can have no more handles.
    Handles,
    Memory,
}

/// Zeros at first. The memory lives as long as it is mapped somewhere or has a handle.
#[derive(Debug)]
pub struct Section {
    /// Filled by [`Self::map`] in a private section.
    file: OnceLock<Arc<Handle>>,
    is_private: bool,
}

impl Section {
    /// A section of this process, which cannot be exported. It is mapped once by [`Self::map`], and
    /// that gives it its size.
    pub fn private() -> Self {
        Self {
            file: OnceLock::new(),
            is_private: true,
        }
    }

    /// A section with a handle. The system lets no process change its size.
    ///
    /// # Errors
    /// The system refuses.
    pub fn exportable(size_bytes: u64) -> Result<Self, Refused> {
        Ok(Self {
            file: OnceLock::from(create(size_bytes)?),
            is_private: false,
        })
    }

    /// A section that another device or process exported. `None` where it is smaller than
    /// `size_bytes`.
    pub fn import(file: Handle, size_bytes: u64) -> Option<Self> {
        let size_bytes = usize::try_from(size_bytes.max(1)).ok()?;
        // SAFETY: a view that nothing else knows: the system gives none past the section's end.
        unsafe {
            let view = MapViewOfFile(file.raw(), FILE_MAP_WRITE, 0, 0, size_bytes);
            if view.Value.is_null() {
                return None;
            }
            UnmapViewOfFile(view);
        }
        Some(Self {
            file: OnceLock::from(Arc::new(file)),
            is_private: false,
        })
    }

    /// The handle by which others can map it; `None` for a private section.
    pub fn handle(&self) -> Option<&Handle> {
        let file = self.file.get().filter(|_| !self.is_private);
        file.map(Arc::as_ref)
    }

    /// Maps the section from its beginning, in place of the pages at `address`; false if the system
    /// refuses.
    ///
    /// # Safety
    /// The range is a part of a reservation of the caller's, no reference to it is alive, and the
    /// section is as large.
    #[must_use]
    pub unsafe fn map(&self, address: u64, size_bytes: u64) -> bool {
        if self.file.get().is_none() {
            let Ok(file) = create(size_bytes) else {
                return false;
            };
            self.file.get_or_init(|| file);
        }
        // SAFETY: the caller's promise.
        unsafe { self.view(0, size_bytes, address) }
    }

    /// Maps a part of the section at a further address, in place of the pages there; false if the
    /// system refuses. `view` is the address that [`Self::map`] was given, and `offset` is the
    /// part's place in the section.
    ///
    /// # Safety
    /// The section is mapped at `view` and has the part; the range at `address` is a part of a
    /// reservation of the caller's, and no reference to it is alive.
    #[must_use]
    pub unsafe fn alias(&self, _view: u64, offset: u64, size_bytes: u64, address: u64) -> bool {
        // SAFETY: the caller's promise.
        unsafe { self.view(offset, size_bytes, address) }
    }

    /// # Safety
    /// As [`Self::alias`].
    unsafe fn view(&self, offset: u64, size_bytes: u64, address: u64) -> bool {
        let Some(file) = self.file.get() else {
            return false;
        };
        // SAFETY: the caller's promise.
        unsafe { replace_by_view(address, size_bytes, file, offset) }
    }
}

/// A section of whole pages without a name.
fn create(size_bytes: u64) -> Result<Arc<Handle>, Refused> {
    let size_bytes = size_bytes.max(1).checked_next_multiple_of(page_bytes());
    let size_bytes = size_bytes.ok_or(Refused::Memory)?;
    let (high, low) = ((size_bytes >> 32) as u32, size_bytes as u32);
    let (security, name) = (std::ptr::null(), std::ptr::null());
    // SAFETY: a plain system call; the handle is owned from its creation on.
    let file = unsafe {
        let file = CreateFileMappingW(
            INVALID_HANDLE_VALUE,
            security,
            PAGE_READWRITE,
            high,
            low,
            name,
        );
        Handle::created(file).ok_or_else(|| match GetLastError() {
            ERROR_NO_SYSTEM_RESOURCES | ERROR_TOO_MANY_OPEN_FILES => Refused::Handles,
            _ => Refused::Memory,
        })
    };
    file.map(Arc::new)
}
