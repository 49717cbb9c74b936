//! How exact the float functions are: `cargo xtask precision [--step N] [--threads N] [--out
//! FILE]`.
//!
//! Functions of one 32-bit float run over all 2^32 inputs (or over every N-th), those of a 16-bit
//! float over all 65,536, those of several over structured and random samples; each on the
//! interpreter's best tier, each against a reference of 64 bits. An error past what Vulkan allows,
//! or past our own bound, fails the run.

mod format;
mod functions;
mod kernel;
mod measure;
mod samples;
mod table;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;

#[derive(Parser)]
struct Arguments {
    #[command(flatten)]
    options: measure::Options,
    /// Where the page goes; to the standard output without
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

fn main() -> ExitCode {
    let Arguments { options, out } = Arguments::parse();
    let rows = table::measure_all(&options);
    let text = table::render(&rows, &options);
    match out {
        Some(file) => std::fs::write(&file, text)
            .unwrap_or_else(|error| panic!("{}: {error}", file.display())),
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
