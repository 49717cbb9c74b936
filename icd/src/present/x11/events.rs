//! The Present extension's events of a surface.
//!
//! Libxcb keeps them apart from the application's events. A thread waits for them, because only
//! libxcb knows which of the connection's threads reads what. It reads only while the server has
//! frames: what it takes from the socket may be the application's, and who polls that has to be
//! woken afterwards.

use std::ffi::c_void;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Weak};
use std::thread::JoinHandle;

use parking_lot::{Condvar, Mutex};
use x11rb::connection::Connection as _;
use x11rb::errors::ConnectionError;
use x11rb::protocol::present::{ConnectionExt as _, EventMask};
use x11rb::protocol::xproto::{ConnectionExt as _, CreateWindowAux, WindowClass};

use super::super::{Bell, Gone};
use super::connection::Connection;
use super::library::{self, SpecialEvents};
use crate::os::window_server;

/// Where a screen finds out which of its frames have had their turn.
pub struct Inbox {
    pub bell: Arc<Bell>,
    /// Frames whose turn has come.
    pub completed: Mutex<Vec<Completed>>,
    pub is_broken: AtomicBool,
}

/// Other libraries may present to the window, too, and are likely to count from small numbers.
const FIRST_SERIAL: u32 = 0x5475_0000;

/// A frame's turn has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Completed {
    pub serial: u32,
    /// When it came, by the server's clock, in microseconds ("unadjusted system time").
    pub ust: u64,
    /// The refresh in which it came ("media stream counter").
    pub msc: u64,
}

/// Events of a window, and the thread that waits for them.
pub struct Events {
    line: Arc<Line>,
    thread: Mutex<Option<JoinHandle<()>>>,
    process: u32,
}

/// State shared with the thread.
struct Line {
    connection: Arc<Connection>,
    window: u32,
    root: u32,
    /// The name by which the server tells.
    event: u32,
    special: *mut SpecialEvents,
    inboxes: Mutex<Vec<Weak<Inbox>>>,
    state: Mutex<State>,
    /// Rung when there is something to wait for, or the end has come.
    changed: Condvar,
}

struct State {
    /// The last frame's number.
    serial: u32,
    /// Frames that the server has.
    under_way: Vec<u32>,
    /// The last frame that was forgotten, while the server may still have it.
    forgotten: Option<u32>,
    is_closing: bool,
    /// The thread waits for an event, or has not yet looked at this state since.
    is_reading: bool,
    /// An event was made to end the thread's waiting.
    is_interrupted: bool,
    /// A window that is never seen, of which events can be had when the surface's has died.
    helper: Option<u32>,
}

// SAFETY: the queue of special events is only passed to libxcb, which locks its connection.
unsafe impl Send for Line {}
// SAFETY: as above.
unsafe impl Sync for Line {}

impl Events {
    /// The events of a window on the screen of `root`. Their thread starts with the first frame.
    ///
    /// # Errors
    /// The connection is broken, or the server refuses.
    pub fn new(connection: &Arc<Connection>, window: u32, root: u32) -> Result<Self, Gone> {
        let event = connection.id()?;
        let xcb = library::xcb().ok_or(Gone)?;
        // SAFETY: the connection is open; the pointers are what the function wants.
        let special = unsafe {
            let extension = library::present_extension();
            (xcb.register_for_special_xge)(connection.raw, extension, event, std::ptr::null_mut())
        };
        if special.is_null() {
            return Err(Gone);
        }
        let line = Arc::new(Line {
            connection: Arc::clone(connection),
            window,
            root,
            event,
            special,
            inboxes: Mutex::default(),
            state: Mutex::new(State {
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
        selected.map_err(|_| Gone)?.check().map_err(|_| Gone)?;
        Ok(Self {
            line,
            thread: Mutex::new(None),
            process: std::process::id(),
        })
    }

    /// Returns a number for a frame, unique within the surface. From now on the thread waits for
    /// the frame's turn.
    ///
    /// # Errors
    /// The thread cannot be started.
    pub fn begin(&self) -> Result<u32, Gone> {
        self.start_thread()?;
        let mut state = self.line.state.lock();
        state.serial = state.serial.wrapping_add(1);
        let serial = state.serial;
        state.under_way.push(serial);
        self.line.changed.notify_one();
        Ok(serial)
    }

    /// Starts the thread, unless it runs.
    fn start_thread(&self) -> Result<(), Gone> {
        let mut thread = self.thread.lock();
        if thread.is_none() {
            let shared = Arc::clone(&self.line);
            let started = std::thread::Builder::new()
                .name("tuff-x11".to_owned())
                .spawn(move || shared.run())
                .map_err(|_| Gone)?;
            *thread = Some(started);
        }
        Ok(())
    }

    /// Whether the server may have frames beside these. It shows each at its own time: one that is
    /// to be shown at once overtakes them, and they cover it later.
    pub fn has_others(&self, own: impl Fn(u32) -> bool) -> bool {
        let state = self.line.state.lock();
        state.forgotten.is_some() || state.under_way.iter().any(|&serial| !own(serial))
    }

    /// A frame has been shown at its refresh, so all frames that the server had before it have been
    /// shown, too.
    pub fn settle(&self, serial: u32) {
        let is_before = |other: &mut u32| serial.wrapping_sub(*other) < u32::MAX / 2;
        self.line.state.lock().forgotten.take_if(is_before);
    }

    /// No longer waits for a frame.
    pub fn forget(&self, serial: u32) {
        let mut state = self.line.state.lock();
        let before = state.under_way.len();
        state.under_way.retain(|other| *other != serial);
        if state.under_way.len() < before {
            state.forgotten = state.forgotten.max(Some(serial));
        }
        if state.under_way.is_empty() && state.is_reading && self.process == std::process::id() {
            // If the connection is broken, the thread ends by itself.
            let _ = self.line.interrupt(&mut state);
        }
    }

    /// A new place to find completed frames in.
    pub fn inbox(&self, bell: &Arc<Bell>) -> Arc<Inbox> {
        let inbox = Arc::new(Inbox {
            bell: Arc::clone(bell),
            completed: Mutex::default(),
            is_broken: AtomicBool::new(false),
        });
        let mut inboxes = self.line.inboxes.lock();
        inboxes.retain(|inbox| inbox.strong_count() > 0);
        inboxes.push(Arc::downgrade(&inbox));
        inbox
    }
}

impl Drop for Events {
    fn drop(&mut self) {
        let thread = self.thread.get_mut().take();
        if self.process != std::process::id() {
            // A child of the process has neither the thread nor a connection of its own.
            std::mem::forget(thread);
            return;
        }
        {
            let mut state = self.line.state.lock();
            state.is_closing = true;
            self.line.changed.notify_one();
            if state.is_reading {
                // If the connection is broken, the thread ends by itself.
                let _ = self.line.interrupt(&mut state);
            }
        }
        if let Some(thread) = thread {
            // A panic on the thread was logged when it happened.
            let _ = thread.join();
        }
        if let Some(helper) = self.line.state.lock().helper
            && let Ok(cookie) = self.line.connection.x.destroy_window(helper)
        {
            cookie.ignore_error();
        }
    }
}

impl Line {
    fn run(&self) {
        let Some(xcb) = library::xcb() else {
            return;
        };
        while self.has_frames() {
            // SAFETY: the connection is open as long as the surface lives, and the surface waits
            // for this thread.
            let event = unsafe { (xcb.wait_for_special_event)(self.connection.raw, self.special) };
            if event.is_null() {
                return self.tell(|inbox| inbox.is_broken.store(true, Ordering::Release));
            }
            // SAFETY: an event of Present's that libxcb has allocated, freed once.
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

    /// Sleeps until the server has frames; whether it has, or else the end has come.
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

    /// Makes an event, so that the thread looks at the state. A window that has died has none any
    /// more, but its name for events is free then, and the helper takes it.
    fn interrupt(&self, state: &mut State) -> Result<(), Gone> {
        let helper = match state.helper {
            Some(helper) => helper,
            None => *state.helper.insert(self.connection.id()?),
        };
        state.is_interrupted = true;
        self.interrupt_by(helper).map_err(|_| Gone)
    }

    /// The helper is made where it is not there yet.
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
            inbox.bell.signal();
        }
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        if let Some(xcb) = library::xcb() {
            // SAFETY: registered on this connection, once; no thread waits any more.
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
    // SAFETY: the first 32 bytes are there in every event; `msc`, behind libxcb's word, in this
    // one, whose `ust` is the last of the first 32.
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
