//! `tuff run | env | info | view`, on Windows also `install | uninstall`: the program that comes
//! with the driver in every package.
//!
//! It does not render. The program points Vulkan's loader at the driver beside it, and reports the
//! devices that programs then find.

mod info;
mod installation;
mod loader;
mod os;
mod program;
mod refusals;
mod registered;
#[cfg(any(windows, test))]
mod registration;
mod shell;
mod view;

use std::ffi::OsString;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::{Parser, Subcommand};

use installation::Installation;
use shell::Shell;

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
        /// Tell what the rays of this pixel do: `x,y` or `x,y,z` (TUFF_CAPTURE_PIXEL)
        #[arg(long, value_name = "X,Y")]
        capture_pixel: Option<OsString>,
        /// The folder for that; without a pixel, for maps of all rays (TUFF_CAPTURE)
        #[arg(long, value_name = "FOLDER")]
        capture: Option<OsString>,
        /// The program and its arguments
        #[arg(required = true, trailing_var_arg = true, value_name = "PROGRAM")]
        program: Vec<OsString>,
    },
    /// Print the lines that make a shell's Vulkan programs use Tuff. sh: eval "$(tuff env)";
    /// PowerShell: tuff env | Out-String | Invoke-Expression; cmd: for /f "delims=" %i in ('tuff
    /// env --shell cmd') do @%i
    Env {
        /// The shell that evaluates them
        #[arg(long, value_enum, default_value_t = Shell::HERE)]
        shell: Shell,
    },
    /// Register the driver for every program: for all users or, without an administrator's rights,
    /// for this one
    #[cfg(windows)]
    Install,
    /// Take out what `install` registered; the files stay. With --manifest: another installation's
    #[cfg(windows)]
    Uninstall,
    /// Print what Vulkan programs will find on this machine (loader, drivers, limits), and how to
    /// fix problems
    Info,
    /// Make a page of a capture, and a picture of each map, and open it where a browser is
    View {
        /// The folder of the capture: `tuff run --capture FOLDER` writes it
        folder: PathBuf,
        /// Do not open the page
        #[arg(long)]
        no_open: bool,
    },
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
    if let Command::View { folder, no_open } = &arguments.command {
        return view::view(folder, !no_open);
    }
    let installation = Installation::find(arguments.manifest.as_deref())?;
    match &arguments.command {
        Command::Run {
            program,
            conformance,
            capture_pixel,
            capture,
        } => {
            let settings = [
                (
                    refusals::CONFORMANCE,
                    conformance.as_ref().map(OsString::from),
                ),
                ("TUFF_CAPTURE_PIXEL", capture_pixel.clone()),
                ("TUFF_CAPTURE", capture.clone()),
            ];
            program::run(&installation, program, &settings)
        }
        Command::Env { shell } => {
            // Printing nothing is better for the shell than lines that point to a missing driver.
            installation.library().map_err(program::with_fix)?;
            program::tell_of_rights(&installation);
            let lines = installation.exports(*shell);
            match shell {
                Shell::Cmd => {
                    let bytes = os::letters_of_shells(&lines);
                    print(&bytes.context("these lines cannot be handed to cmd")?)
                }
                Shell::Sh | Shell::Powershell => print(lines.as_bytes()),
            }
            Ok(ExitCode::SUCCESS)
        }
        #[cfg(windows)]
        Command::Install => {
            installation.library().map_err(program::with_fix)?;
            let lines = registration::install(&registration::System, &installation.manifest)?;
            print((lines.join("\n") + "\n").as_bytes());
            Ok(ExitCode::SUCCESS)
        }
        #[cfg(windows)]
        Command::Uninstall => {
            let lines = registration::uninstall(&registration::System, &installation.manifest)?;
            print((lines.join("\n") + "\n").as_bytes());
            Ok(ExitCode::SUCCESS)
        }
        Command::Info => Ok(info::print(&installation)),
        Command::Probe | Command::View { .. } => unreachable!("done above"),
    }
}

/// Prints to standard output. If the reader closes its end (`tuff info | more`), this program ends,
/// unless the system has ended it already (`os::end_with_the_reader`).
pub fn print(text: &[u8]) {
    let mut out = std::io::stdout().lock();
    if out.write_all(text).and_then(|()| out.flush()).is_err() {
        std::process::exit(1);
    }
}
