//! The built driver and the manifest by which the Vulkan loader finds it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};

use crate::{loader, workspace};

/// The file name of the driver's library.
pub const LIBRARY: &str = "libvulkan_tuff.so";
/// The file name of its manifest.
pub const MANIFEST: &str = "tuff_icd.json";
/// The Vulkan version the driver reports; its patch level is that of the headers it is built with.
const API_VERSION: &str = "1.3.281";
const TEMPLATE: &str = include_str!("../../manifests/tuff_icd.json.in");

/// A driver that is ready to be loaded.
pub struct Driver {
    /// The shared library, absolute.
    pub library: PathBuf,
    /// The manifest that names it, absolute.
    pub manifest: PathBuf,
}

impl Driver {
    /// Builds the driver in release mode, with `also` beside it, and writes its manifest into the
    /// target directory.
    pub fn build(also: &[&str]) -> Result<Driver> {
        let packages: Vec<&str> = ["icd"].iter().chain(also).copied().collect();
        workspace::build_release(&packages)?;
        let target = workspace::target()?;
        let library = target.join("release").join(LIBRARY);
        let manifest = target.join(MANIFEST);
        write_manifest(&manifest, &library)?;
        Ok(Driver { library, manifest })
    }

    /// Builds the driver and a program of the workspace that needs the Vulkan loader.
    pub fn with(program: &str) -> Result<(Driver, Command)> {
        let driver = Driver::build(&[program])?;
        loader::require()?;
        Ok((driver, workspace::program(program)?))
    }

    /// Makes a program see this driver and no other.
    pub fn select_for(&self, program: &mut Command) {
        select(program, &self.manifest);
    }
}

/// Makes a program see the driver of this manifest, an absolute path, and no other.
fn select(program: &mut Command, manifest: &Path) {
    for (name, value) in environment(manifest) {
        program.env(name, value);
    }
    program.env_remove("VK_ADD_DRIVER_FILES");
}

/// Makes a program see another driver than Tuff and no other.
pub fn select_other(program: &mut Command, manifest: &Path) -> Result<()> {
    let manifest = std::path::absolute(manifest).context("the manifest's path")?;
    select(program, &manifest);
    Ok(())
}

/// The variables by which loaders find a driver: `VK_DRIVER_FILES` for current ones,
/// `VK_ICD_FILENAMES` for those before 1.3.207.
pub fn environment(manifest: &Path) -> [(&'static str, &Path); 2] {
    [
        ("VK_DRIVER_FILES", manifest),
        ("VK_ICD_FILENAMES", manifest),
    ]
}

/// Writes a manifest that names `library`.
pub fn write_manifest(manifest: &Path, library: &Path) -> Result<()> {
    let library = library.to_str().context("the library's path is UTF-8")?;
    let escaped = library.replace('\\', "\\\\").replace('"', "\\\"");
    let text = TEMPLATE
        .replace("@LIBRARY_PATH@", &escaped)
        .replace("@API_VERSION@", API_VERSION);
    fs::write(manifest, text).with_context(|| format!("writing {}", manifest.display()))
}
