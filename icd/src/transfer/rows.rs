//! Distributes the rows of large transfers over the device's workers.

use std::ops::Range;

use rayon::iter::{IntoParallelIterator, ParallelIterator};

use crate::wave::Workers;

/// Transfers of fewer bytes run on the queue's thread.
const LEAST_BYTES: u64 = 1 << 17;
/// Chunks per worker, for an even load.
const PIECES_PER_WORKER: u64 = 4;

/// Calls `work` for ranges that cover the rows `0..count`, in any order and on any thread, and
/// returns when all are done. Each row has `row_bytes` bytes.
pub fn for_rows(workers: &Workers, count: u64, row_bytes: u64, work: impl Fn(Range<u64>) + Sync) {
    let threads = workers.current_num_threads() as u64;
    if threads < 2 || count < 2 || count.saturating_mul(row_bytes) < LEAST_BYTES {
        return work(0..count);
    }
    let pieces = (threads * PIECES_PER_WORKER).min(count);
    workers.install(|| {
        (0..pieces).into_par_iter().for_each(|piece| {
            let bound = |piece: u64| count / pieces * piece + (count % pieces).min(piece);
            work(bound(piece)..bound(piece + 1));
        });
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};

    #[test]
    fn every_row_is_done_once() {
        let workers = Workers::new(3);
        for (count, row_bytes) in [
            (0, 1 << 20),
            (1, 1 << 20),
            (5, 1 << 20),
            (1001, 1000),
            (7, 1),
        ] {
            let done: Vec<AtomicU32> = (0..count).map(|_| AtomicU32::new(0)).collect();
            for_rows(&workers, count, row_bytes, |rows| {
                for row in rows {
                    done[row as usize].fetch_add(1, Ordering::Relaxed);
                }
            });
            assert!(done.iter().all(|it| it.load(Ordering::Relaxed) == 1));
        }
    }
}
