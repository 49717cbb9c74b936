//! Queues: each has a thread that waits, executes, signals.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::JoinHandle;

use ash::vk;
use parking_lot::{Condvar, Mutex};

use crate::VkResult;
use crate::command::Command;
use crate::execute::{self, Engine};
use crate::ffi::guard::panic_message;
use crate::handle::Ref;
use crate::log::{self, Level};
use crate::object::{Fence, Semaphore};

/// A batch of a submission: wait, execute, signal.
#[derive(Default)]
pub struct Submission {
    /// Semaphores and the values that they must reach.
    pub waits: Vec<(Ref<Semaphore>, u64)>,
    pub command_buffers: Vec<Arc<Vec<Command>>>,
    pub signals: Vec<(Ref<Semaphore>, u64)>,
    pub fence: Option<Ref<Fence>>,
}

/// `VkQueue`.
pub struct Queue {
    pub index: u32,
    shared: Arc<Shared>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

/// What the queue and its thread share.
struct Shared {
    engine: Arc<Engine>,
    state: Mutex<State>,
    arrived: Condvar,
}

#[derive(Default)]
struct State {
    pending: VecDeque<Submission>,
    submitted: u64,
    completed: u64,
    closing: bool,
}

impl Queue {
    /// A queue and its thread.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY` if the system gives no thread.
    pub fn new(index: u32, engine: Arc<Engine>) -> VkResult<Self> {
        let shared = Arc::new(Shared {
            engine,
            state: Mutex::default(),
            arrived: Condvar::new(),
        });
        let worker = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name(format!("tuff-queue-{index}"))
            .spawn(move || worker.run())
            .map_err(|_| vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
        Ok(Self {
            index,
            shared,
            thread: Mutex::new(Some(thread)),
        })
    }

    /// Hands batches to the thread.
    ///
    /// # Errors
    /// `VK_ERROR_DEVICE_LOST`.
    pub fn submit(&self, submissions: impl IntoIterator<Item = Submission>) -> VkResult {
        self.shared.engine.waiting.lost.check()?;
        let mut state = self.shared.state.lock();
        for submission in submissions {
            state.pending.push_back(submission);
            state.submitted += 1;
        }
        drop(state);
        self.shared.arrived.notify_one();
        Ok(())
    }

    /// Waits until everything submitted so far is complete.
    ///
    /// # Errors
    /// `VK_ERROR_DEVICE_LOST`.
    pub fn wait_idle(&self) -> VkResult {
        let goal = self.shared.state.lock().submitted;
        let waiting = &self.shared.engine.waiting;
        waiting.wait_until(u64::MAX, || self.shared.state.lock().completed >= goal)?;
        waiting.lost.check()
    }

    /// Ends the thread; what has not been executed is dropped.
    pub fn shut_down(&self) {
        self.shared.state.lock().closing = true;
        self.shared.arrived.notify_one();
        self.shared.engine.waiting.notify();
        if let Some(thread) = self.thread.lock().take() {
            // A panic of the thread has been reported where it happened.
            let _ = thread.join();
        }
    }
}

impl Shared {
    /// The thread's loop.
    fn run(&self) {
        while let Some(submission) = self.next() {
            if let Err(reason) = self.perform(&submission) {
                log::write(Level::Error, &format!("device lost: {reason}"));
                self.engine.waiting.lost.set();
            }
            drop(submission);
            self.state.lock().completed += 1;
            self.engine.waiting.notify();
        }
    }

    fn next(&self) -> Option<Submission> {
        let mut state = self.state.lock();
        loop {
            if state.closing {
                return None;
            }
            if let Some(submission) = state.pending.pop_front() {
                return Some(submission);
            }
            self.arrived.wait(&mut state);
        }
    }

    /// Waits, executes, signals.
    fn perform(&self, submission: &Submission) -> Result<(), String> {
        let waiting = &self.engine.waiting;
        for (semaphore, value) in &submission.waits {
            let ready = waiting.wait_until(u64::MAX, || {
                semaphore.has_reached(*value) || self.state.lock().closing
            });
            if ready.is_err() {
                // Lost by another queue, which has said why.
                return Ok(());
            }
            semaphore.consume();
        }
        if waiting.lost.check().is_err() {
            return Ok(());
        }
        catch_unwind(AssertUnwindSafe(|| {
            execute::replay(&self.engine, &submission.command_buffers)
        }))
        .unwrap_or_else(|payload| Err(panic_message(&*payload).to_owned()))?;
        for (semaphore, value) in &submission.signals {
            semaphore.signal(*value);
        }
        if let Some(fence) = &submission.fence {
            fence.set(true);
        }
        Ok(())
    }
}
