//! Memory of gigabytes, of which only the pages that are touched take room.

/// Zeroed memory.
pub struct Sparse {
    start: *mut u8,
    size_bytes: usize,
}

impl Sparse {
    /// Reserves addresses.
    pub fn new(size_bytes: u64) -> Self {
        let found = Self::if_promised(size_bytes);
        found.unwrap_or_else(|| panic!("{size_bytes} bytes of addresses"))
    }

    /// Reserves addresses; none where the system must promise memory for all of them, and has not
    /// as much: only Windows does.
    pub fn if_promised(size_bytes: u64) -> Option<Self> {
        let size_bytes = usize::try_from(size_bytes).expect("addresses have 64 bits");
        let start = map(size_bytes);
        assert!(cfg!(windows) || !start.is_null(), "{size_bytes} bytes");
        (!start.is_null()).then_some(Self { start, size_bytes })
    }

    pub fn as_mut_ptr(&self) -> *mut u8 {
        self.start
    }

    pub fn size_bytes(&self) -> u64 {
        self.size_bytes as u64
    }

    fn place(&self, at: u64, size_bytes: usize) -> *mut u8 {
        let end = at.checked_add(size_bytes as u64);
        assert!(end.is_some_and(|end| end <= self.size_bytes()), "at {at}");
        self.start.wrapping_add(at as usize)
    }

    /// The bytes from `at` on.
    pub fn read<const N: usize>(&self, at: u64) -> [u8; N] {
        // SAFETY: the place has as many bytes, and programs run on this thread.
        unsafe { self.place(at, N).cast::<[u8; N]>().read() }
    }

    pub fn word(&self, at: u64) -> u32 {
        u32::from_ne_bytes(self.read(at))
    }

    /// Writes bytes from `at` on.
    pub fn write(&self, at: u64, bytes: &[u8]) {
        let place = self.place(at, bytes.len());
        // SAFETY: as for `read`.
        unsafe { place.copy_from_nonoverlapping(bytes.as_ptr(), bytes.len()) };
    }
}

impl Drop for Sparse {
    fn drop(&mut self) {
        // SAFETY: the mapping of `new`, which nothing uses any more.
        unsafe { unmap(self.start, self.size_bytes) };
    }
}

/// New zeroed pages; null if the system refuses.
#[cfg(unix)]
fn map(size_bytes: usize) -> *mut u8 {
    // SAFETY: a new mapping, of which nothing else knows.
    let start = unsafe {
        libc::mmap(
            std::ptr::null_mut(),
            size_bytes,
            libc::PROT_READ | libc::PROT_WRITE,
            libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_NORESERVE,
            -1,
            0,
        )
    };
    match start {
        libc::MAP_FAILED => std::ptr::null_mut(),
        start => start.cast(),
    }
}

/// As on Linux, but the system promises memory for all of them.
#[cfg(windows)]
fn map(size_bytes: usize) -> *mut u8 {
    use windows_sys::Win32::System::Memory::{
        MEM_COMMIT, MEM_RESERVE, PAGE_READWRITE, VirtualAlloc,
    };
    let how = MEM_RESERVE | MEM_COMMIT;
    // SAFETY: new pages, of which nothing else knows.
    unsafe { VirtualAlloc(std::ptr::null(), size_bytes, how, PAGE_READWRITE).cast() }
}

/// Gives pages back.
///
/// # Safety
/// [`map`] gave them, and nothing uses them any more.
#[cfg(unix)]
unsafe fn unmap(start: *mut u8, size_bytes: usize) {
    // SAFETY: the caller guarantees that the pages come from `map`, and are unused.
    unsafe { libc::munmap(start.cast(), size_bytes) };
}

/// As on Linux.
///
/// # Safety
/// As there.
#[cfg(windows)]
unsafe fn unmap(start: *mut u8, _size_bytes: usize) {
    use windows_sys::Win32::System::Memory::{MEM_RELEASE, VirtualFree};
    // SAFETY: the caller guarantees that the pages come from `map`, and are unused.
    unsafe { VirtualFree(start.cast(), 0, MEM_RELEASE) };
}
