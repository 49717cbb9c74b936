//! The operating system: no other file of this program names `libc` or `std::os`
//! (`xtask/tests/system.rs`).

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

#[cfg(unix)]
pub use unix::*;
#[cfg(windows)]
pub use windows::*;

/// A root key of Windows' registry.
#[cfg(any(windows, test))]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hive {
    /// `HKEY_LOCAL_MACHINE`, which only administrators can write.
    Machine,
    /// `HKEY_CURRENT_USER`.
    User,
}
