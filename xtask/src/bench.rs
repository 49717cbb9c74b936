//! `cargo xtask bench`: builds the benches in release mode and runs one.

use std::process::{Command, ExitCode};

use anyhow::{Context, Result};
use clap::Args;

use crate::workspace;

#[derive(Args)]
pub struct Options {
    /// Which bench, and its arguments: `traversal --help` tells
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, required = true)]
    arguments: Vec<String>,
}

pub fn bench(options: &Options) -> Result<ExitCode> {
    workspace::build_release(&["bench"])?;
    let status = Command::new(workspace::target()?.join("release/bench"))
        .args(&options.arguments)
        .status()
        .context("starting the bench")?;
    Ok(workspace::exit_code(status))
}
