//! `cargo xtask slang`: slangpy's ray tracing examples, compiled by its own compiler, run on the
//! driver.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::driver::Driver;
use crate::system::{self, COMPILER, LOADER};
use crate::workspace;

/// The version of slangpy whose compiler and examples are taken.
const VERSION: &str = "0.43.0";
const SOURCES: &str = "https://github.com/shader-slang/slangpy";

#[derive(Args)]
pub struct Options {
    /// Slang's library (libslang-compiler.so); else that of the Python package slangpy, which pip
    /// downloads
    #[arg(long, value_name = "LIBRARY")]
    compiler: Option<PathBuf>,
    /// The folder `examples` of slangpy's sources; else git fetches them
    #[arg(long, value_name = "FOLDER")]
    examples: Option<PathBuf>,
}

pub fn slang(options: &Options) -> Result<ExitCode> {
    system::require(&[&COMPILER, &LOADER])?;
    let place = workspace::target()?.join("slang");
    let compiler = match &options.compiler {
        Some(library) => library.clone(),
        None => packaged_compiler(&place)?,
    };
    let examples = match &options.examples {
        Some(folder) => folder.clone(),
        None => fetched_examples(&place)?,
    };
    let driver = Driver::build(&[])?;
    let mut tests = workspace::cargo();
    tests.args(["test", "--package", "tuff-tests", "--test", "slang"]);
    tests.args(["--features", "slang"]);
    tests.env("TUFF_SLANG", std::path::absolute(compiler)?);
    tests.env("TUFF_SLANG_EXAMPLES", std::path::absolute(examples)?);
    driver.select_for(&mut tests);
    workspace::run(tests)
}

/// The library in slangpy's package, downloaded once.
fn packaged_compiler(place: &Path) -> Result<PathBuf> {
    let package = place.join("package");
    if let Some(library) = compiler_in(&package) {
        return Ok(library);
    }
    let wheels = place.join("wheels");
    let mut pip = Command::new("python3");
    pip.args(["-m", "pip", "download", "--no-deps", "--dest"]);
    pip.arg(&wheels).arg(format!("slangpy=={VERSION}"));
    succeed(pip, "pip could not download slangpy: give --compiler")?;
    let wheel = std::fs::read_dir(&wheels)?
        .filter_map(Result::ok)
        .map(|entry| entry.path())
        .find(|path| path.extension().is_some_and(|end| end == "whl"))
        .context("pip left no package")?;
    let mut unpack = Command::new("python3");
    unpack
        .args(["-m", "zipfile", "-e"])
        .arg(wheel)
        .arg(&package);
    succeed(unpack, "the package could not be unpacked")?;
    compiler_in(&package).context("the package has no compiler")
}

fn compiler_in(package: &Path) -> Option<PathBuf> {
    let is_compiler = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with("libslang-compiler.so")
    };
    let entries = std::fs::read_dir(package.join("slangpy")).ok()?;
    (entries.filter_map(Result::ok).map(|entry| entry.path())).find(is_compiler)
}

/// The examples in slangpy's sources, fetched once.
fn fetched_examples(place: &Path) -> Result<PathBuf> {
    let sources = place.join("sources");
    let examples = sources.join("examples");
    if !examples.is_dir() {
        let mut git = Command::new("git");
        git.args([
            "clone",
            "--depth",
            "1",
            "--branch",
            &format!("v{VERSION}"),
            SOURCES,
        ]);
        git.arg(&sources);
        succeed(
            git,
            "git could not fetch slangpy's sources: give --examples",
        )?;
    }
    Ok(examples)
}

fn succeed(mut program: Command, otherwise: &'static str) -> Result<()> {
    let status = program.status().context(otherwise)?;
    ensure!(status.success(), otherwise);
    Ok(())
}
