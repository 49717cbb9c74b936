//! Workloads, each in a process of its own, with a driver and settings.

use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use serde::Deserialize;

use crate::Options;

/// How large a picture and its scene are.
#[derive(Clone, Copy)]
pub struct Scale {
    pub width: u32,
    pub height: u32,
    pub triangles: u32,
    pub instances: u32,
    /// Whether `foliage` goes without its any-hit shader.
    pub no_any_hit: bool,
}

/// The output of a process; `workloads` has more.
#[derive(Debug, Deserialize)]
pub struct Sample {
    pub driver: String,
    pub processor_seconds: Vec<f64>,
    /// Means over blocks of the picture, where there is one.
    pub blocks: Vec<[f32; 3]>,
}

impl Sample {
    /// Processor seconds of the quickest turn.
    pub fn least(&self) -> f64 {
        self.processor_seconds
            .iter()
            .copied()
            .fold(f64::INFINITY, f64::min)
    }
}

fn arguments(command: &mut Command, scale: &Scale) {
    for (name, value) in [
        ("--width", scale.width),
        ("--height", scale.height),
        ("--triangles", scale.triangles),
        ("--instances", scale.instances),
    ] {
        command.args([name, &value.to_string()]);
    }
    if scale.no_any_hit {
        command.arg("--no-any-hit");
    }
}

/// Measures a workload; `None` where the driver lacks a feature that it needs.
pub fn measure(
    options: &Options,
    icd: &Path,
    name: &str,
    scale: &Scale,
    turns: usize,
    settings: &[(&str, &str)],
    picture: Option<&Path>,
) -> Result<Option<Sample>> {
    let icd = std::path::absolute(icd).context("the manifest's path")?;
    let mut command = Command::new(&options.workloads);
    command.args(["measure", name, "--turns", &turns.to_string()]);
    arguments(&mut command, scale);
    if let Some(path) = picture {
        command.arg("--picture").arg(path);
    }
    command
        .stderr(Stdio::inherit())
        .env("VK_DRIVER_FILES", &icd)
        .env("VK_ICD_FILENAMES", &icd)
        .env_remove("VK_ADD_DRIVER_FILES")
        // Processor time is compared: threads that wait for work would add to it.
        .env("TUFF_THREADS", "1")
        .env("LP_NUM_THREADS", "1")
        .envs(settings.iter().copied());
    let output = command.output().context("starting a workload")?;
    ensure!(
        output.status.success(),
        "{name} ended with {}",
        output.status
    );
    let mut lines = output.stdout.split(|&byte| byte == b'\n');
    serde_json::from_slice(lines.next().unwrap_or_default()).context("the workload's answer")
}

/// Draws the workload `path` in f64.
pub fn reference(options: &Options, scale: &Scale, picture: &Path) -> Result<()> {
    let mut command = Command::new(&options.workloads);
    command.arg("reference").arg("--picture").arg(picture);
    arguments(&mut command, scale);
    let status = command.status().context("starting the reference")?;
    ensure!(status.success(), "the reference ended with {status}");
    Ok(())
}

/// A picture of four floats a pixel.
pub fn read(picture: &Path) -> Result<Vec<[f32; 4]>> {
    let bytes = std::fs::read(picture).with_context(|| format!("reading {}", picture.display()))?;
    let mut numbers = bytes
        .chunks_exact(4)
        .map(|bytes| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]));
    let mut pixels = Vec::with_capacity(bytes.len() / 16);
    while let (Some(r), Some(g), Some(b), Some(a)) = (
        numbers.next(),
        numbers.next(),
        numbers.next(),
        numbers.next(),
    ) {
        pixels.push([r, g, b, a]);
    }
    Ok(pixels)
}
