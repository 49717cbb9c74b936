//! `cargo xtask package`: builds the driver for old and new systems alike, and packs it.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;

use crate::driver::{LIBRARY, manifest_text};
use crate::workspace;

/// Where the library lies, seen from the manifest's folder.
const LIBRARY_FROM_MANIFEST: &str = "../../../lib/tuff/libvulkan_tuff.so";
/// What cross-compiles against an old glibc.
const ZIGBUILD: &str = "cargo-zigbuild";

#[derive(Args)]
pub struct Options {
    /// The oldest glibc that the packages run with. Needs cargo-zigbuild and zig (pip install cargo-zigbuild ziglang). `here`: this
    /// machine's, by its own linker
    #[arg(long, value_name = "VERSION", default_value = "2.28")]
    glibc: String,
    /// A Vulkan loader to bring along, with LICENSE.txt beside it, or `none` [default: built from Khronos' sources by packaging/loader.sh]
    #[arg(long, value_name = "FILE")]
    loader: Option<PathBuf>,
    /// Where packages go [default: package in the target directory]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub fn package(options: &Options) -> Result<ExitCode> {
    let target = workspace::target()?.join("package");
    let old = (options.glibc != "here").then_some(options.glibc.as_str());
    ensure!(
        old.is_none() || is_there(ZIGBUILD),
        "{ZIGBUILD} is needed to link against glibc {}: pip install {ZIGBUILD} ziglang, or say --glibc here",
        options.glibc
    );
    // Before minutes of building.
    let loader = match &options.loader {
        Some(none) if none.as_os_str() == "none" => None,
        Some(file) => Some(std::path::absolute(file).context("the loader's path")?),
        None => Some(built_loader(&target.join("loader"), old)?),
    };
    for file in loader
        .iter()
        .flat_map(|file| [file.clone(), file.with_file_name("LICENSE.txt")])
    {
        ensure!(file.exists(), "there is no {}", file.display());
    }
    let built = build(&target.join("build"), old)?;
    let manifest = built.join("tuff_icd.json");
    std::fs::write(&manifest, manifest_text(LIBRARY_FROM_MANIFEST))
        .context("writing the manifest")?;
    workspace::build_release(&["packaging"])?;
    let mut packaging = workspace::program("packaging")?;
    packaging.arg("--driver").arg(built.join(LIBRARY));
    packaging.arg("--program").arg(built.join("tuff"));
    packaging.arg("--manifest").arg(&manifest);
    if let Some(loader) = loader {
        packaging.arg("--loader").arg(loader);
    }
    let here = || glibc_here();
    packaging
        .arg("--glibc")
        .arg(old.map_or_else(here, |old| Ok(old.into()))?);
    packaging.arg("--root").arg(workspace::root());
    packaging
        .arg("--out")
        .arg(options.out.as_deref().unwrap_or(&target));
    workspace::run(packaging)
}

fn is_there(program: &str) -> bool {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&folders).any(|folder| folder.join(program).is_file())
}

/// Driver and program, each built alone; the folder that they lie in.
fn build(folder: &Path, old: Option<&str>) -> Result<PathBuf> {
    let platform = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
    for package in ["icd", "tuff"] {
        let mut cargo = workspace::cargo();
        match old {
            Some(old) => cargo.args(["zigbuild", "--target", &format!("{platform}.{old}")]),
            None => cargo.args(["build", "--target", &platform]),
        };
        cargo
            .args(["--release", "--package", package, "--target-dir"])
            .arg(folder);
        let status = cargo.status().context("starting cargo")?;
        ensure!(status.success(), "building {package} failed");
    }
    Ok(folder.join(platform).join("release"))
}

fn built_loader(folder: &Path, old: Option<&str>) -> Result<PathBuf> {
    let mut script = Command::new(workspace::root().join("packaging/loader.sh"));
    script.arg(folder).args(old);
    let status = script.status().context("starting packaging/loader.sh")?;
    ensure!(
        status.success(),
        "the Vulkan loader could not be built: give one by --loader FILE, or do without by --loader none"
    );
    Ok(folder.join("libvulkan.so.1"))
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
