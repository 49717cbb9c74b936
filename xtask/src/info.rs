//! `cargo xtask info`: the output of `tuff info` for the driver built here.

use std::process::ExitCode;

use anyhow::Result;
use clap::Args;

use crate::driver::Driver;
use crate::workspace;

#[derive(Args)]
pub struct Options {}

pub fn info(_: &Options) -> Result<ExitCode> {
    let driver = Driver::build(&["tuff"])?;
    let mut tuff = workspace::program("tuff")?;
    tuff.arg("--manifest").arg(&driver.manifest).arg("info");
    workspace::run(tuff)
}
