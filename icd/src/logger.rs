//! Messages for people, as `TUFF_LOG` asks for them (by default errors), one line each on stderr.
//! `error`: what failed that should not; `warn`: what a user should know, commands that were
//! refused; `info`: devices and their tiers; `debug`: shaders that are compiled.

#![forbid(unsafe_code)]

use log::{LevelFilter, Log, Metadata, Record};

struct Stderr;

impl Log for Stderr {
    fn enabled(&self, _: &Metadata<'_>) -> bool {
        true
    }

    fn log(&self, record: &Record<'_>) {
        eprintln!("tuff: {}", record.args());
    }

    fn flush(&self) {}
}

/// Prints errors from now on, until the settings are known. (The crate's statics are this library's
/// own: the application's logger is another.)
pub fn start() {
    if log::set_logger(&Stderr).is_ok() {
        log::set_max_level(LevelFilter::Error);
    }
}
