//! Handles of the system's objects.

#[cfg(test)]
use std::os::windows::io::AsHandle;
use std::os::windows::io::{AsRawHandle, FromRawHandle, OwnedHandle};

use windows_sys::Win32::Foundation::{CloseHandle, HANDLE};

/// A handle as C declares it.
pub type RawHandle = HANDLE;

/// A handle of another owner that is open for the lifetime.
pub type BorrowedHandle<'a> = std::os::windows::io::BorrowedHandle<'a>;

/// An owned handle: of a section or an event.
#[derive(Debug)]
pub struct Handle(OwnedHandle);

impl Handle {
    /// The answer of a system call that makes a handle.
    ///
    /// # Safety
    /// Unless null, it is an open handle without an owner.
    pub(super) unsafe fn created(raw: HANDLE) -> Option<Self> {
        // SAFETY: the caller's promise.
        (!raw.is_null()).then(|| Self(unsafe { OwnedHandle::from_raw_handle(raw) }))
    }

    /// Another handle of the same object; `None` where the process can have no more.
    pub fn try_clone(&self) -> Option<Self> {
        self.0.try_clone().ok().map(Self)
    }

    /// The handle, for a call.
    #[cfg(test)]
    pub fn borrow(&self) -> BorrowedHandle<'_> {
        self.0.as_handle()
    }

    pub(super) fn raw(&self) -> HANDLE {
        self.0.as_raw_handle()
    }
}

/// Closes a handle.
///
/// # Safety
/// It is the caller's to close.
pub unsafe fn close(raw: RawHandle) {
    // SAFETY: the caller's promise.
    unsafe { CloseHandle(raw) };
}
