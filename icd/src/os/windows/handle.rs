//! Handles of the system's objects.

#[cfg(test)]
use std::os::windows::io::AsHandle;
use std::os::windows::io::{AsRawHandle, FromRawHandle, IntoRawHandle, OwnedHandle};

use windows_sys::Win32::Foundation::{
    CloseHandle, DUPLICATE_SAME_ACCESS, DuplicateHandle, ERROR_ALREADY_EXISTS, GetLastError, HANDLE,
};
use windows_sys::Win32::Security::SECURITY_ATTRIBUTES;
use windows_sys::Win32::System::Threading::GetCurrentProcess;
use windows_sys::core::PCWSTR;

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
        // SAFETY: the caller guarantees that Unless null, it is an open handle without an owner.
        (!raw.is_null()).then(|| Self(unsafe { OwnedHandle::from_raw_handle(raw) }))
    }

    /// The answer of a system call that makes an object which may have a name. The inner `None`
    /// says that another object has it.
    ///
    /// # Safety
    /// As for [`Self::created`], and no other system call comes in between.
    pub(super) unsafe fn new_object(raw: HANDLE) -> Option<Option<Self>> {
        // SAFETY: a plain system call; the caller keeps the contract of `Self::created`, and no
        // other system call comes in between.
        unsafe {
            let is_new = GetLastError() != ERROR_ALREADY_EXISTS;
            let handle = Self::created(raw)?;
            Some(is_new.then_some(handle))
        }
    }

    /// Another handle of the same object, with the same access rights. `None` where the number is
    /// no handle or the process can have no more of them.
    pub fn duplicate(raw: RawHandle) -> Option<Self> {
        duplicate(raw, 0, false, DUPLICATE_SAME_ACCESS)
    }

    /// Another handle of the same object, with these access rights. `None` where the number is no
    /// handle or the system refuses.
    pub(super) fn with_access(raw: RawHandle, access: u32) -> Option<Self> {
        duplicate(raw, access, false, 0)
    }

    /// Duplicates the handle; `None` if the process cannot have more handles.
    #[cfg(test)]
    pub fn try_clone(&self) -> Option<Self> {
        self.0.try_clone().ok().map(Self)
    }

    /// Another handle of the same object, for others. It has the rights that drivers `need` at
    /// least. `None` where the process can have no more or the system refuses.
    pub(super) fn share(&self, need: u32, rights: Rights) -> Option<Self> {
        match rights.access {
            0 => duplicate(self.raw(), 0, rights.is_inherited, DUPLICATE_SAME_ACCESS),
            access => duplicate(self.raw(), access | need, rights.is_inherited, 0),
        }
    }

    /// Releases the handle to the caller.
    pub fn into_raw(self) -> RawHandle {
        self.0.into_raw_handle()
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

fn duplicate(raw: HANDLE, access: u32, is_inherited: bool, options: u32) -> Option<Handle> {
    let mut copy = std::ptr::null_mut();
    // SAFETY: a plain system call that gives a new handle, owned from its creation on.
    unsafe {
        let process = GetCurrentProcess();
        let is_there = DuplicateHandle(
            process,
            raw,
            process,
            &mut copy,
            access,
            is_inherited.into(),
            options,
        );
        (is_there != 0).then(|| Handle::created(copy)).flatten()
    }
}

/// The access rights of handles for other users.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rights {
    /// 0: all.
    access: u32,
    /// Child processes inherit the handle.
    is_inherited: bool,
}

/// The name, security attributes and access rights of an object that is shared by handles.
#[derive(Clone, Copy, Debug)]
pub struct Sharing {
    attributes: *const SECURITY_ATTRIBUTES,
    name: PCWSTR,
    access: u32,
}

/// No name, and the system's defaults.
impl Default for Sharing {
    fn default() -> Self {
        Self {
            attributes: std::ptr::null(),
            name: std::ptr::null(),
            access: 0,
        }
    }
}

impl Sharing {
    /// The application's parameters. Each pointer may be null, and an access of 0 means all.
    ///
    /// # Safety
    /// The attributes are valid and the name ends with a zero, as long as this is used.
    pub unsafe fn new(attributes: *const std::ffi::c_void, name: *const u16, access: u32) -> Self {
        Self {
            attributes: attributes.cast(),
            name,
            access,
        }
    }

    pub(super) fn name(&self) -> PCWSTR {
        self.name
    }

    /// The attributes of the driver's own handle, which no child process has.
    pub(super) fn attributes(&self) -> Option<SECURITY_ATTRIBUTES> {
        // SAFETY: the promise of `new`.
        let attributes = unsafe { self.attributes.as_ref() }?;
        Some(SECURITY_ATTRIBUTES {
            bInheritHandle: 0,
            ..*attributes
        })
    }

    pub(super) fn rights(&self) -> Rights {
        // SAFETY: the promise of `new`.
        let attributes = unsafe { self.attributes.as_ref() };
        Rights {
            access: self.access,
            is_inherited: attributes.is_some_and(|attributes| attributes.bInheritHandle != 0),
        }
    }
}

/// The attributes, for a call.
pub(super) fn pointer_to(attributes: Option<&SECURITY_ATTRIBUTES>) -> *const SECURITY_ATTRIBUTES {
    attributes.map_or(std::ptr::null(), std::ptr::from_ref)
}

/// Closes a handle.
///
/// # Safety
/// The caller owns the handle.
pub unsafe fn close(raw: RawHandle) {
    // SAFETY: the caller guarantees that it is the caller's to close.
    unsafe { CloseHandle(raw) };
}
