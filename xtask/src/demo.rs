//! `cargo xtask demo`: builds the driver and the demo, or its window, and runs the demo on the
//! driver.

use std::path::PathBuf;
use std::process::{Command, ExitCode};

use anyhow::{Result, ensure};
use clap::Args;
use demo_limits as limits;

use crate::driver::{Driver, select_other};
use crate::system::{self, COMPILER, LOADER};
use crate::workspace;

/// Default samples per pixel of a picture.
const SPP: u32 = 16;

#[derive(Args)]
pub struct Options {
    /// Size of the picture in pixels, 16384 a side at most
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = limits::parse_size)]
    size: (u32, u32),
    /// Samples per pixel, 1 to 65536 [default: 16, and as many as it can be with --window]
    #[arg(long, value_name = "N", value_parser = limits::parse_spp)]
    spp: Option<u32>,
    /// Render only band I (from 0) of N equal ones, into a picture of its own: laid below each
    /// other in order, they are the whole
    #[arg(long, value_name = "I/N", value_parser = limits::parse_tile)]
    tile: Option<limits::Tile>,
    /// Which frame, of 24 a second: the lake's waves move
    #[arg(long, value_name = "K", default_value_t = 0)]
    frame: u16,
    /// Threads the driver may use (all by default)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
    /// The PNG file to write [default: demo.png in the target directory]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// A glTF scene (.glb or .gltf) to render instead of the landscape
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Rasterize the left half, with shadows and mirrors by ray queries, and trace paths in the
    /// right half
    #[arg(long)]
    compare: bool,
    /// Show the picture in a window while it gets better: look around by the mouse, move by W, A,
    /// S, D, Q and E
    #[arg(long, conflicts_with_all = ["tile", "out", "compare"])]
    window: bool,
    /// End the window once so many frames were presented, with an error if they could not be
    #[arg(long, value_name = "N", requires = "window", value_parser = clap::value_parser!(u64).range(1..))]
    frames: Option<u64>,
    /// Render on another driver, given by its manifest
    #[arg(long, value_name = "MANIFEST")]
    icd: Option<PathBuf>,
}

pub fn demo(options: &Options) -> Result<ExitCode> {
    // Checked before a build of minutes.
    if let Some(scene) = &options.scene {
        ensure!(scene.exists(), "there is no {}", scene.display());
    }
    if let Some(tile) = options.tile {
        let (_, rows) = tile.rows(options.size.1);
        ensure!(
            rows > 0,
            "there are more tiles than rows: this one has none"
        );
    }
    if options.window {
        let displays = ["WAYLAND_DISPLAY", "WAYLAND_SOCKET", "DISPLAY"];
        let is_set = |name: &&str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
        ensure!(
            displays.iter().any(is_set),
            "no window can be opened: neither WAYLAND_DISPLAY nor DISPLAY is set"
        );
        let mut window = program("window", options)?;
        if let Some(spp) = options.spp {
            window.args(["--spp", &spp.to_string()]);
        }
        if let Some(frames) = options.frames {
            window.args(["--frames", &frames.to_string()]);
        }
        return workspace::run(window);
    }
    let out = match &options.out {
        Some(out) => out.clone(),
        None => workspace::shown(&workspace::target()?.join("demo.png")),
    };
    limits::try_out(&out).map_err(anyhow::Error::msg)?;
    let mut demo = program("demo", options)?;
    demo.args(["--spp", &options.spp.unwrap_or(SPP).to_string()])
        .arg("--out")
        .arg(out);
    if let Some(limits::Tile { index, count }) = options.tile {
        demo.args(["--tile", &format!("{index}/{count}")]);
    }
    if options.compare {
        demo.arg("--compare");
    }
    workspace::run(demo)
}

/// Builds one of the two programs, with the selected driver and the common options.
fn program(name: &str, options: &Options) -> Result<Command> {
    system::require(&[&COMPILER, &LOADER])?;
    let mut program = workspace::program(name)?;
    match &options.icd {
        Some(manifest) => {
            select_other(&mut program, manifest)?;
            workspace::build_release(&[name])?;
        }
        None => {
            let driver = Driver::build(&[name])?;
            driver.select_for(&mut program);
            program.arg("--driver").arg(&driver.library);
        }
    }
    let (width, height) = options.size;
    program
        .args(["--size", &format!("{width}x{height}")])
        .args(["--frame", &options.frame.to_string()]);
    if let Some(threads) = options.threads {
        program.args(["--threads", &threads.to_string()]);
    }
    if let Some(scene) = &options.scene {
        program.arg("--scene").arg(scene);
    }
    Ok(program)
}
