//! How exact the float functions are: `cargo xtask precision [--step N] [--threads N] [--out FILE]`.
//!
//! Functions of one 32-bit float run over all 2^32 inputs (or over every N-th), those of a 16-bit float over all 65,536, those of
//! several over structured and random samples; each on the interpreter's best tier, each against a reference of 64 bits. An error past
//! what Vulkan allows, or past our own bound, fails the run.

mod functions;
mod kernel;
mod measure;
mod samples;
mod table;

use std::process::ExitCode;

fn main() -> ExitCode {
    let mut options = measure::Options::default();
    let mut out = None;
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--step" => options.step = number(arguments.next()),
            "--threads" => options.threads = number(arguments.next()) as usize,
            "--out" => out = arguments.next(),
            other => {
                eprintln!("unknown argument {other}");
                return ExitCode::FAILURE;
            }
        }
    }
    let rows = table::measure_all(&options);
    let text = table::render(&rows, &options);
    match out {
        Some(file) => std::fs::write(&file, text).unwrap_or_else(|error| panic!("{file}: {error}")),
        None => print!("{text}"),
    }
    let mut outside = rows.iter().filter(|row| !row.holds()).peekable();
    if outside.peek().is_none() {
        return ExitCode::SUCCESS;
    }
    for row in outside {
        eprintln!("{row:?}");
    }
    ExitCode::FAILURE
}

/// An argument's value, at least 1.
fn number(argument: Option<String>) -> u64 {
    let number = argument.and_then(|text| text.parse().ok());
    number.unwrap_or(1).max(1)
}
