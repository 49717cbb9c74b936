//! `cargo xtask package`: builds the driver, for old and new Linux systems or for Windows, and
//! packs it.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;

use crate::architecture::{Architecture, Loader, Target};
use crate::driver::{LIBRARY, MANIFEST, manifest_text};
use crate::{system, windows, workspace};

/// The library's path relative to the manifest's folder.
const LIBRARY_FROM_MANIFEST: &str = "../../../lib/tuff/libvulkan_tuff.so";
/// The path on Windows, whose loader recognizes paths by this separator.
const DLL_FROM_MANIFEST: &str = r"..\..\..\lib\tuff\vulkan_tuff.dll";
/// The tool that cross-compiles against an old glibc.
const ZIGBUILD: &str = "cargo-zigbuild";

#[derive(Args)]
pub struct Options {
    /// The oldest glibc that the packages run with. Needs cargo-zigbuild and zig (pip install
    /// cargo-zigbuild ziglang). `here`: this machine's, by its own linker
    #[arg(long, value_name = "VERSION", default_value = "2.28")]
    glibc: String,
    /// A Vulkan loader to bring along, with LICENSE.txt or copyright beside it, or `none` [default:
    /// the distribution's, of the package libvulkan1; for Windows there is none]
    #[arg(long, value_name = "FILE")]
    loader: Option<PathBuf>,
    /// Where packages go [default: package in the target directory]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// The platform to build for, by Rust's name, or an architecture of Linux [default: this
    /// machine's]. For Windows: needs mingw, and Rust's library for the platform
    #[arg(long, value_name = "PLATFORM")]
    target: Option<Target>,
}

pub fn package(options: &Options) -> Result<ExitCode> {
    match options.target {
        Some(Target::X86_64) => for_linux(options, Architecture::X86_64),
        Some(Target::Aarch64) => for_linux(options, Architecture::Aarch64),
        Some(Target::Windows) => for_windows(options),
        None => {
            let here = Architecture::here();
            let name = std::env::consts::ARCH;
            for_linux(
                options,
                here.with_context(|| format!("there are no packages for {name}"))?,
            )
        }
    }
}

fn for_linux(options: &Options, architecture: Architecture) -> Result<ExitCode> {
    let target = workspace::target()?.join("package");
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
    // Checked before a build of minutes.
    let loader = match named_loader(options)? {
        Some(named) => named,
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
    let mut packaging = packaging(options, LIBRARY_FROM_MANIFEST, loader)?;
    packaging.arg("--driver").arg(built.join(LIBRARY));
    packaging.arg("--program").arg(built.join("tuff"));
    packaging
        .arg("--glibc")
        .arg(old.map_or_else(glibc_here, |old| Ok(old.into()))?);
    packaging.args(["--architecture", architecture.name()]);
    workspace::run(packaging)
}

fn for_windows(options: &Options) -> Result<ExitCode> {
    let loader = named_loader(options)?.context(
        "Windows has a Vulkan loader where a graphics driver brought it: give the Khronos one \
         (https://github.com/KhronosGroup/Vulkan-Loader) for systems without by --loader vulkan-1.dll, or do without \
         by --loader none",
    )?;
    for (package, kind) in [
        ("icd", ["--lib", "--release"]),
        ("tuff", ["--bins", "--release"]),
    ] {
        let mut cargo = windows::cargo("rustc")?;
        cargo.args(["--package", package]).args(kind);
        // The same sources give the same bytes.
        cargo.args(["--", "-Clink-arg=-Wl,--no-insert-timestamp"]);
        let status = cargo.status().context("starting cargo")?;
        ensure!(status.success(), "building {package} failed");
    }
    let built = windows::programs("release")?;
    let mut packaging = packaging(options, DLL_FROM_MANIFEST, loader)?;
    packaging.arg("--driver").arg(built.join(windows::LIBRARY));
    packaging.arg("--program").arg(built.join("tuff.exe"));
    packaging.args(["--windows", "--architecture", Architecture::X86_64.name()]);
    workspace::run(packaging)
}

/// The user's choice of a loader, or of none; `None` without a choice.
fn named_loader(options: &Options) -> Result<Option<Option<Loader>>> {
    match &options.loader {
        Some(none) if none.as_os_str() == "none" => Ok(Some(None)),
        Some(file) => Ok(Some(Some(Loader::named(file)?))),
        None => Ok(None),
    }
}

/// The packing program with its common arguments. It has the profile of the tests, which build it,
/// too; packing takes seconds.
fn packaging(
    options: &Options,
    library_from_manifest: &str,
    loader: Option<Loader>,
) -> Result<Command> {
    let target = workspace::target()?.join("package");
    std::fs::create_dir_all(&target).with_context(|| format!("making {}", target.display()))?;
    let manifest = target.join(MANIFEST);
    std::fs::write(&manifest, manifest_text(library_from_manifest))
        .context("writing the manifest")?;
    let mut packaging = workspace::cargo();
    packaging.args(["run", "--quiet", "--package", "packaging", "--"]);
    packaging.arg("--manifest").arg(&manifest);
    if let Some(loader) = loader {
        packaging.arg("--loader").arg(loader.library);
        packaging.arg("--loader-licence").arg(loader.licence);
    }
    let out = options.out.as_deref().unwrap_or(&target);
    packaging.arg("--root").arg(workspace::root());
    packaging
        .arg("--out")
        .arg(std::path::absolute(out).context("the packages' folder")?);
    Ok(packaging)
}

/// Builds driver and program for an old glibc, each alone. Returns their folder.
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
