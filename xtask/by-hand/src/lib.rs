//! The workspace's only default member: `cargo test` by hand builds this and nothing else. The
//! tests need a driver that is built in release mode, a loader that is pointed at it, and packages
//! of the system, which `cargo xtask test` looks after.

use std::process::ExitCode;

/// Names the command to type. No test ran, which must not look like success.
pub fn name_the_command() -> ExitCode {
    eprintln!(
        "run `cargo xtask test`: it builds the driver and runs every test (`cargo xtask --help` lists what else there is)"
    );
    ExitCode::FAILURE
}
