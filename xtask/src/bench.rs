//! `cargo xtask bench`: builds the benches in release mode and runs one.

use std::process::ExitCode;

use anyhow::Result;
use clap::Args;

use crate::driver::Driver;
use crate::workspace;

#[derive(Args)]
pub struct Options {
    /// `traversal …`: structures alone, against Embree; `reorder`: what reordering brings; `shader`: the interpreter against native code. Otherwise the driver on what renderers do:
    /// `--icd MANIFEST` adds another driver to hold it against, and `--help` after `--` tells the rest
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<String>,
}

pub fn bench(options: &Options) -> Result<ExitCode> {
    let mut bench = match options.arguments.first().map(String::as_str) {
        Some("traversal" | "shader") => {
            workspace::build_release(&["bench"])?;
            workspace::program("bench")?
        }
        Some("reorder") => {
            let (driver, mut bench) = Driver::with("bench")?;
            driver.select_for(&mut bench);
            bench
        }
        _ => {
            let (driver, mut bench) = Driver::with("workloads")?;
            bench.arg("compare").arg("--icd").arg(&driver.manifest);
            bench
        }
    };
    bench.args(&options.arguments);
    workspace::run(bench)
}
