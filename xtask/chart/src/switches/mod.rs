//! The gain of each specialisation of walks and each pass of the compiler: workloads with it and
//! without, alternating.

mod columns;
mod pinned;
mod table;

use anyhow::{Context, Result, ensure};
use canvas::{HeatMap, save};
use indicatif::{ProgressBar, ProgressStyle};
use spirv_jit::pass::PASSES;
use traversal::Specialisation;

use crate::Options;
use crate::report::Report;
use crate::workload;
use columns::{COLUMNS, Column};
use table::{Gain, Table};

/// The names that `TUFF_DISABLE` accepts, by group.
fn switches() -> [(&'static str, Vec<&'static str>); 3] {
    let walks = Specialisation::ALL.iter().map(|(name, _)| *name);
    let passes = PASSES.iter().map(|pass| pass.name);
    [
        ("walks", walks.collect()),
        ("scheduler", vec!["no_any_hit"]),
        ("compiler", passes.collect()),
    ]
}

/// One switch on one workload.
struct SwitchCell<'a> {
    switch: &'a str,
    column: &'a Column,
}

pub fn measure(options: &Options, report: &mut Report) -> Result<()> {
    if options.icds.is_empty() {
        eprintln!("no driver is given: no switches");
        return Ok(());
    }
    let processors = pinned::processors(options.jobs)?;
    let rounds = if options.quick { 3 } else { 15 };
    let mut text = String::new();
    let mut idle: Vec<&str> = Vec::new();
    for (owner, names) in switches() {
        let columns: Vec<&Column> = COLUMNS
            .iter()
            .filter(|column| column.of.contains(&owner))
            .filter(|column| !options.quick || column.quick)
            .collect();
        let cells: Vec<SwitchCell<'_>> = names
            .iter()
            .flat_map(|&switch| {
                columns
                    .iter()
                    .map(move |&column| SwitchCell { switch, column })
            })
            .collect();
        let bar = ProgressBar::new((cells.len() * rounds) as u64);
        bar.set_style(ProgressStyle::with_template(
            "{bar:40} {pos}/{len} ({eta} left)",
        )?);
        let gains = pinned::map(&processors, &cells, |cell| {
            gain(options, cell, rounds, &bar)
        })?;
        bar.finish_and_clear();
        let table = Table {
            columns,
            names,
            gains,
        };
        for (switch, column, gain) in table.cells() {
            report.number("switches", switch, column.name, gain.median);
            report.number("switches, spread", switch, column.name, gain.spread);
        }
        text += &format!("Of {owner}:\n\n{}\n", table.markdown());
        idle.extend(table.idle());
        let map = HeatMap {
            title: format!("What is left out costs so much time ({owner})"),
            across: "workload".into(),
            columns: table
                .columns
                .iter()
                .map(|column| column.name.into())
                .collect(),
            rows: table.coloured(),
            foot: format!("TUFF_DISABLE=name · {}", report.foot()),
        };
        save(&map, &options.out, &format!("switches-{owner}"))?;
    }
    text += &match idle.len() {
        0 => "Each gains 2 % or more on one of these.\n".into(),
        _ => format!(
            "Under 2 % on each of these, candidates for removal: {}.\n",
            idle.join(", ")
        ),
    };
    report.say(&format!(
        "Time without, beyond that with: median of {rounds} pairs of runs, and half the range of the middle half\n\n{text}"
    ));
    Ok(())
}

/// How much longer it takes without, by pairs of processes; whether the one with or the one without
/// goes first, alternates.
fn gain(
    options: &Options,
    cell: &SwitchCell<'_>,
    rounds: usize,
    bar: &ProgressBar,
) -> Result<Gain> {
    let Column {
        workload, turns, ..
    } = *cell.column;
    let scale = cell.column.scale(options.quick);
    let run = |off: &str| -> Result<workload::Sample> {
        let settings = [("TUFF_DISABLE", off)];
        let tuff = &options.icds[0];
        let sample = workload::measure(options, tuff, workload, &scale, turns, &settings, None)?;
        sample.context("the driver cannot do it")
    };
    let mut ratios = Vec::new();
    for round in 0..rounds {
        let (with, without) = if round % 2 == 0 {
            let with = run("")?;
            (with, run(cell.switch)?)
        } else {
            let without = run(cell.switch)?;
            (run("")?, without)
        };
        ensure!(
            with.blocks == without.blocks,
            "{workload} has another picture without {}",
            cell.switch
        );
        ratios.push(without.least() / with.least());
        bar.inc(1);
    }
    Ok(Gain::of(ratios))
}
