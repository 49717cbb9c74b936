//! The commands a person types: `cargo xtask demo | test | fuzz | bench | apps | chart | precision | profile | audit | vuids | env | run | install`.

mod apps;
mod audit;
mod bench;
mod chart;
mod demo;
mod driver;
mod fuzz;
mod install;
mod loader;
mod precision;
mod profile;
mod run;
mod skips;
mod slang;
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
    /// Feed the driver with nonsense, in processes that may die
    Fuzz(fuzz::Options),
    /// Print the export lines that make a shell's Vulkan applications use Tuff
    Env,
    /// Run a program on Tuff
    Run(run::Options),
    /// Install the driver and its manifest where the Vulkan loader looks
    Install(install::Options),
    /// Measure: `bench traversal` compares walks and builds with Embree's
    Bench(bench::Options),
    /// Hold applications that you have built against another driver: their speed and their pictures
    Apps(apps::Options),
    /// Measure how exact the float functions are, and write docs/precision.md
    Precision(precision::Options),
    /// Draw accuracy against cost, where methods fail, and what specialisations bring
    Chart(chart::Options),
    /// Sample a workload with perf, and draw where its time goes as a flame graph
    Profile(profile::Options),
    /// Run slangpy's ray tracing examples, compiled by the Slang compiler; fetches both
    Slang(slang::Options),
    /// Write docs/valid-usage.md: who looks after which rule of valid usage
    Vuids,
    /// Hold the driver's tables against the Vulkan registry (vk.xml)
    Audit(audit::Options),
}

fn main() -> ExitCode {
    let done: Result<ExitCode> = match Arguments::parse().command {
        Command::Demo(options) => demo::demo(&options),
        Command::Test(options) => test::test(&options),
        Command::Fuzz(options) => fuzz::fuzz(&options),
        Command::Env => run::print_environment(),
        Command::Run(options) => run::run(&options),
        Command::Install(options) => install::install(&options),
        Command::Bench(options) => bench::bench(&options),
        Command::Apps(options) => apps::apps(&options),
        Command::Precision(options) => precision::precision(&options),
        Command::Chart(options) => chart::chart(&options),
        Command::Profile(options) => profile::profile(&options),
        Command::Audit(options) => audit::audit(&options),
        Command::Slang(options) => slang::slang(&options),
        Command::Vuids => vuids::write(),
    };
    done.unwrap_or_else(|error| {
        eprintln!("error: {error:#}");
        ExitCode::FAILURE
    })
}
