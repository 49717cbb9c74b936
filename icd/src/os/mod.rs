//! The operating system. No other module of this crate uses `libc` or `std::os`
//! (`xtask/tests/system.rs`).
//!
//! Each system has a folder with the same modules and items, and this file re-exports the target's
//! folder. The documentation of an item in [`unix`] is the contract for every system. There is no
//! dispatch at run time.
//!
//! | module | asks the system for |
//! | --- | --- |
//! | [`address_space`] | reserved ranges of pages, and their mappings |
//! | [`clock`] | monotonic time |
//! | [`event`] | flags that threads and processes wait for |
//! | [`executable`] | pages of native code |
//! | [`handle`] | handles that pass between drivers and processes: file descriptors on Linux |
//! | [`library`] | keeping this library loaded |
//! | [`memory`] | the machine's memory |
//! | [`processors`] | processor count and thread affinity |
//! | [`quota`] | limits of the process: control groups, job objects |
//! | [`section`] | memory that is mapped at several addresses or by several processes |
//! | [`thread`] | names of threads |
//! | [`window_server`] | memory and sockets of X11 and Wayland: Linux alone |
//! | `window` | windows, and pixels that are copied to them: Windows alone |
//!
//! [`missing`] is the reason why the driver cannot run on this system. [`HAS_DESCRIPTORS`] says
//! whether handles are file descriptors, as Vulkan's `_fd` extensions require,
//! [`HAS_X11_AND_WAYLAND`] whether there is a [`window_server`], and [`HAS_WIN32`] whether handles
//! and windows are those of Win32.
//!
//! No item uses Vulkan. A system error is `None`, `false` or [`Refused`](section::Refused), which
//! the caller maps to its own error.

use std::ptr::NonNull;
use std::sync::Once;

use spirv_jit::native::CodePages;

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

#[cfg(unix)]
pub use unix::*;
#[cfg(windows)]
pub use windows::*;

/// The code memory of the compiler.
// SAFETY: `executable::map` and `unmap` keep the trait's contract, as they document.
pub const CODE_PAGES: CodePages = unsafe { CodePages::new(map_code, executable::unmap) };

/// As [`executable::map`], and reports, once, that the system refuses executable pages.
fn map_code(code: &[u8]) -> Option<NonNull<u8>> {
    static ONCE: Once = Once::new();
    let pages = executable::map(code);
    if pages.is_none() {
        ONCE.call_once(|| {
            log::error!(
                "the system refuses executable pages, by a policy or for too little memory: \
                 shaders are interpreted, with the same results; TUFF_NATIVE=0 has the same effect \
                 without this line"
            );
        });
    }
    pages
}

#[cfg(test)]
mod tests;
