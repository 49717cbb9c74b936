//! Where the time of a workload goes: its process is sampled from within, so that no permission is
//! needed, and drawn as flames.

mod stacks;

use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use inferno::flamegraph;
use pprof::ProfilerGuardBuilder;
use tuff_tests::Gpu;

use crate::table;
use crate::world::Scale;
use stacks::Stacks;

#[derive(clap::Args)]
pub struct Options {
    /// The workload's name
    #[arg(default_value = "path")]
    name: String,
    /// Turns are taken for so long
    #[arg(long, default_value_t = 10.0)]
    seconds: f64,
    /// Samples in a second of processor time
    #[arg(long, default_value_t = 997)]
    frequency: i32,
    #[command(flatten)]
    scale: Scale,
    /// Where the flame graph goes
    #[arg(long, value_name = "FILE", default_value = "flame.svg")]
    out: PathBuf,
}

/// Writes the flame graph, and prints the share of each part of the driver as a Markdown table.
pub fn profile(options: &Options) -> Result<()> {
    let workload = table::named(&options.name)?;
    let gpu = Gpu::without_validation();
    let prepared = (workload.prepare)(&gpu, &options.scale);
    let prepared = prepared.context("the driver lacks what the workload needs")?;
    prepared.run(&gpu).context("the warm-up")?;
    // A signal must not interrupt an unwinder by another.
    let guard = ProfilerGuardBuilder::default()
        .frequency(options.frequency)
        .blocklist(&["libgcc"])
        .build()
        .context("starting the samples")?;
    let (start, mut turns) = (Instant::now(), 0u32);
    while start.elapsed() < Duration::from_secs_f64(options.seconds) {
        prepared.run(&gpu).context("a turn")?;
        turns += 1;
    }
    let report = guard.report().build().context("reading the samples")?;
    drop(guard);
    let stacks = Stacks::of(&report);
    ensure!(stacks.samples() > 0, "no sample was taken");
    draw(options, &stacks, turns)?;
    println!("{}: {turns} turns", options.name);
    println!("{} · {}\n", canvas::machine(), canvas::date());
    print!("{}", stacks.table());
    println!("\n{}", options.out.display());
    Ok(())
}

fn draw(options: &Options, stacks: &Stacks, turns: u32) -> Result<()> {
    if let Some(folder) = options.out.parent() {
        std::fs::create_dir_all(folder).with_context(|| format!("making {}", folder.display()))?;
    }
    let file =
        File::create(&options.out).with_context(|| format!("writing {}", options.out.display()))?;
    let mut look = flamegraph::Options::default();
    look.title = format!("workload {}, {turns} turns", options.name);
    look.subtitle = Some(format!("{} · {}", canvas::machine(), canvas::date()));
    look.min_width = 0.1;
    look.deterministic = true;
    let folded = stacks.folded();
    flamegraph::from_lines(
        &mut look,
        folded.iter().map(String::as_str),
        BufWriter::new(file),
    )
    .context("drawing the flames")
}
