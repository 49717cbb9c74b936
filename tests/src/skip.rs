//! Tests that need what a device may lack: they say so, and are counted, so that "ok" cannot mean
//! "not run".

use std::fs::OpenOptions;
use std::io::Write;
use std::panic::Location;

/// Names a file that gets a line for each test that does not run.
const LIST: &str = "TUFF_TEST_SKIPS";

/// Whether something that a test needs is there; where it is not, the test ends, and says so here.
#[track_caller]
pub fn has(what: &str, there: bool) -> bool {
    if !there {
        note(what, Location::caller());
    }
    there
}

fn note(what: &str, place: &Location<'_>) {
    let thread = std::thread::current();
    // Tests are threads of their name, unless there is one thread only.
    let test = match thread.name() {
        Some(name) if name != "main" => name.to_owned(),
        _ => format!("{}:{}", place.file(), place.line()),
    };
    let line = format!("skipped: {test} needs {what}\n");
    // The test program keeps what passing tests print, but not what is written past it.
    let _ = std::io::stderr().write_all(line.as_bytes());
    if let Some(list) = std::env::var_os(LIST)
        && let Ok(mut file) = OpenOptions::new().append(true).create(true).open(list)
    {
        let _ = file.write_all(line.as_bytes());
    }
}
