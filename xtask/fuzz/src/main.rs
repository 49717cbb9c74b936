//! Nonsense through the Vulkan API of whatever driver the loader finds: `cargo xtask fuzz`.
//!
//! ```text
//! parent ──starts──> child TARGET SEED FIRST COUNT     runs cases, and says in a file which one it is at
//!        <──dies───  the case that it was at is kept, made smaller, and kept smaller
//! ```
//!
//! A case is a number: all that it does follows from the seed and that number, in steps. So a case
//! is reduced by leaving out steps, and can be repeated with the same program. Whatever a driver
//! answers is right: success, an error, a lost device. It must not fault, hang, write where it was
//! told nothing of, or panic.

mod case;
mod child;
mod guard;
mod parent;
mod targets;
mod world;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Result;
use clap::{Parser, Subcommand};

use case::Which;
use parent::{Amount, Parent};

#[derive(Parser)]
#[command(
    name = "fuzz",
    about = "Nonsense through the Vulkan API, in processes that may die"
)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    /// How long, in minutes, all targets together
    #[arg(long, default_value_t = 1.0)]
    minutes: f64,
    /// How many cases of each target, however long they take
    #[arg(long, conflicts_with = "minutes")]
    cases: Option<u64>,
    /// The seed of all cases
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder of the findings
    #[arg(long, default_value = "target/fuzz")]
    out: PathBuf,
    /// All by default
    targets: Vec<String>,
}

#[derive(Subcommand)]
enum Command {
    /// Run one case again, as a finding names it: TARGET:SEED:NUMBER, or with :STEP,STEP… only
    /// these steps of it
    Again { case: String },
    /// Run cases in this process
    #[command(hide = true)]
    Child {
        case: String,
        count: u64,
        /// Where it is said which case runs
        progress: PathBuf,
    },
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<ExitCode> {
    match &arguments.command {
        Some(Command::Child {
            case,
            count,
            progress,
        }) => child::run(&Which::parse(case, targets::named)?, *count, Some(progress)),
        Some(Command::Again { .. }) if std::env::var_os(parent::TIMEOUT_NAME).is_none() => {
            parent::again()
        }
        Some(Command::Again { case }) => child::run(&Which::parse(case, targets::named)?, 1, None),
        None => {
            let targets = targets::all_named(&arguments.targets)?;
            let amount = match arguments.cases {
                Some(cases) => Amount::Cases(cases),
                None => Amount::Time(Duration::from_secs_f64(60.0 * arguments.minutes)),
            };
            Parent::new(&arguments.out)?.run(&targets, arguments.seed, amount)
        }
    }
}
