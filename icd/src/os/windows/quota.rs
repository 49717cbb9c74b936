//! The process's limits: job objects.

pub use cgroup::Memory;
use windows_sys::Win32::System::JobObjects::{
    IsProcessInJob, JOB_OBJECT_LIMIT_JOB_MEMORY, JOB_OBJECT_LIMIT_PROCESS_MEMORY,
    JOBOBJECT_EXTENDED_LIMIT_INFORMATION, JOBOBJECTINFOCLASS, JobObjectExtendedLimitInformation,
    QueryInformationJobObject,
};
use windows_sys::Win32::System::ProcessStatus::{K32GetProcessMemoryInfo, PROCESS_MEMORY_COUNTERS};
use windows_sys::Win32::System::Threading::GetCurrentProcess;

/// The limits and the usage of the process.
#[derive(Debug)]
pub struct Quota(());

impl Quota {
    /// Finds the limits.
    pub fn open() -> Self {
        Self(())
    }

    /// The memory limit and the part that this process leaves; `None` without a limit.
    pub fn memory(&self) -> Option<Memory> {
        // SAFETY: the structure of this class.
        let limits: JOBOBJECT_EXTENDED_LIMIT_INFORMATION =
            unsafe { of_job(JobObjectExtendedLimitInformation) }?;
        let flags = limits.BasicLimitInformation.LimitFlags;
        let limit_bytes = [
            (JOB_OBJECT_LIMIT_PROCESS_MEMORY, limits.ProcessMemoryLimit),
            (JOB_OBJECT_LIMIT_JOB_MEMORY, limits.JobMemoryLimit),
        ]
        .into_iter()
        .filter_map(|(flag, bytes)| (flags & flag != 0).then_some(bytes as u64))
        .min()?;
        Some(Memory {
            limit_bytes,
            free_bytes: limit_bytes.saturating_sub(used_bytes()),
        })
    }
}

/// A limit of the process's job; `None` outside of jobs.
///
/// # Safety
/// `T` is the plain structure of the class.
pub(super) unsafe fn of_job<T: Default>(class: JOBOBJECTINFOCLASS) -> Option<T> {
    let null = std::ptr::null_mut();
    let mut limit = T::default();
    // SAFETY: valid pointers; null stands for the job of this process; the caller names the type.
    let found = unsafe {
        let mut is_in_job = 0;
        IsProcessInJob(GetCurrentProcess(), null, &mut is_in_job) != 0
            && is_in_job != 0
            && QueryInformationJobObject(
                null,
                class,
                (&raw mut limit).cast(),
                size_of::<T>() as u32,
                std::ptr::null_mut(),
            ) != 0
    };
    found.then_some(limit)
}

/// The process's committed memory.
fn used_bytes() -> u64 {
    let mut counters = PROCESS_MEMORY_COUNTERS::default();
    let size_bytes = size_of::<PROCESS_MEMORY_COUNTERS>() as u32;
    // SAFETY: the structure is as large as said.
    unsafe { K32GetProcessMemoryInfo(GetCurrentProcess(), &mut counters, size_bytes) };
    counters.PagefileUsage as u64
}
