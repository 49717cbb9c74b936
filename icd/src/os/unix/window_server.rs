//! Memory and sockets that presentation shares with window servers (X11, Wayland). A system without
//! such servers has no module of this name.

use std::ffi::c_void;
use std::os::fd::AsRawFd;

use super::handle::Handle;
use super::section::sealed_file;

/// Memory shared with a server.
pub struct SharedMemory {
    data: *mut u8,
    size_bytes: usize,
    kind: MemoryBacking,
}

enum MemoryBacking {
    /// A file without a name, sealed so that the server is safe from its truncation.
    File(Handle),
    /// `shmget`, for servers that take no descriptors. The system removes it with its last user.
    Segment(i32),
}

// SAFETY: the mapping is this object's own.
unsafe impl Send for SharedMemory {}
// SAFETY: only `bytes` accesses the memory, and it borrows the object exclusively.
unsafe impl Sync for SharedMemory {}

impl SharedMemory {
    /// A file of zeros; `None` if the system refuses.
    pub fn file(size_bytes: usize) -> Option<Self> {
        let file = sealed_file(c"tuff-window", size_bytes as u64).ok()?;
        // SAFETY: the file has this size, and the system chooses the address.
        let data = unsafe {
            libc::mmap(
                std::ptr::null_mut(),
                size_bytes,
                libc::PROT_READ | libc::PROT_WRITE,
                libc::MAP_SHARED,
                file.raw(),
                0,
            )
        };
        (data != libc::MAP_FAILED).then(|| Self {
            data: data.cast(),
            size_bytes,
            kind: MemoryBacking::File(file),
        })
    }

    /// A segment of System V; `None` if the system refuses.
    pub fn segment(size_bytes: usize) -> Option<Self> {
        // SAFETY: plain system calls.
        unsafe {
            let id = libc::shmget(libc::IPC_PRIVATE, size_bytes, libc::IPC_CREAT | 0o600);
            if id < 0 {
                return None;
            }
            let data = libc::shmat(id, std::ptr::null(), 0);
            if data as isize == -1 {
                libc::shmctl(id, libc::IPC_RMID, std::ptr::null_mut());
                return None;
            }
            Some(Self {
                data: data.cast(),
                size_bytes,
                kind: MemoryBacking::Segment(id),
            })
        }
    }

    /// The file, for the server.
    pub fn handle(&self) -> Option<&Handle> {
        match &self.kind {
            MemoryBacking::File(file) => Some(file),
            MemoryBacking::Segment(_) => None,
        }
    }

    /// The segment's id, for the server.
    pub fn segment_id(&self) -> Option<i32> {
        match self.kind {
            MemoryBacking::File(_) => None,
            MemoryBacking::Segment(id) => Some(id),
        }
    }

    /// Removes the id once the server has attached the segment, or has failed to, so that no other
    /// process can attach it.
    pub fn unname(&self) {
        if let MemoryBacking::Segment(id) = self.kind {
            // SAFETY: the call takes no pointer. The segment lives while it is attached.
            unsafe { libc::shmctl(id, libc::IPC_RMID, std::ptr::null_mut()) };
        }
    }

    /// The whole memory.
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
                MemoryBacking::File(_) => libc::munmap(self.data.cast(), self.size_bytes),
                MemoryBacking::Segment(_) => libc::shmdt(self.data.cast()),
            };
        }
    }
}

/// Whether a connection is a local socket.
pub fn is_local(connection: &impl AsRawFd) -> bool {
    // SAFETY: the size is the structure's, and any bytes are valid in it.
    unsafe {
        let mut address: libc::sockaddr_storage = std::mem::zeroed();
        let mut size = size_of::<libc::sockaddr_storage>() as libc::socklen_t;
        let socket = connection.as_raw_fd();
        let asked = libc::getsockname(socket, (&raw mut address).cast(), &mut size);
        asked == 0 && libc::c_int::from(address.ss_family) == libc::AF_UNIX
    }
}

/// Frees an allocation that a library of the server made for its caller with C's `malloc`.
///
/// # Safety
/// C's `malloc` made the allocation, and nothing uses it any more.
pub unsafe fn free(allocation: *mut c_void) {
    // SAFETY: the caller guarantees that C's `malloc` made the allocation, and nothing uses it any
    // more.
    unsafe { libc::free(allocation) };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_and_the_segment_are_memory_of_zeros() {
        for memory in [SharedMemory::file(5000), SharedMemory::segment(5000)] {
            let mut memory = memory.unwrap();
            assert!(memory.bytes().iter().all(|&byte| byte == 0));
            assert_eq!(memory.bytes().len(), 5000);
            assert_ne!(memory.handle().is_some(), memory.segment_id().is_some());
            memory.bytes()[4999] = 7;
        }
    }

    #[test]
    fn sockets_of_this_machine_are_local() {
        let (one, _other) = std::os::unix::net::UnixStream::pair().unwrap();
        assert!(is_local(&one));
        let net = std::net::UdpSocket::bind("127.0.0.1:0");
        assert!(net.is_ok_and(|net| !is_local(&net)));
        assert!(!is_local(&std::fs::File::open("/dev/null").unwrap()));
    }
}
