//! Memory and sockets that presentation shares with window servers (X11, Wayland). A system without
//! such servers has no module of this name.

use std::ffi::c_void;
use std::os::fd::AsRawFd;

use super::handle::Handle;
use super::section::sealed_file;

/// Memory that a server reads, too.
pub struct SharedMemory {
    data: *mut u8,
    size_bytes: usize,
    kind: MemoryBacking,
}

enum MemoryBacking {
    /// A file without a name, which the server need not fear to become shorter.
    File(Handle),
    /// `shmget`: for servers that take no descriptors. The system forgets it with its last user.
    Segment(i32),
}

// SAFETY: the mapping is this object's own.
unsafe impl Send for SharedMemory {}
// SAFETY: only `bytes` reaches it, which takes the object for itself.
unsafe impl Sync for SharedMemory {}

impl SharedMemory {
    /// A file of zeros; `None` if the system refuses.
    pub fn file(size_bytes: usize) -> Option<Self> {
        let file = sealed_file(c"tuff-window", size_bytes as u64).ok()?;
        // SAFETY: a mapping of a file of this size at a place of the system's choice.
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

    /// The file, to be given to the server.
    pub fn handle(&self) -> Option<&Handle> {
        match &self.kind {
            MemoryBacking::File(file) => Some(file),
            MemoryBacking::Segment(_) => None,
        }
    }

    /// The segment's number, to be told to the server.
    pub fn segment_id(&self) -> Option<i32> {
        match self.kind {
            MemoryBacking::File(_) => None,
            MemoryBacking::Segment(id) => Some(id),
        }
    }

    /// Removes the name: the server has attached the segment or never will, and no other process
    /// must find it.
    pub fn unname(&self) {
        if let MemoryBacking::Segment(id) = self.kind {
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
                MemoryBacking::File(_) => libc::munmap(self.data.cast(), self.size_bytes),
                MemoryBacking::Segment(_) => libc::shmdt(self.data.cast()),
            };
        }
    }
}

/// Whether a connection is a socket of this machine.
pub fn is_local(connection: &impl AsRawFd) -> bool {
    // SAFETY: the structure is as large as said, and any bytes are a value of it.
    unsafe {
        let mut address: libc::sockaddr_storage = std::mem::zeroed();
        let mut size = size_of::<libc::sockaddr_storage>() as libc::socklen_t;
        let socket = connection.as_raw_fd();
        let asked = libc::getsockname(socket, (&raw mut address).cast(), &mut size);
        asked == 0 && libc::c_int::from(address.ss_family) == libc::AF_UNIX
    }
}

/// Frees an allocation that a library of the server made for its caller.
///
/// # Safety
/// It is one of C's `malloc`, and nothing uses it any more.
pub unsafe fn free(allocation: *mut c_void) {
    // SAFETY: the caller's promise.
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
