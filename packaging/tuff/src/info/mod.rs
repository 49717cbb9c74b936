//! `tuff info`: the devices that programs find on this machine, and problems with their fixes.

pub mod probe;
mod problems;

use std::process::ExitCode;

use crate::installation::Installation;
use crate::registered::{self, Registered};
use crate::{loader, os, refusals};
use problems::Problem;

/// The observations.
pub struct Seen {
    /// The driver's library, or the problem with it.
    pub library: Result<std::path::PathBuf, String>,
    pub system_loader: Option<loader::System>,
    /// Whether the package has a loader that works here; or why not.
    pub own_loader: Result<(), String>,
    /// Devices under `tuff run`.
    pub selected: probe::Found,
    /// Devices without it.
    pub unselected: probe::Found,
    /// The process's control group, if that has a limit.
    pub group: Option<cgroup::Memory>,
    /// Variables that loader or driver read, and their values.
    pub variables: Vec<(String, String)>,
    /// Whether the loader ignores them in programs that are started from this one.
    pub are_variables_ignored: bool,
    /// Manifests of Tuff in Windows' registry, and their users.
    pub registered: Vec<Registered>,
}

/// Prints all observations; fails if programs cannot use Tuff.
pub fn print(installation: &Installation) -> ExitCode {
    let seen = Seen {
        library: installation.library().map_err(|error| format!("{error:#}")),
        system_loader: loader::System::find().filter(|found| !installation.brought(found)),
        own_loader: installation.own_loader.clone().map(|_| ()),
        selected: probe::ask(&installation.variables()),
        unselected: probe::ask(&[]),
        group: cgroup::Groups::open(os::read_at).memory(),
        variables: variables(),
        are_variables_ignored: os::variables_are_ignored(),
        registered: registered::all(),
    };
    let mut told = text(installation, &seen);
    for Problem { what, mend } in problems::find(&seen) {
        told += &format!("\nproblem: {what}\n   mend: {mend}\n");
    }
    crate::print(told.as_bytes());
    let works = seen
        .selected
        .devices
        .iter()
        .any(|it| it.is_tuff() && it.created == "yes");
    match works {
        true => ExitCode::SUCCESS,
        false => ExitCode::FAILURE,
    }
}

/// Variables that loader, driver and Mesa's layer that puts a device first
/// (`MESA_VK_DEVICE_SELECT`) read.
fn variables() -> Vec<(String, String)> {
    let mut set: Vec<_> = std::env::vars_os()
        .map(|(name, value)| {
            let text = |it: std::ffi::OsString| it.to_string_lossy().into_owned();
            (text(name), text(value))
        })
        .filter(|(name, _)| {
            ["VK_", "TUFF_", "MESA_VK_"]
                .iter()
                .any(|start| name.starts_with(start))
                || name == os::LIBRARY_FOLDERS && !cfg!(windows)
        })
        .collect();
    set.sort();
    set
}

/// The programs for which the loader ignores its variables.
const IGNORED_VARIABLES: &str = match cfg!(windows) {
    true => {
        "Programs that run as administrator ignore VK_DRIVER_FILES and VK_ICD_FILENAMES: they find only\n\
         drivers that are registered for all users (tuff install)."
    }
    false => {
        "Programs with more rights than their user (setuid, file capabilities) ignore VK_DRIVER_FILES and\n\
         VK_ICD_FILENAMES: they find only drivers that are installed for the whole system."
    }
};

fn text(installation: &Installation, seen: &Seen) -> String {
    let mut lines = vec![format!("Tuff {}", env!("CARGO_PKG_VERSION"))];
    let mut line = |name: &str, value: String| lines.push(format!("  {name:<12}{value}"));
    line("manifest", installation.manifest.display().to_string());
    line(
        "driver",
        match &seen.library {
            Ok(library) => library.display().to_string(),
            Err(why) => why.clone(),
        },
    );
    line("loader", loader_text(seen));
    match seen.selected.devices.iter().find(|device| device.is_tuff()) {
        Some(device) => {
            line("device", device.name.clone());
            line(
                "versions",
                format!(
                    "driver {}, Vulkan {}",
                    device.driver_version, device.api_version
                ),
            );
            line("heap", format!("{} MiB", device.heap_bytes >> 20));
        }
        None => line("device", "none: see below".into()),
    }
    for entry in &seen.registered {
        let users = match entry.is_for_all_users {
            true => "for all users",
            false => "for this user",
        };
        line("registered", format!("{users}: {}", entry.manifest));
    }
    let usable = std::thread::available_parallelism().map_or(1, usize::from);
    let processors = os::processors();
    let limited = match usable as i64 == processors {
        true => "",
        false if cfg!(windows) => ", by affinity or a group of processors",
        false => ", by affinity or the control group's CPU quota",
    };
    line(
        "processors",
        format!("{usable} of {processors} may be used{limited}"),
    );
    if let Some(group) = &seen.group {
        let (limit, free) = (group.limit_bytes >> 20, group.free_bytes >> 20);
        line(
            "memory",
            format!("the control group's limit is {limit} MiB, of which {free} are free"),
        );
    }
    lines.push("What programs find without `tuff run` or `tuff env`, in this order:".into());
    for device in &seen.unselected.devices {
        lines.push(format!("  {} (Vulkan {})", device.name, device.api_version));
    }
    if seen.unselected.devices.is_empty() {
        lines.push("  no device".into());
    }
    if !seen.variables.is_empty() {
        lines.push("Variables that are set:".into());
        let set = seen.variables.iter();
        lines.extend(set.map(|(name, value)| format!("  {name}={value}")));
    }
    let conformance = (seen.variables.iter())
        .find(|(name, value)| name == refusals::CONFORMANCE && !value.is_empty())
        .map(|(_, value)| value.as_str());
    lines.extend(refusals::lines(conformance));
    lines.push(IGNORED_VARIABLES.into());
    lines.join("\n") + "\n"
}

fn loader_text(seen: &Seen) -> String {
    let version = seen
        .selected
        .loader_version
        .as_deref()
        .unwrap_or("of an unknown version");
    match &seen.system_loader {
        Some(system) => {
            let path = system
                .path
                .as_ref()
                .map_or(String::new(), |path| format!(", {}", path.display()));
            format!("{version}, the system's{path}")
        }
        None if seen.own_loader.is_ok() => {
            format!("{version}, the package's own: the system has none")
        }
        None => "none".into(),
    }
}
