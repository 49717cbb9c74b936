//! Linux.

pub mod address_space;
pub mod clock;
pub mod event;
pub mod executable;
pub mod handle;
pub mod library;
pub mod memory;
pub mod processors;
pub mod quota;
pub mod section;
pub mod thread;
pub mod window_server;

/// Whether [`handle`]'s handles are file descriptors.
pub const HAS_DESCRIPTORS: bool = true;

/// Whether windows are those of X11 and Wayland.
pub const HAS_X11_AND_WAYLAND: bool = true;

/// Whether handles and windows are those of Win32.
pub const HAS_WIN32: bool = false;

/// A requirement of the driver that this system lacks; `None` if it has all.
pub fn missing() -> Option<&'static str> {
    None
}
