//! The measurements, as a table for people and for programs.

use std::fmt::Write as _;

use crate::measure::Sample;
use crate::results::{Measurement, Results};

/// Median and spread of a driver's turns.
#[derive(Clone, Copy, Debug)]
pub struct Speed {
    /// Units of work (as the workload names them) in a second of wall time.
    pub median: f64,
    /// Half the range from the slowest to the fastest turn, of the median.
    pub spread: f64,
    /// Processor seconds of the median turn.
    pub processor_seconds: f64,
    pub wall_seconds: f64,
    pub peak_bytes: u64,
}

impl Speed {
    pub fn of(samples: &[Sample], unit: &str) -> Option<Speed> {
        let scale = match unit.as_bytes().first() {
            Some(b'M') => 1e-6,
            Some(b'k') => 1e-3,
            _ => 1.0,
        };
        let work = samples.first()?.work * scale;
        let sorted = |pick: fn(&Sample) -> &[f64]| {
            let mut all: Vec<f64> = samples.iter().flat_map(pick).copied().collect();
            all.sort_by(f64::total_cmp);
            all
        };
        let wall = sorted(|sample| &sample.seconds);
        let processor = sorted(|sample| &sample.processor_seconds);
        let median = *wall.get(wall.len() / 2)?;
        Some(Speed {
            median: work / median,
            spread: (wall[wall.len() - 1] - wall[0]) / 2.0 / median,
            processor_seconds: processor[processor.len() / 2],
            wall_seconds: median,
            peak_bytes: samples.iter().map(|sample| sample.peak_bytes).max()?,
        })
    }
}

impl Measurement {
    pub fn speeds(&self) -> Vec<Option<Speed>> {
        self.samples
            .iter()
            .map(|samples| Speed::of(samples, &self.unit))
            .collect()
    }

    /// Where it lies on a curve.
    pub fn at(&self, varies: &str) -> u64 {
        match varies {
            "threads" => u64::from(self.threads.unwrap_or(1)),
            "width" => u64::from(self.scale.width),
            "triangles" => self.scale.triangles as u64,
            _ => self.scale.instances as u64,
        }
    }

    /// The first driver's speed as a multiple of another's, where both agree on the result.
    pub fn ratio(&self, other: usize) -> Option<f64> {
        let speeds = self.speeds();
        match self.disagreement {
            None => Some(speeds[0]?.median / speeds[other]?.median),
            Some(_) => None,
        }
    }

    /// The same, of work in a second of all processors' time together.
    pub fn processor_ratio(&self, other: usize) -> Option<f64> {
        let speeds = self.speeds();
        match self.disagreement {
            None => Some(speeds[other]?.processor_seconds / speeds[0]?.processor_seconds),
            Some(_) => None,
        }
    }
}

pub fn print(results: &Results) {
    println!("{} · {}", results.machine, results.date);
    for (number, driver) in results.drivers.iter().enumerate() {
        println!("{number}: {driver}");
    }
    if !results.table.is_empty() {
        print!("{}", table(results, "workload", &results.table));
    }
    for (varies, points) in &results.curves {
        println!();
        print!("{}", table(results, varies, points));
    }
    for other in 1..results.drivers.len() {
        let all = [
            "traversal",
            "shading",
            "launching",
            "building",
            "programs",
            "drawing",
            "operations",
            "driver",
        ];
        for bounds in all {
            let ratios: Vec<f64> = results
                .table
                .iter()
                .filter(|measurement| measurement.bounds == bounds)
                .filter_map(|measurement| measurement.ratio(other))
                .collect();
            if !ratios.is_empty() {
                let sum: f64 = ratios.iter().map(|ratio| libm::log(*ratio)).sum();
                let mean = libm::exp(sum / ratios.len() as f64);
                println!("0 against {other}, bound by {bounds}: {mean:.2}× in the geometric mean");
            }
        }
    }
}

/// A Markdown table of speeds, ratios and memory; rows are called by workload or by what varies.
fn table(results: &Results, rows: &str, measurements: &[Measurement]) -> String {
    let mut text = format!("| {rows} | unit |");
    let mut rule = String::from("| --- | --- |");
    for number in 0..results.drivers.len() {
        let _ = write!(text, " {number} | MB |");
        rule += " ---: | ---: |";
        if number > 0 {
            let _ = write!(text, " 0 : {number} | by processor |");
            rule += " ---: | ---: |";
        }
    }
    let mut lines = vec![text, rule];
    for measurement in measurements {
        let name = match rows {
            "workload" => measurement.name.clone(),
            varies => measurement.at(varies).to_string(),
        };
        let mut line = format!("| {name} | {} |", measurement.unit);
        for (number, speed) in measurement.speeds().into_iter().enumerate() {
            match (speed, &measurement.disagreement) {
                (Some(speed), None) => {
                    let _ = write!(
                        line,
                        " {:.3} ±{:.0} % | {} |",
                        speed.median,
                        speed.spread * 100.0,
                        speed.peak_bytes >> 20
                    );
                }
                (_, Some(why)) => {
                    let _ = write!(line, " {why} | |");
                }
                (None, None) => line += " – | |",
            }
            if number > 0 {
                let ratios = [
                    measurement.ratio(number),
                    measurement.processor_ratio(number),
                ];
                for ratio in ratios {
                    match ratio {
                        Some(ratio) => {
                            let _ = write!(line, " {ratio:.2} |");
                        }
                        None => line += " – |",
                    }
                }
            }
        }
        lines.push(line);
    }
    lines.push(String::new());
    lines.join("\n")
}

pub fn csv(results: &Results) -> String {
    let mut text = String::from(
        "workload,bounds,unit,width,height,triangles,instances,threads,driver,median,spread,wall_seconds,processor_seconds,peak_bytes,ratio\n",
    );
    let all = results
        .table
        .iter()
        .chain(results.curves.values().flatten());
    for measurement in all {
        for (number, speed) in measurement.speeds().into_iter().enumerate() {
            let Some(speed) = speed else { continue };
            let scale = measurement.scale;
            let threads = measurement.threads.map(|threads| threads.to_string());
            let ratio = measurement.ratio(number).map(|ratio| ratio.to_string());
            let _ = writeln!(
                text,
                "{},{},{},{},{},{},{},{},\"{}\",{},{},{},{},{},{}",
                measurement.name,
                measurement.bounds,
                measurement.unit,
                scale.width,
                scale.height,
                scale.triangles,
                scale.instances,
                threads.unwrap_or_default(),
                results.drivers[number],
                speed.median,
                speed.spread,
                speed.wall_seconds,
                speed.processor_seconds,
                speed.peak_bytes,
                ratio.unwrap_or_default(),
            );
        }
    }
    text
}
