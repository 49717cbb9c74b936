//! The commands a person types: `cargo xtask demo | test | bench | precision | audit | vuids | env | run | install`.

mod audit;
mod bench;
mod demo;
mod driver;
mod install;
mod loader;
mod precision;
mod run;
mod skips;
mod test;
mod vuids;
mod workspace;

use std::process::ExitCode;

use anyhow::Result;
use clap::{Parser, Subcommand};

#[derive(Parser)]
#[command(name = "cargo xtask", about = "What one does with Tuff")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Render a picture of a landscape (or of a glTF scene) by ray tracing through Vulkan
    Demo(demo::Options),
    /// Run every test: units, properties, filetests, and the black-box tests through the loader
    Test(test::Options),
    /// Print the export lines that make a shell's Vulkan applications use Tuff
    Env,
    /// Run a program on Tuff
    Run(run::Options),
    /// Install the driver and its manifest where the Vulkan loader looks
    Install(install::Options),
    /// Measure: `bench traversal` compares walks and builds with Embree's
    Bench(bench::Options),
    /// Measure how exact the float functions are, and write docs/precision.md
    Precision(precision::Options),
    /// Write docs/valid-usage.md: who looks after which rule of valid usage
    Vuids,
    /// Hold the driver's tables against the Vulkan registry (vk.xml)
    Audit(audit::Options),
}

fn main() -> ExitCode {
    let done: Result<ExitCode> = match Arguments::parse().command {
        Command::Demo(options) => demo::demo(&options),
        Command::Test(options) => test::test(&options),
        Command::Env => run::print_environment(),
        Command::Run(options) => run::run(&options),
        Command::Install(options) => install::install(&options),
        Command::Bench(options) => bench::bench(&options),
        Command::Precision(options) => precision::precision(&options),
        Command::Audit(options) => audit::audit(&options),
        Command::Vuids => vuids::write(),
    };
    done.unwrap_or_else(|error| {
        eprintln!("error: {error:#}");
        ExitCode::FAILURE
    })
}
