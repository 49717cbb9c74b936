//! `cargo xtask env` and `cargo xtask run`: other people's programs on Tuff.

use std::ffi::OsString;
use std::process::{Command, ExitCode};

use anyhow::{Context, Result};
use clap::Args;

use crate::driver::{self, Driver};
use crate::{loader, workspace};

#[derive(Args)]
pub struct Options {
    /// The program and its arguments
    #[arg(required = true, trailing_var_arg = true, value_name = "PROGRAM")]
    program: Vec<OsString>,
}

/// Runs a program with the driver selected; its exit code becomes ours.
pub fn run(options: &Options) -> Result<ExitCode> {
    let driver = Driver::build(&[])?;
    loader::require()?;
    let (name, arguments) = options.program.split_first().context("no program given")?;
    let mut program = Command::new(name);
    driver.select_for(&mut program);
    program.args(arguments);
    workspace::run(program)
}

/// Prints lines for a shell's `eval`: nothing else may reach standard output.
pub fn print_environment() -> Result<ExitCode> {
    let driver = Driver::build(&[])?;
    for (name, value) in driver::environment(&driver.manifest) {
        let quoted = value.display().to_string().replace('\'', r"'\''");
        println!("export {name}='{quoted}'");
    }
    if let Err(missing) = loader::require() {
        eprintln!("note: {missing:#}");
    }
    Ok(ExitCode::SUCCESS)
}
