//! `cargo xtask profile`: a flame graph of a workload.

use std::process::{Command, ExitCode};

use anyhow::{Context, Result};
use clap::Args;

use crate::driver::Driver;
use crate::{loader, workspace};

#[derive(Args)]
pub struct Options {
    /// The workload (`path` by default), `--turns N`, `--frequency N`, `--out FILE`
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<String>,
}

pub fn profile(options: &Options) -> Result<ExitCode> {
    let driver = Driver::build(&["profile", "workloads"])?;
    loader::require()?;
    let release = workspace::target()?.join("release");
    let mut profile = Command::new(release.join("profile"));
    driver.select_for(&mut profile);
    let status = profile
        .arg("--workloads")
        .arg(release.join("workloads"))
        .args(&options.arguments)
        .status()
        .context("starting the profiler")?;
    Ok(workspace::exit_code(status))
}
