//! `cargo xtask test`: all tests of the driver.

mod programs;
mod run;
mod times;
mod wine;

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::{Result, anyhow, ensure};
use clap::Args;

use crate::architecture::{Architecture, Emulation, Target};
use crate::driver::{Driver, select_other};
use crate::skips::Skips;
use crate::system::{self, COMPILER, LOADER, PYTHON, XVFB};
use crate::{fuzz, workspace};
use programs::{Program, Stack, Surroundings};
use run::Order;
use times::Times;

#[derive(Args)]
pub struct Options {
    /// Run only the black-box tests, on another driver, given by its manifest
    #[arg(long, value_name = "MANIFEST")]
    icd: Option<PathBuf>,
    /// Run the tests for another platform. aarch64: what the driver is made of and the black-box
    /// tests, by QEMU; takes hours. x86_64-pc-windows-gnu: some black-box tests by Wine, and all
    /// with --deep
    #[arg(long, value_name = "PLATFORM", conflicts_with = "icd")]
    target: Option<Target>,
    /// For Windows: the Khronos Vulkan loader, a vulkan-1.dll
    #[arg(long, value_name = "FILE", requires = "target")]
    loader: Option<PathBuf>,
    /// Also what takes hours: twenty times as many rounds of the property tests, a hundred times as
    /// many cases of the fuzzer
    #[arg(long, conflicts_with = "icd")]
    deep: bool,
    /// Arguments for the test programs, such as a test's name
    #[arg(last = true)]
    arguments: Vec<String>,
}

/// Largest number of programs that run at a time, since some take a gigabyte.
const MOST_AT_A_TIME: usize = 4;

/// The folders of the packages whose tests use only Vulkan.
const BLACK_BOX: [&str; 4] = ["tests", "workloads", "demo", "window"];

/// The folder of the package whose tests need a person or another program.
const BY_HAND: &str = "by-hand";

/// The factor of property test rounds with `--deep`.
const DEEP_ROUNDS: &str = "20";

/// Cases of each target of the fuzzer, and with `--deep`.
const FUZZ_CASES: [u64; 2] = [500, 50_000];

pub fn test(options: &Options) -> Result<ExitCode> {
    let architecture = match options.target {
        None => None,
        Some(Target::X86_64) => Some(Architecture::X86_64),
        Some(Target::Aarch64) => Some(Architecture::Aarch64),
        Some(Target::Windows) => {
            return wine::test(&wine::Order {
                loader: wine::named(options.loader.as_ref())?,
                is_whole: options.deep,
                arguments: &options.arguments,
            });
        }
    };
    if let Some(architecture) = architecture.filter(|it| !it.is_here()) {
        ensure!(!options.deep, "--deep runs here alone");
        return emulated(options, architecture);
    }
    match &options.icd {
        Some(manifest) => on_another_driver(options, manifest),
        None => everything(options),
    }
}

/// The black-box tests on another driver, which may lack capabilities of some tests.
fn on_another_driver(options: &Options, manifest: &Path) -> Result<ExitCode> {
    system::require(&[&COMPILER, &LOADER, &XVFB])?;
    let skips = Skips::new()?;
    let mut command = Command::new("cargo");
    skips.tell(&mut command);
    select_other(&mut command, manifest)?;
    let around = Surroundings::of(&command, Stack::Usual);
    let mut cargo = black_box_packages();
    cargo.args(["--package", "window"]);
    let programs = programs::build(cargo, &options.arguments, |_| Some(&around))?;
    let passed = run_all(options, programs)?;
    skips.print()?;
    Ok(code(passed))
}

/// All tests on Tuff.
fn everything(options: &Options) -> Result<ExitCode> {
    system::require(&[&COMPILER, &LOADER, &XVFB, &PYTHON])?;
    println!("Building the driver and the tests");
    let skips = Skips::new()?;
    let driver = Driver::to_be_built()?;
    // Each build has phases that use only one processor.
    let (built, programs) = std::thread::scope(|scope| {
        let build = scope.spawn(|| workspace::build_release_quietly("icd"));
        let programs = programs_on(&driver, options, &skips);
        (build.join(), programs)
    });
    built.map_err(|_| anyhow!("the thread that builds the driver panicked"))??;
    let passed = run_all(options, programs?)?;
    // Tuff supports every feature that tests need. Programs that tests need are optional.
    let all_ran = skips.print()? == 0;
    Ok(code(passed && all_ran))
}

/// Builds all programs of tests, to run on a driver.
fn programs_on(driver: &Driver, options: &Options, skips: &Skips) -> Result<Vec<Program>> {
    let mut inner = Command::new("cargo");
    let mut outer = Command::new("cargo");
    skips.tell(&mut outer);
    driver.select_for(&mut outer);
    outer.env("TUFF_UNDER_TEST", "1");
    // A dispatch that hangs loses its device after this time. No dispatch of the tests takes that
    // long, even on a loaded machine.
    if std::env::var_os("TUFF_TIMEOUT").is_none() {
        outer.env("TUFF_TIMEOUT", "300");
    }
    if options.deep {
        for command in [&mut inner, &mut outer] {
            command.env("TUFF_DEEP", DEEP_ROUNDS);
        }
    }
    let inner = Surroundings::of(&inner, Stack::Small);
    let outer = Surroundings::of(&outer, Stack::Usual);
    let surroundings = |folder: &str| match folder {
        BY_HAND => None,
        _ if BLACK_BOX.contains(&folder) => Some(&outer),
        _ => Some(&inner),
    };
    // All packages at once. In two builds, shared packages would be built twice, with different
    // features.
    let mut cargo = workspace::cargo();
    cargo.args(["test", "--workspace"]);
    let mut all = programs::build(cargo, &options.arguments, surroundings)?;
    // A test's name selects only that test.
    if options.arguments.iter().all(|word| word.starts_with('-')) {
        let fuzz = fuzz::of_tests(driver, FUZZ_CASES[usize::from(options.deep)])?;
        all.push(Program::alone("fuzz", &fuzz));
        // Only cargo can run the examples of documentation.
        let mut examples = workspace::cargo();
        examples.args(["test", "--workspace", "--doc", "--quiet"]);
        all.push(Program::alone("documentation", &examples));
    }
    Ok(all)
}

/// Runs programs and prints the results. Returns whether all succeeded.
fn run_all(options: &Options, programs: Vec<Program>) -> Result<bool> {
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    let target = workspace::target()?;
    let times = Times::read(&target.join("test-times.txt"));
    let is_loud = ["--nocapture", "--no-capture", "--show-output"];
    let order = Order {
        at_a_time: processors.min(MOST_AT_A_TIME),
        is_loud: (options.arguments.iter()).any(|word| is_loud.contains(&&**word)),
        folder: target.join("tests"),
    };
    let outcome = run::run(programs, times, &order)?;
    let passed = outcome.failed.is_empty();
    println!("{}", outcome.text());
    Ok(passed)
}

fn code(passed: bool) -> ExitCode {
    match passed {
        true => ExitCode::SUCCESS,
        false => ExitCode::FAILURE,
    }
}

/// The tests for another architecture, without this machine's tools and without fuzzing. Tests that
/// need a layer that its loader lacks are skipped.
fn emulated(options: &Options, architecture: Architecture) -> Result<ExitCode> {
    let emulation = Emulation::new(architecture)?;
    let driver = Driver::build_for(architecture, &emulation)?;
    let mut inner = workspace::cargo();
    inner.arg("test");
    for package in ["lanes", "images", "traversal", "spirv-jit", "icd"] {
        inner.args(["--package", package]);
    }
    inner.arg("--no-fail-fast");
    emulation.select_for(&mut inner);
    let inner = workspace::run(with_arguments(inner, options))?;
    let skips = Skips::new()?;
    let mut tests = black_box_packages();
    tests.arg("--no-fail-fast");
    emulation.select_for(&mut tests);
    let mut tests = with_arguments(tests, options);
    skips.tell(&mut tests);
    driver.select_for(&mut tests);
    tests.env("TUFF_UNDER_TEST", "1");
    tests.env("RUST_TEST_THREADS", "1");
    let outer = workspace::run(tests)?;
    skips.print()?;
    Ok(code(
        [inner, outer].iter().all(|it| *it == ExitCode::SUCCESS),
    ))
}

fn black_box_packages() -> Command {
    let mut tests = workspace::cargo();
    tests.args(["test", "--package", "tuff-tests", "--package", "workloads"]);
    tests.args(["--package", "demo"]);
    tests
}

fn with_arguments(mut tests: Command, options: &Options) -> Command {
    tests.arg("--").args(&options.arguments);
    tests
}
