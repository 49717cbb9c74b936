//! Windows 10, version 1803, and later.

pub mod address_space;
pub mod clock;
pub mod event;
pub mod executable;
pub mod handle;
pub mod library;
pub mod memory;
mod placeholder;
pub mod processors;
pub mod quota;
pub mod section;
pub mod thread;
pub mod window;

pub const HAS_DESCRIPTORS: bool = false;
pub const HAS_X11_AND_WAYLAND: bool = false;
pub const HAS_WIN32: bool = true;

/// A requirement of the driver that this system lacks; `None` if it has all.
pub fn missing() -> Option<&'static str> {
    match placeholder::Functions::of_system() {
        Some(_) => None,
        None => Some("Windows 10, version 1803, or later: kernelbase.dll lacks VirtualAlloc2"),
    }
}
