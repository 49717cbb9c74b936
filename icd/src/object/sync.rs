//! Fences, semaphores and events.

#![forbid(unsafe_code)]

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use ash::vk;
use parking_lot::{Condvar, Mutex};

use super::device::Lost;
use crate::VkResult;

/// What all waiting of a device goes through: one lock and one condition, so that waiting for any of several things is simple.
#[derive(Default)]
pub struct Waiting {
    generation: Mutex<u64>,
    changed: Condvar,
    pub lost: Lost,
}

impl Waiting {
    /// Tells everyone who waits that something has changed.
    pub fn notify(&self) {
        *self.generation.lock() += 1;
        self.changed.notify_all();
    }

    /// Waits until `done`, the device is lost, or the time is over.
    ///
    /// # Errors
    /// `VK_TIMEOUT`, `VK_ERROR_DEVICE_LOST`.
    pub fn wait_until(&self, timeout_ns: u64, mut done: impl FnMut() -> bool) -> VkResult {
        if done() {
            return Ok(());
        }
        let deadline = Instant::now().checked_add(std::time::Duration::from_nanos(timeout_ns));
        let mut generation = self.generation.lock();
        loop {
            if done() {
                return Ok(());
            }
            self.lost.check()?;
            match deadline {
                _ if timeout_ns == 0 => return Err(vk::Result::TIMEOUT),
                Some(deadline) => {
                    if self
                        .changed
                        .wait_until(&mut generation, deadline)
                        .timed_out()
                    {
                        return if done() {
                            Ok(())
                        } else {
                            Err(vk::Result::TIMEOUT)
                        };
                    }
                }
                None => self.changed.wait(&mut generation),
            }
        }
    }
}

/// A fence.
pub struct Fence {
    signaled: AtomicBool,
}

impl Fence {
    pub fn new(signaled: bool) -> Self {
        Self {
            signaled: AtomicBool::new(signaled),
        }
    }

    pub fn is_signaled(&self) -> bool {
        self.signaled.load(Ordering::Acquire)
    }

    /// Sets or resets the fence. Who sets it also [notifies](Waiting::notify).
    pub fn set(&self, signaled: bool) {
        self.signaled.store(signaled, Ordering::Release);
    }
}

/// A semaphore. A binary one is a counter too: 0 or 1.
pub struct Semaphore {
    pub ty: vk::SemaphoreType,
    pub value: Mutex<u64>,
    pub waiting: Arc<Waiting>,
}

impl Semaphore {
    /// The counter's value.
    pub fn value(&self) -> u64 {
        *self.value.lock()
    }

    /// Signals: a binary semaphore becomes 1, a timeline one takes the value.
    pub fn signal(&self, value: u64) {
        *self.value.lock() = if self.ty == vk::SemaphoreType::BINARY {
            1
        } else {
            value
        };
        self.waiting.notify();
    }

    /// Whether a wait for `value` is over.
    pub fn has_reached(&self, value: u64) -> bool {
        self.value()
            >= if self.ty == vk::SemaphoreType::BINARY {
                1
            } else {
                value
            }
    }

    /// What a finished queue wait leaves: a binary semaphore is unsignaled again.
    pub fn consume(&self) {
        if self.ty == vk::SemaphoreType::BINARY {
            *self.value.lock() = 0;
        }
    }
}

/// An event.
#[derive(Default)]
pub struct Event {
    set: AtomicBool,
}

impl Event {
    pub fn is_set(&self) -> bool {
        self.set.load(Ordering::Acquire)
    }

    /// Sets or resets the event. Who sets it also [notifies](Waiting::notify).
    pub fn set(&self, set: bool) {
        self.set.store(set, Ordering::Release);
    }
}
