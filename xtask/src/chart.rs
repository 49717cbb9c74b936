//! `cargo xtask chart`: accuracy against cost, where methods fail, and what specialisations bring.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;

use crate::driver::{Driver, existing};
use crate::system::{self, COMPILER, LOADER};
use crate::workspace;

#[derive(Args)]
pub struct Options {
    /// Another driver whose picture is held against the reference, given by its manifest
    #[arg(long = "icd", value_name = "MANIFEST")]
    icds: Vec<PathBuf>,
    /// Subjects (triangles, walks, functions, denormals, builds, stability, pictures, tiers,
    /// switches; all by default), `--quick` for under two minutes, `--out FOLDER`
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<String>,
}

pub fn chart(options: &Options) -> Result<ExitCode> {
    system::require(&[&COMPILER, &LOADER])?;
    let icds = options.icds.iter().map(|icd| existing(icd));
    let icds = icds.collect::<Result<Vec<_>>>()?;
    let driver = Driver::build(&["chart", "workloads"])?;
    let mut chart = workspace::program("chart")?;
    let workloads = workspace::program("workloads")?;
    chart.arg("--workloads").arg(workloads.get_program());
    chart.arg("--icd").arg(&driver.manifest);
    for icd in &icds {
        chart.arg("--icd").arg(icd);
    }
    chart.args(&options.arguments);
    workspace::run(chart)
}
