//! The wake-up of a swapchain's thread: a file that can be polled beside a window's connection.

use std::os::fd::{AsRawFd, BorrowedFd, FromRawFd, OwnedFd};
use std::time::{Duration, Instant};

use ash::vk;

use crate::VkResult;

/// An `eventfd`.
pub struct Bell(OwnedFd);

impl Bell {
    /// A bell that has not rung yet.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY` if the system gives no file.
    pub fn new() -> VkResult<Self> {
        // SAFETY: a plain system call; the descriptor is owned from its creation on.
        unsafe {
            let file = libc::eventfd(0, libc::EFD_CLOEXEC | libc::EFD_NONBLOCK);
            if file < 0 {
                return Err(vk::Result::ERROR_OUT_OF_HOST_MEMORY);
            }
            Ok(Self(OwnedFd::from_raw_fd(file)))
        }
    }

    /// Wakes the current waiter, or the next one.
    pub fn ring(&self) {
        let one = 1u64;
        // SAFETY: eight bytes, as an `eventfd` wants. It only refuses when it is at its largest,
        // and then it is rung.
        unsafe { libc::write(self.0.as_raw_fd(), (&raw const one).cast(), 8) };
    }

    /// Sleeps until the bell is rung, `beside` can be read, or the deadline is over; whether
    /// `beside` can be read (or has failed).
    pub fn wait(&self, deadline: Option<Instant>, beside: Option<BorrowedFd<'_>>) -> bool {
        let poll = |fd| libc::pollfd {
            fd,
            events: libc::POLLIN,
            revents: 0,
        };
        // A negative descriptor is left out by `poll`.
        let mut files = [
            poll(self.0.as_raw_fd()),
            poll(beside.map_or(-1, |file| file.as_raw_fd())),
        ];
        let left = deadline.map(|deadline| deadline.saturating_duration_since(Instant::now()));
        let timeout_ms = left.map_or(-1, milliseconds);
        // SAFETY: two structures that live here.
        unsafe { libc::poll(files.as_mut_ptr(), 2, timeout_ms) };
        if files[0].revents != 0 {
            let mut count = 0u64;
            // SAFETY: eight bytes, as an `eventfd` gives; the file does not block.
            unsafe { libc::read(self.0.as_raw_fd(), (&raw mut count).cast(), 8) };
        }
        files[1].revents != 0
    }
}

/// Rounded up, so that the wait does not end early.
fn milliseconds(time: Duration) -> i32 {
    i32::try_from(time.as_micros().div_ceil(1000)).unwrap_or(i32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ring_before_the_wait_is_heard_once() {
        let bell = Bell::new().unwrap();
        bell.ring();
        assert!(!bell.wait(None, None));
        let start = Instant::now();
        let deadline = start + Duration::from_millis(20);
        bell.wait(Some(deadline), None);
        assert!(Instant::now() >= deadline);
    }
}
