//! The test that `cargo test` finds.

use std::process::ExitCode;

fn main() -> ExitCode {
    by_hand::name_the_command()
}
