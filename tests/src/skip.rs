//! Tests that need what a device or a machine may lack: they say so, and are counted, so that "ok"
//! cannot mean "not run".

use std::fs::OpenOptions;
use std::io::Write;
use std::panic::Location;

/// Names a file that gets a line for each test that does not run.
const LIST: &str = "TUFF_TEST_SKIPS";

/// Whether the device has what a test needs. If not, the test says so here, and ends.
#[track_caller]
pub fn has(what: &str, there: bool) -> bool {
    if !there {
        note("skipped", what, Location::caller());
    }
    there
}

/// Whether the machine has a program that a test needs. If not, the test says so here, and ends. A
/// machine without optional programs tests the driver well enough: `cargo xtask test` succeeds.
#[track_caller]
pub fn has_program(what: &str, there: bool) -> bool {
    if !there {
        note("not installed", what, Location::caller());
    }
    there
}

fn note(why: &str, what: &str, place: &Location<'_>) {
    let thread = std::thread::current();
    // Tests are threads of their name, unless there is one thread only.
    let test = match thread.name() {
        Some(name) if name != "main" => name.to_owned(),
        _ => format!("{}:{}", place.file(), place.line()),
    };
    let line = format!("{why}: {test} needs {what}\n");
    // The test program keeps what passing tests print, but not what is written past it.
    let _ = std::io::stderr().write_all(line.as_bytes());
    if let Some(list) = std::env::var_os(LIST)
        && let Ok(mut file) = OpenOptions::new().append(true).create(true).open(list)
    {
        let _ = file.write_all(line.as_bytes());
    }
}
