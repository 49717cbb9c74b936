//! The threads that commands fan out over: a rayon pool of the device's own, whose threads are joined when it goes.

#![forbid(unsafe_code)]

use std::ops::Deref;
use std::sync::Arc;
use std::thread::JoinHandle;

use ash::vk;
use parking_lot::Mutex;

use crate::VkResult;
use crate::float_environment::DefaultEnvironment;

/// A device's workers. Dropping them waits for their threads to end, so no code of this library runs after the device is gone.
pub struct Workers {
    /// `None` once shut down.
    pool: Option<rayon::ThreadPool>,
    threads: Arc<Mutex<Vec<JoinHandle<()>>>>,
    process: u32,
}

impl Workers {
    /// Starts `count` threads.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY` if they cannot be started.
    pub fn start(count: usize) -> VkResult<Arc<Self>> {
        let threads = Arc::new(Mutex::new(Vec::new()));
        let handles = Arc::clone(&threads);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(count)
            .spawn_handler(move |worker| {
                let handle = std::thread::Builder::new()
                    .name(format!("tuff-worker-{}", worker.index()))
                    .spawn(move || {
                        let _environment = DefaultEnvironment::enter();
                        worker.run();
                    })?;
                handles.lock().push(handle);
                Ok(())
            })
            .build()
            .map_err(|_| vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
        Ok(Arc::new(Self {
            pool: Some(pool),
            threads,
            process: std::process::id(),
        }))
    }
}

impl Deref for Workers {
    type Target = rayon::ThreadPool;

    fn deref(&self) -> &rayon::ThreadPool {
        self.pool.as_ref().expect("there until dropped")
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        if std::process::id() != self.process {
            // A child of the process that started them has no such threads to wait for.
            std::mem::forget(self.pool.take());
            std::mem::forget(std::mem::take(&mut self.threads));
            return;
        }
        drop(self.pool.take());
        for thread in self.threads.lock().drain(..) {
            // Rayon's workers catch what their jobs panic with.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

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
        let workers = Workers::start(3).ok().unwrap();
        workers.broadcast(|_| COUNT.with(|_| ()));
        assert_eq!(ALIVE.load(Ordering::SeqCst), 3);
        drop(workers);
        assert_eq!(ALIVE.load(Ordering::SeqCst), 0);
    }

    /// Half of the least normal number, as the processor computes it here and now: a call, or compilers move it.
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
        // MXCSR: all exceptions masked; with it, results flushed to zero, and denormals read as zero.
        #[cfg(target_arch = "x86_64")]
        let (usual, flushing) = (0x1F80, 0x1F80 | 1 << 15 | 1 << 6);
        // FPCR: nothing; FZ, which does both (Arm Architecture Reference Manual for A-profile, "FPCR").
        #[cfg(target_arch = "aarch64")]
        let (usual, flushing) = (0, 1 << 24);
        // A thread of its own: it ends with what it set.
        let run = move || {
            float_environment::set(flushing);
            let outside = halved();
            let inside = guard("test", halved);
            let workers = Workers::start(1).expect("a thread starts");
            let on_worker = workers.install(halved);
            let after = float_environment::control();
            float_environment::set(usual);
            (outside, inside, on_worker, after)
        };
        let results = std::thread::spawn(run).join().expect("nothing panics");
        assert_eq!(results, (0, 0x0040_0000, 0x0040_0000, flushing));
    }
}
