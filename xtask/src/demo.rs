//! `cargo xtask demo`: builds the driver and the demo, and lets the one draw on the other.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::{Context, Result};
use clap::Args;

use crate::driver::Driver;
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
    let program = workspace::target()?.join("release/demo");
    let mut demo = Command::new(program);
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
    let status = demo.status().context("starting the demo")?;
    Ok(workspace::exit_code(status))
}

/// Makes `program` see the driver of this manifest and no other.
pub fn select_other(program: &mut Command, manifest: &Path) -> Result<()> {
    let manifest = std::path::absolute(manifest).context("the manifest's path")?;
    program
        .env("VK_DRIVER_FILES", &manifest)
        .env("VK_ICD_FILENAMES", &manifest)
        .env_remove("VK_ADD_DRIVER_FILES");
    Ok(())
}
