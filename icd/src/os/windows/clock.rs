//! Clocks (QueryPerformanceCounter).

use std::sync::OnceLock;

use windows_sys::Win32::System::Performance::{QueryPerformanceCounter, QueryPerformanceFrequency};

/// Whether the clocks are those of POSIX.
pub const IS_POSIX: bool = false;

/// A monotonic clock that all processes of the machine share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// The clock of timestamps and of presentation.
    Monotonic,
}

impl Clock {
    /// The time, in nanoseconds.
    pub fn now_ns(self) -> u64 {
        static FREQUENCY: OnceLock<u64> = OnceLock::new();
        let frequency = FREQUENCY.get_or_init(|| {
            let mut frequency = 0;
            // SAFETY: a valid pointer.
            unsafe { QueryPerformanceFrequency(&mut frequency) };
            frequency.max(1) as u64
        });
        (u128::from(ticks()) * 1_000_000_000 / u128::from(*frequency)) as u64
    }
}

/// The time as the system's counter gives it (`VK_TIME_DOMAIN_QUERY_PERFORMANCE_COUNTER_KHR`).
pub fn ticks() -> u64 {
    let mut ticks = 0;
    // SAFETY: a valid pointer.
    unsafe { QueryPerformanceCounter(&mut ticks) };
    ticks as u64
}
