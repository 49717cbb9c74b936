//! Drivers against each other: every measurement in a process of its own, the drivers in turn.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use indicatif::{ProgressBar, ProgressStyle};

use crate::child::{answer, child};
use crate::formats;
use crate::measure::{
    FIRST_PIXEL, MODULE_CACHED, MODULE_COLD, PIPELINE_CACHED, PIPELINE_COLD, Sample,
};
use crate::operations;
use crate::report;
use crate::results::{Measurement, Results};
use crate::table;
use crate::workload::Bounds;
use crate::world::Scale;

#[derive(clap::Args)]
pub struct Options {
    /// A driver's manifest; the first is what the others are held against
    #[arg(long = "icd", value_name = "MANIFEST", required = true)]
    icds: Vec<PathBuf>,
    /// Single operations in compute kernels, instead of what renderers do
    #[arg(long)]
    operations: bool,
    /// Every format: sampled, fetched, stored, blended and blitted. `--only` takes formats
    /// (`R8_UNORM`) and accesses (`linear`); one thread by default
    #[arg(long, conflicts_with_all = ["operations", "curves", "csv", "charts"])]
    formats: bool,
    /// Small pictures and few rounds: under five minutes for two drivers
    #[arg(long)]
    quick: bool,
    /// Only these workloads and curves (`threads`, `width`, `triangles`, `instances`)
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    only: Vec<String>,
    /// How often the drivers take turns
    #[arg(long, value_name = "N")]
    rounds: Option<usize>,
    /// Threads that the drivers may use (their own choice by default)
    #[arg(long, value_name = "N")]
    threads: Option<u32>,
    /// Also measure how the speed of paths follows threads, resolution, triangles and instances
    #[arg(long)]
    curves: bool,
    /// Every sample and ratio, as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// The table, as CSV
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Where to draw charts, as SVG and PNG
    #[arg(long, value_name = "FOLDER")]
    charts: Option<PathBuf>,
}

/// A thing to measure.
struct Task {
    name: &'static str,
    unit: &'static str,
    bounds: &'static str,
    scale: Scale,
    threads: Option<u32>,
    curve: Option<&'static str>,
}

impl Task {
    /// The name for `--only`.
    fn title(&self) -> &'static str {
        self.curve.unwrap_or(self.name)
    }
}

pub fn compare(options: &Options) -> Result<()> {
    let rounds = options.rounds.unwrap_or(if options.quick { 2 } else { 5 });
    if options.formats {
        let threads = options.threads.unwrap_or(1);
        let json = options.json.as_deref();
        return formats::compare(&options.icds, &options.only, rounds, threads, json);
    }
    let tasks = tasks(options)?;
    let turns = if options.quick { 2 } else { 3 };
    let mut results = Results {
        machine: canvas::machine(),
        date: canvas::date(),
        ..Results::default()
    };
    let bar = ProgressBar::new((tasks.len() * rounds * options.icds.len()) as u64);
    bar.set_style(ProgressStyle::with_template(
        "{bar:40} {pos}/{len} {msg} ({eta} left)",
    )?);
    for task in &tasks {
        bar.set_message(task.name);
        let mut samples = vec![Vec::new(); options.icds.len()];
        for _ in 0..rounds {
            for (icd, samples) in options.icds.iter().zip(&mut samples) {
                let sample = run(icd, task, turns)
                    .with_context(|| format!("{} with {}", task.name, icd.display()))?;
                samples.extend(sample);
                bar.inc(1);
            }
        }
        let disagreement = disagreement(&samples);
        // Pictures have served their purpose.
        for sample in samples.iter_mut().flatten() {
            sample.blocks.clear();
        }
        let measurement = Measurement {
            name: task.name.into(),
            unit: task.unit.into(),
            bounds: task.bounds.into(),
            scale: task.scale,
            threads: task.threads,
            disagreement,
            samples,
        };
        match task.curve {
            None => results.table.push(measurement),
            Some(curve) => results
                .curves
                .entry(curve.into())
                .or_default()
                .push(measurement),
        }
    }
    bar.finish_and_clear();
    results.drivers = names(&results, options.icds.len());
    ensure!(
        !results.drivers.iter().all(String::is_empty),
        "no driver could do any of it"
    );
    report::print(&results);
    if let Some(path) = &options.json {
        let text = serde_json::to_string_pretty(&results)?;
        std::fs::write(path, text).with_context(|| format!("writing {}", path.display()))?;
    }
    if let Some(path) = &options.csv {
        std::fs::write(path, report::csv(&results))
            .with_context(|| format!("writing {}", path.display()))?;
    }
    if let Some(folder) = &options.charts {
        std::fs::create_dir_all(folder).with_context(|| format!("making {}", folder.display()))?;
        crate::chart::draw(&results, folder)?;
    }
    Ok(())
}

fn tasks(options: &Options) -> Result<Vec<Task>> {
    let scale = if options.quick {
        Scale {
            width: 320,
            height: 180,
            triangles: 100_000,
            instances: 128,
            no_any_hit: false,
        }
    } else {
        Scale {
            width: 640,
            height: 360,
            triangles: 500_000,
            instances: 256,
            no_any_hit: false,
        }
    };
    let task = |name, unit, bounds| Task {
        name,
        unit,
        bounds,
        scale,
        threads: options.threads,
        curve: None,
    };
    if options.operations {
        let all = || operations::ALL.iter().map(|operation| operation.name);
        for name in &options.only {
            ensure!(
                operations::named(name).is_some(),
                "there is no operation «{name}»"
            );
        }
        let is_wanted = |name: &&str| {
            options.only.is_empty() || options.only.iter().any(|wanted| wanted == name)
        };
        let tasks = all().filter(is_wanted);
        return Ok(tasks
            .map(|name| task(name, "Mop/s", "operations"))
            .collect());
    }
    let mut tasks: Vec<Task> = table::all()
        .map(|workload| {
            let bounds = match workload.bounds {
                Bounds::Traversal => "traversal",
                Bounds::Shading => "shading",
                Bounds::Launching => "launching",
                Bounds::Building => "building",
                Bounds::Programs => "programs",
                Bounds::Drawing => "drawing",
            };
            task(workload.name, workload.unit, bounds)
        })
        .collect();
    for name in [
        PIPELINE_COLD,
        PIPELINE_CACHED,
        MODULE_COLD,
        MODULE_CACHED,
        FIRST_PIXEL,
    ] {
        tasks.push(task(name, "1/s", "driver"));
    }
    let curves = curves(scale);
    let known = tasks.iter().chain(&curves).map(Task::title);
    let known: BTreeSet<&str> = known.collect();
    if let Some(unknown) = options.only.iter().find(|name| !known.contains(&name[..])) {
        bail!("there is no workload or curve «{unknown}»");
    }
    let wanted = |task: &Task| options.only.iter().any(|name| name == task.title());
    tasks.retain(|task| options.only.is_empty() || wanted(task));
    tasks.extend(
        curves
            .into_iter()
            .filter(|task| options.curves || wanted(task)),
    );
    Ok(tasks)
}

/// Paths over a range of threads, resolutions, triangles and instances.
fn curves(scale: Scale) -> Vec<Task> {
    let mut tasks = Vec::new();
    let mut add = |curve, scale, threads| {
        tasks.push(Task {
            name: "path",
            unit: "Mrays/s",
            bounds: "traversal",
            scale,
            threads,
            curve: Some(curve),
        });
    };
    let processors = std::thread::available_parallelism().map_or(1, usize::from) as u32;
    for threads in (0..)
        .map(|power| 1 << power)
        .take_while(|&threads| threads <= processors)
    {
        add("threads", scale, Some(threads));
    }
    for width in [40, 160, 640, 1280] {
        add(
            "width",
            Scale {
                width,
                height: width * 9 / 16,
                ..scale
            },
            None,
        );
    }
    for triangles in [1_000, 10_000, 100_000, 1_000_000] {
        add("triangles", Scale { triangles, ..scale }, None);
    }
    for instances in [1, 64, 4_096, 65_536] {
        add("instances", Scale { instances, ..scale }, None);
    }
    tasks
}

/// One process with one driver. `None` where it lacks what the workload needs.
fn run(icd: &Path, task: &Task, turns: usize) -> Result<Option<Sample>> {
    let mut child = child(icd, task.threads)?;
    child
        .args(["measure", task.name, "--turns", &turns.to_string()])
        .args(["--width", &task.scale.width.to_string()])
        .args(["--height", &task.scale.height.to_string()])
        .args(["--triangles", &task.scale.triangles.to_string()])
        .args(["--instances", &task.scale.instances.to_string()]);
    answer(child)
}

/// How far the mean of a picture's blocks may differ between drivers, of its mean: shaders'
/// arithmetic may round differently, and then paths part; a driver that traces something else is
/// far beyond it.
const TOLERANCE: f64 = 0.02;

/// Holds the first picture of each driver against the first driver's.
fn disagreement(samples: &[Vec<Sample>]) -> Option<String> {
    let mut there = samples.iter().filter_map(|samples| samples.first());
    let first = there.next()?;
    for other in there {
        if (first.work - other.work).abs() > TOLERANCE * first.work.abs() {
            return Some(format!("{} and {} units of work", first.work, other.work));
        }
        let channels = |sample: &Sample| -> Vec<f64> {
            sample
                .blocks
                .iter()
                .flatten()
                .map(|&channel| f64::from(channel))
                .collect()
        };
        let (a, b) = (channels(first), channels(other));
        let apart: f64 = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).sum();
        let whole: f64 = a.iter().sum();
        if a.len() != b.len() || apart > TOLERANCE * whole {
            return Some(format!("pictures differ by {:.1} %", 100.0 * apart / whole));
        }
    }
    None
}

fn names(results: &Results, count: usize) -> Vec<String> {
    let all = || {
        results
            .table
            .iter()
            .chain(results.curves.values().flatten())
    };
    (0..count)
        .map(|driver| {
            all()
                .find_map(|it| it.samples[driver].first())
                .map(|sample| sample.driver.clone())
                .unwrap_or_default()
        })
        .collect()
}
