//! Clocks (clock_gettime(2)).

/// Whether the clocks are those of POSIX.
pub const IS_POSIX: bool = true;

/// A clock that never goes back, and that all processes of the machine share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// The clock of timestamps and of presentation. The system may correct its rate.
    Monotonic,
    /// The hardware's clock, without corrections.
    MonotonicRaw,
}

impl Clock {
    /// The time, in nanoseconds. Needs no system call where the processor's counter will do.
    pub fn now_ns(self) -> u64 {
        let mut time = libc::timespec {
            tv_sec: 0,
            tv_nsec: 0,
        };
        // SAFETY: a valid pointer, and a clock that every system has.
        unsafe { libc::clock_gettime(self.number(), &mut time) };
        time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
    }

    /// The number by which protocols of this system name the clock (`clockid_t`).
    pub fn number(self) -> i32 {
        match self {
            Clock::Monotonic => libc::CLOCK_MONOTONIC,
            Clock::MonotonicRaw => libc::CLOCK_MONOTONIC_RAW,
        }
    }
}
