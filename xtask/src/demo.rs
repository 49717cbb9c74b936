//! `cargo xtask demo`: builds the driver and the demo, and lets the one draw on the other.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;

use crate::driver::{Driver, select_other};
use crate::workspace;

#[derive(Args)]
pub struct Options {
    /// Size of the picture in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720")]
    size: String,
    /// Samples per pixel
    #[arg(long, value_name = "N", default_value_t = 16)]
    spp: u32,
    /// Threads the driver may use (all by default)
    #[arg(long, value_name = "N")]
    threads: Option<u32>,
    /// The PNG file to write [default: demo.png in the target directory]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// A glTF scene (.glb or .gltf) to render instead of the landscape
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Render on another driver, given by its manifest
    #[arg(long, value_name = "MANIFEST")]
    icd: Option<PathBuf>,
}

pub fn demo(options: &Options) -> Result<ExitCode> {
    let mut demo = workspace::program("demo")?;
    match &options.icd {
        Some(manifest) => {
            workspace::build_release(&["demo"])?;
            select_other(&mut demo, manifest)?;
        }
        None => {
            let driver = Driver::build(&["demo"])?;
            driver.select_for(&mut demo);
            demo.arg("--driver").arg(&driver.library);
        }
    }
    let out = match &options.out {
        Some(out) => out.clone(),
        None => workspace::shown(&workspace::target()?.join("demo.png")),
    };
    demo.args(["--size", &options.size])
        .args(["--spp", &options.spp.to_string()])
        .arg("--out")
        .arg(out);
    if let Some(threads) = options.threads {
        demo.args(["--threads", &threads.to_string()]);
    }
    if let Some(scene) = &options.scene {
        demo.arg("--scene").arg(scene);
    }
    workspace::run(demo)
}
