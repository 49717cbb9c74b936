//! Handles of the system: file descriptors here.

use std::os::fd::{AsFd, AsRawFd, BorrowedFd, FromRawFd, IntoRawFd, OwnedFd, RawFd};

/// A handle as C declares it.
pub type RawHandle = RawFd;

/// A handle of another owner that is open for the lifetime.
pub type BorrowedHandle<'a> = BorrowedFd<'a>;

/// An owned handle of a section, an event, or an object of another driver or the kernel.
#[derive(Debug)]
pub struct Handle(OwnedFd);

impl Handle {
    /// Duplicates a handle. `None` if the number is no handle or the process cannot have more
    /// handles.
    pub fn duplicate(raw: RawHandle) -> Option<Self> {
        // SAFETY: the call takes no pointer, and the new descriptor has no other owner.
        unsafe { Self::created(libc::fcntl(raw, libc::F_DUPFD_CLOEXEC, 0)) }
    }

    /// Takes ownership of a handle. `None` if the number is no handle.
    ///
    /// # Safety
    /// The caller owns the handle, if it is open, and transfers it.
    pub unsafe fn adopt(raw: RawHandle) -> Option<Self> {
        // SAFETY: the call takes no pointer. After it the descriptor is open, and the caller
        // transfers it.
        unsafe {
            Self::created(if libc::fcntl(raw, libc::F_GETFD) < 0 {
                -1
            } else {
                raw
            })
        }
    }

    /// The result of a system call that creates a descriptor.
    ///
    /// # Safety
    /// Unless negative, it is an open descriptor without an owner.
    pub(super) unsafe fn created(raw: RawHandle) -> Option<Self> {
        // SAFETY: the caller guarantees that Unless negative, it is an open descriptor without an
        // owner.
        (raw >= 0).then(|| Self(unsafe { OwnedFd::from_raw_fd(raw) }))
    }

    /// Duplicates the handle; `None` if the process cannot have more handles.
    pub fn try_clone(&self) -> Option<Self> {
        self.0.try_clone().ok().map(Self)
    }

    /// Releases the handle to the caller.
    pub fn into_raw(self) -> RawHandle {
        self.0.into_raw_fd()
    }

    /// The handle, for a call.
    pub fn borrow(&self) -> BorrowedHandle<'_> {
        self.0.as_fd()
    }

    pub(super) fn raw(&self) -> RawHandle {
        self.0.as_raw_fd()
    }
}

/// For protocol libraries that pass descriptors.
impl From<Handle> for OwnedFd {
    fn from(handle: Handle) -> Self {
        handle.0
    }
}

/// The name, security attributes and access rights of an object that is shared by handles: file
/// descriptors have none.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sharing(());

/// Closes a handle.
///
/// # Safety
/// The caller owns the handle.
pub unsafe fn close(raw: RawHandle) {
    // SAFETY: the caller guarantees that it is the caller's to close.
    unsafe { libc::close(raw) };
}
