//! Packages of a built driver: `cargo xtask package` builds it and calls this.
//!
//! ```text
//! driver, tuff, loader ──> Tree: bin/ lib/ share/ ──> tarball, for Windows a zip
//!                                                ├──> .deb (below /usr), for Linux alone
//!                                                └──> wheel (inside the Python package)
//! ```
//!
//! The same input gives the same bytes: files are sorted, and their times are `SOURCE_DATE_EPOCH`
//! or a fixed day.

mod deb;
mod hash;
mod imports;
mod licences;
mod symbols;
mod tarball;
mod tree;
mod wheel;
mod zipfile;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use clap::Parser;

use symbols::{GlibcVersion, Tools};
use tree::{Entry, Tree};

#[derive(Parser)]
struct Arguments {
    /// The driver's library, with debug information
    #[arg(long, value_name = "FILE")]
    driver: PathBuf,
    /// The manifest that goes with it; it names the library relative to its own folder
    #[arg(long, value_name = "FILE")]
    manifest: PathBuf,
    /// The program `tuff`
    #[arg(long, value_name = "FILE")]
    program: PathBuf,
    /// A Vulkan loader for systems that have none, a distribution's: it is taken as it is
    #[arg(long, value_name = "FILE", requires = "loader_licence")]
    loader: Option<PathBuf>,
    /// The loader's licence
    #[arg(long, value_name = "FILE")]
    loader_licence: Option<PathBuf>,
    /// The binaries' architecture, by Rust's name
    #[arg(long, value_name = "NAME", default_value = std::env::consts::ARCH)]
    architecture: String,
    /// The binaries are of Windows
    #[arg(long)]
    windows: bool,
    /// The newest glibc that driver and program may need
    #[arg(long, value_name = "VERSION", required_unless_present = "windows")]
    glibc: Option<GlibcVersion>,
    /// The repository
    #[arg(long, value_name = "FOLDER")]
    root: PathBuf,
    /// Where packages go
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
}

/// The most bytes that a stripped driver may have: for Linux, and for Windows, where functions save
/// more registers and have larger tables for unwinding.
const MAX_DRIVER_BYTES: usize = 15_500_000;
const MAX_DLL_BYTES: usize = 17_000_000;

/// The system that packages are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PackageSystem {
    Linux {
        /// The glibc version that the binaries need.
        glibc: GlibcVersion,
        /// Whether they are linked with the compiler's unwinding library.
        needs_libgcc: bool,
    },
    Windows,
}

/// The common name of all packages.
pub struct Release {
    pub version: String,
    /// By Rust's name.
    pub architecture: String,
    pub system: PackageSystem,
    /// The time of all files, in seconds since 1970.
    pub time: u64,
}

impl Release {
    /// The name of packages that can be unpacked anywhere.
    fn name(&self) -> String {
        let system = match self.system {
            PackageSystem::Linux { .. } => "linux",
            PackageSystem::Windows => "windows",
        };
        format!(
            "tuff-vulkan-{}-{system}-{}",
            self.version, self.architecture
        )
    }
}

/// Where files lie in an installation.
struct InstallPaths {
    driver: &'static str,
    program: &'static str,
    loader: &'static str,
}

const ON_LINUX: InstallPaths = InstallPaths {
    driver: "lib/tuff/libvulkan_tuff.so",
    program: "bin/tuff",
    loader: "lib/tuff/loader/libvulkan.so.1",
};
const ON_WINDOWS: InstallPaths = InstallPaths {
    driver: "lib/tuff/vulkan_tuff.dll",
    program: "bin/tuff.exe",
    loader: "lib/tuff/loader/vulkan-1.dll",
};

fn main() -> ExitCode {
    match package(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn package(arguments: &Arguments) -> Result<()> {
    let out = &arguments.out;
    std::fs::create_dir_all(out).with_context(|| format!("making {}", out.display()))?;
    let scratch = out.join("stripped");
    let time = time(std::env::var("SOURCE_DATE_EPOCH").ok().as_deref())?;
    let tools = Tools::of(&arguments.architecture, arguments.windows, time);
    let driver = tools.separate(&arguments.driver, &scratch)?;
    let program = tools.separate(&arguments.program, &scratch)?;
    let size = driver.stripped.len();
    let most = match arguments.windows {
        true => MAX_DLL_BYTES,
        false => MAX_DRIVER_BYTES,
    };
    ensure!(
        size <= most,
        "the stripped driver has {size} bytes, more than {most}"
    );
    let paths = match arguments.windows {
        true => ON_WINDOWS,
        false => ON_LINUX,
    };
    let tree = installed_files(arguments, &paths, driver.stripped, program.stripped)?;
    let system = match arguments.glibc {
        Some(glibc) if !arguments.windows => needs_on_linux(&tree, glibc, &scratch)?,
        _ => PackageSystem::Windows,
    };
    let with_loader = with_loader(arguments, &paths, &tree)?;
    if system == PackageSystem::Windows {
        let missing = imports::missing(&with_loader)?;
        ensure!(
            missing.is_empty(),
            "some versions of Windows 10 lack functions that the binaries import: {}",
            missing.join(", ")
        );
    }
    let needed_glibc = symbols::newest_glibc(&tree, &scratch)?;
    // Systems older than the packed loader need a loader of their own; `tuff info` reports that.
    let loaders_glibc = symbols::newest_glibc(&with_loader.only(paths.loader), &scratch)?;
    let release = Release {
        version: env!("CARGO_PKG_VERSION").into(),
        architecture: arguments.architecture.clone(),
        system,
        time,
    };
    std::fs::remove_dir_all(&scratch).context("removing the stripped binaries")?;
    let debug = [driver.debug, program.debug];
    let wheel = || {
        let sources = arguments.root.join("packaging/python");
        wheel::write(&with_loader, &release, &sources, out)
    };
    let packages = match system {
        PackageSystem::Linux { .. } => vec![
            tarball::write(&with_loader, &release, out)?,
            deb::write(&tree, &release, out)?,
            wheel()?,
            tarball::write_debug(&debug, &release, out)?,
        ],
        PackageSystem::Windows => vec![
            zipfile::write(&with_loader, &release, out)?,
            wheel()?,
            zipfile::write_debug(&debug, &release, out)?,
        ],
    };
    print_sizes(&packages)?;
    let sums = hash::write_sums(&packages, out)?;
    println!(
        "{}\ndriver: {:.1} MB stripped",
        sums.display(),
        size as f64 / 1e6
    );
    if let Some(glibc) = needed_glibc {
        println!("driver and tuff: need glibc {glibc}");
    }
    if let Some(glibc) = loaders_glibc {
        println!("loader: the distribution's; needs glibc {glibc}");
    }
    Ok(())
}

/// The files that every package installs.
fn installed_files(
    arguments: &Arguments,
    paths: &InstallPaths,
    driver: Vec<u8>,
    program: Vec<u8>,
) -> Result<Tree> {
    let platform = match arguments.windows {
        true => format!("{}-pc-windows-gnu", arguments.architecture),
        false => format!("{}-unknown-linux-gnu", arguments.architecture),
    };
    let licences = licences::all(&arguments.root, &["icd", "tuff"], &platform)?;
    let mut tree = Tree::default();
    tree.add(paths.driver, Entry::file(driver));
    tree.add(paths.program, Entry::program(program));
    let manifest = read(&arguments.manifest)?;
    tree.add("share/vulkan/icd.d/tuff_icd.json", Entry::file(manifest));
    for (name, text) in licences {
        tree.add(
            &format!("share/doc/tuff-vulkan/{name}"),
            Entry::file(text.into_bytes()),
        );
    }
    Ok(tree)
}

/// The same files, and the Vulkan loader if one is packed.
fn with_loader(arguments: &Arguments, paths: &InstallPaths, tree: &Tree) -> Result<Tree> {
    let mut with_loader = tree.clone();
    if let (Some(loader), Some(licence)) = (&arguments.loader, &arguments.loader_licence) {
        with_loader.add(paths.loader, Entry::file(read(loader)?));
        let name = "share/doc/tuff-vulkan/LICENSE-vulkan-loader.txt";
        with_loader.add(name, Entry::file(read(licence)?));
    }
    Ok(with_loader)
}

fn print_sizes(packages: &[PathBuf]) -> Result<()> {
    for package in packages {
        let bytes = std::fs::metadata(package)?.len();
        println!("{} ({:.1} MB)", package.display(), bytes as f64 / 1e6);
    }
    Ok(())
}

/// Checks that the binaries for Linux need no newer glibc than the packages declare, and not the
/// system's libm. Returns what they need.
fn needs_on_linux(tree: &Tree, promised: GlibcVersion, scratch: &Path) -> Result<PackageSystem> {
    // Functions of libm give different bits in different versions and on different architectures.
    ensure!(
        !symbols::is_linked_with(tree, "libm.so.6", scratch)?,
        "the driver is linked with the system's libm"
    );
    let glibc = symbols::newest_glibc(tree, scratch)?;
    let glibc = glibc.context("no binary asks for a version of glibc")?;
    ensure!(
        glibc <= promised,
        "the binaries need glibc {glibc}, more than {promised}"
    );
    Ok(PackageSystem::Linux {
        glibc: promised,
        needs_libgcc: symbols::is_linked_with(tree, "libgcc_s.so.1", scratch)?,
    })
}

fn read(path: &PathBuf) -> Result<Vec<u8>> {
    std::fs::read(path).with_context(|| format!("reading {}", path.display()))
}

/// The time of all files: `SOURCE_DATE_EPOCH` of reproducible builds, or the first day that a zip
/// file can represent.
fn time(source_date_epoch: Option<&str>) -> Result<u64> {
    const FIRST_DAY: u64 = 315_532_800;
    let Some(text) = source_date_epoch else {
        return Ok(FIRST_DAY);
    };
    let seconds: u64 = text
        .parse()
        .context("SOURCE_DATE_EPOCH is not a number of seconds")?;
    Ok(seconds.max(FIRST_DAY))
}
