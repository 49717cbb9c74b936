//! The built driver and its manifest for the Vulkan loader.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};

use crate::architecture::{Architecture, Emulation};
use crate::system::{self, COMPILER, LOADER};
use crate::workspace;

/// The file name of the driver's library.
pub const LIBRARY: &str = "libvulkan_tuff.so";
/// The file name of its manifest.
pub const MANIFEST: &str = "tuff_icd.json";
/// The Vulkan version the driver reports.
const API_VERSION: &str = "1.4.356";
const TEMPLATE: &str = include_str!("../../manifests/tuff_icd.json.in");

/// A driver, ready to be loaded.
pub struct Driver {
    /// The shared library, absolute.
    pub library: PathBuf,
    /// The manifest that names it, absolute.
    pub manifest: PathBuf,
}

impl Driver {
    /// Builds the driver in release mode, then the packages `also`, and writes its manifest into
    /// the target directory.
    pub fn build(also: &[&str]) -> Result<Driver> {
        workspace::build_release(&["icd"])?;
        if !also.is_empty() {
            workspace::build_release(also)?;
        }
        Self::to_be_built()
    }

    /// Writes the manifest of the driver of a release build.
    pub fn to_be_built() -> Result<Driver> {
        let target = workspace::target()?;
        let library = target.join("release").join(LIBRARY);
        let manifest = target.join(MANIFEST);
        write_manifest(&manifest, &library)?;
        Ok(Driver { library, manifest })
    }

    /// Builds the driver in release mode for another architecture, and writes its manifest beside
    /// it.
    pub fn build_for(architecture: Architecture, emulation: &Emulation) -> Result<Driver> {
        let mut cargo = workspace::cargo();
        cargo.args(["build", "--release", "--package", "icd"]);
        emulation.select_for(&mut cargo);
        let status = cargo.status().context("starting cargo")?;
        ensure!(status.success(), "building icd failed");
        let folder = workspace::target()?
            .join(architecture.platform())
            .join("release");
        let (library, manifest) = (folder.join(LIBRARY), folder.join(MANIFEST));
        write_manifest(&manifest, &library)?;
        Ok(Driver { library, manifest })
    }

    /// Builds the driver and a program of the workspace that needs the Vulkan loader and, to be
    /// built, a C++ compiler.
    pub fn with(program: &str) -> Result<(Driver, Command)> {
        system::require(&[&COMPILER, &LOADER])?;
        let driver = Driver::build(&[program])?;
        Ok((driver, workspace::program(program)?))
    }

    /// Makes a program find only this driver.
    pub fn select_for(&self, program: &mut Command) {
        select(program, &self.manifest);
    }
}

/// Makes a program find only the driver of this manifest, an absolute path.
fn select(program: &mut Command, manifest: &Path) {
    for (name, value) in environment(manifest) {
        program.env(name, value);
    }
    program.env_remove("VK_ADD_DRIVER_FILES");
}

/// Makes a program find only another driver than Tuff.
pub fn select_other(program: &mut Command, manifest: &Path) -> Result<()> {
    select(program, &existing(manifest)?);
    Ok(())
}

/// The absolute path of an existing manifest.
///
/// # Errors
/// The manifest does not exist.
pub fn existing(manifest: &Path) -> Result<PathBuf> {
    let absolute = std::path::absolute(manifest).context("the manifest's path")?;
    ensure!(
        absolute.is_file(),
        "there is no manifest {}",
        manifest.display()
    );
    Ok(absolute)
}

/// The loader's variables for drivers: `VK_DRIVER_FILES` for current loaders, `VK_ICD_FILENAMES`
/// for those before 1.3.207.
pub fn environment(manifest: &Path) -> [(&'static str, &Path); 2] {
    [
        ("VK_DRIVER_FILES", manifest),
        ("VK_ICD_FILENAMES", manifest),
    ]
}

/// Writes a manifest that names `library`.
pub fn write_manifest(manifest: &Path, library: &Path) -> Result<()> {
    let library = library.to_str().context("the library's path is UTF-8")?;
    let text = manifest_text(library);
    fs::write(manifest, text).with_context(|| format!("writing {}", manifest.display()))
}

/// A manifest that names `library`: absolute, or relative to the manifest's folder.
pub fn manifest_text(library: &str) -> String {
    let escaped = library.replace('\\', "\\\\").replace('"', "\\\"");
    TEMPLATE
        .replace("@LIBRARY_PATH@", &escaped)
        .replace("@API_VERSION@", API_VERSION)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_manifest_that_is_not_there_is_named() {
        let message = existing(Path::new("no/such.json")).unwrap_err().to_string();
        assert_eq!(message, "there is no manifest no/such.json");
    }
}
