//! One workload on the one driver that this process sees.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use tuff_tests::{Gpu, Group, Stage, vk};

use crate::operations;
use crate::shader;
use crate::table;
use crate::usage::{peak_bytes, processor_seconds};
use crate::workload::{Prepared, path_parts};
use crate::world::Scale;

/// The result of one process; it goes to the parent as a line of JSON.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Sample {
    pub driver: String,
    /// Wall seconds of each turn, the warm-up left out.
    pub seconds: Vec<f64>,
    /// Processor seconds of each turn.
    pub processor_seconds: Vec<f64>,
    /// Units of work in a turn.
    pub work: f64,
    /// Largest resident set of the process.
    pub peak_bytes: u64,
    /// Means of the picture's colour channels over 8×8 blocks, by which drivers are held against
    /// each other.
    pub blocks: Vec<[f32; 3]>,
}

/// The names of the measurements that are not turns of a [`Workload`].
pub const PIPELINE_COLD: &str = "pipeline cold";
pub const PIPELINE_CACHED: &str = "pipeline cached";
pub const MODULE_COLD: &str = "module cold";
pub const MODULE_CACHED: &str = "module cached";
pub const FIRST_PIXEL: &str = "first pixel";

#[derive(clap::Args)]
pub struct Options {
    /// The workload's name
    name: String,
    /// Turns to time, after one that is not
    #[arg(long, default_value_t = 3)]
    turns: usize,
    #[command(flatten)]
    scale: Scale,
    /// Write the picture here, as raw 32-bit floats, four a pixel
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
}

/// Prints a [`Sample`] as JSON, or `null` if the driver lacks a capability of the workload.
pub fn measure(options: &Options) -> Result<()> {
    let sample = match options.name.as_str() {
        PIPELINE_COLD => Some(pipeline(options.turns, false, path_salted)),
        PIPELINE_CACHED => Some(pipeline(options.turns, true, path_salted)),
        MODULE_COLD => Some(pipeline(options.turns, false, large_salted)),
        MODULE_CACHED => Some(pipeline(options.turns, true, large_salted)),
        FIRST_PIXEL => first_pixel(&options.scale),
        name => match operations::named(name) {
            Some(operation) => turns(options, |gpu, scale| operation.prepare(gpu, scale))?,
            None => turns(options, table::named(name)?.prepare)?,
        },
    };
    println!("{}", serde_json::to_string(&sample)?);
    Ok(())
}

fn turns(
    options: &Options,
    prepare: impl Fn(&Gpu, &Scale) -> Option<Prepared>,
) -> Result<Option<Sample>> {
    let gpu = Gpu::without_validation();
    let Some(prepared) = prepare(&gpu, &options.scale) else {
        return Ok(None);
    };
    let mut sample = Sample {
        driver: gpu.name(),
        ..Sample::default()
    };
    prepared.run(&gpu).context("the warm-up")?;
    for _ in 0..options.turns {
        let (start, processor) = (Instant::now(), processor_seconds());
        prepared.run(&gpu).context("a turn")?;
        sample.seconds.push(start.elapsed().as_secs_f64());
        sample
            .processor_seconds
            .push(processor_seconds() - processor);
    }
    sample.peak_bytes = peak_bytes();
    finish(&gpu, &prepared, options, &mut sample)?;
    Ok(Some(sample))
}

/// The picture: its count of rays, its blocks, and a file of it.
fn finish(gpu: &Gpu, prepared: &Prepared, options: &Options, sample: &mut Sample) -> Result<()> {
    if let Some(look) = prepared.look {
        gpu.submit(look).context("drawing what was built")?;
    }
    if let Some(check) = &prepared.check {
        check(gpu).context("checking what was drawn")?;
    }
    let pixels: Vec<[f32; 4]> = prepared.picture.read();
    let counted = || pixels.iter().map(|pixel| f64::from(pixel[3])).sum();
    sample.work = prepared.work.unwrap_or_else(counted);
    sample.blocks = blocks(&pixels, options.scale.width as usize);
    if let Some(path) = &options.picture {
        let bytes: &[u8] = bytemuck::cast_slice(&pixels);
        std::fs::write(path, bytes).with_context(|| format!("writing {}", path.display()))?;
    }
    Ok(())
}

fn blocks(pixels: &[[f32; 4]], width: usize) -> Vec<[f32; 3]> {
    const SIDE: usize = 8;
    let width = width.min(pixels.len());
    let height = pixels.len() / width;
    let mut blocks = Vec::new();
    for top in (0..height).step_by(SIDE) {
        for left in (0..width).step_by(SIDE) {
            let (mut sum, mut count) = ([0.0f64; 3], 0.0f64);
            for y in top..height.min(top + SIDE) {
                for pixel in &pixels[y * width..][left..width.min(left + SIDE)] {
                    for (sum, &channel) in sum.iter_mut().zip(pixel) {
                        *sum += f64::from(channel);
                    }
                    count += 1.0;
                }
            }
            blocks.push(sum.map(|sum| (sum / count) as f32));
        }
    }
    blocks
}

/// Shaders of a pipeline, and its groups.
type Parts = (Vec<(Stage, Vec<u32>)>, Vec<Group>);

/// The path tracer's, of which a constant is the salt.
fn path_salted(salt: usize) -> Parts {
    let (mut shaders, groups) = path_parts();
    let salted = shader::PATH.replace("bounce < 8u", &format!("bounce < {}u", 8 + salt));
    shaders[0].1 = shader::raygen(&salted);
    (shaders, groups)
}

/// The path tracer's parts, with a ray generation shader of about 10,000 instructions.
fn large_salted(salt: usize) -> Parts {
    let (mut shaders, groups) = path_parts();
    shaders[0].1 = shader::large(salt);
    (shaders, groups)
}

/// The time that creating a pipeline takes: each turn a new one, or, when `cached`, the same from a
/// pipeline cache.
fn pipeline(turns: usize, cached: bool, parts: fn(usize) -> Parts) -> Sample {
    let gpu = Gpu::without_validation();
    let mut sample = Sample {
        driver: gpu.name(),
        work: 1.0,
        ..Sample::default()
    };
    let bindings = shader_bindings();
    let plain = vk::DescriptorSetLayoutCreateFlags::empty();
    let layout = gpu.layout(&[gpu.set_layout_of(&bindings, plain)]);
    let cache = cached.then(|| gpu.pipeline_cache());
    for turn in 0..=turns {
        let (shaders, groups) = parts(if cached { 0 } else { turn });
        let (start, processor) = (Instant::now(), processor_seconds());
        create(&gpu, &shaders, &groups, layout, cache);
        if turn > 0 {
            sample.seconds.push(start.elapsed().as_secs_f64());
            sample
                .processor_seconds
                .push(processor_seconds() - processor);
        }
    }
    sample.peak_bytes = peak_bytes();
    sample
}

fn create(
    gpu: &Gpu,
    shaders: &[(Stage, Vec<u32>)],
    groups: &[Group],
    layout: vk::PipelineLayout,
    cache: Option<vk::PipelineCache>,
) {
    let cache = cache.unwrap_or_default();
    let no_flags = vk::PipelineCreateFlags::empty();
    let made = gpu.try_rays_with(shaders, groups, 1, layout, no_flags, cache);
    made.expect("vkCreateRayTracingPipelinesKHR");
}

/// The bindings of `common.glsl`.
fn shader_bindings() -> [(u32, vk::DescriptorType, u32); 5] {
    use vk::DescriptorType as Kind;
    [
        (0, Kind::ACCELERATION_STRUCTURE_KHR, 1),
        (1, Kind::STORAGE_BUFFER, 1),
        (2, Kind::STORAGE_BUFFER, 1),
        (3, Kind::STORAGE_BUFFER, 1),
        (4, Kind::UNIFORM_BUFFER, 1),
    ]
}

/// From nothing to the first picture of the path tracer: instance, device, structures, pipeline and
/// one launch.
fn first_pixel(scale: &Scale) -> Option<Sample> {
    // The front end from GLSL is not the driver's: what follows finds its shaders compiled.
    drop(path_parts());
    let (start, processor) = (Instant::now(), processor_seconds());
    let gpu = Gpu::without_validation();
    let workload = table::named("path").ok()?;
    let prepared = (workload.prepare)(&gpu, scale)?;
    gpu.submit(prepared.turn).expect("the launch runs");
    let seconds = start.elapsed().as_secs_f64();
    Some(Sample {
        driver: gpu.name(),
        seconds: vec![seconds],
        processor_seconds: vec![processor_seconds() - processor],
        work: 1.0,
        peak_bytes: peak_bytes(),
        ..Sample::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_modules_are_large() {
        let (shaders, _) = large_salted(3);
        let count = shader::instruction_count(&shaders[0].1);
        assert!((10_000..12_000).contains(&count), "{count}");
        assert_ne!(shaders[0].1, large_salted(4).0[0].1);
    }
}
