//! `cargo xtask apps`: applications that the user has built, on two drivers in turn.
//!
//! Nothing is downloaded. A folder is a set of applications. Its file `apps.txt` has one on each
//! line, as a shell would start it from that folder (`name: command and arguments`, `#` before
//! remarks). Without the file, every program in the folder is one, started with the arguments after
//! `--`. An application's speed is the frame rate that it prints, or else its run time.

mod once;
mod picture;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::driver::{Driver, existing};
use crate::workspace;
use once::{Application, RunOutcome};
use picture::Picture;

#[derive(Args)]
pub struct Options {
    /// Folders of applications
    #[arg(required = true, value_name = "FOLDER")]
    folders: Vec<PathBuf>,
    /// The manifest of the driver that Tuff is held against
    #[arg(long, value_name = "MANIFEST")]
    icd: PathBuf,
    /// The manifest of the first driver, instead of Tuff's own
    #[arg(long, value_name = "MANIFEST")]
    first: Option<PathBuf>,
    /// Only applications whose name contains one of these
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    only: Vec<String>,
    /// How often the drivers take turns
    #[arg(long, value_name = "N", default_value_t = 3)]
    rounds: usize,
    /// Seconds after which an application is ended
    #[arg(long, value_name = "SECONDS", default_value_t = 120)]
    patience: u64,
    /// A command that starts the applications: a container's, say. It is given the program and its
    /// arguments
    #[arg(long, value_name = "COMMAND")]
    through: Option<String>,
    /// The arguments of applications, if there is no `apps.txt`
    #[arg(last = true, value_name = "ARGUMENT")]
    arguments: Vec<String>,
}

pub fn apps(options: &Options) -> Result<ExitCode> {
    let mut applications = Vec::new();
    for folder in &options.folders {
        applications.extend(Application::in_folder(folder, &options.arguments)?);
    }
    applications.retain(|it| {
        options.only.is_empty() || options.only.iter().any(|name| it.name.contains(name))
    });
    ensure!(!applications.is_empty(), "there is no application");
    let second = existing(&options.icd)?;
    let first = match &options.first {
        Some(manifest) => existing(manifest)?,
        None => Driver::build(&[])?.manifest,
    };
    let drivers = [first, second];
    println!("0: {}", workspace::shown(&drivers[0]).display());
    println!("1: {}", workspace::shown(&drivers[1]).display());
    println!("| application | unit | 0 | 1 | 0 : 1 | processor 0 : 1 | pictures |");
    println!("| --- | --- | ---: | ---: | ---: | ---: | --- |");
    let mut ratios = Vec::new();
    for application in &applications {
        let runs = in_turn(application, &drivers, options)
            .with_context(|| format!("running {}", application.name))?;
        let line = Line::of(&runs);
        println!("| {} | {}", application.name, line.text);
        ratios.extend(line.ratio);
    }
    if !ratios.is_empty() {
        let sum: f64 = ratios.iter().map(|ratio: &f64| ratio.ln()).sum();
        let mean = (sum / ratios.len() as f64).exp();
        let least = ratios.iter().copied().fold(f64::INFINITY, f64::min);
        println!("0 against 1: {mean:.2}× in the geometric mean, {least:.2}× at least");
    }
    // An application that fails on either driver has no ratio.
    Ok(match ratios.len() == applications.len() {
        true => ExitCode::SUCCESS,
        false => ExitCode::FAILURE,
    })
}

/// The outcomes of each driver's runs.
type Runs = [Vec<RunOutcome>; 2];

fn in_turn(application: &Application, drivers: &[PathBuf; 2], options: &Options) -> Result<Runs> {
    let mut runs = [Vec::new(), Vec::new()];
    for _ in 0..options.rounds.max(1) {
        for (manifest, runs) in drivers.iter().zip(&mut runs) {
            runs.push(run(application, manifest, options)?);
        }
    }
    Ok(runs)
}

fn run(application: &Application, manifest: &Path, options: &Options) -> Result<RunOutcome> {
    application.run(manifest, options.through.as_deref(), options.patience)
}

/// A line of the table.
struct Line {
    text: String,
    ratio: Option<f64>,
}

impl Line {
    fn of(runs: &Runs) -> Line {
        if let Some(failure) = runs.iter().flatten().find_map(|run| run.failure.as_ref()) {
            return Line {
                text: format!("{failure} | | | | | |"),
                ratio: None,
            };
        }
        let has_frames = runs.iter().flatten().all(|run| run.frames.is_some());
        // Frames a second, or seconds: the ratio is one of speeds either way.
        let speeds = runs.each_ref().map(|runs| {
            median(runs.iter().map(|run| match run.frames {
                Some(frames) if has_frames => frames,
                _ => 1.0 / run.wall_seconds,
            }))
        });
        let processor = runs
            .each_ref()
            .map(|runs| median(runs.iter().map(|run| run.processor_seconds)));
        let ratio = speeds[0] / speeds[1];
        let shown = speeds.map(|speed| match has_frames {
            true => format!("{speed:.2}"),
            false => format!("{:.3}", 1.0 / speed),
        });
        Line {
            text: format!(
                "{} | {} | {} | {ratio:.2} | {:.2} | {} |",
                if has_frames { "frames/s" } else { "s" },
                shown[0],
                shown[1],
                processor[0] / processor[1],
                pictures(&runs[0][0].pictures, &runs[1][0].pictures),
            ),
            ratio: Some(ratio),
        }
    }
}

/// The largest difference of pictures with the same name.
fn pictures(first: &[Picture], second: &[Picture]) -> String {
    let mut worst: Option<(f64, &str)> = None;
    for picture in first {
        let Some(other) = second.iter().find(|other| other.name == picture.name) else {
            return format!("{} by one alone", picture.name);
        };
        let Some(apart) = picture.distance(other) else {
            return format!("{} of different sizes", picture.name);
        };
        if worst.is_none_or(|(most, _)| apart > most) {
            worst = Some((apart, &picture.name));
        }
    }
    match worst {
        None => "–".into(),
        Some((0.0, _)) => "equal".into(),
        Some((apart, name)) => format!("{:.3} % apart ({name})", 100.0 * apart),
    }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(frames: Option<f64>, wall_seconds: f64) -> RunOutcome {
        RunOutcome {
            frames,
            wall_seconds,
            processor_seconds: 2.0 * wall_seconds,
            ..RunOutcome::default()
        }
    }

    #[test]
    fn ratios_are_of_frames_or_of_times() {
        let frames = [
            vec![outcome(Some(30.0), 1.0)],
            vec![outcome(Some(20.0), 9.0)],
        ];
        assert_eq!(Line::of(&frames).ratio, Some(1.5));
        let times = [vec![outcome(Some(30.0), 2.0)], vec![outcome(None, 3.0)]];
        assert_eq!(Line::of(&times).ratio, Some(1.5));
    }

    #[test]
    fn a_failure_has_no_ratio() {
        let mut runs = [vec![outcome(None, 1.0)], vec![outcome(None, 1.0)]];
        runs[1][0].failure = Some("ended with 1".into());
        assert_eq!(Line::of(&runs).ratio, None);
    }
}
