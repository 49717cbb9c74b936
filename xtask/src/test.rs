//! `cargo xtask test`: everything that shows the driver right.

use std::path::PathBuf;
use std::process::{Command, ExitCode};

use anyhow::Result;
use clap::Args;

use crate::architecture::{Architecture, Emulation};
use crate::driver::{Driver, select_other};
use crate::skips::Skips;
use crate::system::{self, COMPILER, LOADER, PYTHON, XVFB};
use crate::{fuzz, workspace};

#[derive(Args)]
pub struct Options {
    /// Run only the black-box tests, on another driver, given by its manifest
    #[arg(long, value_name = "MANIFEST")]
    icd: Option<PathBuf>,
    /// Run what the driver is made of, and the black-box tests, for another architecture: by its cross compiler and QEMU. Takes hours
    #[arg(long, value_name = "ARCHITECTURE", conflicts_with = "icd")]
    target: Option<Architecture>,
    /// Arguments for the test programs, such as a test's name
    #[arg(last = true)]
    arguments: Vec<String>,
}

pub fn test(options: &Options) -> Result<ExitCode> {
    if let Some(architecture) = options.target.filter(|target| !target.is_here()) {
        return emulated(options, architecture);
    }
    match &options.icd {
        Some(manifest) => {
            system::require(&[&COMPILER, &LOADER, &XVFB])?;
            let skips = Skips::new()?;
            let mut tests = black_box_tests(options, &skips);
            select_other(&mut tests, manifest)?;
            let passed = workspace::run(tests)?;
            skips.print()?;
            Ok(passed)
        }
        None => {
            system::require(&[&COMPILER, &LOADER, &XVFB, &PYTHON])?;
            let driver = Driver::build(&[])?;
            let mut inner = workspace::cargo();
            inner.args(["test", "--workspace", "--exclude", "tuff-tests"]);
            inner.args(["--exclude", "workloads", "--exclude", "demo"]);
            inner.args(["--exclude", "window"]);
            inner
                .args(["--no-fail-fast", "--"])
                .args(&options.arguments);
            let inner = workspace::run(inner)?;
            let skips = Skips::new()?;
            let mut tests = black_box_tests(options, &skips);
            driver.select_for(&mut tests);
            tests.env("TUFF_UNDER_TEST", "1");
            // No dispatch of the tests takes long: one that hangs loses its device, not the evening.
            if std::env::var_os("TUFF_TIMEOUT").is_none() {
                tests.env("TUFF_TIMEOUT", "60");
            }
            let outer = workspace::run(tests)?;
            let fuzzed = fuzz::shortly(&driver)?;
            let all = [inner, outer, fuzzed]
                .iter()
                .all(|code| *code == ExitCode::SUCCESS);
            // Tuff has all that there are tests of.
            let all_ran = skips.print()? == 0;
            Ok(if all && all_ran {
                ExitCode::SUCCESS
            } else {
                ExitCode::FAILURE
            })
        }
    }
}

/// The same for another architecture: without tools of this machine and without nonsense. What its loader has no layer for is skipped.
fn emulated(options: &Options, architecture: Architecture) -> Result<ExitCode> {
    let emulation = Emulation::new(architecture)?;
    let driver = Driver::build_for(architecture, &emulation)?;
    let mut inner = workspace::cargo();
    inner.arg("test");
    for package in ["traversal", "spirv-jit", "icd"] {
        inner.args(["--package", package]);
    }
    inner.arg("--no-fail-fast");
    emulation.select_for(&mut inner);
    let inner = workspace::run(with_arguments(inner, options))?;
    let skips = Skips::new()?;
    let mut tests = black_box_packages();
    emulation.select_for(&mut tests);
    let mut tests = told(with_arguments(tests, options), &skips);
    driver.select_for(&mut tests);
    tests.env("TUFF_UNDER_TEST", "1");
    let outer = workspace::run(tests)?;
    skips.print()?;
    let all = [inner, outer].iter().all(|code| *code == ExitCode::SUCCESS);
    Ok(if all {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}

/// The tests that see nothing but Vulkan.
fn black_box_tests(options: &Options, skips: &Skips) -> Command {
    let mut tests = black_box_packages();
    tests.args(["--package", "window"]);
    told(with_arguments(tests, options), skips)
}

fn black_box_packages() -> Command {
    let mut tests = workspace::cargo();
    tests.args(["test", "--package", "tuff-tests", "--package", "workloads"]);
    tests.args(["--package", "demo", "--no-fail-fast"]);
    tests
}

fn with_arguments(mut tests: Command, options: &Options) -> Command {
    tests.arg("--").args(&options.arguments);
    tests
}

/// How black-box tests are run.
fn told(mut tests: Command, skips: &Skips) -> Command {
    skips.tell(&mut tests);
    // Older validation layers (1.3.239 was seen to crash) read their table of handles while another thread's new device grows
    // it (Vulkan-ValidationLayers issue 4391): one test at a time.
    if std::env::var_os("RUST_TEST_THREADS").is_none() {
        tests.env("RUST_TEST_THREADS", "1");
    }
    tests
}
