//! Benches: each alternates its contestants in one run and checks that they agree before it prints.

mod reorder;
mod traversal;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

#[derive(Parser)]
#[command(name = "cargo xtask bench", about = "How fast Tuff is, beside others")]
struct Arguments {
    #[command(subcommand)]
    bench: Bench,
}

#[derive(Subcommand)]
enum Bench {
    /// Builds and walks of acceleration structures, against Embree where it is found
    Traversal(traversal::Options),
    /// What reordering gains a path tracer with divergent materials
    Reorder(reorder::Options),
}

fn main() -> ExitCode {
    let done = match Arguments::parse().bench {
        Bench::Traversal(options) => traversal::run(&options),
        Bench::Reorder(options) => reorder::run(&options),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
