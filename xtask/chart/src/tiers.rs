//! Instruction sets: what each gains, and that all draw the same bits.

use anyhow::{Context, Result, ensure};
use spirv_jit::Tier;

use crate::Options;
use crate::report::Report;
use crate::workload::{self, Scale};

pub fn measure(options: &Options, report: &mut Report) -> Result<()> {
    let Some(tuff) = options.icds.first() else {
        eprintln!("no driver is given: no instruction sets");
        return Ok(());
    };
    let scale = Scale {
        width: if options.quick { 96 } else { 320 },
        height: if options.quick { 54 } else { 180 },
        triangles: 20_000,
        instances: 32,
        no_any_hit: false,
    };
    let rounds = if options.quick { 1 } else { 3 };
    std::fs::create_dir_all(&options.out)?;
    let raw = options.out.join("picture.raw");
    let workloads = ["primary", "path", "arithmetic"];
    let mut rows = Vec::new();
    let mut pictures: [Option<Vec<u8>>; 3] = Default::default();
    for tier in Tier::ALL.map(|tier| tier.to_string()) {
        let tier = tier.as_str();
        let mut row = vec![tier.to_string()];
        for (name, first) in workloads.into_iter().zip(&mut pictures) {
            let mut least = f64::INFINITY;
            for _ in 0..rounds {
                let settings = [("TUFF_TIER", tier)];
                let sample =
                    workload::measure(options, tuff, name, &scale, 3, &settings, Some(&raw))?;
                least = least.min(sample.context("the driver cannot draw")?.least());
            }
            let bits = std::fs::read(&raw).context("reading a picture")?;
            let same = first.get_or_insert_with(|| bits.clone()) == &bits;
            ensure!(same, "{name} has other bits with {tier}");
            report.number("tiers", tier, name, least * 1e3);
            row.push(format!("{:.1}", least * 1e3));
        }
        rows.push(row);
    }
    let title = "Instruction sets: ms of processor time a picture";
    report.table(title, &workloads, &rows);
    std::fs::remove_file(&raw).context("removing a picture")
}
