//! `TUFF_STATS=1`: how full the waves are, per shader, as a table on standard error when a device
//! is destroyed.
#![forbid(unsafe_code)]

use std::collections::BTreeMap;
use std::fmt::Write;

use parking_lot::Mutex;
use spirv_jit::program::AlignedRow;
use spirv_jit::{Program, SUBGROUP_SIZE};

use crate::settings::settings;
use crate::wave::table::ProgramIndex;

/// The counts of one shader's runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Counts {
    /// Runs of a wave from one event to the next.
    waves: u64,
    subgroups: u64,
    /// Active lanes at the start of the run.
    lanes: u64,
}

/// The counts of one batch, by program; present only if statistics are on.
#[derive(Default)]
pub struct Tally(Vec<Counts>);

/// All of the process, by stage and the program's number.
static TOTAL: Mutex<BTreeMap<(&'static str, u64), Counts>> = Mutex::new(BTreeMap::new());

impl Tally {
    /// Counts for a batch of a dispatch with so many programs; `None` if statistics are off.
    pub fn new(programs: usize) -> Option<Tally> {
        settings()
            .stats
            .then(|| Tally(vec![Counts::default(); programs]))
    }

    /// Notes a wave that is about to run.
    pub fn count(&mut self, index: ProgramIndex, program: &Program, states: &[&mut [AlignedRow]]) {
        let counts = &mut self.0[index as usize];
        counts.waves += 1;
        counts.subgroups += states.len() as u64;
        for state in states {
            counts.lanes += u64::from(program.event_mask(state).count());
        }
    }

    /// Adds the batch to the total.
    pub fn close<'p>(&mut self, program: impl Fn(usize) -> &'p Program) {
        let mut total = TOTAL.lock();
        for (index, counts) in std::mem::take(&mut self.0).into_iter().enumerate() {
            if counts.waves > 0 {
                let program = program(index);
                let sum = total
                    .entry((stage_name(program), program.number()))
                    .or_default();
                sum.waves += counts.waves;
                sum.subgroups += counts.subgroups;
                sum.lanes += counts.lanes;
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
