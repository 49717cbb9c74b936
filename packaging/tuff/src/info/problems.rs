//! Problems that keep programs from using Tuff, in plain words, with the command that fixes each.

use super::Seen;
use crate::shell::Shell;
use crate::{loader, os};

/// A problem and its fix.
#[derive(Debug, PartialEq, Eq)]
pub struct Problem {
    pub what: String,
    pub mend: String,
}

/// The first loader that reads `VK_DRIVER_FILES`.
const DRIVER_FILES_SINCE: [u32; 3] = [1, 3, 207];
/// Scenes of ordinary size need at least this heap.
const SMALL_HEAP_BYTES: u64 = 192 << 20;

/// All problems, the most important first.
pub fn find(seen: &Seen) -> Vec<Problem> {
    let mut problems = Vec::new();
    let mut add = |what: String, mend: String| problems.push(Problem { what, mend });
    if let Err(why) = &seen.library {
        add(
            why.clone(),
            "install Tuff again, or name its manifest: tuff --manifest FILE info".into(),
        );
    }
    if let (None, Err(why)) = (&seen.system_loader, &seen.own_loader) {
        add(
            format!("there is no Vulkan loader ({}; {why})", loader::LIBRARY),
            loader::install_command().into(),
        );
    }
    let refused: Vec<&String> = (seen.selected.said.iter())
        .filter(|line| line.starts_with("tuff: TUFF_"))
        .collect();
    for line in &refused {
        let what = line.trim_start_matches("tuff: ");
        let name = what.split(':').next().unwrap_or(what);
        add(what.into(), Shell::HERE.unset(name));
    }
    let tuff = seen.selected.devices.iter().find(|device| device.is_tuff());
    match tuff {
        // `of_registry` says why, and what helps.
        None if is_hidden_from_administrators(seen) => {}
        None if seen.library.is_ok()
            && (seen.system_loader.is_some() || seen.own_loader.is_ok()) =>
        {
            add(
                format!(
                    "the loader does not load the driver: {}",
                    each_once(&seen.selected.said).join("; ")
                ),
                "with the variable VK_LOADER_DEBUG=all `tuff run -- vulkaninfo --summary` shows every step"
                    .into(),
            )
        }
        Some(device) if device.created != "yes" && refused.is_empty() => add(
            format!(
                "no device can be created: {}; {}",
                device.created,
                each_once(&seen.selected.said).join("; ")
            ),
            match cfg!(windows) {
                true => "give the process more memory: a larger page file, or a larger limit of its job object",
                false => "give the process more memory or threads (ulimit -a, and the container's limits)",
            }
            .into(),
        ),
        _ => {}
    }
    if let Some(device) = tuff.filter(|device| device.heap_bytes < SMALL_HEAP_BYTES) {
        add(
            format!(
                "there are only {} MiB of memory for scenes",
                device.heap_bytes >> 20
            ),
            "give the container more memory, 512 MB for instance: docker run --memory 512m …"
                .into(),
        );
    }
    of_variables(seen, &mut add);
    of_registry(seen, &mut add);
    of_order(seen, &mut add);
    problems
}

/// Another device that comes before Tuff.
fn of_order(seen: &Seen, add: &mut dyn FnMut(String, String)) {
    let unselected = &seen.unselected.devices;
    if let Some(place) = unselected
        .iter()
        .position(|device| device.is_tuff())
        .filter(|&it| it > 0)
    {
        add(
            format!(
                "a program that takes the first device gets {}, Tuff is number {}",
                unselected[0].name,
                place + 1
            ),
            format!(
                "tuff run -- PROGRAM, or for a whole shell: {}",
                Shell::HERE.evaluation()
            ),
        );
    }
}

/// Variables that mislead the loader.
fn of_variables(seen: &Seen, add: &mut dyn FnMut(String, String)) {
    let value = |wanted: &str| {
        let found = seen.variables.iter().find(|(name, _)| name == wanted);
        found
            .map(|(_, value)| value.as_str())
            .filter(|value| !value.is_empty())
    };
    for name in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES", "VK_ADD_DRIVER_FILES"] {
        for file in value(name)
            .unwrap_or_default()
            .split(os::LIST_SEPARATOR)
            .filter(|file| !file.is_empty())
        {
            if !std::path::Path::new(file).exists() {
                add(
                    format!("{name} names {file}, which is not there"),
                    format!(
                        "{}, or {}",
                        Shell::HERE.unset(name),
                        Shell::HERE.evaluation()
                    ),
                );
            }
        }
    }
    let loader = seen.selected.loader_version.as_deref();
    let is_old = loader.is_some_and(|version| numbers(version) < DRIVER_FILES_SINCE);
    if is_old && value("VK_DRIVER_FILES").is_some() && value("VK_ICD_FILENAMES").is_none() {
        add(
            format!(
                "the loader, {}, is too old to read VK_DRIVER_FILES",
                loader.unwrap_or("?")
            ),
            Shell::HERE.set(
                "VK_ICD_FILENAMES",
                value("VK_DRIVER_FILES").unwrap_or_default().as_ref(),
            ),
        );
    }
}

/// Entries of Windows' registry. Programs with an administrator's rights find Tuff only by them.
fn of_registry(seen: &Seen, add: &mut dyn FnMut(String, String)) {
    for entry in &seen.registered {
        if !std::path::Path::new(&entry.manifest).exists() {
            add(
                format!("{} is registered, and not there", entry.manifest),
                format!("tuff --manifest \"{}\" uninstall", entry.manifest),
            );
        }
    }
    if let [first, .., last] = &seen.registered[..] {
        add(
            format!(
                "two versions are registered, and programs find both: {} and {}",
                first.manifest, last.manifest
            ),
            format!("tuff --manifest \"{}\" uninstall", last.manifest),
        );
    }
    if is_hidden_from_administrators(seen) {
        add(
            "this process runs as administrator: the loader ignores VK_DRIVER_FILES and drivers of one user".into(),
            "tuff install".into(),
        );
    }
}

/// Whether the loader ignores what would lead this process to Tuff.
fn is_hidden_from_administrators(seen: &Seen) -> bool {
    let is_for_all_users = seen.registered.iter().any(|it| it.is_for_all_users);
    let is_found = seen.selected.devices.iter().any(|it| it.is_tuff());
    seen.are_variables_ignored && !is_for_all_users && !is_found
}

/// Lines without those that came before: the loader repeats some for each folder and key.
fn each_once(lines: &[String]) -> Vec<&str> {
    let mut once: Vec<&str> = Vec::new();
    for line in lines {
        if !once.contains(&line.as_str()) {
            once.push(line);
        }
    }
    once
}

fn numbers(version: &str) -> [u32; 3] {
    let mut numbers = version.split('.').map(|number| number.parse().unwrap_or(0));
    std::array::from_fn(|_| numbers.next().unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::super::probe::{Device, Found};
    use super::*;
    use crate::loader::System;

    fn tuff() -> Device {
        Device {
            name: "Tuff (2 threads, AVX2)".into(),
            heap_bytes: 1 << 30,
            created: "yes".into(),
            ..Device::default()
        }
    }

    fn well() -> Seen {
        let found = Found {
            loader_version: Some("1.3.239".into()),
            devices: vec![tuff()],
            said: vec![],
        };
        Seen {
            library: Ok("/lib.so".into()),
            system_loader: Some(System { path: None }),
            own_loader: Err("none came along".into()),
            selected: found.clone(),
            unselected: found,
            group: None,
            variables: vec![],
            are_variables_ignored: false,
            registered: vec![],
        }
    }

    #[track_caller]
    fn expect(seen: &Seen, what: &str, mend: &str) {
        let problems = find(seen);
        let hit = problems
            .iter()
            .any(|it| it.what.contains(what) && it.mend.contains(mend));
        assert!(hit, "{problems:#?}");
    }

    #[test]
    fn nothing_is_wrong_where_nothing_is() {
        assert_eq!(find(&well()), []);
        // The package's loader is used if the system has none.
        let slim = Seen {
            system_loader: None,
            own_loader: Ok(()),
            ..well()
        };
        assert_eq!(find(&slim), []);
    }

    #[test]
    fn each_problem_has_its_line() {
        let mut seen = well();
        seen.library = Err("the manifest /x.json cannot be read".into());
        expect(&seen, "/x.json cannot be read", "--manifest");
        let seen = Seen {
            system_loader: None,
            ..well()
        };
        expect(
            &seen,
            &format!("no Vulkan loader ({}; none came along)", loader::LIBRARY),
            "install",
        );
        let mut seen = well();
        seen.selected.devices.clear();
        let line = || "libgcc_s.so.1: cannot open".to_owned();
        seen.selected.said.extend([line(), line()]);
        expect(&seen, "libgcc_s.so.1: cannot open", "VK_LOADER_DEBUG");
        assert_eq!(find(&seen)[0].what.matches("libgcc_s").count(), 1);
        let mut seen = well();
        seen.selected.devices[0].created = "ERROR_INITIALIZATION_FAILED".into();
        seen.selected
            .said
            .push("tuff: TUFF_TIER: \"x\" is not one of".into());
        expect(&seen, "TUFF_TIER: \"x\"", &Shell::HERE.unset("TUFF_TIER"));
        assert_eq!(find(&seen).len(), 1);
        let mut seen = well();
        seen.selected.devices[0].heap_bytes = 75 << 20;
        expect(&seen, "only 75 MiB", "--memory");
        let mut seen = well();
        let other = Device {
            name: "llvmpipe".into(),
            ..Device::default()
        };
        seen.unselected.devices.insert(0, other);
        expect(&seen, "gets llvmpipe, Tuff is number 2", "tuff run");
    }

    #[test]
    fn entries_of_the_registry_are_looked_at() {
        let entry = |manifest: &str| crate::registered::Registered {
            manifest: manifest.into(),
            is_for_all_users: true,
        };
        let mut seen = well();
        seen.registered = vec![entry("/")];
        seen.are_variables_ignored = true;
        assert_eq!(find(&seen), []);
        seen.registered.push(entry("/no/such.json"));
        expect(
            &seen,
            "/no/such.json is registered, and not there",
            "--manifest \"/no/such.json\" uninstall",
        );
        expect(
            &seen,
            "programs find both: / and /no/such.json",
            "uninstall",
        );
        seen.selected.devices.clear();
        assert!(!find(&seen).iter().any(|it| it.mend == "tuff install"));
        seen.registered.clear();
        expect(&seen, "runs as administrator", "tuff install");
        let others = find(&seen);
        assert!(!others.iter().any(|it| it.what.contains("does not load")));
    }

    #[test]
    fn variables_that_lead_astray_are_named() {
        let variable = |name: &str, value: &str| vec![(name.to_owned(), value.to_owned())];
        let mut seen = well();
        seen.variables = variable("VK_ICD_FILENAMES", "/no/such.json");
        expect(
            &seen,
            "names /no/such.json, which is not there",
            &Shell::HERE.unset("VK_ICD_FILENAMES"),
        );
        seen.variables = variable("VK_DRIVER_FILES", "/");
        assert_eq!(find(&seen), []);
        seen.selected.loader_version = Some("1.3.204".into());
        expect(&seen, "1.3.204, is too old", "VK_ICD_FILENAMES");
    }
}
