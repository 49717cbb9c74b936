//! What executes commands: a device's workers and what they keep warm.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ash::vk;
use parking_lot::{Mutex, RwLock};

use super::dispatch::Worker;
use crate::VkResult;
use crate::object::sync::Waiting;
use crate::trace::{Limits, Tracer};

/// A device's workers.
pub struct Engine {
    pool: RwLock<Option<rayon::ThreadPool>>,
    threads: Mutex<Vec<JoinHandle<()>>>,
    pub waiting: Arc<Waiting>,
    pub tracer: Tracer,
    /// `TUFF_TIMEOUT`, in seconds: how long one dispatch may take before it counts as hanging.
    timeout: Option<Duration>,
    compute_workers: Mutex<Vec<Box<Worker>>>,
}

impl Engine {
    /// Starts the workers.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY` if the system gives no threads.
    pub fn new(thread_count: usize, waiting: Arc<Waiting>) -> VkResult<Self> {
        let mut threads = Vec::new();
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(thread_count)
            .spawn_handler(|thread| {
                let builder =
                    std::thread::Builder::new().name(format!("tuff-worker-{}", thread.index()));
                threads.push(builder.spawn(|| thread.run())?);
                Ok(())
            })
            .build()
            .map_err(|_| vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
        Ok(Self {
            pool: RwLock::new(Some(pool)),
            threads: Mutex::new(threads),
            waiting,
            tracer: Tracer::default(),
            timeout: timeout(),
            compute_workers: Mutex::default(),
        })
    }

    /// Runs work on the pool, so that what it spreads with rayon stays there. After [`Self::shut_down`] it runs nothing.
    pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> Option<R> {
        self.pool.read().as_ref().map(|pool| pool.install(work))
    }

    /// Ends and joins the workers.
    pub fn shut_down(&self) {
        drop(self.pool.write().take());
        for thread in self.threads.lock().drain(..) {
            // A worker's panic has been passed on to who waited for its work.
            let _ = thread.join();
        }
    }

    /// Limits of a dispatch that starts now.
    pub fn limits(&self) -> Limits {
        Limits {
            deadline: self
                .timeout
                .and_then(|timeout| Instant::now().checked_add(timeout)),
            ..Limits::default()
        }
    }

    /// A worker's memory, kept warm between dispatches.
    pub fn lease_worker(&self) -> Lease<'_> {
        Lease {
            worker: Some(self.compute_workers.lock().pop().unwrap_or_default()),
            engine: self,
        }
    }
}

fn timeout() -> Option<Duration> {
    let seconds: f64 = std::env::var("TUFF_TIMEOUT").ok()?.parse().ok()?;
    Duration::try_from_secs_f64(seconds).ok()
}

/// A worker's memory on loan. What a panic has touched is not given back.
pub struct Lease<'a> {
    worker: Option<Box<Worker>>,
    engine: &'a Engine,
}

impl Lease<'_> {
    pub fn worker(&mut self) -> &mut Worker {
        self.worker.as_mut().expect("held until dropped")
    }
}

impl Drop for Lease<'_> {
    fn drop(&mut self) {
        if let Some(worker) = self.worker.take()
            && !std::thread::panicking()
        {
            self.engine.compute_workers.lock().push(worker);
        }
    }
}
