//! `tuff run | env | info`: what comes with the driver in every package.
//!
//! Nothing here renders. It points Vulkan's loader at the driver beside this program, and tells
//! what programs then find.

mod info;
mod installation;
mod loader;
mod os;
mod program;
mod refusals;

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::{Parser, Subcommand};

use installation::Installation;

#[derive(Parser)]
#[command(
    name = "tuff",
    version,
    about = "Runs Vulkan programs on Tuff, a driver that traces rays on the CPU"
)]
struct Arguments {
    /// The driver's manifest [default: the one that came with this program]
    #[arg(long, global = true, value_name = "FILE")]
    manifest: Option<PathBuf>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Run a program on Tuff
    Run {
        /// Have the driver report a conformance version to this program, which refuses a driver
        /// without one: 1.4.0.0, or another. Tuff has not been certified: it repeats what you say
        #[arg(long, value_name = "VERSION", num_args = 0..=1, require_equals = true, default_missing_value = "1.4.0.0",
            value_parser = refusals::conformance_version)]
        conformance: Option<String>,
        /// The program and its arguments
        #[arg(required = true, trailing_var_arg = true, value_name = "PROGRAM")]
        program: Vec<OsString>,
    },
    /// Print the export lines that make a shell's Vulkan programs use Tuff: eval "$(tuff env)"
    Env,
    /// Tell what programs find here: loader, drivers, limits; and what mends what is wrong
    Info,
    /// Print the devices that this process finds, for `info`
    #[command(hide = true)]
    Probe,
}

fn main() -> ExitCode {
    os::end_with_the_reader();
    let arguments = Arguments::parse();
    done(&arguments).unwrap_or_else(|error| {
        eprintln!("tuff: {error:#}");
        ExitCode::FAILURE
    })
}

fn done(arguments: &Arguments) -> Result<ExitCode> {
    if let Command::Probe = arguments.command {
        info::probe::print();
        return Ok(ExitCode::SUCCESS);
    }
    let installation = Installation::find(arguments.manifest.as_deref())?;
    match &arguments.command {
        Command::Run {
            program,
            conformance,
        } => program::run(&installation, program, conformance.as_deref()),
        Command::Env => {
            // A shell that evaluates nothing is better off than one that is pointed nowhere.
            installation.library().map_err(program::with_what_mends)?;
            print!("{}", installation.exports());
            Ok(ExitCode::SUCCESS)
        }
        Command::Info => Ok(info::print(&installation)),
        Command::Probe => unreachable!("done above"),
    }
}
