//! Measures Vulkan drivers against each other on the work that renderers do: tracing rays and
//! drawing.
//!
//! One program, any driver: `compare` starts itself once for every workload, driver and round, so
//! that drivers take turns, each in a process of its own, and no time is given for a result on
//! which they differ.

mod building;
mod chart;
mod child;
mod compare;
mod digest;
mod drawing;
mod formats;
mod measure;
mod micromaps;
mod mips;
mod network;
mod operations;
mod probe;
#[cfg(unix)]
mod profile;
mod programs;
mod reference;
mod report;
mod results;
mod scene;
mod shader;
mod table;
mod usage;
mod workload;
mod world;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

#[derive(Parser)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Measure drivers in turn, and print how they compare
    Compare(compare::Options),
    /// Measure one workload on the one driver that the loader finds
    Measure(measure::Options),
    /// Measure one format on the one driver that the loader finds
    Format(formats::Options),
    /// Sample one workload on the one driver that the loader finds, and draw where its time goes
    #[cfg(unix)]
    Profile(profile::Options),
    /// Print digests of every workload's picture, drawn twice
    Digest(digest::Options),
    /// Print digests of what shaders can see of how they are run, drawn twice
    Probe(probe::Options),
    /// Trace the workload `path` in f64 on no driver at all, and write its picture
    Reference(reference::Options),
    /// List the workloads
    List,
}

fn main() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Compare(options) => compare::compare(&options),
        Command::Measure(options) => measure::measure(&options),
        Command::Format(options) => formats::measure(&options),
        #[cfg(unix)]
        Command::Profile(options) => profile::profile(&options),
        Command::Digest(options) => digest::digest(&options),
        Command::Probe(options) => probe::probe(&options),
        Command::Reference(options) => reference::reference(&options),
        Command::List => {
            for workload in table::all() {
                println!("{:12} {}", workload.name, workload.about);
            }
            Ok(())
        }
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
