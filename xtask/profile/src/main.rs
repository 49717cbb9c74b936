//! Where the time of a workload goes: `perf` samples it, `inferno` draws the flames.

use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;
use std::process::{Command, ExitCode, Stdio};

use anyhow::{Context, Result, ensure};
use clap::Parser;
use inferno::collapse::Collapse;
use inferno::collapse::perf::Folder;
use inferno::flamegraph;

#[derive(Parser)]
#[command(name = "cargo xtask profile", about = "A flame graph of a workload")]
struct Options {
    /// The workload's name, as `cargo xtask bench` has it
    #[arg(default_value = "path")]
    workload: String,
    /// Turns to sample
    #[arg(long, default_value_t = 20)]
    turns: u32,
    /// Samples a second
    #[arg(long, default_value_t = 499)]
    frequency: u32,
    /// Where the picture goes [default: flame-WORKLOAD.svg in the target directory]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// The program that runs workloads
    #[arg(long, value_name = "FILE")]
    workloads: PathBuf,
}

fn run(options: &Options) -> Result<()> {
    let name = &options.workload;
    let beside = options.workloads.with_file_name("..");
    let out = match &options.out {
        Some(out) => out.clone(),
        None => beside.join(format!("flame-{name}.svg")),
    };
    let samples = out.with_extension("perf");
    // Frames are found by the tables for exceptions: optimised code keeps no frame pointers.
    let status = Command::new("perf")
        .args(["record", "--quiet", "--call-graph", "dwarf,16384"])
        .args(["-F", &options.frequency.to_string(), "-o"])
        .arg(&samples)
        .arg("--")
        .arg(&options.workloads)
        .args(["measure", name, "--turns", &options.turns.to_string()])
        .stdout(Stdio::null())
        .status()
        .context("starting perf, which this needs (package linux-perf)")?;
    ensure!(status.success(), "perf record ended with {status}");
    let script = Command::new("perf")
        .args(["script", "--no-inline", "-i"])
        .arg(&samples)
        .stderr(Stdio::null())
        .output()
        .context("perf script")?;
    ensure!(
        script.status.success(),
        "perf script ended with {}",
        script.status
    );
    let mut folded = Vec::new();
    Folder::default()
        .collapse(&script.stdout[..], &mut folded)
        .context("folding the samples")?;
    let file = File::create(&out).with_context(|| format!("writing {}", out.display()))?;
    let mut look = flamegraph::Options::default();
    look.title = format!("workload {name}, {} turns", options.turns);
    look.min_width = 0.1;
    look.deterministic = true;
    flamegraph::from_reader(&mut look, &folded[..], BufWriter::new(file))
        .context("drawing the flames")?;
    std::fs::remove_file(&samples).context("removing the samples")?;
    println!("{}", out.display());
    Ok(())
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
