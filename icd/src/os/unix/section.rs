//! Sections: memory that is mapped at several addresses, of this process or of others.

use std::ffi::CStr;

use super::address_space::map_anonymous;
use super::handle::{Handle, Sharing};

/// The resource that the system refuses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// The process can have no more handles.
    Handles,
    Memory,
    /// Another object has the name. No object of this system has one.
    #[allow(dead_code)]
    Name,
}

/// Zeros at first. The memory lives as long as it is mapped somewhere or has a handle.
#[derive(Debug)]
pub struct Section {
    /// None: the mappings alone keep it.
    file: Option<Handle>,
}

impl Section {
    /// A section of this process, which cannot be exported. It is mapped once by [`Self::map`], and
    /// that gives it its size.
    pub fn private() -> Self {
        Self { file: None }
    }

    /// A section with a handle, of a size that no process can change.
    ///
    /// # Errors
    /// The system refuses.
    pub fn exportable(size_bytes: u64, _sharing: &Sharing) -> Result<Self, Refused> {
        let file = sealed_file(c"tuff", size_bytes)?;
        Ok(Self { file: Some(file) })
    }

    /// A section that another device or process exported. From now on its size cannot shrink: an
    /// access past its end would be a fault. `None` where it can, or is smaller than `size_bytes`.
    pub fn import(file: Handle, size_bytes: u64) -> Option<Self> {
        let is_large = seal(&file, libc::F_SEAL_SHRINK) && file_size(&file) >= size_bytes;
        is_large.then_some(Self { file: Some(file) })
    }

    /// The handle by which others can map it; `None` for a private section.
    pub fn handle(&self) -> Option<&Handle> {
        self.file.as_ref()
    }

    /// A new handle by which others can map it; `None` where the process can have no more, and for
    /// a private section.
    pub fn export(&self) -> Option<Handle> {
        self.handle().and_then(Handle::try_clone)
    }

    /// Maps the section from its beginning, in place of the pages at `address`; false if the system
    /// refuses.
    ///
    /// # Safety
    /// The range is a part of a reservation of the caller's, no reference to it is alive, and the
    /// section is as large.
    #[must_use]
    pub unsafe fn map(&self, address: u64, size_bytes: u64) -> bool {
        let Some(file) = &self.file else {
            return map_anonymous(address, size_bytes, libc::MAP_SHARED | libc::MAP_FIXED)
                .is_some();
        };
        // SAFETY: the caller's promise.
        let mapped = unsafe {
            libc::mmap(
                address as *mut _,
                size_bytes as usize,
                libc::PROT_READ | libc::PROT_WRITE,
                libc::MAP_SHARED | libc::MAP_FIXED,
                file.raw(),
                0,
            )
        };
        mapped != libc::MAP_FAILED
    }

    /// Maps a part of the section at a further address, in place of the pages there; false if the
    /// system refuses. `view` is the address that [`Self::map`] was given, and `offset` is the
    /// part's place in the section.
    ///
    /// # Safety
    /// The section is mapped at `view` and has the part; the range at `address` is a part of a
    /// reservation of the caller's, and no reference to it is alive.
    #[must_use]
    pub unsafe fn alias(&self, view: u64, offset: u64, size_bytes: u64, address: u64) -> bool {
        // A length of zero makes a second mapping of shared pages (mremap(2)).
        // SAFETY: the caller's promise.
        let mapped = unsafe {
            libc::mremap(
                (view + offset) as *mut _,
                0,
                size_bytes as usize,
                libc::MREMAP_MAYMOVE | libc::MREMAP_FIXED,
                address as *mut libc::c_void,
            )
        };
        mapped != libc::MAP_FAILED
    }
}

/// A file of zeros without a path. Its descriptors allow to read, write and map it, but not to
/// change its size.
pub(super) fn sealed_file(name: &CStr, size_bytes: u64) -> Result<Handle, Refused> {
    let flags = libc::MFD_CLOEXEC | libc::MFD_ALLOW_SEALING;
    // SAFETY: a plain system call; the descriptor is owned from its creation on.
    let file = unsafe { Handle::created(libc::memfd_create(name.as_ptr(), flags)) };
    let file = file.ok_or(Refused::Handles)?;
    let size = libc::off_t::try_from(size_bytes).map_err(|_| Refused::Memory)?;
    // SAFETY: a plain system call.
    let has_size = unsafe { libc::ftruncate(file.raw(), size) } == 0;
    let is_sealed = has_size && seal(&file, libc::F_SEAL_SHRINK | libc::F_SEAL_GROW);
    is_sealed.then_some(file).ok_or(Refused::Memory)
}

/// Seals a file, unless it is sealed so; false for what cannot be.
fn seal(file: &Handle, seals: i32) -> bool {
    // SAFETY: plain system calls.
    unsafe {
        let there = libc::fcntl(file.raw(), libc::F_GET_SEALS);
        there >= 0
            && (there & seals == seals || libc::fcntl(file.raw(), libc::F_ADD_SEALS, seals) == 0)
    }
}

/// The size of a file; 0 if it has none.
fn file_size(file: &Handle) -> u64 {
    // SAFETY: `stat` is plain data that the call fills.
    unsafe {
        let mut stat: libc::stat = std::mem::zeroed();
        match libc::fstat(file.raw(), &mut stat) {
            0 => stat.st_size as u64,
            _ => 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_of_exported_sections_stay() {
        let section = Section::exportable(4096, &Sharing::default()).unwrap();
        let file = section.handle().unwrap();
        // SAFETY: a plain system call.
        assert_eq!(unsafe { libc::ftruncate(file.raw(), 0) }, -1);
        assert!(Section::import(file.try_clone().unwrap(), 4096).is_some());
        assert!(Section::import(file.try_clone().unwrap(), 4097).is_none());
        // An event has no size and cannot be sealed.
        let event = super::super::event::Event::new(false).unwrap();
        assert!(Section::import(event.handle().try_clone().unwrap(), 0).is_none());
    }
}
