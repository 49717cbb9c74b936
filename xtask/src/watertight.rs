//! `cargo xtask watertight`: counts rays that are lost at the seams of closed meshes.

use std::process::ExitCode;

use anyhow::Result;
use clap::Args;

use crate::workspace;

#[derive(Args)]
pub struct Options {
    /// `--rays N` and `--triples N` say how many of each kind, `--threads N` by how many threads,
    /// `--only NAME` which meshes
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<String>,
}

pub fn watertight(options: &Options) -> Result<ExitCode> {
    workspace::build_release(&["watertight"])?;
    let mut command = workspace::program("watertight")?;
    command.args(&options.arguments);
    workspace::run(command)
}
