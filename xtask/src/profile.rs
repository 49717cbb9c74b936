//! `cargo xtask profile`: a flame graph of a workload.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;

use crate::driver::Driver;
use crate::workspace;

#[derive(Args)]
pub struct Options {
    /// The workload, as `cargo xtask bench` has it
    #[arg(default_value = "path")]
    workload: String,
    /// Where the picture goes [default: flame-WORKLOAD.svg in the target directory]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// `--seconds S`, `--frequency N`, and how large the scene and the picture are
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<String>,
}

pub fn profile(options: &Options) -> Result<ExitCode> {
    let (driver, mut profile) = Driver::with("workloads")?;
    driver.select_for(&mut profile);
    let name = &options.workload;
    let out = match &options.out {
        Some(out) => out.clone(),
        None => workspace::target()?.join(format!("flame-{name}.svg")),
    };
    profile.args(["profile", name]).arg("--out").arg(out);
    profile.args(&options.arguments);
    workspace::run(profile)
}
