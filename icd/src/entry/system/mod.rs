//! Entry points and clocks of one operating system: the only such code outside of [`os`](crate::os)
//! and [`present`](crate::present).

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

#[cfg(unix)]
pub use unix::*;
#[cfg(windows)]
pub use windows::*;
