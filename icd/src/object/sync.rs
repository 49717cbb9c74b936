//! Fences, semaphores and events, and waits for them.

#![forbid(unsafe_code)]

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use ash::vk;
use parking_lot::{Condvar, Mutex};

use super::external_sync::External;
use crate::VkResult;

/// First and longest pause between two checks of a wait for an object in a file.
const FIRST_LOOK: Duration = Duration::from_micros(20);
const LAST_LOOK: Duration = Duration::from_millis(1);

/// Whether a device is lost, which is permanent. A device is also lost in a forked child of its
/// process, because a fork does not copy threads.
pub struct Lost {
    lost: AtomicBool,
    process: u32,
}

impl Default for Lost {
    fn default() -> Self {
        Self {
            lost: AtomicBool::new(false),
            process: std::process::id(),
        }
    }
}

impl Lost {
    /// Marks the device lost.
    pub fn set(&self) {
        self.lost.store(true, Ordering::Release);
    }

    /// Whether this is a child of the device's process, without its threads.
    pub fn is_inherited(&self) -> bool {
        std::process::id() != self.process
    }

    /// # Errors
    /// `VK_ERROR_DEVICE_LOST`.
    pub fn check(&self) -> VkResult {
        if self.lost.load(Ordering::Acquire) || self.is_inherited() {
            Err(vk::Result::ERROR_DEVICE_LOST)
        } else {
            Ok(())
        }
    }
}

/// The single lock and condition variable of all waits of a device. So a wait for any of several
/// objects is simple.
#[derive(Default)]
pub struct Waiting {
    changed_lock: Mutex<()>,
    changed: Condvar,
    pub lost: Lost,
}

impl Waiting {
    /// Notifies all waiters of a change.
    pub fn notify(&self) {
        // A waiter holds the lock from its check until it sleeps, so this notification is not lost.
        drop(self.changed_lock.lock());
        self.changed.notify_all();
    }

    /// Waits until `done` returns true, the device is lost, or the timeout has passed.
    ///
    /// # Errors
    /// `VK_TIMEOUT`, `VK_ERROR_DEVICE_LOST`.
    pub fn wait_until(&self, timeout_ns: u64, done: impl FnMut() -> bool) -> VkResult {
        self.wait(timeout_ns, false, done)
    }

    /// Like [`Self::wait_until`], for objects `in_files`, which cause no notification.
    ///
    /// # Errors
    /// As [`Self::wait_until`].
    pub fn wait(
        &self,
        timeout_ns: u64,
        in_files: bool,
        mut done: impl FnMut() -> bool,
    ) -> VkResult {
        if done() {
            return Ok(());
        }
        let deadline = Instant::now().checked_add(Duration::from_nanos(timeout_ns));
        let mut look = FIRST_LOOK;
        let mut lock = self.changed_lock.lock();
        loop {
            if done() {
                return Ok(());
            }
            self.lost.check()?;
            match deadline {
                _ if timeout_ns == 0 => return Err(vk::Result::TIMEOUT),
                _ if in_files => {
                    if deadline.is_some_and(|deadline| Instant::now() >= deadline) {
                        return Err(vk::Result::TIMEOUT);
                    }
                    self.changed.wait_for(&mut lock, look);
                    look = (2 * look).min(LAST_LOOK);
                }
                Some(deadline) => {
                    if self.changed.wait_until(&mut lock, deadline).timed_out() {
                        return if done() {
                            Ok(())
                        } else {
                            Err(vk::Result::TIMEOUT)
                        };
                    }
                }
                None => self.changed.wait(&mut lock),
            }
        }
    }
}

/// A fence.
pub struct Fence {
    signaled: AtomicBool,
    /// The external payload, which takes precedence if there is one.
    pub external: External,
}

impl Fence {
    pub fn new(signaled: bool) -> Self {
        Self::with(signaled, External::default())
    }

    /// A fence whose payload may lie in a file.
    pub fn with(signaled: bool, external: External) -> Self {
        Self {
            signaled: AtomicBool::new(signaled),
            external,
        }
    }

    pub fn is_signaled(&self) -> bool {
        let external = self.external.is_signaled();
        external.unwrap_or_else(|| self.signaled.load(Ordering::Acquire))
    }

    /// Sets or resets the fence. The caller that sets it also [notifies](Waiting::notify).
    pub fn set(&self, signaled: bool) {
        let is_external = match signaled {
            true => self.external.signal(),
            false => self.external.reset(),
        };
        if !is_external {
            self.signaled.store(signaled, Ordering::Release);
        }
    }
}

/// A semaphore. A binary semaphore is a counter of 0 or 1.
pub struct Semaphore {
    pub ty: vk::SemaphoreType,
    value: AtomicU64,
    waiting: Arc<Waiting>,
    /// The external payload of a binary semaphore, which takes precedence over the counter.
    pub external: External,
}

impl Semaphore {
    /// Creates a semaphore; `value` is the initial value of a timeline.
    pub fn new(ty: vk::SemaphoreType, value: u64, waiting: Arc<Waiting>) -> Self {
        Self::with(ty, value, waiting, External::default())
    }

    /// A semaphore whose payload may lie in a file.
    pub fn with(
        ty: vk::SemaphoreType,
        value: u64,
        waiting: Arc<Waiting>,
        external: External,
    ) -> Self {
        Self {
            ty,
            value: AtomicU64::new(value),
            waiting,
            external,
        }
    }

    fn is_binary(&self) -> bool {
        self.ty == vk::SemaphoreType::BINARY
    }

    /// The counter's value.
    pub fn value(&self) -> u64 {
        self.value.load(Ordering::Acquire)
    }

    /// Signals: a binary semaphore becomes 1, a timeline semaphore takes the value. A timeline
    /// never decreases (chapter Semaphores: signals must increase the value).
    pub fn signal(&self, value: u64) {
        if !self.external.signal() {
            let value = if self.is_binary() { 1 } else { value };
            self.value.fetch_max(value, Ordering::AcqRel);
        }
        self.waiting.notify();
    }

    /// Whether a wait for `value` is complete.
    pub fn has_reached(&self, value: u64) -> bool {
        let external = self.external.is_signaled();
        external.unwrap_or_else(|| self.value() >= if self.is_binary() { 1 } else { value })
    }

    /// Consumes the signal after a finished queue wait: a binary semaphore becomes unsignaled.
    pub fn consume(&self) {
        if !self.external.consume() && self.is_binary() {
            self.value.store(0, Ordering::Release);
        }
    }
}

/// An event.
pub struct Event {
    set: AtomicBool,
    waiting: Arc<Waiting>,
}

impl Event {
    /// Creates an event, not set.
    pub fn new(waiting: Arc<Waiting>) -> Self {
        Self {
            set: AtomicBool::new(false),
            waiting,
        }
    }

    pub fn is_set(&self) -> bool {
        self.set.load(Ordering::Acquire)
    }

    /// Sets the event.
    pub fn set(&self) {
        self.set.store(true, Ordering::Release);
        self.waiting.notify();
    }

    /// Resets the event.
    pub fn reset(&self) {
        self.set.store(false, Ordering::Release);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_end_by_signal_timeout_or_loss() {
        let waiting = Arc::new(Waiting::default());
        let semaphore = Semaphore::new(vk::SemaphoreType::TIMELINE, 3, Arc::clone(&waiting));
        assert!(waiting.wait_until(0, || semaphore.has_reached(3)).is_ok());
        assert_eq!(
            waiting.wait_until(1000, || semaphore.has_reached(4)),
            Err(vk::Result::TIMEOUT)
        );
        std::thread::scope(|scope| {
            scope.spawn(|| semaphore.signal(9));
            assert!(
                waiting
                    .wait_until(u64::MAX, || semaphore.has_reached(4))
                    .is_ok()
            );
        });
        assert_eq!(semaphore.value(), 9);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                waiting.lost.set();
                waiting.notify();
            });
            let result = waiting.wait_until(u64::MAX, || semaphore.has_reached(10));
            assert_eq!(result, Err(vk::Result::ERROR_DEVICE_LOST));
        });
    }

    #[test]
    fn a_binary_semaphore_is_consumed_by_its_wait() {
        let semaphore = Semaphore::new(vk::SemaphoreType::BINARY, 0, Arc::default());
        assert!(!semaphore.has_reached(0));
        semaphore.signal(0);
        assert!(semaphore.has_reached(0));
        semaphore.consume();
        assert!(!semaphore.has_reached(0));
    }
}
