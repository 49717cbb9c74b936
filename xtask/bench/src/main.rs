//! Benches: each alternates its contestants in one run and checks that they agree before it prints.

mod reorder;
mod shader;
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
    /// The gain of reordering in a path tracer with divergent materials
    Reorder(reorder::Options),
    /// The interpreter of shaders, as a share of what the compiler makes of the same operations
    Shader(shader::Options),
}

fn main() -> ExitCode {
    let done = match Arguments::parse().bench {
        Bench::Traversal(options) => traversal::run(&options),
        Bench::Reorder(options) => reorder::run(&options),
        Bench::Shader(options) => shader::run(&options),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
