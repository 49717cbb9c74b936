//! `cargo xtask package`: builds the driver for old and new systems alike, and packs it.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::{Context, Result, anyhow, bail, ensure};
use clap::{Args, ValueEnum};

use crate::architecture::{Architecture, Loader};
use crate::driver::{LIBRARY, MANIFEST, manifest_text};
use crate::{system, workspace};

/// Where the library lies, seen from the manifest's folder.
const LIBRARY_FROM_MANIFEST: &str = "../../../lib/tuff/libvulkan_tuff.so";
/// The tool that cross-compiles against an old glibc.
const ZIGBUILD: &str = "cargo-zigbuild";

#[derive(Args)]
pub struct Options {
    /// The oldest glibc that the packages run with. Needs cargo-zigbuild and zig (pip install
    /// cargo-zigbuild ziglang). `here`: this machine's, by its own linker
    #[arg(long, value_name = "VERSION", default_value = "2.28")]
    glibc: String,
    /// A Vulkan loader to bring along, with LICENSE.txt or copyright beside it, or `none` [default:
    /// the distribution's, of the package libvulkan1]
    #[arg(long, value_name = "FILE")]
    loader: Option<PathBuf>,
    /// Where packages go [default: package in the target directory]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// The architecture to build for [default: this machine's]
    #[arg(long, value_name = "ARCHITECTURE")]
    target: Option<Architecture>,
}

pub fn package(options: &Options) -> Result<ExitCode> {
    let target = workspace::target()?.join("package");
    let architecture = match options.target {
        Some(architecture) => architecture,
        None => Architecture::from_str(std::env::consts::ARCH, false)
            .map_err(|_| anyhow!("there are no packages for {}", std::env::consts::ARCH))?,
    };
    let old = (options.glibc != "here").then_some(options.glibc.as_str());
    ensure!(
        old.is_none() || system::is_program(ZIGBUILD),
        "{ZIGBUILD} is needed to link against glibc {}: pip install {ZIGBUILD} ziglang, or say --glibc here",
        options.glibc
    );
    ensure!(
        old.is_some() || architecture.is_here(),
        "--glibc here is for this machine, which is no {}",
        architecture.name()
    );
    let strip = format!("{}-linux-gnu-strip", architecture.name());
    ensure!(
        architecture.is_here() || system::is_program(&strip),
        "{strip} is needed: install binutils-{}-linux-gnu",
        architecture.name()
    );
    // Before minutes of building.
    let loader = match &options.loader {
        Some(none) if none.as_os_str() == "none" => None,
        Some(file) => Some(Loader::named(file)?),
        None => {
            if architecture.is_here() {
                system::require(&[&system::LOADER])?;
            }
            let hint = "give one by --loader FILE, or do without by --loader none";
            Some(Loader::of(architecture).context(hint)?)
        }
    };
    let built = match old {
        Some(old) => build(&target.join("build"), old, architecture)?,
        None => {
            workspace::build_release(&["icd", "tuff"])?;
            workspace::target()?.join("release")
        }
    };
    std::fs::create_dir_all(&target).with_context(|| format!("making {}", target.display()))?;
    let manifest = target.join(MANIFEST);
    std::fs::write(&manifest, manifest_text(LIBRARY_FROM_MANIFEST))
        .context("writing the manifest")?;
    // Of the tests' profile, as they build it: packing takes seconds.
    let mut packaging = workspace::cargo();
    packaging.args(["run", "--quiet", "--package", "packaging", "--"]);
    packaging.arg("--driver").arg(built.join(LIBRARY));
    packaging.arg("--program").arg(built.join("tuff"));
    packaging.arg("--manifest").arg(&manifest);
    if let Some(loader) = loader {
        packaging.arg("--loader").arg(loader.library);
        packaging.arg("--loader-licence").arg(loader.licence);
    }
    let here = || glibc_here();
    let out = options.out.as_deref().unwrap_or(&target);
    packaging
        .arg("--glibc")
        .arg(old.map_or_else(here, |old| Ok(old.into()))?);
    packaging.args(["--architecture", architecture.name()]);
    packaging.arg("--root").arg(workspace::root());
    packaging
        .arg("--out")
        .arg(std::path::absolute(out).context("the packages' folder")?);
    workspace::run(packaging)
}

/// Driver and program for an old glibc, each built alone; the folder that they lie in.
fn build(folder: &Path, old: &str, architecture: Architecture) -> Result<PathBuf> {
    let platform = architecture.platform();
    for package in ["icd", "tuff"] {
        let mut cargo = workspace::cargo();
        cargo
            .args(["zigbuild", "--target", &format!("{platform}.{old}")])
            .args(["--release", "--package", package, "--target-dir"])
            .arg(folder);
        let status = cargo.status().context("starting cargo")?;
        ensure!(status.success(), "building {package} failed");
    }
    Ok(folder.join(platform).join("release"))
}

/// The version of this machine's glibc.
fn glibc_here() -> Result<String> {
    let output = Command::new("getconf").arg("GNU_LIBC_VERSION").output();
    let output = output.context("starting getconf")?;
    let text = String::from_utf8_lossy(&output.stdout);
    match text.trim().strip_prefix("glibc ") {
        Some(version) => Ok(version.into()),
        None => bail!("this system's C library is not glibc, which packages are for"),
    }
}
