//! `cargo xtask bench`: builds the benches in release mode and runs one.

use std::process::{Command, ExitCode};

use anyhow::{Context, Result};
use clap::Args;

use crate::driver::Driver;
use crate::workspace;

#[derive(Args)]
pub struct Options {
    /// Which bench, and its arguments: `traversal --help` tells
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, required = true)]
    arguments: Vec<String>,
}

pub fn bench(options: &Options) -> Result<ExitCode> {
    let mut bench = Command::new(workspace::target()?.join("release/bench"));
    bench.args(&options.arguments);
    // The others do without the driver.
    if options
        .arguments
        .first()
        .is_some_and(|name| name == "reorder")
    {
        Driver::build(&["bench"])?.select_for(&mut bench);
    } else {
        workspace::build_release(&["bench"])?;
    }
    let status = bench.status().context("starting the bench")?;
    Ok(workspace::exit_code(status))
}
