//! Processor time and memory of this process.

#[cfg(unix)]
pub use unix::{peak_bytes, processor_seconds};
#[cfg(windows)]
pub use windows::{peak_bytes, processor_seconds};

#[cfg(unix)]
mod unix {
    /// User and system time so far.
    pub fn processor_seconds() -> f64 {
        let usage = usage();
        let seconds = |time: libc::timeval| time.tv_sec as f64 + time.tv_usec as f64 * 1e-6;
        seconds(usage.ru_utime) + seconds(usage.ru_stime)
    }

    /// Largest resident set so far.
    pub fn peak_bytes() -> u64 {
        usage().ru_maxrss as u64 * 1024
    }

    fn usage() -> libc::rusage {
        // SAFETY: `rusage` is plain data, and the call fills it.
        unsafe {
            let mut usage: libc::rusage = std::mem::zeroed();
            libc::getrusage(libc::RUSAGE_SELF, &mut usage);
            usage
        }
    }
}

#[cfg(windows)]
mod windows {
    use windows_sys::Win32::Foundation::FILETIME;
    use windows_sys::Win32::System::ProcessStatus::{
        K32GetProcessMemoryInfo, PROCESS_MEMORY_COUNTERS,
    };
    use windows_sys::Win32::System::Threading::{GetCurrentProcess, GetProcessTimes};

    /// User and system time so far.
    pub fn processor_seconds() -> f64 {
        let mut times = [FILETIME::default(); 4];
        let [created, ended, kernel, user] = &mut times;
        // SAFETY: valid pointers, and the handle of this process.
        unsafe { GetProcessTimes(GetCurrentProcess(), created, ended, kernel, user) };
        let hundreds_of_ns = |time: &FILETIME| {
            (u64::from(time.dwHighDateTime) << 32 | u64::from(time.dwLowDateTime)) as f64
        };
        (hundreds_of_ns(kernel) + hundreds_of_ns(user)) * 1e-7
    }

    /// Largest working set so far.
    pub fn peak_bytes() -> u64 {
        let mut counters = PROCESS_MEMORY_COUNTERS::default();
        let size_bytes = size_of::<PROCESS_MEMORY_COUNTERS>() as u32;
        // SAFETY: the structure is as large as said.
        unsafe { K32GetProcessMemoryInfo(GetCurrentProcess(), &mut counters, size_bytes) };
        counters.PeakWorkingSetSize as u64
    }
}
