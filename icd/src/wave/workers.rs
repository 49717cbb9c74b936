//! The threads that commands fan out over: a rayon pool of the device's own. Its threads start with
//! the first work that is shared out, and are joined when the device goes.

#![forbid(unsafe_code)]

use std::io;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;

use rayon::prelude::*;
use rayon::{ThreadBuilder, ThreadPool, ThreadPoolBuilder};

use super::lent_thread::run_on_this_thread;
use crate::float_environment::DefaultEnvironment;
use crate::os::processors::Affinity;

/// A device's workers. Dropping them waits for their threads to end, so no code of this library
/// runs after the device is gone.
pub struct Workers {
    count: usize,
    /// Of the thread that made the device. Threads inherit that of the thread that starts them,
    /// which may be tied to one processor.
    affinity: Affinity,
    /// Filled by the first work. `None` inside if the system gave no thread.
    pool: OnceLock<Option<Pool>>,
    process: u32,
}

impl Workers {
    /// Workers that need `count` threads. None is started yet.
    pub fn new(count: usize) -> Arc<Self> {
        Arc::new(Self {
            count: count.max(1),
            affinity: Affinity::of_this_thread(),
            pool: OnceLock::new(),
            process: std::process::id(),
        })
    }

    /// Threads that work is cut up for. If the system gives fewer, those do all of it.
    pub fn current_num_threads(&self) -> usize {
        self.count
    }

    /// Performs work inside the pool, and starts its threads if this is the first. If the system
    /// gives no thread, the calling thread does all of the work.
    pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        // A fork takes no threads along. Its copy of the cell may be locked for ever, so it is not
        // looked at.
        let pool = match self.is_inherited() {
            true => None,
            false => (self.pool)
                .get_or_init(|| Pool::start(self.count, self.affinity))
                .as_ref(),
        };
        match pool {
            Some(pool) => pool.rayon.install(work),
            None => run_on_this_thread(work),
        }
    }

    /// Has each of so many workers do `work`, which takes its parts from what they share. A single
    /// one is the calling thread.
    ///
    /// # Errors
    /// One of a worker.
    pub fn share<E: Send>(
        &self,
        workers: usize,
        work: impl Fn() -> Result<(), E> + Sync + Send,
    ) -> Result<(), E> {
        match workers {
            0 | 1 => work(),
            _ => self.install(|| {
                (0..workers)
                    .into_par_iter()
                    .with_max_len(1)
                    .try_for_each(|_| work())
            }),
        }
    }

    /// Does `work` for each of some parts, which workers take in order. Returns the results in that
    /// order, too.
    ///
    /// # Errors
    /// One of a part; then workers take no more parts.
    pub fn in_order<P: Sync, R: Send + Sync, E: Send>(
        &self,
        parts: &[P],
        work: impl Fn(&P) -> Result<R, E> + Sync + Send,
    ) -> Result<Vec<R>, E> {
        let next = AtomicUsize::new(0);
        let results: Vec<OnceLock<R>> = parts.iter().map(|_| OnceLock::new()).collect();
        self.share(parts.len().min(self.count), || {
            loop {
                let index = next.fetch_add(1, Ordering::Relaxed);
                let Some(part) = parts.get(index) else {
                    return Ok(());
                };
                let result =
                    work(part).inspect_err(|_| next.store(parts.len(), Ordering::Relaxed))?;
                // A part is taken once.
                let _ = results[index].set(result);
            }
        })?;
        Ok(results
            .into_iter()
            .filter_map(OnceLock::into_inner)
            .collect())
    }

    /// Whether this is a child of the process that made the workers.
    fn is_inherited(&self) -> bool {
        std::process::id() != self.process
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        let is_inherited = self.is_inherited();
        let Some(pool) = self.pool.take().flatten() else {
            return;
        };
        if is_inherited {
            // There are no such threads here to wait for.
            return std::mem::forget(pool);
        }
        drop(pool.rayon);
        for thread in pool.threads {
            // Rayon's workers catch what their jobs panic with.
            let _ = thread.join();
        }
    }
}

/// The threads, once they run.
struct Pool {
    rayon: ThreadPool,
    threads: Vec<JoinHandle<()>>,
}

impl Pool {
    /// Starts `count` threads, or as many as the system gives; `None` if it gives none.
    fn start(count: usize, affinity: Affinity) -> Option<Self> {
        Self::start_by(count, |worker| {
            std::thread::Builder::new()
                .name(format!("tuff-worker-{}", worker.index()))
                .spawn(move || {
                    affinity.apply();
                    let _environment = DefaultEnvironment::enter();
                    worker.run();
                })
        })
    }

    /// As [`Self::start`], each thread by `spawn`. The first failure is the last attempt.
    fn start_by(
        count: usize,
        mut spawn: impl FnMut(ThreadBuilder) -> io::Result<JoinHandle<()>>,
    ) -> Option<Self> {
        let mut threads = Vec::new();
        let mut refusal = None;
        let pool = ThreadPoolBuilder::new()
            .num_threads(count)
            .spawn_handler(|worker| {
                // Rayon's threads take work from wherever it is: those that run do the work of the
                // others, too.
                if refusal.is_none() {
                    match spawn(worker) {
                        Ok(thread) => threads.push(thread),
                        Err(why) => refusal = Some(why),
                    }
                }
                Ok(())
            })
            .build();
        if let Some(why) = refusal {
            log::warn!("{} of {count} workers start: {why}", threads.len());
        }
        let rayon = pool.ok()?;
        (!threads.is_empty()).then_some(Self { rayon, threads })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_are_gone_after_drop() {
        static ALIVE: AtomicUsize = AtomicUsize::new(0);
        struct Count;
        impl Drop for Count {
            fn drop(&mut self) {
                ALIVE.fetch_sub(1, Ordering::SeqCst);
            }
        }
        thread_local!(static COUNT: Count = { ALIVE.fetch_add(1, Ordering::SeqCst); Count });
        let workers = Workers::new(3);
        workers.install(|| rayon::broadcast(|_| COUNT.with(|_| ())));
        assert_eq!(ALIVE.load(Ordering::SeqCst), 3);
        drop(workers);
        assert_eq!(ALIVE.load(Ordering::SeqCst), 0);
    }

    #[test]
    fn the_threads_that_start_do_all_of_the_work() {
        let mut count = 0;
        let pool = Pool::start_by(4, |worker| {
            count += 1;
            match count {
                1..3 => Ok(std::thread::spawn(|| worker.run())),
                _ => Err(io::ErrorKind::WouldBlock.into()),
            }
        });
        assert_eq!(count, 3);
        let Pool { rayon, threads } = pool.expect("two threads");
        let numbers = || (0..10_000u32).into_par_iter().with_max_len(1);
        let sum: u32 = rayon.install(|| numbers().sum());
        assert_eq!(sum, 49_995_000);
        drop(rayon);
        assert_eq!(threads.len(), 2);
        threads
            .into_iter()
            .for_each(|thread| thread.join().unwrap());
    }

    #[test]
    fn without_any_thread_the_caller_does_the_work() {
        let refuse = |_| Err(io::ErrorKind::WouldBlock.into());
        let workers = Workers {
            count: 3,
            affinity: Affinity::of_this_thread(),
            pool: OnceLock::from(Pool::start_by(3, refuse)),
            process: std::process::id(),
        };
        let here = std::thread::current().id();
        let found = workers.install(|| {
            let threads = (0..100)
                .into_par_iter()
                .map(|_| std::thread::current().id());
            threads.all(|thread| thread == here)
        });
        assert!(found);
    }

    #[test]
    fn workers_run_where_the_device_was_made() {
        let workers = Workers::new(2);
        let expected = workers.affinity;
        // A thread of its own, tied to one processor, performs the first work.
        let run = move || {
            expected.first().apply();
            workers.install(|| rayon::broadcast(|_| Affinity::of_this_thread()))
        };
        let found = std::thread::spawn(run).join().expect("nothing panics");
        assert_eq!(found, [expected; 2]);
    }

    /// Half of the least normal number, as the processor computes it here and now: a call, or
    /// compilers move it.
    #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
    #[inline(never)]
    fn halved() -> u32 {
        use std::hint::black_box;
        black_box(black_box(f32::MIN_POSITIVE) * black_box(0.5)).to_bits()
    }

    #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
    #[test]
    fn a_flushing_host_gets_its_environment_back_and_denormals_are_kept_meanwhile() {
        use crate::float_environment;
        use crate::guard::guard;
        // MXCSR: all exceptions masked; with it, results flushed to zero, and denormals read as
        // zero.
        #[cfg(target_arch = "x86_64")]
        let (usual, flushing) = (0x1F80, 0x1F80 | 1 << 15 | 1 << 6);
        // FPCR: nothing; FZ, which does both (Arm Architecture Reference Manual for A-profile,
        // "FPCR").
        #[cfg(target_arch = "aarch64")]
        let (usual, flushing) = (0, 1 << 24);
        // A thread of its own: it ends with what it set.
        let run = move || {
            float_environment::set(flushing);
            let outside = halved();
            let inside = guard("test", halved);
            let workers = Workers::new(1);
            let on_worker = workers.install(halved);
            let after = float_environment::control();
            float_environment::set(usual);
            (outside, inside, on_worker, after)
        };
        let results = std::thread::spawn(run).join().expect("nothing panics");
        assert_eq!(results, (0, 0x0040_0000, 0x0040_0000, flushing));
    }
}
