//! `cargo xtask test --target x86_64-pc-windows-gnu`: the driver and the tests as programs for
//! Windows, run by Wine through the Khronos loader.
//!
//! That loader ignores variables in processes with administrator rights, which all processes have
//! under Wine. So the driver is registered in a Wine prefix in the target folder. The loader reads
//! the registry only if DXGI starts, which needs a display.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, ExitStatus, Stdio};

use anyhow::{Context, Result, ensure};

use crate::driver::write_manifest;
use crate::skips::Skips;
use crate::windows::{self, LOADER, PLATFORM};
use crate::{system, workspace};

/// The variable by which tests find the compiler of GLSL.
const GLSL_SERVER: &str = "TUFF_GLSL_SERVER";

/// The registry key of drivers.
const DRIVERS: &str = r"HKLM\SOFTWARE\Khronos\Vulkan\Drivers";

/// This setting starts Wine's DXGI without OpenGL. With OpenGL, programs take long to end after
/// they have passed, and Wine kills them on a busy machine with exit status 137.
const DIRECT3D: &str = r"HKCU\Software\Wine\Direct3D";

/// The black-box tests that run without `--deep`: those that depend most on the system.
const CHOSEN: [&str; 13] = [
    "compute",
    "descriptors",
    "device",
    "draws",
    "external_handles",
    "float_functions",
    "large_buffers",
    "ray_shaders",
    "settings",
    "sparse",
    "structures",
    "swapchains",
    "win32_windows",
];

/// The selection of tests.
pub struct Order<'a> {
    /// The Khronos loader.
    pub loader: &'a Path,
    /// All tests, those of the crates too.
    pub is_whole: bool,
    /// For the test programs.
    pub arguments: &'a [String],
}

pub fn test(order: &Order) -> Result<ExitCode> {
    for program in ["wine", "xvfb-run", "xauth"] {
        ensure!(
            system::is_program(program),
            "{program} is needed; install it with `sudo apt-get install wine xvfb xauth`"
        );
    }
    let loader = std::path::absolute(order.loader).context("the loader's path")?;
    ensure!(
        loader.is_file() && loader.ends_with(LOADER),
        "there is no {LOADER} at {}",
        loader.display()
    );
    let mut driver = cargo("build")?;
    driver.args(["--package", "icd"]);
    let status = driver.status().context("starting cargo")?;
    ensure!(status.success(), "building icd failed");
    let folder = windows::programs("debug")?;
    let manifest = folder.join("tuff_icd.json");
    let library = on_drive(&folder.join(windows::LIBRARY));
    write_manifest(&manifest, library.as_ref())?;
    // Beside the test programs, and `tuff`: Wine's own loader lies in a folder that it searches
    // next.
    for beside in [&folder, &folder.join("deps")] {
        std::fs::create_dir_all(beside)
            .and_then(|()| std::fs::copy(&loader, beside.join(LOADER)))
            .with_context(|| format!("copying the loader to {}", beside.display()))?;
    }
    register(&manifest)?;

    let compiler = Compiler::start()?;
    let mut inner = ExitCode::SUCCESS;
    if order.is_whole {
        let mut tests = cargo("test")?;
        for package in ["lanes", "images", "traversal", "spirv-jit", "icd"] {
            tests.args(["--package", package]);
        }
        inner = run(tests, &compiler, order)?;
    }
    let skips = Skips::new()?;
    // The program that comes with the driver: seconds.
    let mut program = cargo("test")?;
    program.args(["--package", "tuff"]);
    let program = run(program, &compiler, order)?;
    let mut tests = cargo("test")?;
    tests.args(["--package", "tuff-tests"]);
    if order.is_whole {
        // The digests of pictures, and the demo.
        tests.args(["--package", "workloads", "--package", "demo"]);
    } else {
        for name in CHOSEN {
            tests.args(["--test", name]);
        }
    }
    skips.tell(&mut tests);
    // Wine's own loader finds the drivers of the machine: tests fail on those.
    tests.env("TUFF_UNDER_TEST", "1");
    let outer = run(tests, &compiler, order)?;
    skips.print()?;
    let is_good = [inner, program, outer]
        .iter()
        .all(|it| *it == ExitCode::SUCCESS);
    Ok(super::code(is_good))
}

/// Cargo for programs of the platform, in the development profile.
fn cargo(command: &str) -> Result<Command> {
    let mut cargo = windows::cargo(command)?;
    let variable = PLATFORM.to_uppercase().replace('-', "_");
    cargo.env(
        format!("CARGO_TARGET_{variable}_RUNNER"),
        "xvfb-run --auto-servernum wine",
    );
    set_wine(&mut cargo)?;
    Ok(cargo)
}

/// Has a program find the Wine of the target folder.
fn set_wine(program: &mut Command) -> Result<()> {
    let prefix = windows::target()?.join("wine");
    program.env("WINEPREFIX", prefix);
    // A new one asks whether to install a browser and .NET.
    program.env("WINEDLLOVERRIDES", "mscoree=;mshtml=;vulkan-1=n");
    if std::env::var_os("WINEDEBUG").is_none() {
        program.env("WINEDEBUG", "-all");
    }
    Ok(())
}

/// Registers a driver as the only one, and sets Wine up.
fn register(manifest: &Path) -> Result<()> {
    let reg = |arguments: &[&str]| -> Result<ExitStatus> {
        let mut reg = Command::new("wine");
        reg.arg("reg").args(arguments);
        set_wine(&mut reg)?;
        reg.stdout(Stdio::null()).stderr(Stdio::null());
        reg.status().context("starting wine")
    };
    // There may be none.
    reg(&["delete", DRIVERS, "/f"])?;
    let name = on_drive(manifest);
    let add = |key: &str, value: &str, kind: &str, data: &str| {
        reg(&["add", key, "/v", value, "/t", kind, "/d", data, "/f"])
    };
    let added = add(DRIVERS, &name, "REG_DWORD", "0")?;
    ensure!(added.success(), "wine does not register {name}");
    let set = add(DIRECT3D, "renderer", "REG_SZ", "no3d")?;
    ensure!(set.success(), "wine does not set {DIRECT3D}");
    Ok(())
}

fn run(mut tests: Command, compiler: &Compiler, order: &Order) -> Result<ExitCode> {
    tests.env(GLSL_SERVER, &compiler.address);
    tests.env("RUST_TEST_THREADS", "1");
    tests.arg("--no-fail-fast").arg("--").args(order.arguments);
    workspace::run(tests)
}

/// A path of this machine in the form for programs under Wine.
fn on_drive(path: &Path) -> String {
    format!("Z:{}", path.display()).replace('/', "\\")
}

/// The program that compiles GLSL on this side.
struct Compiler {
    process: Option<Child>,
    address: String,
}

impl Compiler {
    /// Builds and starts it, unless the user names one that runs already.
    fn start() -> Result<Compiler> {
        if let Ok(address) = std::env::var(GLSL_SERVER) {
            return Ok(Compiler {
                process: None,
                address,
            });
        }
        let mut cargo = workspace::cargo();
        cargo.args(["run", "--quiet", "--package", "glsl"]);
        cargo.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut process = cargo.spawn().context("starting cargo")?;
        let output = process.stdout.take().context("the compiler's output")?;
        let mut address = String::new();
        BufReader::new(output)
            .read_line(&mut address)
            .context("the compiler's address")?;
        ensure!(!address.is_empty(), "building glsl failed");
        Ok(Compiler {
            process: Some(process),
            address: address.trim().into(),
        })
    }
}

impl Drop for Compiler {
    fn drop(&mut self) {
        if let Some(mut process) = self.process.take() {
            // It ends with its input.
            drop(process.stdin.take());
            let _ = process.wait();
        }
    }
}

/// The loader that an argument names.
///
/// # Errors
/// There is none. The message says what to do.
pub fn named(loader: Option<&PathBuf>) -> Result<&Path> {
    loader.map(PathBuf::as_path).context(
        "Wine's own Vulkan loader does not find drivers of Windows: build the Khronos loader \
         (https://github.com/KhronosGroup/Vulkan-Loader) by mingw, and give its vulkan-1.dll by --loader",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_lie_on_the_drive_that_wine_has_for_them() {
        assert_eq!(on_drive(Path::new("/a b/c.dll")), r"Z:\a b\c.dll");
    }
}
