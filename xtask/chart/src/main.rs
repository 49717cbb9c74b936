//! Accuracy against cost, drawn: `cargo xtask chart`.
//!
//! [`triangles`], [`walks`], [`functions`], [`denormals`], [`builds`], [`pictures`] and [`tiers`]
//! measure methods, [`stability`] finds where they fail, [`switches`] what specialisations bring.
//! All of it goes into one folder, as pictures and as `results.json` and `results.csv`.

mod builds;
mod denormals;
mod functions;
mod pictures;
mod report;
mod stability;
mod switches;
mod tiers;
mod timing;
mod triangles;
mod walks;
mod workload;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Result, bail};
use clap::Parser;

use report::Report;

#[derive(Parser)]
#[command(name = "cargo xtask chart", about = "Accuracy against cost")]
struct Options {
    /// Only these subjects [default: all]: triangles, walks, functions, denormals, builds,
    /// stability, pictures, tiers, switches
    #[arg(value_name = "SUBJECT")]
    only: Vec<String>,
    /// Fewer rays and samples: under two minutes
    #[arg(long)]
    quick: bool,
    /// Where charts and numbers go
    #[arg(long, value_name = "FOLDER", default_value = "target/chart")]
    out: PathBuf,
    /// The program that runs workloads
    #[arg(long, value_name = "FILE")]
    workloads: PathBuf,
    /// How many workloads `switches` runs at once, each on a processor of its own [default: one on
    /// each processor]
    #[arg(long, value_name = "N")]
    jobs: Option<usize>,
    /// Embree 4's library for the maps of `stability`, if it is not found by itself
    #[arg(long, value_name = "PATH")]
    embree: Option<PathBuf>,
    /// Drivers' manifests; the first is Tuff's
    #[arg(long = "icd", value_name = "MANIFEST")]
    icds: Vec<PathBuf>,
}

type Subject = fn(&Options, &mut Report) -> Result<()>;

const SUBJECTS: &[(&str, Subject)] = &[
    ("triangles", triangles::measure),
    ("walks", walks::measure),
    ("functions", functions::measure),
    ("denormals", denormals::measure),
    ("builds", builds::measure),
    ("stability", stability::measure),
    ("pictures", pictures::measure),
    ("tiers", tiers::measure),
    ("switches", switches::measure),
];

fn run(options: &Options) -> Result<()> {
    for name in &options.only {
        if !SUBJECTS.iter().any(|(subject, _)| subject == name) {
            let known: Vec<&str> = SUBJECTS.iter().map(|(name, _)| *name).collect();
            bail!("\"{name}\" is not one of {}", known.join(", "));
        }
    }
    let mut report = Report::new();
    for (name, measure) in SUBJECTS {
        if options.only.is_empty() || options.only.iter().any(|only| only == name) {
            eprintln!("{name}");
            measure(options, &mut report)?;
        }
    }
    report.write(&options.out)
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
