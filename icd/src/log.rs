//! Messages for people: `TUFF_LOG=off|error|warn|info|debug` (default `error`), one line each on stderr.

#![forbid(unsafe_code)]

use std::sync::atomic::{AtomicU8, Ordering};

/// How much a message matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    Off,
    Error,
    Warn,
    Info,
    Debug,
}

/// The least important [`Level`] that is printed.
static THRESHOLD: AtomicU8 = AtomicU8::new(Level::Error as u8);

/// Prints messages up to this level from now on.
pub fn set_threshold(level: Level) {
    THRESHOLD.store(level as u8, Ordering::Relaxed);
}

/// Whether messages of this level are printed.
pub fn enabled(level: Level) -> bool {
    level as u8 <= THRESHOLD.load(Ordering::Relaxed)
}

/// Prints a message.
pub fn write(level: Level, message: &str) {
    if enabled(level) {
        eprintln!("tuff: {message}");
    }
}
