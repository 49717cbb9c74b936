//! The operating system.
//!
//! Each system has a folder with the same modules and items; this file re-exports the one that is
//! built. The documentation of an item in [`unix`] is the contract for every system. There is no
//! dispatch at run time.
//!
//! | module | asks the system for |
//! | --- | --- |
//! | [`clock`] | monotonic time |
//! | [`event`] | flags that threads and processes wait for |
//! | [`handle`] | handles that pass between drivers and processes: file descriptors |
//! | [`memory`] | the machine's memory |
//! | [`processors`] | processor count and thread affinity |
//! | [`quota`] | limits of the process: control groups, job objects |
//!
//! No item knows Vulkan. A refusal of the system is `None` or `false`, and the caller maps it to
//! its own error.

#[cfg(unix)]
mod unix;

#[cfg(unix)]
pub use unix::*;
