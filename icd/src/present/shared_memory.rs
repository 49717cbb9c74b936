//! Memory that a window's server reads too: a file's, or a segment of System V.

use std::os::fd::{AsRawFd, BorrowedFd, FromRawFd, OwnedFd};

use ash::vk;

use crate::VkResult;
use crate::object::memory::seal;

/// A mapping of a file without a name.
pub struct SharedMemory {
    data: *mut u8,
    size_bytes: usize,
    kind: Kind,
}

enum Kind {
    File(OwnedFd),
    /// `shmget`: for servers that take no descriptors. The system forgets it with its last user.
    Segment(i32),
}

// SAFETY: the mapping is this object's own.
unsafe impl Send for SharedMemory {}
// SAFETY: only `bytes` reaches it, which takes the object for itself.
unsafe impl Sync for SharedMemory {}

impl SharedMemory {
    /// A file of zeros.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY`.
    pub fn file(size_bytes: usize) -> VkResult<Self> {
        const REFUSED: vk::Result = vk::Result::ERROR_OUT_OF_HOST_MEMORY;
        // SAFETY: plain system calls; the descriptor is owned from its creation on.
        let file = unsafe {
            let name = c"tuff-window".as_ptr();
            let file = libc::memfd_create(name, libc::MFD_CLOEXEC | libc::MFD_ALLOW_SEALING);
            if file < 0 {
                return Err(REFUSED);
            }
            let file = OwnedFd::from_raw_fd(file);
            let size = libc::off_t::try_from(size_bytes).map_err(|_| REFUSED)?;
            if libc::ftruncate(file.as_raw_fd(), size) != 0 {
                return Err(REFUSED);
            }
            file
        };
        // The server need not fear that it is made shorter.
        seal(&file, libc::F_SEAL_SHRINK | libc::F_SEAL_GROW);
        // SAFETY: a mapping of a file of this size at a place of the system's choice.
        let data = unsafe {
            libc::mmap(
                std::ptr::null_mut(),
                size_bytes,
                libc::PROT_READ | libc::PROT_WRITE,
                libc::MAP_SHARED,
                file.as_raw_fd(),
                0,
            )
        };
        if data == libc::MAP_FAILED {
            return Err(REFUSED);
        }
        Ok(Self {
            data: data.cast(),
            size_bytes,
            kind: Kind::File(file),
        })
    }

    /// A segment of System V.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY`.
    pub fn segment(size_bytes: usize) -> VkResult<Self> {
        // SAFETY: plain system calls.
        unsafe {
            let id = libc::shmget(libc::IPC_PRIVATE, size_bytes, libc::IPC_CREAT | 0o600);
            if id < 0 {
                return Err(vk::Result::ERROR_OUT_OF_HOST_MEMORY);
            }
            let data = libc::shmat(id, std::ptr::null(), 0);
            if data as isize == -1 {
                libc::shmctl(id, libc::IPC_RMID, std::ptr::null_mut());
                return Err(vk::Result::ERROR_OUT_OF_HOST_MEMORY);
            }
            Ok(Self {
                data: data.cast(),
                size_bytes,
                kind: Kind::Segment(id),
            })
        }
    }

    /// The file, to be given to the server.
    pub fn descriptor(&self) -> Option<BorrowedFd<'_>> {
        match &self.kind {
            Kind::File(file) => Some(std::os::fd::AsFd::as_fd(file)),
            Kind::Segment(_) => None,
        }
    }

    /// The segment's number, to be told to the server.
    pub fn segment_id(&self) -> Option<i32> {
        match self.kind {
            Kind::File(_) => None,
            Kind::Segment(id) => Some(id),
        }
    }

    /// Removes the name: the server has attached the segment or never will, and no other process
    /// must find it.
    pub fn unname(&self) {
        if let Kind::Segment(id) = self.kind {
            // SAFETY: a plain system call. The segment lives on while it is attached.
            unsafe { libc::shmctl(id, libc::IPC_RMID, std::ptr::null_mut()) };
        }
    }

    /// All of it.
    pub fn bytes(&mut self) -> &mut [u8] {
        // SAFETY: the mapping lives as long as the object. The server only reads it.
        unsafe { std::slice::from_raw_parts_mut(self.data, self.size_bytes) }
    }
}

impl Drop for SharedMemory {
    fn drop(&mut self) {
        self.unname();
        // SAFETY: the object's own mapping.
        unsafe {
            match self.kind {
                Kind::File(_) => libc::munmap(self.data.cast(), self.size_bytes),
                Kind::Segment(_) => libc::shmdt(self.data.cast()),
            };
        }
    }
}
