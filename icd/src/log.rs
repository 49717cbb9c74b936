//! Messages for people: `TUFF_LOG=error|warn|info|debug` (default `error`), one line each on stderr.

#![forbid(unsafe_code)]

use std::sync::OnceLock;

/// How much a message matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    Off,
    Error,
    Warn,
    Info,
    Debug,
}

fn threshold() -> Level {
    static THRESHOLD: OnceLock<Level> = OnceLock::new();
    *THRESHOLD.get_or_init(|| match std::env::var("TUFF_LOG").as_deref() {
        Ok("off") => Level::Off,
        Ok("warn") => Level::Warn,
        Ok("info") => Level::Info,
        Ok("debug") => Level::Debug,
        _ => Level::Error,
    })
}

/// Whether messages of this level are printed.
pub fn enabled(level: Level) -> bool {
    level <= threshold()
}

/// Prints a message.
pub fn write(level: Level, message: &str) {
    if enabled(level) {
        eprintln!("tuff: {message}");
    }
}
