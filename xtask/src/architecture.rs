//! Target architectures. A cross compiler compiles programs for another architecture than this
//! machine's, and QEMU runs them.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use clap::ValueEnum;

use crate::{system, windows, workspace};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Architecture {
    X86_64,
    Aarch64,
}

/// A platform that commands build for, by Rust's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Target {
    #[value(name = "x86_64-unknown-linux-gnu", alias = "x86_64")]
    X86_64,
    #[value(name = "aarch64-unknown-linux-gnu", alias = "aarch64")]
    Aarch64,
    #[value(name = windows::PLATFORM)]
    Windows,
}

/// The variable with which QEMU limits the address space of its program.
const ADDRESS_SPACE: &str = "QEMU_RESERVED_VA";

impl Architecture {
    /// This machine's own, if Tuff is built for it.
    pub fn here() -> Option<Architecture> {
        let all = [Architecture::X86_64, Architecture::Aarch64];
        all.into_iter().find(|it| it.is_here())
    }

    /// Rust's name, which GNU's tools and QEMU also use.
    pub fn name(self) -> &'static str {
        match self {
            Architecture::X86_64 => "x86_64",
            Architecture::Aarch64 => "aarch64",
        }
    }

    /// Whether it is this machine's architecture.
    pub fn is_here(self) -> bool {
        self.name() == std::env::consts::ARCH
    }

    /// Debian's name.
    fn debian_name(self) -> &'static str {
        match self {
            Architecture::X86_64 => "amd64",
            Architecture::Aarch64 => "arm64",
        }
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
    /// Looks for the tools and for the loader.
    ///
    /// # Errors
    /// One of them is missing. The message says what to install.
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
        // In a folder of its own, without the distribution's other libraries: the emulated C
        // library is the cross compiler's.
        let loader = Loader::of(architecture)?;
        std::fs::create_dir_all(&folder)
            .and_then(|()| std::fs::copy(&loader.library, folder.join(LOADER)))
            .with_context(|| format!("copying the loader to {}", folder.display()))?;
        Ok(Emulation {
            architecture,
            loader: folder,
        })
    }

    /// Makes cargo build for the architecture and run the programs.
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
        // Installed layers are for this machine's architecture, so the loader would fail to load
        // them.
        cargo.env("VK_LAYER_PATH", &self.loader);
        // The emulator has a record for each page, which takes half a minute for the terabyte that
        // a device would reserve.
        if std::env::var_os(ADDRESS_SPACE).is_none() {
            cargo.env(ADDRESS_SPACE, "16G");
        }
    }
}

/// The file name of the Vulkan loader.
const LOADER: &str = "libvulkan.so.1";

/// The distribution's Vulkan loader, and its licence.
#[derive(Debug, PartialEq, Eq)]
pub struct Loader {
    pub library: PathBuf,
    pub licence: PathBuf,
}

impl Loader {
    /// The one that is installed for an architecture.
    ///
    /// # Errors
    /// There is none, or it has no licence. The message says what to install.
    pub fn of(architecture: Architecture) -> Result<Loader> {
        Self::below(Path::new("/"), architecture)
    }

    fn below(root: &Path, architecture: Architecture) -> Result<Loader> {
        let mut folders = vec![format!("usr/lib/{}-linux-gnu", architecture.name())];
        if architecture.is_here() {
            folders.extend(["usr/lib64", "usr/lib"].map(str::to_owned));
        }
        let debian = architecture.debian_name();
        let mut libraries = (folders.iter()).map(|folder| root.join(folder).join(LOADER));
        let Some(library) = libraries.find(|file| file.is_file()) else {
            let name = architecture.name();
            bail!(
                "there is no Vulkan loader for {name} here; on Debian `sudo dpkg --add-architecture {debian} && sudo apt-get update && \
                 sudo apt-get install libvulkan1:{debian}` brings it"
            );
        };
        // Debian and its derivatives, Fedora, Arch.
        let licences = [
            "usr/share/doc/libvulkan1/copyright",
            "usr/share/licenses/vulkan-loader/LICENSE.txt",
            "usr/share/licenses/vulkan-icd-loader/LICENSE.txt",
        ];
        let mut licences = licences.iter().map(|file| root.join(file));
        let licence = licences.find(|file| file.is_file()).with_context(|| {
            format!(
                "{} came without a licence: give both by --loader",
                library.display()
            )
        })?;
        Ok(Loader { library, licence })
    }

    /// A library that the user names, with its licence beside it.
    ///
    /// # Errors
    /// One of them is missing.
    pub fn named(library: &Path) -> Result<Loader> {
        let library = std::path::absolute(library).context("the loader's path")?;
        ensure!(library.is_file(), "there is no {}", library.display());
        let mut licences = ["LICENSE.txt", "copyright"]
            .iter()
            .map(|name| library.with_file_name(name));
        let licence = licences.find(|file| file.is_file()).with_context(|| {
            format!(
                "{} has no licence beside it, LICENSE.txt or copyright",
                library.display()
            )
        })?;
        Ok(Loader { library, licence })
    }
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

    #[test]
    fn targets_are_triples_or_architectures() {
        let target = |text: &str| Target::from_str(text, false).ok();
        assert_eq!(target("aarch64"), Some(Target::Aarch64));
        assert_eq!(target("aarch64-unknown-linux-gnu"), Some(Target::Aarch64));
        assert_eq!(target("x86_64"), Some(Target::X86_64));
        assert_eq!(target("x86_64-pc-windows-gnu"), Some(Target::Windows));
        assert_eq!(target("aarch64-apple-darwin"), None);
    }

    #[test]
    fn loaders_come_with_their_licences() {
        let root = std::env::temp_dir().join(format!("tuff-loader-{}", std::process::id()));
        let missing = Loader::below(&root, Architecture::Aarch64).unwrap_err();
        assert!(
            missing.to_string().contains("libvulkan1:arm64"),
            "{missing}"
        );
        let put = |path: &str| {
            let path = root.join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, "").unwrap();
            path
        };
        let library = put("usr/lib/aarch64-linux-gnu/libvulkan.so.1");
        let bare = Loader::below(&root, Architecture::Aarch64).unwrap_err();
        let named = Loader::named(&library).unwrap_err();
        let licence = put("usr/share/doc/libvulkan1/copyright");
        let found = Loader::below(&root, Architecture::Aarch64).unwrap();
        let beside = put("usr/lib/aarch64-linux-gnu/LICENSE.txt");
        let by_name = Loader::named(&library).unwrap();
        std::fs::remove_dir_all(&root).unwrap();
        assert!(bare.to_string().contains("without a licence"), "{bare}");
        assert!(named.to_string().contains("no licence beside"), "{named}");
        let library = || library.clone();
        assert_eq!(
            found,
            Loader {
                library: library(),
                licence
            }
        );
        assert_eq!(
            by_name,
            Loader {
                library: library(),
                licence: beside
            }
        );
    }
}
