//! Sections: memory that is mapped at several addresses, of this process or of others.

use std::sync::{Arc, OnceLock};

use windows_sys::Win32::Foundation::{
    ERROR_INVALID_HANDLE, ERROR_NO_SYSTEM_RESOURCES, ERROR_SUCCESS, ERROR_TOO_MANY_OPEN_FILES,
    GetLastError, INVALID_HANDLE_VALUE, SetLastError,
};
use windows_sys::Win32::System::Memory::{
    CreateFileMappingW, FILE_MAP_READ, FILE_MAP_WRITE, MEM_COMMIT, MEMORY_BASIC_INFORMATION,
    MEMORY_MAPPED_VIEW_ADDRESS, MapViewOfFile, OpenFileMappingW, PAGE_READWRITE, UnmapViewOfFile,
    VirtualQuery,
};

use super::address_space::{page_bytes, replace_by_view};
use super::handle::{Handle, Rights, Sharing, pointer_to};

/// The reason of a refusal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// The process cannot have more handles.
    Handles,
    Memory,
    /// Another object has the name.
    Name,
}

/// The rights that drivers need: to map a section, and to write to it.
const NEEDS: u32 = FILE_MAP_READ | FILE_MAP_WRITE;

/// Shared memory, zero at first. It lives as long as it is mapped or has a handle.
#[derive(Debug)]
pub struct Section {
    /// Filled by [`Self::map`] in a private section.
    file: OnceLock<Arc<Handle>>,
    is_private: bool,
    /// Of the handles that others get.
    rights: Rights,
}

impl Section {
    /// A section of this process, which cannot be exported. [`Self::map`] maps it once and gives it
    /// its size.
    pub fn private() -> Self {
        Self {
            file: OnceLock::new(),
            is_private: true,
            rights: Rights::default(),
        }
    }

    /// A section with a handle. The system lets no process change its size.
    ///
    /// # Errors
    /// The system refuses.
    pub fn exportable(size_bytes: u64, sharing: &Sharing) -> Result<Self, Refused> {
        Ok(Self {
            file: OnceLock::from(create(size_bytes, sharing)?),
            is_private: false,
            rights: sharing.rights(),
        })
    }

    /// A section that another device or process exported. `None` where it is smaller than
    /// `size_bytes`, or its pages are reserved alone: an access would be a fault.
    pub fn import(file: Handle, size_bytes: u64) -> Option<Self> {
        let size_bytes = usize::try_from(size_bytes.max(1)).ok()?;
        // SAFETY: a view that nothing else knows: the system gives none past the section's end.
        unsafe {
            let view = MapViewOfFile(file.raw(), FILE_MAP_WRITE, 0, 0, size_bytes);
            if view.Value.is_null() {
                return None;
            }
            let is_committed = is_committed(&view, size_bytes);
            UnmapViewOfFile(view);
            if !is_committed {
                return None;
            }
        }
        Some(Self {
            file: OnceLock::from(Arc::new(file)),
            is_private: false,
            rights: Rights::default(),
        })
    }

    /// The handle for other users; `None` for a private section.
    pub fn handle(&self) -> Option<&Handle> {
        let file = self.file.get().filter(|_| !self.is_private);
        file.map(Arc::as_ref)
    }

    /// A new handle for other users; `None` if the process cannot have more, and for a private
    /// section.
    pub fn export(&self) -> Option<Handle> {
        self.handle()?.share(NEEDS, self.rights)
    }

    /// Maps the section from its beginning, in place of the pages at `address`; false if the system
    /// refuses.
    ///
    /// # Safety
    /// The caller owns a reservation with the range, no reference to the range is alive, and the
    /// section is as large.
    #[must_use]
    pub unsafe fn map(&self, address: u64, size_bytes: u64) -> bool {
        if self.file.get().is_none() {
            let Ok(file) = create(size_bytes, &Sharing::default()) else {
                return false;
            };
            self.file.get_or_init(|| file);
        }
        // SAFETY: the caller guarantees that the range is a part of a reservation of the caller's,
        // no reference to it is alive, and the section is as large.
        unsafe { self.view(0, size_bytes, address) }
    }

    /// Maps a part of the section at another address, in place of the pages there; false if the
    /// system refuses. `view` is the address of [`Self::map`], and `offset` the part's offset in
    /// the section.
    ///
    /// # Safety
    /// The section is mapped at `view` and has the part. The caller owns a reservation with the
    /// range at `address`, and no reference to the range is alive.
    #[must_use]
    pub unsafe fn alias(&self, _view: u64, offset: u64, size_bytes: u64, address: u64) -> bool {
        // SAFETY: the caller guarantees that the section is mapped at `view` and has the part; the
        // range at `address` is a part of a reservation of the caller's, and no reference to it is
        // alive.
        unsafe { self.view(offset, size_bytes, address) }
    }

    /// # Safety
    /// As [`Self::alias`].
    unsafe fn view(&self, offset: u64, size_bytes: u64, address: u64) -> bool {
        let Some(file) = self.file.get() else {
            return false;
        };
        // SAFETY: the caller keeps the promises of `Self::alias`.
        unsafe { replace_by_view(address, size_bytes, file, offset) }
    }
}

/// Whether all pages of a view have memory.
fn is_committed(view: &MEMORY_MAPPED_VIEW_ADDRESS, size_bytes: usize) -> bool {
    // SAFETY: plain data, which the call fills.
    unsafe {
        let mut pages: MEMORY_BASIC_INFORMATION = std::mem::zeroed();
        let size = size_of::<MEMORY_BASIC_INFORMATION>();
        VirtualQuery(view.Value, &mut pages, size) != 0
            && pages.State == MEM_COMMIT
            && pages.RegionSize >= size_bytes
    }
}

/// A handle of a section that another device or process exported, by a name. `None` where there is
/// none.
///
/// # Safety
/// The name is null or ends with a zero.
pub unsafe fn named(name: *const u16) -> Option<Handle> {
    if name.is_null() {
        return None;
    }
    // SAFETY: a plain system call; the handle is owned from its creation on.
    unsafe { Handle::created(OpenFileMappingW(NEEDS, 0, name)) }
}

/// A section of whole pages.
fn create(size_bytes: u64, sharing: &Sharing) -> Result<Arc<Handle>, Refused> {
    let size_bytes = size_bytes.max(1).checked_next_multiple_of(page_bytes());
    let size_bytes = size_bytes.ok_or(Refused::Memory)?;
    let (high, low) = ((size_bytes >> 32) as u32, size_bytes as u32);
    let attributes = sharing.attributes();
    let security = pointer_to(attributes.as_ref());
    // SAFETY: a plain system call; the handle is owned from its creation on.
    let file = unsafe {
        SetLastError(ERROR_SUCCESS);
        let file = CreateFileMappingW(
            INVALID_HANDLE_VALUE,
            security,
            PAGE_READWRITE,
            high,
            low,
            sharing.name(),
        );
        Handle::new_object(file).ok_or_else(|| match GetLastError() {
            ERROR_NO_SYSTEM_RESOURCES | ERROR_TOO_MANY_OPEN_FILES => Refused::Handles,
            // An object of another kind has it.
            ERROR_INVALID_HANDLE => Refused::Name,
            _ => Refused::Memory,
        })
    };
    file?.map(Arc::new).ok_or(Refused::Name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sections_without_memory_are_not_imported() {
        const SEC_RESERVE: u32 = 0x400_0000;
        let own = create(1 << 20, &Sharing::default()).unwrap();
        let own = Handle::duplicate(own.raw()).unwrap();
        assert!(Section::import(own, 1 << 20).is_some());
        // SAFETY: a plain system call; the handle is owned from its creation on.
        let reserved = unsafe {
            let (none, kind) = (std::ptr::null(), PAGE_READWRITE | SEC_RESERVE);
            let name = std::ptr::null();
            let file = CreateFileMappingW(INVALID_HANDLE_VALUE, none, kind, 0, 1 << 20, name);
            Handle::created(file).unwrap()
        };
        assert!(Section::import(reserved, 1 << 20).is_none());
        for number in [0, -1, -2, 0x7fff_fff0_isize] {
            let handle = Handle::duplicate(number as _);
            let section = handle.and_then(|handle| Section::import(handle, 1));
            assert!(section.is_none(), "{number}");
        }
    }
}
