//! `TUFF_STATS=1`: how full the waves are, per shader, as a table on standard error when a device
//! is destroyed.
#![forbid(unsafe_code)]

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering};

use parking_lot::Mutex;
use spirv_jit::{Program, SUBGROUP_SIZE};

use crate::settings::settings;
use crate::wave::binding_table::Shaders;
use crate::wave::observer::{Interests, Observer, StartedWave};

/// The counts of one shader's runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Counts {
    /// Runs of a wave from one event to the next.
    waves: u64,
    subgroups: u64,
    /// Active lanes at the start of the run.
    lanes: u64,
}

/// Counts of one command, by program of its pipeline.
pub struct Occupancy<'a> {
    shaders: &'a Shaders,
    counts: Vec<SharedCounts>,
}

/// [`Counts`] that all workers add to.
#[derive(Debug, Default)]
struct SharedCounts {
    waves: AtomicU64,
    subgroups: AtomicU64,
    lanes: AtomicU64,
}

/// All of the process, by stage and the program's number.
static TOTAL: Mutex<BTreeMap<(&'static str, u64), Counts>> = Mutex::new(BTreeMap::new());

impl<'a> Occupancy<'a> {
    /// Counts for a command with these shaders; `None` if statistics are off.
    pub fn new(shaders: &'a Shaders) -> Option<Self> {
        settings().stats.then(|| Self {
            shaders,
            counts: (shaders.programs.iter())
                .map(|_| SharedCounts::default())
                .collect(),
        })
    }
}

impl Observer for Occupancy<'_> {
    fn interests(&self) -> Interests {
        Interests {
            waves: true,
            ..Interests::default()
        }
    }

    fn wave(&self, wave: &StartedWave) {
        let counts = &self.counts[wave.program as usize];
        for (count, number) in [
            (&counts.waves, 1),
            (&counts.subgroups, wave.subgroups),
            (&counts.lanes, wave.lanes),
        ] {
            count.fetch_add(number.into(), Ordering::Relaxed);
        }
    }
}

impl Drop for Occupancy<'_> {
    /// Adds the command to the total.
    fn drop(&mut self) {
        let mut total = TOTAL.lock();
        for (counts, program) in self.counts.iter_mut().zip(&self.shaders.programs) {
            let waves = *counts.waves.get_mut();
            if waves > 0 {
                let sum = total
                    .entry((stage_name(program), program.number()))
                    .or_default();
                sum.waves += waves;
                sum.subgroups += *counts.subgroups.get_mut();
                sum.lanes += *counts.lanes.get_mut();
            }
        }
    }
}

fn stage_name(program: &Program) -> &'static str {
    use spirv_jit::program::Stage;
    match program.stage() {
        Stage::RayGeneration => "ray generation",
        Stage::Intersection => "intersection",
        Stage::AnyHit => "any hit",
        Stage::ClosestHit => "closest hit",
        Stage::Miss => "miss",
        Stage::Callable => "callable",
        Stage::Vertex => "vertex",
        Stage::TessellationControl => "tessellation control",
        Stage::TessellationEvaluation => "tessellation evaluation",
        Stage::Geometry => "geometry",
        Stage::Task => "task",
        Stage::Mesh => "mesh",
        Stage::Fragment => "fragment",
        _ => "compute",
    }
}

/// Prints the table, if there is something in it, and starts over.
pub fn print() {
    let total = std::mem::take(&mut *TOTAL.lock());
    if !total.is_empty() {
        eprint!("{}", table(&total));
    }
}

fn table(total: &BTreeMap<(&'static str, u64), Counts>) -> String {
    let mut text = format!(
        "{:<18}{:>8}{:>12}{:>12}{:>14}{:>11}\n",
        "shader", "number", "waves", "subgroups", "lanes", "occupancy"
    );
    for ((stage, number), counts) in total {
        let places = (counts.subgroups * SUBGROUP_SIZE as u64).max(1);
        let percent = 100.0 * counts.lanes as f64 / places as f64;
        let _ = writeln!(
            text,
            "{stage:<18}{number:>8}{:>12}{:>12}{:>14}{percent:>10.1}%",
            counts.waves, counts.subgroups, counts.lanes
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn occupancy_is_lanes_over_places() {
        let counts = Counts {
            waves: 2,
            subgroups: 5,
            lanes: 20,
        };
        let text = table(&BTreeMap::from([(("miss", 7), counts)]));
        let last = text.lines().last().expect("a row");
        let words: Vec<&str> = last.split_whitespace().collect();
        assert_eq!(words, ["miss", "7", "2", "5", "20", "25.0%"]);
    }
}
