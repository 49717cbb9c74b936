//! `cargo xtask demo`: builds the driver and the demo, and lets the one draw on the other.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Result, ensure};
use clap::Args;

use crate::driver::{Driver, select_other};
use crate::{limits, workspace};

#[derive(Args)]
pub struct Options {
    /// Size of the picture in pixels, 16384 a side at most
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = limits::parse_size)]
    size: (u32, u32),
    /// Samples per pixel, 1 to 65536
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = limits::parse_spp)]
    spp: u32,
    /// Render only band I (from 0) of N equal ones, into a picture of its own: laid below each other in order, they are the whole
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
    /// Rasterize the left half, with shadows and mirrors by ray queries, and trace paths in the right half
    #[arg(long)]
    compare: bool,
    /// Render on another driver, given by its manifest
    #[arg(long, value_name = "MANIFEST")]
    icd: Option<PathBuf>,
}

pub fn demo(options: &Options) -> Result<ExitCode> {
    let out = match &options.out {
        Some(out) => out.clone(),
        None => workspace::shown(&workspace::target()?.join("demo.png")),
    };
    // Before minutes of building.
    limits::try_out(&out).map_err(anyhow::Error::msg)?;
    if let Some(tile) = options.tile {
        let (_, rows) = tile.rows(options.size.1);
        ensure!(
            rows > 0,
            "there are more tiles than rows: this one has none"
        );
    }
    if let Some(scene) = &options.scene {
        ensure!(scene.exists(), "there is no {}", scene.display());
    }
    let mut demo = workspace::program("demo")?;
    match &options.icd {
        Some(manifest) => {
            select_other(&mut demo, manifest)?;
            workspace::build_release(&["demo"])?;
        }
        None => {
            let driver = Driver::build(&["demo"])?;
            driver.select_for(&mut demo);
            demo.arg("--driver").arg(&driver.library);
        }
    }
    let (width, height) = options.size;
    demo.args(["--size", &format!("{width}x{height}")])
        .args(["--spp", &options.spp.to_string()])
        .args(["--frame", &options.frame.to_string()])
        .arg("--out")
        .arg(out);
    if let Some(limits::Tile { index, count }) = options.tile {
        demo.args(["--tile", &format!("{index}/{count}")]);
    }
    if let Some(threads) = options.threads {
        demo.args(["--threads", &threads.to_string()]);
    }
    if options.compare {
        demo.arg("--compare");
    }
    if let Some(scene) = &options.scene {
        demo.arg("--scene").arg(scene);
    }
    workspace::run(demo)
}
