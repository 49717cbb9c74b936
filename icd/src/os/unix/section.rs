//! Sections: memory that is mapped at several addresses, of this process or of others.

use std::ffi::CStr;

use super::address_space::map_anonymous;
use super::handle::{Handle, Sharing};

/// The reason of a refusal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// The process cannot have more handles.
    Handles,
    Memory,
    /// Another object has the name. Objects of this system have no names.
    #[allow(dead_code)]
    Name,
}

/// Shared memory, zero at first. It lives as long as it is mapped or has a handle.
#[derive(Debug)]
pub struct Section {
    /// `None` for a private section, which only its mappings keep.
    file: Option<Handle>,
}

impl Section {
    /// A section of this process, which cannot be exported. [`Self::map`] maps it once and gives it
    /// its size.
    pub fn private() -> Self {
        Self { file: None }
    }

    /// A section with a handle and a fixed size.
    ///
    /// # Errors
    /// The system refuses.
    pub fn exportable(size_bytes: u64, _sharing: &Sharing) -> Result<Self, Refused> {
        let file = sealed_file(c"tuff", size_bytes)?;
        Ok(Self { file: Some(file) })
    }

    /// Imports a section of another device or process. Its size is sealed against shrinking, since
    /// an access past its end would fault. `None` if it cannot be sealed or is smaller than
    /// `size_bytes`.
    pub fn import(file: Handle, size_bytes: u64) -> Option<Self> {
        let is_large = seal(&file, libc::F_SEAL_SHRINK) && file_size(&file) >= size_bytes;
        is_large.then_some(Self { file: Some(file) })
    }

    /// The handle for other users; `None` for a private section.
    pub fn handle(&self) -> Option<&Handle> {
        self.file.as_ref()
    }

    /// A new handle for other users; `None` if the process cannot have more, and for a private
    /// section.
    pub fn export(&self) -> Option<Handle> {
        self.handle().and_then(Handle::try_clone)
    }

    /// Maps the section from its beginning, in place of the pages at `address`; false if the system
    /// refuses.
    ///
    /// # Safety
    /// The caller owns a reservation with the range, no reference to the range is alive, and the
    /// section is as large.
    #[must_use]
    pub unsafe fn map(&self, address: u64, size_bytes: u64) -> bool {
        let Some(file) = &self.file else {
            return map_anonymous(address, size_bytes, libc::MAP_SHARED | libc::MAP_FIXED)
                .is_some();
        };
        // SAFETY: the caller guarantees that the range is a part of a reservation of the caller's,
        // no reference to it is alive, and the section is as large.
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

    /// Maps a part of the section at another address, in place of the pages there; false if the
    /// system refuses. `view` is the address of [`Self::map`], and `offset` the part's offset in
    /// the section.
    ///
    /// # Safety
    /// The section is mapped at `view` and has the part. The caller owns a reservation with the
    /// range at `address`, and no reference to the range is alive.
    #[must_use]
    pub unsafe fn alias(&self, view: u64, offset: u64, size_bytes: u64, address: u64) -> bool {
        // A length of zero creates a second mapping of shared pages (mremap(2)). SAFETY: the caller
        // guarantees that the section is mapped at `view` and has the part; the range at `address`
        // is a part of a reservation of the caller's, and no reference to it is alive.
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

/// A file of zeros without a path. Its descriptors allow reads, writes and mappings, but no change
/// of its size.
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

/// Seals a file, unless it is sealed already; false for files that cannot be sealed.
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
