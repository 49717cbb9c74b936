//! Events: flags that threads and processes wait for.

use std::os::fd::AsRawFd;
use std::time::{Duration, Instant};

use super::handle::{BorrowedHandle, Handle, Sharing};
use super::section::Refused;

/// A flag that stays set until it is cleared (an `eventfd`, whose counter is not zero then).
#[derive(Debug)]
pub struct Event(Handle);

impl Event {
    /// An event; `None` where the process can have no more handles.
    pub fn new(is_signaled: bool) -> Option<Self> {
        let flags = libc::EFD_CLOEXEC | libc::EFD_NONBLOCK;
        // SAFETY: a plain system call; the descriptor is owned from its creation on.
        let file = unsafe { Handle::created(libc::eventfd(u32::from(is_signaled), flags)) };
        file.map(Self)
    }

    /// An event that others can use.
    ///
    /// # Errors
    /// The system refuses.
    pub fn exportable(is_signaled: bool, _sharing: &Sharing) -> Result<Self, Refused> {
        Self::new(is_signaled).ok_or(Refused::Handles)
    }

    /// An event of another device or process, or a sync file of the kernel's: that has
    /// [`Self::is_signaled`] alone.
    pub fn from_handle(handle: Handle) -> Self {
        Self(handle)
    }

    #[cfg(test)]
    pub fn handle(&self) -> &Handle {
        &self.0
    }

    /// A new handle by which others can use it; `None` where the process can have no more.
    pub fn export(&self) -> Option<Handle> {
        self.0.try_clone()
    }

    /// Sets the flag, and wakes its waiters.
    pub fn signal(&self) {
        let one = 1u64;
        // SAFETY: eight bytes, as an `eventfd` wants. It only refuses when its counter is at its
        // largest, and then the flag is set.
        unsafe { libc::write(self.0.raw(), (&raw const one).cast(), 8) };
    }

    /// Whether the flag is set. Does not wait.
    pub fn is_signaled(&self) -> bool {
        let mut poll = readable(self.0.raw());
        // SAFETY: one structure, which is there.
        let ready = unsafe { libc::poll(&raw mut poll, 1, 0) };
        ready == 1 && poll.revents & libc::POLLIN != 0
    }

    /// Clears the flag. An imported file may block, so it is only read when that would not wait.
    pub fn clear(&self) {
        if self.is_signaled() {
            self.empty();
        }
    }

    /// Sleeps until the flag is set, `beside` can be read (or has failed), or the deadline is over;
    /// whether `beside` can. Clears the flag.
    pub fn wait(&self, deadline: Option<Instant>, beside: Option<BorrowedHandle<'_>>) -> bool {
        // A negative descriptor is left out by `poll`.
        let mut files = [
            readable(self.0.raw()),
            readable(beside.map_or(-1, |file| file.as_raw_fd())),
        ];
        let left = deadline.map(|deadline| deadline.saturating_duration_since(Instant::now()));
        let timeout_ms = left.map_or(-1, milliseconds);
        // SAFETY: two structures that live here.
        unsafe { libc::poll(files.as_mut_ptr(), 2, timeout_ms) };
        if files[0].revents != 0 {
            self.empty();
        }
        files[1].revents != 0
    }

    fn empty(&self) {
        let mut count = 0u64;
        // SAFETY: eight bytes, as an `eventfd` gives.
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
