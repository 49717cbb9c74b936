//! Folders of the workspace, and calls of cargo.

use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, ExitStatus};

use anyhow::{Context, Result, ensure};

use crate::environment;

/// The root of the repository.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("xtask lies in the workspace")
}

/// Cargo's target directory, for any user configuration, since this program runs from
/// `<target>/<profile>/xtask`.
pub fn target() -> Result<PathBuf> {
    let program = std::env::current_exe().context("where xtask lies")?;
    let target = program.ancestors().nth(2);
    Ok(target.context("xtask lies in a target directory")?.into())
}

/// Cargo, called at the root of the workspace, in the environment that cargo itself made for this
/// program.
pub fn cargo() -> Command {
    let program = environment::of_cargo("CARGO").unwrap_or("cargo".as_ref());
    let mut cargo = Command::new(program);
    environment::give_back(&mut cargo);
    cargo.current_dir(root());
    cargo
}

/// Builds packages in release mode, one after the other.
pub fn build_release(packages: &[&str]) -> Result<()> {
    for package in packages {
        finish(build_command(package), package)?;
    }
    Ok(())
}

/// Builds a package in release mode while other builds print their progress.
pub fn build_release_quietly(package: &str) -> Result<()> {
    let mut build = build_command(package);
    build.arg("--quiet");
    finish(build, package)
}

fn finish(mut build: Command, package: &str) -> Result<()> {
    let status = build.status().context("starting cargo")?;
    ensure!(status.success(), "building {package} failed");
    Ok(())
}

/// Packages that are built together share their dependencies with the features of all of them, so
/// that the driver would be built again whenever it is built with others. One at a time, each is
/// built once.
fn build_command(package: &str) -> Command {
    let mut cargo = cargo();
    cargo.args(["build", "--release", "--package", package]);
    cargo
}

/// The path of a program of a release build.
pub fn program(name: &str) -> Result<Command> {
    Ok(Command::new(target()?.join("release").join(name)))
}

/// Runs a program and returns its exit code.
pub fn run(mut program: Command) -> Result<ExitCode> {
    let status = program
        .status()
        .with_context(|| format!("starting {}", program.get_program().display()))?;
    Ok(exit_code(status))
}

/// The exit code for a child's exit status.
fn exit_code(status: ExitStatus) -> ExitCode {
    match (status.code(), status.signal()) {
        (Some(code), _) => ExitCode::from(u8::try_from(code).unwrap_or(1)),
        // The reader of its output has seen enough: no error, and the exit code that a shell
        // returns for it.
        (None, Some(libc::SIGPIPE)) => ExitCode::from(128 + libc::SIGPIPE as u8),
        (None, _) => {
            eprintln!("error: {status}");
            ExitCode::FAILURE
        }
    }
}

/// A path relative to the current folder, if that is shorter.
pub fn shown(path: &Path) -> PathBuf {
    std::env::current_dir()
        .ok()
        .and_then(|here| path.strip_prefix(here).ok())
        .unwrap_or(path)
        .to_path_buf()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The driver's dependencies must not depend on those of another command.
    #[test]
    fn packages_are_built_one_at_a_time() {
        let command = build_command("icd");
        let packages = command.get_args().filter(|word| *word == "--package");
        assert_eq!(packages.count(), 1);
    }

    #[test]
    fn ends_are_what_a_shell_makes_of_them() {
        for (line, expected) in [("exit 3", 3), ("kill -PIPE $$", 141), ("kill $$", 1)] {
            let mut shell = Command::new("sh");
            shell.args(["-c", line]);
            assert_eq!(run(shell).unwrap(), ExitCode::from(expected), "{line}");
        }
    }
}
