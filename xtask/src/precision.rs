//! `cargo xtask precision`: measures the float functions' errors, and writes `docs/precision.md`.

use std::process::{Command, ExitCode};

use anyhow::{Context, Result};
use clap::Args;

use crate::workspace;

#[derive(Args)]
pub struct Options {
    /// Sample the 32-bit inputs instead of running over all 2^32; prints the table instead of writing the page
    #[arg(long)]
    quick: bool,
    /// How many threads work; all that the machine has by default
    #[arg(long)]
    threads: Option<usize>,
}

pub fn precision(options: &Options) -> Result<ExitCode> {
    workspace::build_release(&["precision"])?;
    let mut command = Command::new(workspace::target()?.join("release/precision"));
    if options.quick {
        command.arg("--quick");
    } else {
        command
            .arg("--out")
            .arg(workspace::root().join("docs/precision.md"));
    }
    if let Some(threads) = options.threads {
        command.args(["--threads", &threads.to_string()]);
    }
    let status = command.status().context("starting the measurement")?;
    Ok(workspace::exit_code(status))
}
