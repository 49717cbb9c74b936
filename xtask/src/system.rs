//! The system packages that commands need.

use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Result, bail};

/// A system requirement of a command.
#[derive(Debug)]
pub struct Need {
    name: &'static str,
    is_there: fn() -> bool,
    /// The package for `apt-get`, `dnf`, `pacman` and `zypper`.
    packages: [&'static str; 4],
}

/// A C++ compiler, for the shader compiler of demo, tests and benches.
pub const COMPILER: Need = Need {
    name: "a C++ compiler (c++)",
    is_there: || std::env::var_os("CXX").is_some() || is_program("c++"),
    packages: ["g++", "gcc-c++", "gcc", "gcc-c++"],
};

/// The Vulkan loader: the library between applications and drivers.
pub const LOADER: Need = Need {
    name: "the Vulkan loader (libvulkan.so.1)",
    // SAFETY: the loader's initializers only set up its own state, and the library is closed again
    // at once.
    is_there: || unsafe { libloading::Library::new("libvulkan.so.1") }.is_ok(),
    packages: [
        "libvulkan1",
        "vulkan-loader",
        "vulkan-icd-loader",
        "libvulkan1",
    ],
};

/// A display server without a screen, for tests of presentation.
pub const XVFB: Need = Need {
    name: "Xvfb, which shows the windows of tests",
    is_there: || is_program("Xvfb"),
    packages: [
        "xvfb",
        "xorg-x11-server-Xvfb",
        "xorg-server-xvfb",
        "xorg-x11-server-Xvfb",
    ],
};

/// Python with the module for virtual environments, for the test of the wheel.
pub const PYTHON: Need = Need {
    name: "Python with venv and pip",
    is_there: || {
        let mut python = Command::new("python3");
        python.args(["-c", "import ensurepip, venv"]);
        is_success(python.stdin(Stdio::null()))
    },
    packages: ["python3-venv", "python3-pip", "python", "python3-pip"],
};

/// Whether packages may be installed: false with `--no-install`.
static MAY_INSTALL: AtomicBool = AtomicBool::new(true);

/// Disables installation.
pub fn install_nothing() {
    MAY_INSTALL.store(false, Ordering::Relaxed);
}

/// Installs the missing packages, if allowed.
///
/// # Errors
/// Something is missing; the message says what to install.
pub fn require(needs: &[&Need]) -> Result<()> {
    let missing = || -> Vec<&Need> {
        let needs = needs.iter().copied();
        needs.filter(|need| !(need.is_there)()).collect()
    };
    let first = missing();
    if first.is_empty() {
        return Ok(());
    }
    if MAY_INSTALL.load(Ordering::Relaxed)
        && is_program("apt-get")
        && let Some(prefix) = administrator()
    {
        let packages = packages(&first, 0);
        eprintln!("installing by {prefix}apt-get: {}", packages.join(" "));
        install(prefix, &packages);
    }
    match missing() {
        still if still.is_empty() => Ok(()),
        still => bail!(missing_line(&still, is_program)),
    }
}

/// The prefix of a command line with administrator rights; `None` if the user has none.
fn administrator() -> Option<&'static str> {
    // SAFETY: a plain system call.
    if unsafe { libc::geteuid() } == 0 {
        return Some("");
    }
    is_success(Command::new("sudo").args(["-n", "true"])).then_some("sudo -n ")
}

/// The packages with a requirement, for one of the package managers.
fn packages(needs: &[&Need], manager: usize) -> Vec<&'static str> {
    needs.iter().map(|need| need.packages[manager]).collect()
}

/// Installs packages. The caller checks whether that succeeded.
fn install(prefix: &str, packages: &[&str]) {
    let apt = |arguments: &[&str]| {
        let mut words = prefix.split_whitespace().chain(["env"]);
        let mut apt = Command::new(words.next().unwrap_or("env"));
        apt.args(words)
            .args(["DEBIAN_FRONTEND=noninteractive", "apt-get", "--quiet"])
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::null());
        apt.status().is_ok_and(|status| status.success())
    };
    let mut install = vec!["install", "--yes", "--no-install-recommends"];
    install.extend(packages);
    // A fresh container has no lists of packages yet.
    let _ = apt(&install) || (apt(&["update"]) && apt(&install));
}

/// One line: the missing packages, and the command that installs them here.
fn missing_line(missing: &[&Need], is_program: impl Fn(&str) -> bool) -> String {
    let names: Vec<&str> = missing.iter().map(|need| need.name).collect();
    let managers = [
        "apt-get install",
        "dnf install",
        "pacman -S",
        "zypper install",
    ];
    let program = |line: &str| line.split(' ').next().is_some_and(&is_program);
    let manager = (1..managers.len()).find(|&it| program(managers[it]));
    let manager = manager.unwrap_or(0);
    format!(
        "missing: {}; install with `sudo {} {}`",
        names.join(", "),
        managers[manager],
        packages(missing, manager).join(" ")
    )
}

/// True when a program of this name is on the search path.
pub fn is_program(name: &str) -> bool {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let places = std::env::split_paths(&folders).map(|folder| folder.join(name));
    places.into_iter().any(|place: PathBuf| place.is_file())
}

/// Whether a program starts and succeeds, with its output discarded.
fn is_success(program: &mut Command) -> bool {
    let status = program.stdout(Stdio::null()).stderr(Stdio::null()).status();
    status.is_ok_and(|status| status.success())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A requirement that no machine meets.
    const NOTHING: Need = Need {
        name: "the philosopher's stone",
        is_there: || false,
        packages: ["stone", "stone-rpm", "stone-pacman", "stone-zypper"],
    };

    #[test]
    fn the_line_says_what_to_install() {
        let line = |manager: &str| missing_line(&[&LOADER, &NOTHING], |program| program == manager);
        for (manager, expected) in [
            ("apt-get", "`sudo apt-get install libvulkan1 stone`"),
            ("dnf", "`sudo dnf install vulkan-loader stone-rpm`"),
            ("pacman", "`sudo pacman -S vulkan-icd-loader stone-pacman`"),
            ("zypper", "`sudo zypper install libvulkan1 stone-zypper`"),
            ("none", "`sudo apt-get install libvulkan1 stone`"),
        ] {
            let line = line(manager);
            assert!(line.contains("missing: the Vulkan loader") && line.contains(expected));
            assert!(line.contains("the philosopher's stone") && !line.contains('\n'));
        }
    }

    #[test]
    fn nothing_is_installed_where_nothing_may_be() {
        install_nothing();
        let message = require(&[&NOTHING]).unwrap_err().to_string();
        assert!(message.starts_with("missing: the philosopher's stone; install with "));
        require(&[]).unwrap();
    }
}
