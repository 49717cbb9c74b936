//! Output with a reader that stops early: `tuff info | head`.

#![cfg(unix)]

use std::os::unix::process::ExitStatusExt;
use std::process::Command;

#[test]
fn a_reader_that_has_gone_ends_it_without_a_word() {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let mut program = Command::new(env!("CARGO_BIN_EXE_tuff"));
    let output = program.arg("info").stdout(writer).output();
    let output = output.expect("the program starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.signal(), Some(libc::SIGPIPE), "{said}");
    assert_eq!(said, "");
}
