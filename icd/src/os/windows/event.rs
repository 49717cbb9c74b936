//! Events: flags that threads and processes wait for.

use std::os::windows::io::AsRawHandle;
use std::time::{Duration, Instant};

use windows_sys::Win32::Foundation::{HANDLE, WAIT_OBJECT_0, WAIT_TIMEOUT};
use windows_sys::Win32::System::Threading::{
    CreateEventW, INFINITE, ResetEvent, SetEvent, WaitForMultipleObjects, WaitForSingleObject,
};

use super::handle::{BorrowedHandle, Handle};

/// A flag that stays set until it is cleared.
#[derive(Debug)]
pub struct Event(Handle);

impl Event {
    /// An event; `None` where the process can have no more handles.
    pub fn new(is_signaled: bool) -> Option<Self> {
        const MANUAL_RESET: i32 = 1;
        let (security, name) = (std::ptr::null(), std::ptr::null());
        // SAFETY: a plain system call; the handle is owned from its creation on.
        unsafe {
            let event = CreateEventW(security, MANUAL_RESET, is_signaled.into(), name);
            Handle::created(event).map(Self)
        }
    }

    /// An event of another device or process.
    pub fn from_handle(handle: Handle) -> Self {
        Self(handle)
    }

    /// The handle by which others can use it.
    pub fn handle(&self) -> &Handle {
        &self.0
    }

    /// Sets the flag, and wakes its waiters.
    pub fn signal(&self) {
        // SAFETY: an event that is open.
        unsafe { SetEvent(self.0.raw()) };
    }

    /// Whether the flag is set. Does not wait.
    pub fn is_signaled(&self) -> bool {
        is_signaled(self.0.raw())
    }

    /// Clears the flag.
    pub fn clear(&self) {
        // SAFETY: an event that is open.
        unsafe { ResetEvent(self.0.raw()) };
    }

    /// Sleeps until the flag is set, `beside` is signaled, or the deadline is over; whether
    /// `beside` is. Clears the flag.
    pub fn wait(&self, deadline: Option<Instant>, beside: Option<BorrowedHandle<'_>>) -> bool {
        let beside = beside.map(|handle| handle.as_raw_handle());
        let handles = [self.0.raw(), beside.unwrap_or_default()];
        let count = 1 + u32::from(beside.is_some());
        loop {
            let left = deadline.map(|deadline| deadline.saturating_duration_since(Instant::now()));
            let timeout_ms = left.map_or(INFINITE, milliseconds);
            // SAFETY: so many handles that are open.
            let why = unsafe { WaitForMultipleObjects(count, handles.as_ptr(), 0, timeout_ms) };
            // The system's clock of waits is coarser than the deadline's.
            let is_early = deadline.is_some_and(|deadline| Instant::now() < deadline);
            if why != WAIT_TIMEOUT || !is_early {
                break;
            }
        }
        self.clear();
        beside.is_some_and(is_signaled)
    }
}

fn is_signaled(handle: HANDLE) -> bool {
    // SAFETY: a handle that is open.
    unsafe { WaitForSingleObject(handle, 0) == WAIT_OBJECT_0 }
}

/// Rounded up, and less than for ever.
fn milliseconds(time: Duration) -> u32 {
    u32::try_from(time.as_micros().div_ceil(1000)).map_or(INFINITE - 1, |ms| ms.min(INFINITE - 1))
}
