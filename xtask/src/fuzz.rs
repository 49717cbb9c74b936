//! `cargo xtask fuzz`: nonsense through the Vulkan API of the built driver, and the coverage-guided
//! targets of the two crates below it.

use std::path::PathBuf;
use std::process::{Command, ExitCode};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;

use crate::driver::{Driver, LIBRARY, write_manifest};
use crate::system::{self, COMPILER, LOADER};
use crate::{environment, workspace};

#[derive(Args)]
pub struct Options {
    /// How long, in minutes, all targets together
    #[arg(long, default_value_t = 10.0)]
    minutes: f64,
    /// The seed of all cases
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// With AddressSanitizer in the driver and in the program
    #[arg(long)]
    address: bool,
    /// modules, structures, blobs, scribbles, caches, transfers, builds, descriptors, draws,
    /// tables: all of these by default. Or one or more of those that coverage guides:
    /// spirv-jit/words, spirv-jit/modules, traversal/builds, traversal/blobs
    targets: Vec<String>,
}

/// The folder of builds with AddressSanitizer, beside the others with different flags.
const PLATFORM: &str = "x86_64-unknown-linux-gnu";

pub fn fuzz(options: &Options) -> Result<ExitCode> {
    let (guided, through_vulkan): (Vec<_>, Vec<_>) =
        (options.targets.iter()).partition(|target| target.contains('/'));
    for target in &guided {
        run_guided(target, options.minutes / guided.len() as f64)?;
    }
    if !guided.is_empty() && through_vulkan.is_empty() {
        return Ok(ExitCode::SUCCESS);
    }
    let mut fuzz = match options.address {
        false => {
            let (driver, mut fuzz) = Driver::with("fuzz")?;
            driver.select_for(&mut fuzz);
            fuzz
        }
        true => with_address_sanitizer()?,
    };
    fuzz.args(["--minutes", &options.minutes.to_string()])
        .args(["--seed", &options.seed.to_string()])
        .arg("--out")
        .arg(workspace::target()?.join("fuzz"))
        .args(through_vulkan);
    workspace::run(fuzz)
}

/// A run of a number of cases of each target, as a part of the tests. It is built like them, so
/// that the shared shader compiler, in C++, is not built again.
pub fn of_tests(driver: &Driver, cases: u64) -> Result<Command> {
    let mut build = workspace::cargo();
    build.args(["build", "--workspace", "--bin", "fuzz"]);
    let status = build.status().context("starting cargo")?;
    ensure!(status.success(), "building fuzz failed");
    let target = workspace::target()?;
    let mut fuzz = Command::new(target.join("debug/fuzz"));
    driver.select_for(&mut fuzz);
    fuzz.args(["--cases", &cases.to_string()])
        .arg("--out")
        .arg(target.join("fuzz"));
    Ok(fuzz)
}

/// Cargo with a compiler that accepts nightly flags, and the flags.
fn sanitizing(flags: &str) -> Command {
    let mut cargo = workspace::cargo();
    // The sanitizer's runtime lies with every toolchain; the stable one takes the flag with this.
    cargo.env("RUSTC_BOOTSTRAP", "1").env("RUSTFLAGS", flags);
    cargo
}

/// Builds the driver and all that it is made of with the sanitizer, and the program as ever, but
/// linked with the sanitizer's runtime, which the driver finds in it: what the program is made of
/// (a compiler in C++ is) need not be built again.
fn with_address_sanitizer() -> Result<Command> {
    let target = workspace::target()?.join("address");
    let mut driver = sanitizing("-Zsanitizer=address");
    driver
        .args(["build", "--release", "--target", PLATFORM, "--target-dir"])
        .arg(&target)
        .args(["--package", "icd"]);
    let mut program = workspace::cargo();
    program
        .args(["rustc", "--release", "--package", "fuzz", "--bin", "fuzz"])
        .args(["--", "-Clink-arg=-rdynamic"])
        .arg(format!(
            "-Clink-arg=-Wl,--whole-archive,{},--no-whole-archive",
            address_runtime()?.display()
        ));
    for mut cargo in [driver, program] {
        let status = cargo.status().context("starting cargo")?;
        ensure!(
            status.success(),
            "building with AddressSanitizer failed; `rustup toolchain install nightly` brings a compiler that is made for it"
        );
    }
    system::require(&[&COMPILER, &LOADER])?;
    let manifest = target.join("tuff_icd.json");
    let built = target.join(PLATFORM).join("release");
    write_manifest(&manifest, &built.join(LIBRARY))?;
    // The next ordinary build replaces this program.
    let own = target.join("fuzz");
    std::fs::copy(workspace::target()?.join("release/fuzz"), &own)
        .with_context(|| format!("copying to {}", own.display()))?;
    let mut fuzz = Command::new(own);
    for (name, value) in crate::driver::environment(&manifest) {
        fuzz.env(name, value);
    }
    fuzz.env_remove("VK_ADD_DRIVER_FILES");
    // The driver reserves terabytes of addresses and looks after its own faults; leaks at the
    // loader's end are not ours.
    fuzz.env("ASAN_OPTIONS", "detect_leaks=0:abort_on_error=1");
    Ok(fuzz)
}

/// The sanitizer's runtime, which lies with the standard library.
fn address_runtime() -> Result<PathBuf> {
    let mut rustc = Command::new("rustc");
    environment::give_back(&mut rustc);
    let said = rustc.args(["--print", "target-libdir"]).output();
    let said = said.context("starting rustc")?.stdout;
    let folder = PathBuf::from(String::from_utf8_lossy(&said).trim());
    let entries = folder
        .read_dir()
        .with_context(|| format!("reading {}", folder.display()))?;
    let mut paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    paths
        .find(|path| path.to_string_lossy().ends_with("_rt.asan.a"))
        .with_context(|| format!("no runtime of AddressSanitizer in {}", folder.display()))
}

/// The options that cargo-fuzz would pass.
const COVERAGE: &str = "-Zsanitizer=address -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
    -Cllvm-args=-sanitizer-coverage-trace-compares --cfg fuzzing -Ccodegen-units=1";

/// Runs a target of libFuzzer, `CRATE/NAME`.
fn run_guided(target: &str, minutes: f64) -> Result<()> {
    let Some((package, name)) = target.split_once('/') else {
        bail!("{target} is not a fuzz target");
    };
    let target_folder = workspace::target()?.join("fuzz").join(package);
    let out = target_folder.join(name);
    let corpus = out.join("corpus");
    std::fs::create_dir_all(&corpus).with_context(|| format!("making {}", corpus.display()))?;
    let seeds = target_folder.join("seeds");
    std::fs::create_dir_all(seeds.join(name))?;
    if package == "spirv-jit" {
        let mut seed = workspace::cargo();
        seed.args(["run", "--release", "--package", package])
            .args(["--example", "seed_corpus", "--"])
            .arg(&seeds);
        ensure!(
            seed.status().context("starting cargo")?.success(),
            "no modules to start from"
        );
    }
    let mut cargo = sanitizing(COVERAGE);
    cargo
        .args(["run", "--release", "--target", PLATFORM, "--bin", name])
        .args([
            "--manifest-path",
            &format!("{package}/fuzz/Cargo.toml"),
            "--target-dir",
        ])
        .arg(workspace::target()?.join("guided"))
        .arg("--")
        .arg(&corpus)
        .arg(seeds.join(name))
        .arg(format!("-artifact_prefix={}/", out.display()))
        .arg(format!("-max_total_time={}", (60.0 * minutes).ceil()))
        // Long inputs from the start: most of what a tree does needs many triangles.
        .args(["-max_len=65536", "-len_control=0"])
        .args(["-timeout=20", "-rss_limit_mb=4096"]);
    let status = cargo.status().context("starting cargo")?;
    ensure!(
        status.success(),
        "{target}: the findings are in {}",
        out.display()
    );
    Ok(())
}
