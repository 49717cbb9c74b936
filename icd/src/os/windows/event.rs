//! Events: flags that threads and processes wait for.

use std::os::windows::io::AsRawHandle;
use std::time::{Duration, Instant};

use windows_sys::Win32::Foundation::{
    ERROR_INVALID_HANDLE, ERROR_SUCCESS, GetLastError, HANDLE, SetLastError, WAIT_OBJECT_0,
    WAIT_TIMEOUT,
};
use windows_sys::Win32::System::Threading::{
    CREATE_WAITABLE_TIMER_HIGH_RESOLUTION, CreateEventW, CreateWaitableTimerExW,
    EVENT_MODIFY_STATE, INFINITE, OpenEventW, ResetEvent, SYNCHRONIZATION_SYNCHRONIZE, SetEvent,
    SetWaitableTimer, TIMER_ALL_ACCESS, WaitForMultipleObjects, WaitForSingleObject,
};

use super::handle::{BorrowedHandle, Handle, RawHandle, Rights, Sharing, pointer_to};
use super::placeholder::function_of;
use super::section::Refused;

/// `EVENT_QUERY_STATE`, for [`is_event`].
const EVENT_QUERY_STATE: u32 = 1;

/// The rights that drivers need: to set, clear and wait for an event.
const NEEDS: u32 = EVENT_QUERY_STATE | EVENT_MODIFY_STATE | SYNCHRONIZATION_SYNCHRONIZE;

/// A flag that stays set until it is cleared.
#[derive(Debug)]
pub struct Event {
    handle: Handle,
    /// The sharing of handles for other users.
    rights: Rights,
}

impl Event {
    /// Creates an event; `None` if the process cannot have more handles.
    pub fn new(is_signaled: bool) -> Option<Self> {
        Self::exportable(is_signaled, &Sharing::default()).ok()
    }

    /// Creates an event for other devices and processes.
    ///
    /// # Errors
    /// The system refuses.
    pub fn exportable(is_signaled: bool, sharing: &Sharing) -> Result<Self, Refused> {
        const MANUAL_RESET: i32 = 1;
        let attributes = sharing.attributes();
        let security = pointer_to(attributes.as_ref());
        // SAFETY: a plain system calls; the handle is owned from its creation on.
        let handle = unsafe {
            SetLastError(ERROR_SUCCESS);
            let event = CreateEventW(security, MANUAL_RESET, is_signaled.into(), sharing.name());
            Handle::new_object(event).ok_or_else(|| match GetLastError() {
                // An object of another type has the name.
                ERROR_INVALID_HANDLE => Refused::Name,
                _ => Refused::Handles,
            })
        };
        Ok(Self {
            handle: handle?.ok_or(Refused::Name)?,
            rights: sharing.rights(),
        })
    }

    /// An event of another device or process.
    pub fn from_handle(handle: Handle) -> Self {
        let rights = Rights::default();
        Self { handle, rights }
    }

    #[cfg(test)]
    pub fn handle(&self) -> &Handle {
        &self.handle
    }

    /// A new handle for other users; `None` if the process cannot have more.
    pub fn export(&self) -> Option<Handle> {
        self.handle.share(NEEDS, self.rights)
    }

    /// Sets the flag, and wakes its waiters.
    pub fn signal(&self) {
        // SAFETY: an event that is open.
        unsafe { SetEvent(self.handle.raw()) };
    }

    /// Whether the flag is set. Does not wait.
    pub fn is_signaled(&self) -> bool {
        is_signaled(self.handle.raw())
    }

    /// Clears the flag.
    pub fn clear(&self) {
        // SAFETY: an event that is open.
        unsafe { ResetEvent(self.handle.raw()) };
    }

    /// Sleeps until the flag is set, `beside` is signaled, or the deadline has passed. Returns
    /// whether `beside` is signaled. Clears the flag.
    pub fn wait(&self, deadline: Option<Instant>, beside: Option<BorrowedHandle<'_>>) -> bool {
        let beside = beside.map(|handle| handle.as_raw_handle());
        loop {
            let alarm = deadline.and_then(Alarm::at);
            let all = [
                Some(self.handle.raw()),
                beside,
                alarm.as_ref().map(Alarm::raw),
            ];
            let mut handles = [std::ptr::null_mut(); 3];
            let mut count = 0;
            for handle in all.into_iter().flatten() {
                handles[count as usize] = handle;
                count += 1;
            }
            let left = deadline.map(|deadline| deadline.saturating_duration_since(Instant::now()));
            let timeout_ms = left.map_or(INFINITE, milliseconds);
            // SAFETY: so many handles that are open.
            let why = unsafe { WaitForMultipleObjects(count, handles.as_ptr(), 0, timeout_ms) };
            // The clock of waits is coarser than that of the deadline.
            let is_early = deadline.is_some_and(|deadline| Instant::now() < deadline);
            let is_alarm = alarm.is_some() && why == WAIT_OBJECT_0 + count - 1;
            if !(why == WAIT_TIMEOUT || is_alarm) || !is_early {
                break;
            }
        }
        self.clear();
        beside.is_some_and(is_signaled)
    }
}

/// System timeouts end at clock ticks, some 16 ms apart. This timer, if the system has it, has a
/// resolution of half a millisecond.
struct Alarm(Handle);

impl Alarm {
    /// A timer for short waits; `None` for longer waits, which need none.
    fn at(deadline: Instant) -> Option<Self> {
        const NEAR: Duration = Duration::from_millis(100);
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() || left > NEAR {
            return None;
        }
        // Relative times are negative, in steps of 100 ns.
        let due = -(left.as_nanos().div_ceil(100) as i64);
        let (security, name) = (std::ptr::null(), std::ptr::null());
        // SAFETY: plain system calls; the handle is owned from its creation on.
        unsafe {
            let kind = CREATE_WAITABLE_TIMER_HIGH_RESOLUTION;
            let timer = CreateWaitableTimerExW(security, name, kind, TIMER_ALL_ACCESS);
            let timer = Handle::created(timer)?;
            let is_set = SetWaitableTimer(timer.raw(), &due, 0, None, std::ptr::null(), 0);
            (is_set != 0).then_some(Self(timer))
        }
    }

    fn raw(&self) -> HANDLE {
        self.0.raw()
    }
}

/// A handle of an event that another device or process exported, for [`Event::from_handle`].
/// `None` for other objects, and for events that clear themselves.
pub fn imported(raw: RawHandle) -> Option<Handle> {
    Handle::with_access(raw, NEEDS).filter(is_event)
}

/// As [`imported`], by a name.
///
/// # Safety
/// The name is null or ends with a zero.
pub unsafe fn named(name: *const u16) -> Option<Handle> {
    if name.is_null() {
        return None;
    }
    // SAFETY: a plain system call; the handle is owned from its creation on.
    unsafe { Handle::created(OpenEventW(NEEDS, 0, name)).filter(is_event) }
}

/// Whether a handle is one of an event that stays set until it is cleared.
fn is_event(handle: &Handle) -> bool {
    type NtQueryEvent = unsafe extern "system" fn(HANDLE, i32, *mut [i32; 2], u32, *mut u32) -> i32;
    const BASIC: i32 = 0;
    const NOTIFICATION: i32 = 0;
    // Its kind and its state.
    let mut facts = [-1; 2];
    // SAFETY: the type is that of the system's headers; the call fills eight bytes.
    unsafe {
        let query = function_of::<NtQueryEvent>(c"ntdll.dll", c"NtQueryEvent");
        let answer =
            query.map(|query| query(handle.raw(), BASIC, &mut facts, 8, std::ptr::null_mut()));
        answer.is_some_and(|code| code >= 0) && facts[0] == NOTIFICATION
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_events_that_stay_set_are_imported() {
        let event = Event::new(false).unwrap();
        assert!(imported(event.handle().raw()).is_some());
        let section = super::super::section::Section::exportable(4096, &Sharing::default());
        assert!(imported(section.unwrap().handle().unwrap().raw()).is_none());
        for number in [0, -1, -2, 0x7fff_fff0_isize] {
            assert!(imported(number as HANDLE).is_none(), "{number}");
        }
        // SAFETY: plain system calls; the handle is owned from its creation on.
        let own = unsafe {
            let event = CreateEventW(std::ptr::null(), 0, 0, std::ptr::null());
            Handle::created(event).unwrap()
        };
        assert!(imported(own.raw()).is_none());
    }

    #[test]
    fn names_are_taken_once_and_found() {
        let name = format!("tuff event {}", std::process::id());
        let name: Vec<u16> = name.encode_utf16().chain([0]).collect();
        // SAFETY: the name ends with a zero.
        let sharing = unsafe { Sharing::new(std::ptr::null(), name.as_ptr(), 0) };
        let event = Event::exportable(false, &sharing).unwrap();
        assert_eq!(
            Event::exportable(false, &sharing).err(),
            Some(Refused::Name)
        );
        // SAFETY: the name ends with a zero.
        let other = Event::from_handle(unsafe { named(name.as_ptr()) }.unwrap());
        other.signal();
        assert!(event.is_signaled());
        drop((event, other));
        // SAFETY: the name ends with a zero.
        assert!(unsafe { named(name.as_ptr()) }.is_none());
    }

    #[test]
    fn handles_for_others_have_what_drivers_need() {
        const GENERIC_READ: u32 = 1 << 31;
        // SAFETY: no attributes and no name.
        let sharing = unsafe { Sharing::new(std::ptr::null(), std::ptr::null(), GENERIC_READ) };
        let event = Event::exportable(false, &sharing).unwrap();
        let given = event.export().unwrap();
        let other = Event::from_handle(imported(given.raw()).unwrap());
        other.signal();
        assert!(event.is_signaled());
    }
}
