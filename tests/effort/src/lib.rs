//! How much tests do, and what it takes, whatever else the machine does.

pub mod sparse;

use std::sync::OnceLock;
use std::time::Duration;

#[cfg(windows)]
use windows_sys::Win32::Foundation::FILETIME;

/// The variable by which `cargo xtask test --deep` asks for more: how many times as many rounds.
const DEEP: &str = "TUFF_DEEP";

/// How many rounds a property test makes: `usual` of them, or with `cargo xtask test --deep` a
/// multiple. The usual number takes seconds at most and finds each fault that such a test is known
/// to have found.
pub fn rounds(usual: u32) -> u32 {
    static TIMES: OnceLock<u32> = OnceLock::new();
    let times = TIMES.get_or_init(|| {
        let given = std::env::var(DEEP).ok();
        given.map_or(1, |times| times.parse().expect("TUFF_DEEP is a number"))
    });
    usual.saturating_mul(*times)
}

/// Processor time that this process has taken so far, in all of its threads: a limit on it holds on
/// a busy machine, too.
#[cfg(unix)]
pub fn processor_time() -> Duration {
    clock(libc::CLOCK_PROCESS_CPUTIME_ID)
}

/// Processor time that this thread has taken so far.
#[cfg(unix)]
pub fn thread_time() -> Duration {
    clock(libc::CLOCK_THREAD_CPUTIME_ID)
}

#[cfg(unix)]
fn clock(clock: libc::clockid_t) -> Duration {
    let mut time = libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    // SAFETY: the call fills the structure.
    let code = unsafe { libc::clock_gettime(clock, &raw mut time) };
    assert_eq!(code, 0, "Linux has this clock");
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}

/// As on Linux, in the system's hundreds of nanoseconds.
#[cfg(windows)]
pub fn processor_time() -> Duration {
    use windows_sys::Win32::System::Threading::{GetCurrentProcess, GetProcessTimes};
    // SAFETY: the call fills the structures.
    sum(|[start, end, kernel, user]| unsafe {
        GetProcessTimes(GetCurrentProcess(), start, end, kernel, user)
    })
}

/// As on Linux, in the system's hundreds of nanoseconds.
#[cfg(windows)]
pub fn thread_time() -> Duration {
    use windows_sys::Win32::System::Threading::{GetCurrentThread, GetThreadTimes};
    // SAFETY: the call fills the structures.
    sum(|[start, end, kernel, user]| unsafe {
        GetThreadTimes(GetCurrentThread(), start, end, kernel, user)
    })
}

/// The times in the kernel and outside of it, together, of four that a call fills in.
#[cfg(windows)]
fn sum(fill: impl FnOnce([&mut FILETIME; 4]) -> i32) -> Duration {
    let mut times = [FILETIME::default(); 4];
    assert_ne!(fill(times.each_mut()), 0, "Windows counts these");
    let hundreds =
        |time: &FILETIME| u64::from(time.dwHighDateTime) << 32 | u64::from(time.dwLowDateTime);
    let [_, _, kernel, user] = &times;
    Duration::from_nanos((hundreds(kernel) + hundreds(user)) * 100)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_takes_processor_time_and_sleep_does_not() {
        let before = processor_time();
        let mut number = 1u64;
        while processor_time() - before < Duration::from_millis(20) {
            number = std::hint::black_box(number).wrapping_mul(3);
        }
        assert_eq!(rounds(7) % 7, 0);
        assert_ne!(number, 0);
    }
}
