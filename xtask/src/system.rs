//! The system packages that commands need.

use std::process::{Command, Stdio};

use anyhow::{Result, bail};

/// Something of the system that a command cannot do without.
pub struct Need {
    name: &'static str,
    is_there: fn() -> bool,
    /// The package for `apt-get`, `dnf`, `pacman` and `zypper`.
    packages: [&'static str; 4],
}

/// The Vulkan loader: the library between applications and drivers.
pub const LOADER: Need = Need {
    name: "the Vulkan loader (libvulkan.so.1)",
    // SAFETY: the loader's initialisers only set up its own state, and it is closed again at once.
    is_there: || unsafe { libloading::Library::new("libvulkan.so.1") }.is_ok(),
    packages: [
        "libvulkan1",
        "vulkan-loader",
        "vulkan-icd-loader",
        "libvulkan1",
    ],
};

/// A virtual display server, for tests of presentation.
pub const XVFB: Need = Need {
    name: "Xvfb, which shows the windows of tests,",
    is_there: || is_program("Xvfb"),
    packages: [
        "xvfb",
        "xorg-x11-server-Xvfb",
        "xorg-server-xvfb",
        "xorg-x11-server-Xvfb",
    ],
};

/// Sees to it that something is there: installs it where this program may, and otherwise fails
/// with one line that says what to install.
pub fn require(need: &Need) -> Result<()> {
    let is_there = need.is_there;
    if is_there() || (may_install() && install(need) && is_there()) {
        return Ok(());
    }
    bail!(
        "{} is missing; install it with `{}`",
        need.name,
        install_command(need)
    );
}

/// True when a program of this name is on the search path.
fn is_program(name: &str) -> bool {
    std::env::var_os("PATH")
        .is_some_and(|path| std::env::split_paths(&path).any(|folder| folder.join(name).is_file()))
}

/// True on a Debian-like system, for its administrator.
fn may_install() -> bool {
    let is_root = Command::new("id")
        .arg("-u")
        .output()
        .is_ok_and(|id| id.stdout.trim_ascii() == b"0");
    is_root && is_program("apt-get")
}

fn install(need: &Need) -> bool {
    let package = need.packages[0];
    eprintln!("installing the package {package}");
    let apt = |arguments: &[&str]| {
        Command::new("apt-get")
            .args(arguments)
            .env("DEBIAN_FRONTEND", "noninteractive")
            .stdout(Stdio::null())
            .status()
            .is_ok_and(|status| status.success())
    };
    let install = ["install", "--yes", "--no-install-recommends", package];
    apt(&install) || (apt(&["update"]) && apt(&install))
}

/// The command that installs it here.
fn install_command(need: &Need) -> String {
    let [apt, dnf, pacman, zypper] = need.packages;
    if is_program("dnf") {
        format!("sudo dnf install {dnf}")
    } else if is_program("pacman") {
        format!("sudo pacman -S {pacman}")
    } else if is_program("zypper") {
        format!("sudo zypper install {zypper}")
    } else {
        format!("sudo apt-get install {apt}")
    }
}
