//! `cargo xtask bench`: builds the benches in release mode and runs one.

use std::path::Path;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;

use crate::driver::{Driver, existing};
use crate::system::{self, COMPILER};
use crate::workspace;

#[derive(Args)]
pub struct Options {
    /// `traversal …`: structures alone, against Embree; `reorder`: what reordering brings;
    /// `shader`: the interpreter against native code. Otherwise the driver on what renderers do, or
    /// with `--operations` on single operations, with `--formats` on every format: `--icd MANIFEST`
    /// adds another driver to hold it against, and `--help` after `--` tells the rest
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<String>,
}

pub fn bench(options: &Options) -> Result<ExitCode> {
    // Checked before a build of minutes.
    for manifest in manifests(&options.arguments) {
        existing(Path::new(manifest))?;
    }
    let mut bench = match options.arguments.first().map(String::as_str) {
        Some("traversal" | "shader") => {
            system::require(&[&COMPILER])?;
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

/// Manifests of other drivers for a bench.
fn manifests(arguments: &[String]) -> impl Iterator<Item = &str> {
    let before = std::iter::once("").chain(arguments.iter().map(String::as_str));
    before.zip(arguments).filter_map(|(before, argument)| {
        let separate = (before == "--icd").then_some(argument.as_str());
        separate.or_else(|| argument.strip_prefix("--icd="))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn manifests_are_found_before_anything_is_built() {
        let arguments = ["--tiers", "--icd", "a.json", "--icd=b.json", "c.json"];
        let arguments = arguments.map(String::from);
        let found: Vec<_> = manifests(&arguments).collect();
        assert_eq!(found, ["a.json", "b.json"]);
        let arguments = vec!["--icd".into(), "no/such.json".into()];
        let error = bench(&Options { arguments }).unwrap_err();
        assert_eq!(error.to_string(), "there is no manifest no/such.json");
    }
}
