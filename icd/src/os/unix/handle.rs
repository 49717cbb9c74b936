//! Handles of the system: file descriptors here.

use std::os::fd::{AsFd, AsRawFd, BorrowedFd, FromRawFd, IntoRawFd, OwnedFd, RawFd};

/// A handle as C declares it.
pub type RawHandle = RawFd;

/// A handle of another owner that is open for the lifetime.
pub type BorrowedHandle<'a> = BorrowedFd<'a>;

/// An owned handle: of a section, an event, or an object that another driver or the kernel made.
#[derive(Debug)]
pub struct Handle(OwnedFd);

impl Handle {
    /// Another handle of the same object. `None` where the number is no handle or the process can
    /// have no more of them.
    pub fn duplicate(raw: RawHandle) -> Option<Self> {
        // SAFETY: a plain system call that gives a new descriptor, owned from its creation on.
        unsafe { Self::created(libc::fcntl(raw, libc::F_DUPFD_CLOEXEC, 0)) }
    }

    /// Takes a handle over. `None` where the number is no handle.
    ///
    /// # Safety
    /// An open handle is the caller's to give away.
    pub unsafe fn adopt(raw: RawHandle) -> Option<Self> {
        // SAFETY: a plain system call; then the descriptor is open, and the caller's promise.
        unsafe {
            Self::created(if libc::fcntl(raw, libc::F_GETFD) < 0 {
                -1
            } else {
                raw
            })
        }
    }

    /// The answer of a system call that makes a descriptor.
    ///
    /// # Safety
    /// Unless negative, it is an open descriptor without an owner.
    pub(super) unsafe fn created(raw: RawHandle) -> Option<Self> {
        // SAFETY: the caller's promise.
        (raw >= 0).then(|| Self(unsafe { OwnedFd::from_raw_fd(raw) }))
    }

    /// Another handle of the same object; `None` where the process can have no more.
    pub fn try_clone(&self) -> Option<Self> {
        self.0.try_clone().ok().map(Self)
    }

    /// The handle, which the caller owns from now on.
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

/// For the libraries of protocols that pass descriptors.
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
/// It is the caller's to close.
pub unsafe fn close(raw: RawHandle) {
    // SAFETY: the caller's promise.
    unsafe { libc::close(raw) };
}
