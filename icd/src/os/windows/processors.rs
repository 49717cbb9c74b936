//! Processor count and thread affinity.

use windows_sys::Win32::System::JobObjects::{
    JOB_OBJECT_CPU_RATE_CONTROL_ENABLE, JOB_OBJECT_CPU_RATE_CONTROL_HARD_CAP,
    JOBOBJECT_CPU_RATE_CONTROL_INFORMATION, JobObjectCpuRateControlInformation,
};
use windows_sys::Win32::System::SystemInformation::GROUP_AFFINITY;
use windows_sys::Win32::System::Threading::{
    GetActiveProcessorGroupCount, GetCurrentProcess, GetCurrentThread, GetProcessAffinityMask,
    GetThreadGroupAffinity, SetThreadGroupAffinity,
};

use super::quota::of_job;

/// The number of processors that the process can use: those of its affinity mask, limited by its
/// quota of processor time. At least one.
pub fn count() -> usize {
    let all = std::thread::available_parallelism().map_or(1, usize::from);
    let count = process_mask().map_or(all, |mask| mask.count_ones() as usize);
    match rate() {
        Some(rate) => (all * rate as usize)
            .div_ceil(HUNDRED_PERCENT)
            .min(count)
            .max(1),
        None => count.max(1),
    }
}

/// Rates are hundredths of a percent of all processors.
const HUNDRED_PERCENT: usize = 10_000;

/// The share of processor time that the process's job may use.
fn rate() -> Option<u32> {
    const CAPPED: u32 = JOB_OBJECT_CPU_RATE_CONTROL_ENABLE | JOB_OBJECT_CPU_RATE_CONTROL_HARD_CAP;
    // SAFETY: the structure of this class.
    let limit: JOBOBJECT_CPU_RATE_CONTROL_INFORMATION =
        unsafe { of_job(JobObjectCpuRateControlInformation) }?;
    // SAFETY: a hard cap is given by a rate.
    (limit.ControlFlags & CAPPED == CAPPED).then(|| unsafe { limit.Anonymous.CpuRate })
}

/// The processors that the process may use; `None` if they are of several groups.
fn process_mask() -> Option<usize> {
    let (mut process, mut system) = (0, 0);
    // SAFETY: valid pointers.
    let found = unsafe { GetProcessAffinityMask(GetCurrentProcess(), &mut process, &mut system) };
    (found != 0 && process != 0).then_some(process)
}

/// The processors that a thread may run on. Nothing on machines with several groups of processors:
/// the system moves threads between them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Affinity(Option<(u16, usize)>);

impl Affinity {
    /// The affinity of the calling thread.
    pub fn of_this_thread() -> Self {
        // SAFETY: a plain system call.
        if unsafe { GetActiveProcessorGroupCount() } > 1 {
            return Self(None);
        }
        let mut affinity = GROUP_AFFINITY::default();
        // SAFETY: a valid pointer.
        let found = unsafe { GetThreadGroupAffinity(GetCurrentThread(), &mut affinity) };
        Self((found != 0).then_some((affinity.Group, affinity.Mask)))
    }

    /// Applies the affinity to the calling thread, if it differs. If the system refuses, the thread
    /// keeps its affinity.
    pub fn apply(&self) {
        let Some((group, mask)) = self.0 else { return };
        if *self != Self::of_this_thread() {
            let affinity = GROUP_AFFINITY {
                Mask: mask,
                Group: group,
                ..Default::default()
            };
            // SAFETY: valid pointers, one of them null.
            unsafe {
                SetThreadGroupAffinity(GetCurrentThread(), &affinity, std::ptr::null_mut());
            }
        }
    }

    /// The affinity with only its first processor.
    #[cfg(test)]
    pub fn first(&self) -> Self {
        Self(
            self.0
                .map(|(group, mask)| (group, mask & mask.wrapping_neg())),
        )
    }
}
