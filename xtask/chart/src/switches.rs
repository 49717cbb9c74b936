//! What each specialisation and pass brings: workloads with it and without, in turn.

use anyhow::{Context, Result};
use canvas::{Cell, HeatMap, save};
use spirv_jit::pass::PASSES;
use traversal::Specialisation;

use crate::Options;
use crate::report::Report;
use crate::workload::{self, Scale};

const WORKLOADS: [&str; 6] = [
    "primary",
    "shadow",
    "path",
    "foliage",
    "query",
    "arithmetic",
];

pub fn measure(options: &Options, report: &mut Report) -> Result<()> {
    let Some(tuff) = options.icds.first() else {
        eprintln!("no driver is given: no switches");
        return Ok(());
    };
    let (scale, rounds, turns, workloads) = if options.quick {
        let scale = Scale {
            width: 160,
            height: 90,
            triangles: 20_000,
            instances: 32,
        };
        (scale, 1, 2, &["primary", "path"][..])
    } else {
        let scale = Scale {
            width: 320,
            height: 180,
            triangles: 100_000,
            instances: 128,
        };
        (scale, 3, 3, &WORKLOADS[..])
    };
    let walks = Specialisation::ALL.iter().map(|(name, _)| *name);
    let passes = PASSES.iter().map(|pass| pass.name);
    let switches: Vec<&str> = walks.chain(passes).collect();
    let mut rows: Vec<(String, Vec<Option<Cell>>)> = switches
        .iter()
        .map(|name| ((*name).to_string(), Vec::new()))
        .collect();
    for workload in workloads {
        for (number, (name, cells)) in rows.iter_mut().enumerate() {
            // With everything and without this, in turn.
            let mut times = [f64::INFINITY; 2];
            for _ in 0..rounds {
                for (off, time) in ["", switches[number]].into_iter().zip(&mut times) {
                    let settings = [("TUFF_DISABLE", off)];
                    let sample =
                        workload::measure(options, tuff, workload, &scale, turns, &settings, None)?;
                    *time = time.min(sample.context("the driver cannot do it")?.least());
                }
            }
            let gain = times[1] / times[0] - 1.0;
            report.number("switches", name, workload, gain);
            let sure = gain.abs() >= 0.02;
            let badness = if sure {
                (gain * 1.5).clamp(0.05, 1.0)
            } else {
                0.0
            };
            cells.push(Some((format!("{:+.0} %", gain * 100.0), badness)));
        }
    }
    println!("\nTime without a specialisation or pass, beyond that with it");
    print!("{:<34}", "");
    workloads
        .iter()
        .for_each(|workload| print!("{workload:>12}"));
    println!();
    for (name, cells) in &rows {
        print!("{name:<34}");
        for cell in cells {
            print!("{:>12}", cell.as_ref().map_or("", |cell| cell.0.as_str()));
        }
        println!();
    }
    let map = HeatMap {
        title: "What is left out costs so much time".into(),
        across: "workload".into(),
        columns: workloads
            .iter()
            .map(|workload| (*workload).into())
            .collect(),
        rows,
        foot: format!("TUFF_DISABLE=name · {}", report.foot()),
    };
    save(&map, &options.out, "switches")
}
