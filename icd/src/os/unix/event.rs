//! Events: flags that threads and processes wait for.

use std::os::fd::AsRawFd;
use std::time::{Duration, Instant};

use super::handle::{BorrowedHandle, Handle, Sharing};
use super::section::Refused;

/// A flag that stays set until it is cleared (an `eventfd`, whose counter is not zero then).
#[derive(Debug)]
pub struct Event(Handle);

impl Event {
    /// Creates an event; `None` if the process cannot have more handles.
    pub fn new(is_signaled: bool) -> Option<Self> {
        let flags = libc::EFD_CLOEXEC | libc::EFD_NONBLOCK;
        // SAFETY: the call takes no pointer, and the new descriptor has no other owner.
        let file = unsafe { Handle::created(libc::eventfd(u32::from(is_signaled), flags)) };
        file.map(Self)
    }

    /// Creates an event for other devices and processes.
    ///
    /// # Errors
    /// The system refuses.
    pub fn exportable(is_signaled: bool, _sharing: &Sharing) -> Result<Self, Refused> {
        Self::new(is_signaled).ok_or(Refused::Handles)
    }

    /// Imports an event of another device or process, or a sync file of the kernel, which only
    /// supports [`Self::is_signaled`].
    pub fn from_handle(handle: Handle) -> Self {
        Self(handle)
    }

    #[cfg(test)]
    pub fn handle(&self) -> &Handle {
        &self.0
    }

    /// A new handle for other users; `None` if the process cannot have more.
    pub fn export(&self) -> Option<Handle> {
        self.0.try_clone()
    }

    /// Sets the flag, and wakes its waiters.
    pub fn signal(&self) {
        let one = 1u64;
        // SAFETY: an `eventfd` takes eight bytes. It refuses only when its counter is at its
        // largest, and then the flag is set.
        unsafe { libc::write(self.0.raw(), (&raw const one).cast(), 8) };
    }

    /// Whether the flag is set. Does not wait.
    pub fn is_signaled(&self) -> bool {
        let mut poll = readable(self.0.raw());
        // SAFETY: the pointer leads to one structure.
        let ready = unsafe { libc::poll(&raw mut poll, 1, 0) };
        ready == 1 && poll.revents & libc::POLLIN != 0
    }

    /// Clears the flag. A read of an imported file may block, so it is read only when it is ready.
    pub fn clear(&self) {
        if self.is_signaled() {
            self.empty();
        }
    }

    /// Sleeps until the flag is set, `beside` is readable (or has failed), or the deadline has
    /// passed. Returns whether `beside` is readable. Clears the flag.
    pub fn wait(&self, deadline: Option<Instant>, beside: Option<BorrowedHandle<'_>>) -> bool {
        // `poll` ignores a negative descriptor.
        let mut files = [
            readable(self.0.raw()),
            readable(beside.map_or(-1, |file| file.as_raw_fd())),
        ];
        let left = deadline.map(|deadline| deadline.saturating_duration_since(Instant::now()));
        let timeout_ms = left.map_or(-1, milliseconds);
        // SAFETY: the pointer leads to two structures.
        unsafe { libc::poll(files.as_mut_ptr(), 2, timeout_ms) };
        if files[0].revents != 0 {
            self.empty();
        }
        files[1].revents != 0
    }

    fn empty(&self) {
        let mut count = 0u64;
        // SAFETY: the buffer has the eight bytes that an `eventfd` returns.
        unsafe { libc::read(self.0.raw(), (&raw mut count).cast(), 8) };
    }
}

fn readable(fd: i32) -> libc::pollfd {
    libc::pollfd {
        fd,
        events: libc::POLLIN,
        revents: 0,
    }
}

/// Rounded up, so that the wait does not end early.
fn milliseconds(time: Duration) -> i32 {
    i32::try_from(time.as_micros().div_ceil(1000)).unwrap_or(i32::MAX)
}
