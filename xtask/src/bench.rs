//! `cargo xtask bench`: builds the benches in release mode and runs one.

use std::process::{Command, ExitCode};

use anyhow::{Context, Result};
use clap::Args;

use crate::driver::Driver;
use crate::{loader, workspace};

#[derive(Args)]
pub struct Options {
    /// `traversal …`: structures alone, against Embree; `reorder`: what reordering brings; `shader`: the interpreter against native code. Otherwise the driver on what renderers do:
    /// `--icd MANIFEST` adds another driver to hold it against, and `--help` after `--` tells the rest
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<String>,
}

pub fn bench(options: &Options) -> Result<ExitCode> {
    let release = workspace::target()?.join("release");
    let mut bench = match options.arguments.first().map(String::as_str) {
        Some("traversal" | "shader") => {
            workspace::build_release(&["bench"])?;
            Command::new(release.join("bench"))
        }
        Some("reorder") => {
            let mut bench = Command::new(release.join("bench"));
            Driver::build(&["bench"])?.select_for(&mut bench);
            bench
        }
        _ => {
            let driver = Driver::build(&["workloads"])?;
            loader::require()?;
            let mut bench = Command::new(release.join("workloads"));
            bench.arg("compare").arg("--icd").arg(&driver.manifest);
            bench
        }
    };
    let status = bench
        .args(&options.arguments)
        .status()
        .context("starting the bench")?;
    Ok(workspace::exit_code(status))
}
