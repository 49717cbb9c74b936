//! Deferred host operations: work on the application's threads that join.
//!
//! An operation is a rayon pool without threads. A thread that joins becomes a thread of the pool
//! until the work is done. So parallel builds and compilations run on exactly the joined threads.

#![forbid(unsafe_code)]

use ash::vk;
use parking_lot::Mutex;

use crate::VkResult;
use crate::guard::guard;
use crate::handle::Ref;

/// `VkDeferredOperationKHR`.
#[derive(Default)]
pub struct DeferredOperation(Mutex<DeferredState>);

enum DeferredState {
    /// Complete, with the result of the last command; a success before any command.
    Complete(VkResult),
    Pending(Pool),
}

impl Default for DeferredState {
    fn default() -> Self {
        Self::Complete(Ok(()))
    }
}

struct Pool {
    /// Dropping it releases the threads once the work has ended.
    _pool: rayon::ThreadPool,
    /// One entry for each thread that may still join.
    seats: Vec<rayon::ThreadBuilder>,
}

impl DeferredOperation {
    /// Leaves `work` to the threads that will join. It keeps up to `concurrency` threads busy.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY`.
    pub fn defer(
        operation: &Ref<Self>,
        concurrency: usize,
        work: impl FnOnce() -> VkResult + Send + 'static,
    ) -> VkResult {
        let mut seats = Vec::new();
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(concurrency.max(1))
            .spawn_handler(|seat| {
                seats.push(seat);
                Ok(())
            })
            .build()
            .map_err(|_| vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
        let this = Ref::clone(operation);
        pool.spawn(move || {
            let result = guard("deferred operation", work);
            let pool = std::mem::replace(&mut *this.0.lock(), DeferredState::Complete(result));
            drop(pool);
        });
        *operation.0.lock() = DeferredState::Pending(Pool { _pool: pool, seats });
        Ok(())
    }

    /// The number of threads that may still join (`vkGetDeferredOperationMaxConcurrencyKHR`); 0
    /// once complete.
    pub fn max_concurrency(&self) -> u32 {
        match &*self.0.lock() {
            DeferredState::Complete(_) => 0,
            // A pending operation counts at least the threads that have joined.
            DeferredState::Pending(pool) => pool.seats.len().max(1) as u32,
        }
    }

    /// The result of the deferred command.
    ///
    /// # Errors
    /// The command's error, or `VK_NOT_READY`.
    pub fn result(&self) -> VkResult {
        match &*self.0.lock() {
            DeferredState::Complete(result) => *result,
            DeferredState::Pending(_) => Err(vk::Result::NOT_READY),
        }
    }

    /// Works on the operation until it is complete.
    ///
    /// # Errors
    /// `VK_THREAD_DONE_KHR` if there is no work for another thread.
    pub fn join(&self) -> VkResult {
        let seat = match &mut *self.0.lock() {
            DeferredState::Complete(_) => return Ok(()),
            DeferredState::Pending(pool) => pool.seats.pop(),
        };
        seat.ok_or(vk::Result::THREAD_DONE_KHR)?.run();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::handle;
    use rayon::prelude::*;
    use std::collections::HashSet;
    use std::sync::{Arc, Barrier};
    use std::thread::{self, ThreadId};

    #[test]
    fn joining_threads_do_the_work_and_no_others() {
        let operation = handle::new(DeferredOperation::default());
        assert!(operation.join().is_ok() && operation.result().is_ok());
        let workers: Arc<Mutex<HashSet<ThreadId>>> = Arc::default();
        let seen = Arc::clone(&workers);
        // Both parts must run at once.
        let meet = Barrier::new(2);
        let deferred = DeferredOperation::defer(&operation, 2, move || {
            (0..2).into_par_iter().with_max_len(1).for_each(|_| {
                meet.wait();
                seen.lock().insert(thread::current().id());
            });
            Err(vk::Result::ERROR_UNKNOWN)
        });
        assert!(deferred.is_ok());
        assert_eq!(operation.max_concurrency(), 2);
        assert_eq!(operation.result(), Err(vk::Result::NOT_READY));
        let joined: HashSet<_> = thread::scope(|scope| {
            let join = || {
                assert_eq!(operation.join(), Ok(()));
                thread::current().id()
            };
            let threads = [scope.spawn(join), scope.spawn(join)];
            threads
                .into_iter()
                .map(|thread| thread.join().unwrap())
                .collect()
        });
        assert_eq!(*workers.lock(), joined);
        assert_eq!(operation.max_concurrency(), 0);
        assert_eq!(operation.result(), Err(vk::Result::ERROR_UNKNOWN));
        assert_eq!(operation.join(), Ok(()));
    }

    #[test]
    fn a_panic_is_a_result_and_a_thread_too_many_is_not_needed() {
        let operation = handle::new(DeferredOperation::default());
        let (started, starts) = std::sync::mpsc::channel();
        let (go, goes) = std::sync::mpsc::channel::<()>();
        let work = move || {
            started.send(()).unwrap();
            let _ = goes.recv();
            panic!("expected by a test")
        };
        assert!(DeferredOperation::defer(&operation, 1, work).is_ok());
        thread::scope(|scope| {
            let first = scope.spawn(|| operation.join());
            starts.recv().unwrap();
            assert_eq!(operation.join(), Err(vk::Result::THREAD_DONE_KHR));
            drop(go);
            assert_eq!(first.join().unwrap(), Ok(()));
        });
        assert_eq!(operation.result(), Err(vk::Result::ERROR_UNKNOWN));
    }
}
