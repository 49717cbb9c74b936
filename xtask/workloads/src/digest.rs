//! Every workload's picture, small, as a number: the same bits give the same numbers.

use std::hash::{DefaultHasher, Hasher};

use anyhow::{Context, Result};
use tuff_tests::Gpu;

use crate::table;
use crate::workload::Prepared;
use crate::world::Scale;

#[derive(clap::Args)]
pub struct Options {
    #[command(flatten)]
    scale: Scale,
}

/// Prints a line for each workload: its name and the digests of two turns.
pub fn digest(options: &Options) -> Result<()> {
    let gpu = Gpu::without_validation();
    for workload in table::all() {
        let Some(prepared) = (workload.prepare)(&gpu, &options.scale) else {
            continue;
        };
        let first = of(&gpu, &prepared).with_context(|| workload.name)?;
        let second = of(&gpu, &prepared).with_context(|| workload.name)?;
        println!("{}\t{first:016x}\t{second:016x}", workload.name);
    }
    Ok(())
}

fn of(gpu: &Gpu, prepared: &Prepared) -> Result<u64> {
    prepared.run(gpu).context("a turn")?;
    if let Some(look) = prepared.look {
        gpu.submit(look).context("drawing what was built")?;
    }
    let pixels: Vec<[f32; 4]> = prepared.picture.read();
    let mut hasher = DefaultHasher::new();
    hasher.write(bytemuck::cast_slice(&pixels));
    Ok(hasher.finish())
}
