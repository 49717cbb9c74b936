//! The Present extension's events of a surface.
//!
//! Libxcb keeps them apart from the application's events. A thread waits for them, because only
//! libxcb knows which of the connection's threads reads what.

use std::ffi::c_void;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Weak};
use std::thread::JoinHandle;

use parking_lot::Mutex;
use x11rb::connection::Connection as _;
use x11rb::errors::ConnectionError;
use x11rb::protocol::present::{ConnectionExt as _, EventMask};
use x11rb::protocol::xproto::{ConnectionExt as _, CreateWindowAux, WindowClass};

use super::super::{Bell, Gone};
use super::connection::Connection;
use super::library::{self, SpecialEvents};

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
    /// The refresh in which it came ("media stream counter").
    pub msc: u64,
}

/// What is told of a window, and the thread that waits for it.
pub struct Events {
    line: Arc<Line>,
    thread: Mutex<Option<JoinHandle<()>>>,
    process: u32,
}

/// What is shared with the thread.
struct Line {
    connection: Arc<Connection>,
    window: u32,
    root: u32,
    /// The name by which the server tells.
    event: u32,
    special: *mut SpecialEvents,
    inboxes: Mutex<Vec<Weak<Inbox>>>,
    is_closing: AtomicBool,
    serial: AtomicU32,
}

// SAFETY: the queue of special events is only passed to libxcb, which locks its connection.
unsafe impl Send for Line {}
// SAFETY: as above.
unsafe impl Sync for Line {}

impl Events {
    /// The events of a window on the screen of `root`, and their thread.
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
            is_closing: AtomicBool::new(false),
            serial: AtomicU32::new(FIRST_SERIAL),
        });
        let mask = EventMask::COMPLETE_NOTIFY;
        let selected = connection.x.present_select_input(event, window, mask);
        selected.map_err(|_| Gone)?.check().map_err(|_| Gone)?;
        let shared = Arc::clone(&line);
        let thread = std::thread::Builder::new()
            .name("tuff-x11".to_owned())
            .spawn(move || shared.run())
            .map_err(|_| Gone)?;
        Ok(Self {
            line,
            thread: Mutex::new(Some(thread)),
            process: std::process::id(),
        })
    }

    /// A number for a frame that no other one of the surface has.
    pub fn serial(&self) -> u32 {
        self.line.serial.fetch_add(1, Ordering::Relaxed)
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
        self.line.is_closing.store(true, Ordering::Release);
        // If the connection is broken, the thread has ended.
        let helper = self.line.wake();
        if let Some(thread) = thread {
            // A panic on the thread was logged when it happened.
            let _ = thread.join();
        }
        if let Ok(helper) = helper
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
        loop {
            // SAFETY: the connection is open as long as the surface lives, and the surface waits
            // for this thread.
            let event = unsafe { (xcb.wait_for_special_event)(self.connection.raw, self.special) };
            if event.is_null() {
                return self.tell(|inbox| inbox.is_broken.store(true, Ordering::Release));
            }
            // SAFETY: an event of Present's that libxcb has allocated, freed once.
            let completed = unsafe {
                let completed = completed_pixmap(event.cast());
                libc::free(event);
                completed
            };
            if self.is_closing.load(Ordering::Acquire) {
                return;
            }
            if let Some(completed) = completed {
                self.tell(|inbox| inbox.completed.lock().push(completed));
            }
        }
    }

    /// Makes an event, so that the thread wakes. A window that has died has none any more, but its
    /// name for events is free then, and another window takes it; the window is returned.
    fn wake(&self) -> Result<u32, Gone> {
        let helper = self.connection.id()?;
        self.wake_by(helper).map_err(|_| Gone)?;
        Ok(helper)
    }

    fn wake_by(&self, helper: u32) -> Result<(), ConnectionError> {
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
            inbox.bell.ring();
        }
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        if let Some(xcb) = library::xcb() {
            // SAFETY: registered on this connection, once; nobody waits any more.
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

/// What a `PresentCompleteNotify` of a pixmap says (presentproto.txt, section 8; libxcb puts a word
/// behind the first 32 bytes).
///
/// # Safety
/// `event` is a generic event of the Present extension as libxcb gives it.
unsafe fn completed_pixmap(event: *const c_void) -> Option<Completed> {
    const COMPLETE_NOTIFY: u16 = 1;
    const OF_PIXMAP: u8 = 0;
    let event = event.cast::<u8>();
    // SAFETY: the first 32 bytes are there in every event; `msc`, behind libxcb's word, in this
    // one.
    unsafe {
        let is_completion = event.add(8).cast::<u16>().read_unaligned() == COMPLETE_NOTIFY;
        let of_pixmap = event.add(10).read() == OF_PIXMAP;
        (is_completion && of_pixmap).then(|| Completed {
            serial: event.add(20).cast::<u32>().read_unaligned(),
            msc: event.add(36).cast::<u64>().read_unaligned(),
        })
    }
}
