//! Time in tests. Whether a test passes depends on no speed: the machine may be as slow, and as
//! busy, as it likes.

use std::time::{Duration, Instant};

/// Limit of a test's wait for an event that must come. It guards against waiting for ever, and is
/// far longer than any event takes.
pub const PATIENCE: Duration = Duration::from_secs(300);
/// The same for Vulkan's commands.
pub const PATIENCE_NS: u64 = 300_000_000_000;

/// Waits for a condition; returns false if it does not become true in time.
pub fn comes(mut is_so: impl FnMut() -> bool) -> bool {
    let start = Instant::now();
    loop {
        if is_so() {
            return true;
        }
        if start.elapsed() > PATIENCE {
            return false;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Whether `wanted` of `most` measurements are good; it stops at the last that is wanted. Other
/// work on the machine makes a measurement worse and never better, so a few good ones show what the
/// driver can do, and only a driver that cannot do it has none.
pub fn enough(wanted: usize, most: usize, mut is_good: impl FnMut() -> bool) -> bool {
    let mut good = 0;
    (0..most).any(|_| {
        good += usize::from(is_good());
        good == wanted
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn measurements_end_with_the_last_that_is_wanted() {
        let mut count = 0;
        let mut every_third = || {
            count += 1;
            count % 3 == 0
        };
        assert!(enough(2, 10, &mut every_third));
        assert!(!enough(2, 5, &mut every_third));
        assert_eq!(count, 11);
    }
}
