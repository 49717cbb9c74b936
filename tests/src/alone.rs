//! Tests that need a process of their own.

use std::process::Command;

/// Says that this process was started for one test.
const MARK: &str = "TUFF_TESTS_ALONE";

/// Runs one test of this program in a process of its own, with variables set that drivers read when
/// they are loaded; fails where it fails. True in that process: there the test goes on.
pub fn alone(test: &str, variables: &[(&str, &str)]) -> bool {
    if std::env::var_os(MARK).is_some() {
        return true;
    }
    let program = std::env::current_exe().expect("this program lies somewhere");
    let status = Command::new(program)
        .args(["--exact", test, "--nocapture"])
        .envs(variables.iter().copied())
        .env(MARK, "1")
        .status()
        .expect("it starts again");
    assert!(status.success(), "{test}: {status}");
    false
}
