//! `cargo xtask precision`: measures the float functions' errors, and writes `docs/precision.md`.

use std::process::ExitCode;

use anyhow::Result;
use clap::Args;

use crate::workspace;

#[derive(Args)]
pub struct Options {
    /// Take every N-th of the 2^32 inputs instead of all, which takes an hour of one core
    #[arg(long, value_name = "N", default_value_t = 1)]
    step: u64,
    /// Print the page instead of writing it
    #[arg(long)]
    print: bool,
    /// How many threads work; all that the machine has by default
    #[arg(long)]
    threads: Option<usize>,
}

pub fn precision(options: &Options) -> Result<ExitCode> {
    workspace::build_release(&["precision"])?;
    let mut command = workspace::program("precision")?;
    command.args(["--step", &options.step.to_string()]);
    if !options.print {
        command
            .arg("--out")
            .arg(workspace::root().join("docs/precision.md"));
    }
    if let Some(threads) = options.threads {
        command.args(["--threads", &threads.to_string()]);
    }
    workspace::run(command)
}
