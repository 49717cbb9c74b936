//! Queues. The thread of a queue waits, executes and signals, one submission after the other.
//!
//! ```text
//! vkQueueSubmit ──> Queue::submit ──> [ pending ] ──> thread: wait for semaphores ──> execute::replay ──> signal semaphores, fence
//! ```
//!
//! A submission may wait for a semaphore that another queue, or the host, signals later. It blocks
//! only its own queue's thread.

#![forbid(unsafe_code)]

#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::JoinHandle;

use ash::vk;
use parking_lot::{Condvar, Mutex};
use serde_json::json;

use crate::VkResult;
use crate::capture;
use crate::command::Command;
use crate::execute::{self, Engine, Failure};
use crate::float_environment::DefaultEnvironment;
use crate::guard::panic_text;
use crate::handle::Ref;
use crate::object::sparse::SparseBind;
use crate::object::{Fence, Semaphore};
use crate::present::{Request, Swapchain};
use crate::timeline::{self, Kind};
use crate::wave::{Cause, Fault, Stopped};

/// The number of queues of a device, all of one family.
pub const MAX_QUEUES: u32 = 4;

/// The time within which the command of an aborted shader must lose the device: 5 seconds.
const LOSS_PATIENCE_NS: u64 = 5_000_000_000;

/// A batch of work of `vkQueueSubmit`.
#[derive(Default)]
pub struct Submission {
    /// Semaphores, with the values of timeline semaphores.
    pub waits: Vec<(Ref<Semaphore>, u64)>,
    /// Sparse binds, performed in order before the commands.
    pub binds: Vec<SparseBind>,
    pub commands: Vec<Arc<Vec<Command>>>,
    /// Images that are presented after the commands.
    pub presents: Vec<(Ref<Swapchain>, Request)>,
    /// Signaled when the presentations no longer need the semaphores
    /// (`VkSwapchainPresentFenceInfoKHR`).
    pub present_fences: Vec<Ref<Fence>>,
    pub signals: Vec<(Ref<Semaphore>, u64)>,
    pub fence: Option<Ref<Fence>>,
}

crate::handle::handled!(Queue => Queue);

/// `VkQueue`.
pub struct Queue {
    pub index: u32,
    line: Arc<QueueShared>,
    /// Started by the first submission.
    thread: Mutex<Option<JoinHandle<()>>>,
}

/// State shared by a queue and its thread.
struct QueueShared {
    engine: Arc<Engine>,
    state: Mutex<QueueState>,
    arrived: Condvar,
}

#[derive(Default)]
struct QueueState {
    pending: VecDeque<Submission>,
    /// The number of submissions, and of those that are complete.
    submitted: u64,
    completed: u64,
    closing: bool,
}

impl Queue {
    /// Creates an idle queue.
    pub fn new(index: u32, engine: Arc<Engine>) -> Self {
        Self {
            index,
            line: Arc::new(QueueShared {
                engine,
                state: Mutex::default(),
                arrived: Condvar::new(),
            }),
            thread: Mutex::new(None),
        }
    }

    /// Appends work.
    ///
    /// # Errors
    /// `VK_ERROR_DEVICE_LOST`; `VK_ERROR_OUT_OF_HOST_MEMORY` if the thread cannot be started.
    pub fn submit(&self, submissions: impl IntoIterator<Item = Submission>) -> VkResult {
        self.line.engine.waiting.lost.check()?;
        self.start_thread()?;
        let mut state = self.line.state.lock();
        for submission in submissions {
            state.pending.push_back(submission);
            state.submitted += 1;
        }
        drop(state);
        self.line.arrived.notify_one();
        Ok(())
    }

    fn start_thread(&self) -> VkResult {
        let mut thread = self.thread.lock();
        if thread.is_none() {
            let line = Arc::clone(&self.line);
            let started = std::thread::Builder::new()
                .name(format!("tuff-queue-{}", self.index))
                .spawn(move || {
                    let _environment = DefaultEnvironment::enter();
                    line.run();
                })
                .map_err(|_| vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
            *thread = Some(started);
        }
        Ok(())
    }

    /// Waits until everything submitted so far is complete.
    ///
    /// # Errors
    /// `VK_ERROR_DEVICE_LOST`.
    pub fn wait_idle(&self) -> VkResult {
        let waiting = &self.line.engine.waiting;
        waiting.lost.check()?;
        let submitted = self.line.state.lock().submitted;
        waiting.wait_until(u64::MAX, || self.line.state.lock().completed >= submitted)?;
        waiting.lost.check()
    }

    /// Ends the queue's thread and drops pending work. [`Engine::shut_down`] must have ended the
    /// device's waits before.
    pub fn close(&self) {
        if self.line.engine.waiting.lost.is_inherited() {
            // This is a forked child: the thread does not exist here and must not be joined.
            std::mem::forget(self.thread.try_lock().and_then(|mut thread| thread.take()));
            return;
        }
        self.line.state.lock().closing = true;
        self.line.arrived.notify_one();
        if let Some(thread) = self.thread.lock().take() {
            // A panic on the thread was logged when it happened.
            let _ = thread.join();
        }
    }
}

impl QueueShared {
    fn run(&self) {
        while let Some(submission) = self.next() {
            self.perform(submission);
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

    /// Returns once the device is lost. The command of an aborted shader loses the device, perhaps
    /// on another queue. If that takes too long, this function loses it.
    fn await_loss(&self) {
        let waited = self.engine.waiting.wait_until(LOSS_PATIENCE_NS, || false);
        if waited == Err(vk::Result::TIMEOUT) {
            self.engine.lose(Stopped::Aborted.into());
        }
    }

    /// Waits, executes, signals. On a lost device nothing is executed and nothing signaled.
    fn perform(&self, submission: Submission) {
        let Submission {
            waits,
            binds,
            commands,
            presents,
            present_fences,
            signals,
            fence,
        } = submission;
        let in_files = waits
            .iter()
            .any(|(semaphore, _)| semaphore.external.is_there());
        let waited = self.engine.waiting.wait(u64::MAX, in_files, || {
            waits
                .iter()
                .all(|(semaphore, value)| semaphore.has_reached(*value))
        });
        if waited.is_err() || self.engine.waiting.lost.check().is_err() {
            return;
        }
        waits.iter().for_each(|(semaphore, _)| semaphore.consume());
        if let Err(why) = binds.iter().try_for_each(SparseBind::perform) {
            let cause = Cause::SparseBinding(why.to_owned());
            return self.engine.lose(Fault::new(cause));
        }
        let span = timeline::span(Kind::Submission, || {
            let sizes = json!({
                "command buffers": commands.len(),
                "waits": waits.len(),
                "signals": signals.len(),
                "presents": presents.len(),
            });
            ("submission".into(), sizes)
        });
        let result = catch_unwind(AssertUnwindSafe(|| {
            execute::replay_all(&self.engine, commands.iter().map(|list| &list[..]))
        }));
        match result {
            Ok(Ok(())) => {}
            Ok(Err(Failure::AlreadyLost)) => return self.await_loss(),
            Ok(Err(Failure::Stopped(why))) => return self.engine.lose(*why),
            Err(payload) => {
                let cause = Cause::Internal(panic_text(&*payload));
                return self.engine.lose(Fault::new(cause));
            }
        }
        // An application that sees a signal may end the process.
        drop(span);
        // An application that sees a signal may reset the command buffers, destroy sparse
        // resources, free their memory and reuse the addresses. So the queue drops its references
        // before it signals.
        drop((commands, binds));
        if !presents.is_empty() {
            capture::end_frame();
        }
        for (swapchain, request) in presents {
            swapchain.enqueue(request);
        }
        for (semaphore, value) in &signals {
            semaphore.signal(*value);
        }
        for fence in present_fences.iter().chain(&fence) {
            fence.set(true);
        }
    }
}
