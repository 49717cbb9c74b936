//! Clocks (clock_gettime(2)).

/// Whether the clocks are those of POSIX.
pub const IS_POSIX: bool = true;

/// A monotonic clock that all processes of the machine share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// The clock of timestamps and of presentation. The system may correct its rate.
    Monotonic,
    /// The hardware's clock, which the system does not correct.
    MonotonicRaw,
}

impl Clock {
    /// The time in nanoseconds. Usually needs no system call.
    pub fn now_ns(self) -> u64 {
        let mut time = libc::timespec {
            tv_sec: 0,
            tv_nsec: 0,
        };
        // SAFETY: the pointer is valid, and every system has the clock.
        unsafe { libc::clock_gettime(self.number(), &mut time) };
        time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
    }

    /// The number of the clock in protocols of this system (`clockid_t`).
    pub fn number(self) -> i32 {
        match self {
            Clock::Monotonic => libc::CLOCK_MONOTONIC,
            Clock::MonotonicRaw => libc::CLOCK_MONOTONIC_RAW,
        }
    }
}
