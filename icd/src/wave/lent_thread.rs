//! A pool whose one thread is the calling one, for work that is written for a pool where the system
//! gives no threads.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

/// Runs `work` on the calling thread as a rayon pool of one thread, which also runs all tasks that
/// `work` spawns. Without a pool around it, rayon would start one for the whole process.
pub(super) fn run_on_this_thread<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    if rayon::current_thread_index().is_some() {
        // The thread is in a pool already.
        return work();
    }
    let mut seat = None;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .spawn_handler(|only| {
            seat = Some(only);
            Ok(())
        })
        .build();
    let (Ok(pool), Some(seat)) = (pool, seat) else {
        unreachable!("a pool without threads of its own can always be made");
    };
    let mut result = None;
    let job: Box<dyn FnOnce() + Send + '_> =
        Box::new(|| result = Some(catch_unwind(AssertUnwindSafe(work))));
    // SAFETY: only the lifetime changes, and the job is gone before this function returns: the
    // pool's only thread is this one, and a pool that is dropped ends its threads after they have
    // done what was spawned (rayon's documentation of `ThreadPool` and of `ThreadBuilder::run`).
    // `run` does not unwind: the job catches its panics.
    let job: Box<dyn FnOnce() + Send> = unsafe { std::mem::transmute(job) };
    pool.spawn(job);
    drop(pool);
    seat.run();
    match result {
        Some(Ok(result)) => result,
        Some(Err(panic)) => resume_unwind(panic),
        None => unreachable!("a pool does what was spawned before it ends"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;
    use std::thread;

    #[test]
    fn shared_work_stays_on_the_thread() {
        let here = thread::current().id();
        let numbers: Vec<u64> = (0..1000).collect();
        // Twice: the thread is no pool afterwards.
        for _ in 0..2 {
            let sum: u64 = run_on_this_thread(|| {
                numbers
                    .par_iter()
                    .inspect(|_| assert_eq!(thread::current().id(), here))
                    // A pool inside of a pool is the outer one.
                    .map(|number| run_on_this_thread(|| 2 * number))
                    .sum()
            });
            assert_eq!(sum, 999_000);
            assert!(rayon::current_thread_index().is_none());
        }
    }

    #[test]
    fn a_panic_reaches_the_caller() {
        let panic = catch_unwind(|| run_on_this_thread(|| panic!("expected by a test")));
        let panic = panic.unwrap_err();
        assert_eq!(panic.downcast_ref(), Some(&"expected by a test"));
        assert_eq!(run_on_this_thread(|| 5), 5);
    }
}
