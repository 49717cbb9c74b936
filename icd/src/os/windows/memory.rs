//! The machine's memory, and the process's heap.

use windows_sys::Win32::System::SystemInformation::{GlobalMemoryStatusEx, MEMORYSTATUSEX};

/// Bytes of the machine's memory; `None` if the system does not say.
pub fn total_bytes() -> Option<u64> {
    Some(status()?.ullTotalPhys)
}

/// Bytes of the machine's memory that nothing uses, and that the process can still be promised;
/// `None` if the system does not say.
pub fn free_bytes() -> Option<u64> {
    let status = status()?;
    Some(status.ullAvailPhys.min(status.ullAvailPageFile))
}

fn status() -> Option<MEMORYSTATUSEX> {
    let mut status = MEMORYSTATUSEX {
        dwLength: size_of::<MEMORYSTATUSEX>() as u32,
        ..Default::default()
    };
    // SAFETY: the structure says how large it is.
    (unsafe { GlobalMemoryStatusEx(&mut status) } != 0).then_some(status)
}

/// Gives freed memory back to the system. The system's heap does so by itself.
pub fn trim_heap() {}
