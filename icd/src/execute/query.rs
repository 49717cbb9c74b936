//! Queries: timestamps, and copies of results.

use ash::vk;

use crate::object::QueryPool;
use crate::object::sync::Waiting;

/// Nanoseconds of the monotonic clock: what `vkCmdWriteTimestamp*` writes (`timestampPeriod` is 1).
pub fn timestamp() -> u64 {
    clock_ns(libc::CLOCK_MONOTONIC)
}

/// Nanoseconds of a system clock.
pub fn clock_ns(clock: libc::clockid_t) -> u64 {
    let mut time = libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    // SAFETY: a valid pointer; the clocks asked for exist on every Linux.
    unsafe { libc::clock_gettime(clock, &mut time) };
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
}

/// Writes results by the rules of "Copying Query Results" and says whether all were available.
///
/// # Safety
/// `out` has room for `count` results, `stride_bytes` apart.
pub unsafe fn write_results(
    pool: &QueryPool,
    waiting: &Waiting,
    first: u32,
    count: u32,
    out: *mut u8,
    stride_bytes: u64,
    flags: vk::QueryResultFlags,
) -> bool {
    let wide = flags.contains(vk::QueryResultFlags::TYPE_64);
    let mut complete = true;
    for index in 0..count {
        let query = first + index;
        if flags.contains(vk::QueryResultFlags::WAIT) {
            // A lost device ends the wait; the result is then missing, and the caller reports the loss.
            let _ = waiting.wait_until(u64::MAX, || pool.value(query).is_some());
        }
        let value = pool.value(query);
        complete &= value.is_some();
        let place = out.wrapping_add((u64::from(index) * stride_bytes) as usize);
        let store = |word: usize, value: u64| {
            // SAFETY: the caller's promise.
            unsafe {
                if wide {
                    place.add(word * 8).cast::<u64>().write_unaligned(value);
                } else {
                    place
                        .add(word * 4)
                        .cast::<u32>()
                        .write_unaligned(value as u32);
                }
            }
        };
        match value {
            Some(value) => store(0, value),
            None if flags.contains(vk::QueryResultFlags::PARTIAL) => store(0, 0),
            None => {}
        }
        if flags.contains(vk::QueryResultFlags::WITH_AVAILABILITY) {
            store(1, u64::from(value.is_some()));
        }
    }
    complete
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unavailable_results_leave_memory_alone() {
        let pool = QueryPool::new(vk::QueryType::TIMESTAMP, 2);
        let waiting = Waiting::default();
        pool.write(1, 0x1_0000_0005);
        let mut out = [9u32; 4];
        let flags = vk::QueryResultFlags::WITH_AVAILABILITY;
        // SAFETY: room for two results of two words.
        let complete =
            unsafe { write_results(&pool, &waiting, 0, 2, out.as_mut_ptr().cast(), 8, flags) };
        assert!(!complete);
        assert_eq!(out, [9, 0, 5, 1]);
    }
}
