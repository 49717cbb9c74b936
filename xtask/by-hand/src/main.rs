//! The program that `cargo run` finds.

use std::process::ExitCode;

fn main() -> ExitCode {
    by_hand::name_the_command()
}
