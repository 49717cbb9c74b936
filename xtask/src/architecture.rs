//! Architectures that Tuff is built for. Programs of another one than this machine's are compiled by its cross compiler, and run by QEMU.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Result, ensure};
use clap::ValueEnum;

use crate::{system, workspace};

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Architecture {
    #[value(name = "x86_64")]
    X86_64,
    #[value(name = "aarch64")]
    Aarch64,
}

/// The variable by which QEMU limits the address space of what it runs.
const ADDRESS_SPACE: &str = "QEMU_RESERVED_VA";

impl Architecture {
    /// By Rust's name, which is also that of GNU's tools and of QEMU.
    pub fn name(self) -> &'static str {
        match self {
            Architecture::X86_64 => "x86_64",
            Architecture::Aarch64 => "aarch64",
        }
    }

    /// Whether it is this machine's own.
    pub fn is_here(self) -> bool {
        self.name() == std::env::consts::ARCH
    }

    /// Rust's name of a Linux system of this architecture.
    pub fn platform(self) -> String {
        format!("{}-unknown-linux-gnu", self.name())
    }
}

/// The tools that compile and run programs of another architecture here.
pub struct Emulation {
    architecture: Architecture,
    /// The folder of the architecture's Vulkan loader.
    loader: PathBuf,
}

impl Emulation {
    /// Looks for the tools, and builds the loader.
    ///
    /// # Errors
    /// A tool is not there, or the loader cannot be built: the message says what to install.
    pub fn new(architecture: Architecture) -> Result<Emulation> {
        let name = architecture.name();
        for program in [format!("{name}-linux-gnu-g++"), format!("qemu-{name}")] {
            ensure!(
                system::is_program(&program),
                "{program} is needed; install it with `sudo apt-get install g++-{name}-linux-gnu qemu-user`"
            );
        }
        let folder = workspace::target()?
            .join(architecture.platform())
            .join("loader");
        let loader = built_loader(&folder, None, architecture)?;
        let loader = loader.parent().unwrap_or(Path::new("/")).to_path_buf();
        Ok(Emulation {
            architecture,
            loader,
        })
    }

    /// Has cargo build for the architecture, and run what it built.
    pub fn select_for(&self, cargo: &mut Command) {
        let name = self.architecture.name();
        let platform = self.architecture.platform();
        cargo.args(["--target", &platform]);
        let variable = platform.to_uppercase().replace('-', "_");
        cargo.env(
            format!("CARGO_TARGET_{variable}_LINKER"),
            format!("{name}-linux-gnu-gcc"),
        );
        cargo.env(
            format!("CARGO_TARGET_{variable}_RUNNER"),
            format!("qemu-{name}"),
        );
        // Where Debian's cross compiler has the architecture's C library.
        cargo.env("QEMU_LD_PREFIX", format!("/usr/{name}-linux-gnu"));
        cargo.env("LD_LIBRARY_PATH", &self.loader);
        // Layers that are installed here are of this machine's architecture: the loader would name them, and fail to load them.
        cargo.env("VK_LAYER_PATH", &self.loader);
        // The emulator keeps a note of each page: of the terabyte that a device would reserve they take it half a minute.
        if std::env::var_os(ADDRESS_SPACE).is_none() {
            cargo.env(ADDRESS_SPACE, "16G");
        }
    }
}

/// The loader of `packaging/loader.sh`, in `folder`; for `glibc` or newer, or for the compiler's own.
///
/// # Errors
/// It cannot be built.
pub fn built_loader(
    folder: &Path,
    glibc: Option<&str>,
    architecture: Architecture,
) -> Result<PathBuf> {
    let mut script = Command::new(workspace::root().join("packaging/loader.sh"));
    script.arg(folder).arg(glibc.unwrap_or("here"));
    let status = script.arg(architecture.name()).status()?;
    ensure!(
        status.success(),
        "the Vulkan loader could not be built: packaging/loader.sh says what it needs"
    );
    Ok(folder.join("libvulkan.so.1"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cargo_is_told_how_to_link_and_to_run() {
        let emulation = Emulation {
            architecture: Architecture::Aarch64,
            loader: "/loader".into(),
        };
        let mut cargo = Command::new("cargo");
        emulation.select_for(&mut cargo);
        let arguments: Vec<_> = cargo.get_args().collect();
        assert_eq!(arguments, ["--target", "aarch64-unknown-linux-gnu"]);
        for (name, value) in [
            (
                "CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER",
                "aarch64-linux-gnu-gcc",
            ),
            (
                "CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER",
                "qemu-aarch64",
            ),
            ("QEMU_LD_PREFIX", "/usr/aarch64-linux-gnu"),
            ("LD_LIBRARY_PATH", "/loader"),
            ("VK_LAYER_PATH", "/loader"),
            (ADDRESS_SPACE, "16G"),
        ] {
            let mut set = cargo.get_envs();
            assert!(
                set.any(|it| it == (name.as_ref(), Some(value.as_ref()))),
                "{name}"
            );
        }
    }
}
