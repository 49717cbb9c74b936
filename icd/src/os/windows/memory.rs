//! The machine's memory, and the process's heap.

use windows_sys::Win32::System::SystemInformation::{GlobalMemoryStatusEx, MEMORYSTATUSEX};

/// The machine's memory in bytes; `None` if it is unknown.
pub fn total_bytes() -> Option<u64> {
    Some(status()?.ullTotalPhys)
}

/// The machine's free memory in bytes that the process can still commit; `None` if it is unknown.
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

/// Does nothing: the system's heap returns freed memory to the system.
pub fn trim_heap() {}
