//! The Present extension's events of a surface.
//!
//! Libxcb keeps them apart from the application's events. A thread waits for them, because libxcb
//! decides which thread reads the connection. The thread reads only while frames are in flight: it
//! may also read events of the application, whose pollers must be woken afterwards.

use std::ffi::c_void;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Weak};
use std::thread::JoinHandle;

use parking_lot::{Condvar, Mutex};
use x11rb::connection::Connection as _;
use x11rb::errors::ConnectionError;
use x11rb::protocol::present::{ConnectionExt as _, EventMask};
use x11rb::protocol::xproto::{ConnectionExt as _, CreateWindowAux, WindowClass};

use super::super::{SurfaceLost, WakeEvent};
use super::connection::Connection;
use super::library::{self, SpecialEvents};
use crate::os::window_server;

/// The completed frames of a screen.
pub struct Inbox {
    pub wake: Arc<WakeEvent>,
    /// Frames that the server has shown or skipped.
    pub completed: Mutex<Vec<Completed>>,
    pub is_broken: AtomicBool,
}

/// The serial before the first frame's. Other libraries may present to the window, too, and are
/// likely to count from small numbers.
const FIRST_SERIAL: u32 = 0x5475_0000;

/// The completion of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Completed {
    pub serial: u32,
    /// The time by the server's clock, in microseconds ("unadjusted system time").
    pub ust: u64,
    /// The number of the refresh ("media stream counter").
    pub msc: u64,
}

/// The events of a window, and the thread that waits for them.
pub struct Events {
    queue: Arc<EventQueue>,
    thread: Mutex<Option<JoinHandle<()>>>,
    process: u32,
}

/// State shared with the thread.
struct EventQueue {
    connection: Arc<Connection>,
    window: u32,
    root: u32,
    /// The id of the event registration.
    event: u32,
    special: *mut SpecialEvents,
    inboxes: Mutex<Vec<Weak<Inbox>>>,
    state: Mutex<FrameState>,
    /// Signaled when there is a frame to wait for, and at the end.
    changed: Condvar,
}

struct FrameState {
    /// The last frame's serial.
    serial: u32,
    /// Serials of the frames in flight.
    under_way: Vec<u32>,
    /// The last frame that was given up, while the server may still show it.
    forgotten: Option<u32>,
    is_closing: bool,
    /// The thread waits for an event, or has not read this state since.
    is_reading: bool,
    /// An event was requested to end the thread's wait.
    is_interrupted: bool,
    /// An invisible window, which delivers events when the surface's window is destroyed.
    helper: Option<u32>,
}

// SAFETY: the pointer is only passed to libxcb, which locks its connection.
unsafe impl Send for EventQueue {}
// SAFETY: as for `Send`.
unsafe impl Sync for EventQueue {}

impl Events {
    /// Registers for the events of a window on the screen of `root`. The thread starts with the
    /// first frame.
    ///
    /// # Errors
    /// The connection is broken, or the server refuses the registration.
    pub fn new(connection: &Arc<Connection>, window: u32, root: u32) -> Result<Self, SurfaceLost> {
        let event = connection.id()?;
        let xcb = library::xcb().ok_or(SurfaceLost)?;
        // SAFETY: the connection is open, and the arguments have the types of xcb.h.
        let special = unsafe {
            let extension = library::present_extension();
            (xcb.register_for_special_xge)(connection.raw, extension, event, std::ptr::null_mut())
        };
        if special.is_null() {
            return Err(SurfaceLost);
        }
        let queue = Arc::new(EventQueue {
            connection: Arc::clone(connection),
            window,
            root,
            event,
            special,
            inboxes: Mutex::default(),
            state: Mutex::new(FrameState {
                serial: FIRST_SERIAL,
                under_way: Vec::new(),
                forgotten: None,
                is_closing: false,
                is_reading: false,
                is_interrupted: false,
                helper: None,
            }),
            changed: Condvar::new(),
        });
        let mask = EventMask::COMPLETE_NOTIFY;
        let selected = connection.x.present_select_input(event, window, mask);
        selected
            .map_err(|_| SurfaceLost)?
            .check()
            .map_err(|_| SurfaceLost)?;
        Ok(Self {
            queue,
            thread: Mutex::new(None),
            process: std::process::id(),
        })
    }

    /// Returns a serial for a frame, unique within the surface. The thread waits for the frame's
    /// completion from now on.
    ///
    /// # Errors
    /// The thread cannot be started.
    pub fn begin(&self) -> Result<u32, SurfaceLost> {
        self.start_thread()?;
        let mut state = self.queue.state.lock();
        state.serial = state.serial.wrapping_add(1);
        let serial = state.serial;
        state.under_way.push(serial);
        self.queue.changed.notify_one();
        Ok(serial)
    }

    /// Starts the thread, unless it runs.
    fn start_thread(&self) -> Result<(), SurfaceLost> {
        let mut thread = self.thread.lock();
        if thread.is_none() {
            let shared = Arc::clone(&self.queue);
            let started = std::thread::Builder::new()
                .name("tuff-x11".to_owned())
                .spawn(move || shared.run())
                .map_err(|_| SurfaceLost)?;
            *thread = Some(started);
        }
        Ok(())
    }

    /// Whether other frames than these may be in flight. The server shows each at its own time: a
    /// frame that is shown at once would overtake them, and they would cover it later.
    pub fn has_others(&self, own: impl Fn(u32) -> bool) -> bool {
        let state = self.queue.state.lock();
        state.forgotten.is_some() || state.under_way.iter().any(|&serial| !own(serial))
    }

    /// Notes that a frame was shown at its refresh, which means that all earlier frames were shown,
    /// too.
    pub fn settle(&self, serial: u32) {
        let is_before = |other: &mut u32| serial.wrapping_sub(*other) < u32::MAX / 2;
        self.queue.state.lock().forgotten.take_if(is_before);
    }

    /// Stops waiting for a frame.
    pub fn forget(&self, serial: u32) {
        let mut state = self.queue.state.lock();
        let before = state.under_way.len();
        state.under_way.retain(|other| *other != serial);
        if state.under_way.len() < before {
            state.forgotten = state.forgotten.max(Some(serial));
        }
        if state.under_way.is_empty() && state.is_reading && self.process == std::process::id() {
            // If the connection is broken, the thread ends by itself.
            let _ = self.queue.interrupt(&mut state);
        }
    }

    /// Creates the inbox of a screen.
    pub fn inbox(&self, wake: &Arc<WakeEvent>) -> Arc<Inbox> {
        let inbox = Arc::new(Inbox {
            wake: Arc::clone(wake),
            completed: Mutex::default(),
            is_broken: AtomicBool::new(false),
        });
        let mut inboxes = self.queue.inboxes.lock();
        inboxes.retain(|inbox| inbox.strong_count() > 0);
        inboxes.push(Arc::downgrade(&inbox));
        inbox
    }
}

impl Drop for Events {
    fn drop(&mut self) {
        let thread = self.thread.get_mut().take();
        if self.process != std::process::id() {
            // A forked child has neither the thread nor a connection of its own.
            std::mem::forget(thread);
            return;
        }
        {
            let mut state = self.queue.state.lock();
            state.is_closing = true;
            self.queue.changed.notify_one();
            if state.is_reading {
                // If the connection is broken, the thread ends by itself.
                let _ = self.queue.interrupt(&mut state);
            }
        }
        if let Some(thread) = thread {
            // A panic on the thread was logged when it happened.
            let _ = thread.join();
        }
        if let Some(helper) = self.queue.state.lock().helper
            && let Ok(cookie) = self.queue.connection.x.destroy_window(helper)
        {
            cookie.ignore_error();
        }
    }
}

impl EventQueue {
    fn run(&self) {
        let Some(xcb) = library::xcb() else {
            return;
        };
        while self.has_frames() {
            // SAFETY: the connection is open as long as the surface lives, and the surface joins
            // this thread.
            let event = unsafe { (xcb.wait_for_special_event)(self.connection.raw, self.special) };
            if event.is_null() {
                return self.tell(|inbox| inbox.is_broken.store(true, Ordering::Release));
            }
            // SAFETY: libxcb has allocated the event, which is one of the Present extension; it is
            // freed once.
            let completed = unsafe {
                let completed = completed_pixmap(event.cast());
                window_server::free(event);
                completed
            };
            if let Some(completed) = completed {
                let mut state = self.state.lock();
                state.under_way.retain(|other| *other != completed.serial);
                drop(state);
                self.tell(|inbox| inbox.completed.lock().push(completed));
            }
        }
    }

    /// Sleeps until frames are in flight, and returns true; returns false at the end.
    fn has_frames(&self) -> bool {
        let mut state = self.state.lock();
        if std::mem::take(&mut state.is_interrupted) {
            // If the wake-up fails, nothing retries it. The next present reports the lost
            // connection.
            let _ = self.connection.wake_pollers();
        }
        state.is_reading = false;
        while state.under_way.is_empty() && !state.is_closing {
            self.changed.wait(&mut state);
        }
        state.is_reading = !state.is_closing;
        state.is_reading
    }

    /// Requests an event, so that the thread reads the state. A destroyed window gets none, but its
    /// event id is free then and the helper takes it.
    fn interrupt(&self, state: &mut FrameState) -> Result<(), SurfaceLost> {
        let helper = match state.helper {
            Some(helper) => helper,
            None => *state.helper.insert(self.connection.id()?),
        };
        state.is_interrupted = true;
        self.interrupt_by(helper).map_err(|_| SurfaceLost)
    }

    /// Creates the helper window, unless it exists, and requests an event of both windows.
    fn interrupt_by(&self, helper: u32) -> Result<(), ConnectionError> {
        let x = &self.connection.x;
        let look = CreateWindowAux::new().override_redirect(1);
        let class = WindowClass::INPUT_ONLY;
        x.create_window(0, helper, self.root, -1, -1, 1, 1, 0, class, 0, &look)?
            .ignore_error();
        let mask = EventMask::COMPLETE_NOTIFY;
        x.present_select_input(self.event, helper, mask)?
            .ignore_error();
        for window in [self.window, helper] {
            x.present_notify_msc(window, 0, 0, 0, 0)?.ignore_error();
        }
        x.flush()
    }

    fn tell(&self, what: impl Fn(&Inbox)) {
        for inbox in self.inboxes.lock().iter().filter_map(Weak::upgrade) {
            what(&inbox);
            inbox.wake.signal();
        }
    }
}

impl Drop for EventQueue {
    fn drop(&mut self) {
        if let Some(xcb) = library::xcb() {
            // SAFETY: the registration is one on this connection, removed once, and no thread waits
            // any more.
            unsafe { (xcb.unregister_for_special_event)(self.connection.raw, self.special) };
        }
        let nothing = EventMask::NO_EVENT;
        let x = &self.connection.x;
        if let Ok(cookie) = x.present_select_input(self.event, self.window, nothing) {
            cookie.ignore_error();
        }
        let _ = self.connection.flush();
    }
}

/// Decodes a `PresentCompleteNotify` of a pixmap (presentproto.txt, section 8; libxcb puts a word
/// behind the first 32 bytes).
///
/// # Safety
/// `event` is a generic event of the Present extension as libxcb gives it.
unsafe fn completed_pixmap(event: *const c_void) -> Option<Completed> {
    const COMPLETE_NOTIFY: u16 = 1;
    const OF_PIXMAP: u8 = 0;
    let event = event.cast::<u8>();
    // SAFETY: every event has the first 32 bytes, of which `ust` is the last member; this kind of
    // event also has `msc` after libxcb's word.
    unsafe {
        let is_completion = event.add(8).cast::<u16>().read_unaligned() == COMPLETE_NOTIFY;
        let of_pixmap = event.add(10).read() == OF_PIXMAP;
        (is_completion && of_pixmap).then(|| Completed {
            serial: event.add(20).cast::<u32>().read_unaligned(),
            ust: event.add(24).cast::<u64>().read_unaligned(),
            msc: event.add(36).cast::<u64>().read_unaligned(),
        })
    }
}
