//! The Vulkan loader: the system's library between applications and drivers.

use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Result, bail};

const LIBRARY: &str = "libvulkan.so.1";

/// True when applications will find a Vulkan loader.
pub fn is_installed() -> bool {
    // SAFETY: the loader's initialisers only set up its own state, and it is closed again at once.
    unsafe { libloading::Library::new(LIBRARY) }.is_ok()
}

/// Sees to it that there is a loader: installs it where this program may, and otherwise fails
/// with one line that says what to install.
pub fn require() -> Result<()> {
    if is_installed() || (may_install() && install() && is_installed()) {
        return Ok(());
    }
    bail!(
        "the Vulkan loader ({LIBRARY}) is missing; install it with `{}`",
        install_command()
    );
}

/// True on a Debian-like system, for its administrator.
fn may_install() -> bool {
    let is_root = Command::new("id")
        .arg("-u")
        .output()
        .is_ok_and(|id| id.stdout.trim_ascii() == b"0");
    is_root && Path::new("/usr/bin/apt-get").exists()
}

fn install() -> bool {
    eprintln!("installing the Vulkan loader (libvulkan1)");
    let apt = |arguments: &[&str]| {
        Command::new("apt-get")
            .args(arguments)
            .env("DEBIAN_FRONTEND", "noninteractive")
            .stdout(Stdio::null())
            .status()
            .is_ok_and(|status| status.success())
    };
    let install = ["install", "--yes", "--no-install-recommends", "libvulkan1"];
    apt(&install) || (apt(&["update"]) && apt(&install))
}

/// What a person would type to install the loader here.
fn install_command() -> &'static str {
    let has = |program: &str| Path::new("/usr/bin").join(program).exists();
    if has("dnf") {
        "sudo dnf install vulkan-loader"
    } else if has("pacman") {
        "sudo pacman -S vulkan-icd-loader"
    } else if has("zypper") {
        "sudo zypper install libvulkan1"
    } else {
        "sudo apt-get install libvulkan1"
    }
}
