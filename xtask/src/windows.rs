//! Builds programs for Windows with cargo and mingw.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};

use crate::{environment, system, workspace};

/// Rust's name of the platform.
pub const PLATFORM: &str = "x86_64-pc-windows-gnu";
/// The file name of the driver's library there.
pub const LIBRARY: &str = "vulkan_tuff.dll";
/// The file name of the Vulkan loader there.
pub const LOADER: &str = "vulkan-1.dll";

/// The compiler of C that links.
const LINKER: &str = "x86_64-w64-mingw32-gcc";

/// The source of Rust's library for the platform.
#[derive(Debug, PartialEq, Eq)]
enum Library {
    Installed,
    /// Built with the programs, from the sources that came with the compiler.
    Built,
}

impl Library {
    /// That of the compiler in a folder.
    ///
    /// # Errors
    /// There is none. The message says what to install.
    fn of(sysroot: &Path) -> Result<Library> {
        let rustlib = sysroot.join("lib/rustlib");
        if rustlib.join(PLATFORM).join("lib").is_dir() {
            return Ok(Library::Installed);
        }
        if rustlib.join("src/rust/library/std/Cargo.toml").is_file() {
            return Ok(Library::Built);
        }
        bail!(
            "Rust has no library for {PLATFORM} here: `rustup target add {PLATFORM}` brings it, and where Rust is the \
             distribution's, the package rust-src has its sources"
        )
    }
}

/// The target folder of builds for the platform. It is not the one of this machine's programs:
/// build scripts run again when `RUSTC_BOOTSTRAP` changes, so that builds with and without the
/// variable would compile each other's dependencies anew.
pub fn target() -> Result<PathBuf> {
    Ok(workspace::target()?.join("windows"))
}

/// The folder of programs that are built for the platform, in a profile.
pub fn programs(profile: &str) -> Result<PathBuf> {
    Ok(target()?.join(PLATFORM).join(profile))
}

/// Cargo with one of its commands, for programs of the platform. [`programs`] says where they are.
///
/// # Errors
/// The linker or Rust's library is missing. The message says what to install.
pub fn cargo(command: &str) -> Result<Command> {
    ensure!(
        system::is_program(LINKER),
        "{LINKER} is needed; install it with `sudo apt-get install gcc-mingw-w64-x86-64-posix`"
    );
    let library = Library::of(&sysroot()?)?;
    let mut cargo = workspace::cargo();
    cargo.args([command, "--target", PLATFORM, "--target-dir"]);
    cargo.arg(target()?);
    if library == Library::Built {
        cargo.arg("-Zbuild-std=std,panic_unwind");
        // The option is for nightly compilers, and the sources fit this one alone.
        cargo.env("RUSTC_BOOTSTRAP", "1");
    }
    let variable = PLATFORM.to_uppercase().replace('-', "_");
    cargo.env(format!("CARGO_TARGET_{variable}_LINKER"), LINKER);
    Ok(cargo)
}

/// The folder of the compiler.
fn sysroot() -> Result<PathBuf> {
    let mut rustc = Command::new("rustc");
    environment::give_back(&mut rustc);
    rustc.current_dir(workspace::root());
    let output = rustc.args(["--print", "sysroot"]).output();
    let output = output.context("starting rustc")?;
    ensure!(output.status.success(), "rustc does not report its sysroot");
    Ok(String::from_utf8_lossy(&output.stdout).trim().into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_library_is_the_one_that_is_there() {
        let root = std::env::temp_dir().join(format!("tuff-sysroot-{}", std::process::id()));
        let none = Library::of(&root).unwrap_err().to_string();
        assert!(
            none.contains("rustup target add x86_64-pc-windows-gnu"),
            "{none}"
        );
        let std = root.join("lib/rustlib/src/rust/library/std");
        std::fs::create_dir_all(&std).unwrap();
        std::fs::write(std.join("Cargo.toml"), "").unwrap();
        let built = Library::of(&root).unwrap();
        std::fs::create_dir_all(root.join("lib/rustlib").join(PLATFORM).join("lib")).unwrap();
        let installed = Library::of(&root).unwrap();
        std::fs::remove_dir_all(&root).unwrap();
        assert_eq!((built, installed), (Library::Built, Library::Installed));
    }
}
