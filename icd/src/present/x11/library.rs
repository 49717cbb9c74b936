//! The C libraries of X11, opened when a window is first used. `x11rb` opens the functions that it
//! calls itself; these are the others.

use std::ffi::{c_char, c_int, c_void};
use std::sync::OnceLock;

use libloading::Library;

/// `xcb_extension_t` (xcbext.h). Libxcb numbers extensions by it, under its own lock.
#[repr(C)]
pub struct Extension {
    name: *const c_char,
    global_id: c_int,
}

/// A queue of special events.
#[repr(C)]
pub struct SpecialEvents {
    _opaque: [u8; 0],
}

type Register =
    unsafe extern "C" fn(*mut c_void, *mut Extension, u32, *mut u32) -> *mut SpecialEvents;
type Unregister = unsafe extern "C" fn(*mut c_void, *mut SpecialEvents);
type Wait = unsafe extern "C" fn(*mut c_void, *mut SpecialEvents) -> *mut c_void;

/// Functions of libxcb.
pub struct Xcb {
    _library: Library,
    pub register_for_special_xge: Register,
    pub unregister_for_special_event: Unregister,
    pub wait_for_special_event: Wait,
}

/// Libxcb, if it is installed.
pub fn xcb() -> Option<&'static Xcb> {
    static XCB: OnceLock<Option<Xcb>> = OnceLock::new();
    // SAFETY: the application has loaded the library already, so opening it runs no initialisation,
    // and the functions have these types (xcb.h, xcbext.h).
    let open = || unsafe {
        let library = Library::new("libxcb.so.1").ok()?;
        let xcb = Xcb {
            register_for_special_xge: *library.get(b"xcb_register_for_special_xge\0").ok()?,
            unregister_for_special_event: *library
                .get(b"xcb_unregister_for_special_event\0")
                .ok()?,
            wait_for_special_event: *library.get(b"xcb_wait_for_special_event\0").ok()?,
            _library: library,
        };
        x11rb::xcb_ffi::load_libxcb().ok()?;
        Some(xcb)
    };
    XCB.get_or_init(open).as_ref()
}

/// `&xcb_present_id`, without libxcb-present.
pub fn present_extension() -> *mut Extension {
    struct Present(std::cell::UnsafeCell<Extension>);
    // SAFETY: only libxcb reads and writes it, under its lock.
    unsafe impl Sync for Present {}
    static PRESENT: Present = Present(std::cell::UnsafeCell::new(Extension {
        name: c"Present".as_ptr(),
        global_id: 0,
    }));
    PRESENT.0.get()
}

/// The connection of an Xlib display (`XGetXCBConnection`).
///
/// # Safety
/// `display` is a `Display *` that is open.
pub unsafe fn connection_of(display: *mut c_void) -> Option<*mut c_void> {
    type Get = unsafe extern "C" fn(*mut c_void) -> *mut c_void;
    static XLIB: OnceLock<Option<(Library, Get)>> = OnceLock::new();
    // SAFETY: as for libxcb (Xlib-xcb.h).
    let open = || unsafe {
        let library = Library::new("libX11-xcb.so.1").ok()?;
        let get = *library.get::<Get>(b"XGetXCBConnection\0").ok()?;
        Some((library, get))
    };
    let (_, get) = XLIB.get_or_init(open).as_ref()?;
    // SAFETY: the caller passes an open display.
    let connection = unsafe { get(display) };
    (!connection.is_null()).then_some(connection)
}
