//! `cargo xtask install` and `uninstall`: the driver and its manifest where the Vulkan loader
//! looks.

use std::ffi::OsString;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::{Context, Result, bail};
use clap::Args;

use crate::driver::{self, Driver};

#[derive(Args)]
pub struct Options {
    /// Where to install [default: ~/.local, which the loader searches for this user]
    #[arg(long, value_name = "DIR")]
    prefix: Option<PathBuf>,
}

/// The paths of the two files.
struct Places {
    prefix: PathBuf,
    library: PathBuf,
    manifest: PathBuf,
}

impl Options {
    fn places(&self) -> Result<Places> {
        let prefix = match &self.prefix {
            Some(prefix) => std::path::absolute(prefix).context("the prefix")?,
            None => {
                PathBuf::from(std::env::var_os("HOME").context("HOME is not set")?).join(".local")
            }
        };
        Ok(Places {
            library: prefix.join("lib").join(driver::LIBRARY),
            manifest: prefix.join("share/vulkan/icd.d").join(driver::MANIFEST),
            prefix,
        })
    }
}

pub fn install(options: &Options) -> Result<ExitCode> {
    let places = options.places()?;
    for file in [&places.library, &places.manifest] {
        let folder = file.parent().context("a file lies in a folder")?;
        fs::create_dir_all(folder).with_context(|| format!("making {}", folder.display()))?;
    }
    // A program may have the old library mapped: the new one gets its own inode. Tried before
    // minutes of building.
    let incoming = places.library.with_extension("so.new");
    fs::write(&incoming, "").with_context(|| format!("writing {}", incoming.display()))?;
    let built = Driver::build(&[]).inspect_err(|_| {
        let _ = fs::remove_file(&incoming);
    })?;
    fs::copy(&built.library, &incoming)
        .with_context(|| format!("writing {}", incoming.display()))?;
    strip(&incoming);
    fs::rename(&incoming, &places.library)
        .with_context(|| format!("writing {}", places.library.display()))?;
    driver::write_manifest(&places.manifest, &places.library)?;
    println!(
        "{}\n{}",
        places.library.display(),
        places.manifest.display()
    );
    for note in notes(&places, &|name| std::env::var_os(name)) {
        eprintln!("note: {note}");
    }
    Ok(ExitCode::SUCCESS)
}

/// Removes the files of `install` and the folders that are empty afterwards.
pub fn uninstall(options: &Options) -> Result<ExitCode> {
    let places = options.places()?;
    let mut removed = false;
    for file in [&places.manifest, &places.library] {
        match fs::remove_file(file) {
            Ok(()) => {
                println!("removed {}", file.display());
                removed = true;
                remove_empty_folders(file, &places.prefix);
            }
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => {
                return Err(error).with_context(|| format!("removing {}", file.display()));
            }
        }
    }
    if !removed {
        bail!("Tuff is not installed in {}", places.prefix.display());
    }
    Ok(ExitCode::SUCCESS)
}

/// Folders above `file` as long as they are empty, up to the prefix, which stays.
fn remove_empty_folders(file: &Path, prefix: &Path) {
    let inside = |folder: &&Path| folder.starts_with(prefix) && *folder != prefix;
    for folder in file.ancestors().skip(1).take_while(inside) {
        // The first nonempty folder ends the loop.
        if fs::remove_dir(folder).is_err() {
            break;
        }
    }
}

/// Strips the debug information from a copy. Without the tool the library is larger, and still
/// works.
fn strip(library: &Path) {
    let stripped = Command::new("strip").arg(library).status();
    if !stripped.is_ok_and(|status| status.success()) {
        eprintln!(
            "note: there is no working `strip` (package binutils): the library keeps its debug information"
        );
    }
}

/// Problems that keep the loader from finding the manifest, each with its fix.
fn notes(places: &Places, variable: &dyn Fn(&str) -> Option<OsString>) -> Vec<String> {
    let manifest = places.manifest.display();
    let set = |name: &str| variable(name).filter(|value| !value.is_empty());
    let mut notes = Vec::new();
    let share = places.prefix.join("share");
    if !searched(&set).contains(&share) {
        notes.push(format!(
            "the Vulkan loader does not look in {}; for programs of this shell: export VK_DRIVER_FILES='{manifest}' VK_ICD_FILENAMES='{manifest}'",
            share.display()
        ));
    }
    for name in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
        if let Some(value) = set(name).filter(|value| *value != *places.manifest.as_os_str()) {
            notes.push(format!(
                "{name} is set to {}, and the loader searches nowhere else; `unset {name}` lets it find the installed driver",
                value.display()
            ));
        }
    }
    notes
}

/// Folders that have the loader's manifests in `vulkan/icd.d` (Khronos'
/// LoaderDriverInterface.md, "Driver Discovery on Linux").
fn searched(set: &dyn Fn(&str) -> Option<OsString>) -> Vec<PathBuf> {
    let mut folders: Vec<PathBuf> = ["/etc", "/usr/local/etc"].map(PathBuf::from).into();
    let mut list = |name: &str, otherwise: &str| {
        let value = set(name).unwrap_or_else(|| otherwise.into());
        folders.extend(std::env::split_paths(&value));
    };
    list("XDG_CONFIG_DIRS", "/etc/xdg");
    list("XDG_DATA_DIRS", "/usr/local/share:/usr/share");
    for (name, inside) in [
        ("XDG_DATA_HOME", ".local/share"),
        ("XDG_CONFIG_HOME", ".config"),
    ] {
        match (set(name), set("HOME")) {
            (Some(folder), _) => folders.push(folder.into()),
            (None, Some(home)) => folders.push(PathBuf::from(home).join(inside)),
            (None, None) => {}
        }
    }
    // `XDG_DATA_DIRS=/opt/share/` names the same folder without the slash.
    folders
        .iter()
        .map(|folder| folder.components().collect())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noted(prefix: &str, variables: &[(&str, &str)]) -> Vec<String> {
        let options = Options {
            prefix: Some(prefix.into()),
        };
        let places = options.places().unwrap();
        notes(&places, &|wanted| {
            let found = variables.iter().find(|(name, _)| *name == wanted);
            found.map(|(_, value)| (*value).into())
        })
    }

    #[test]
    fn says_when_the_loader_will_not_look() {
        let home = ("HOME", "/home/ada");
        assert_eq!(noted("/home/ada/.local", &[home]), [""; 0]);
        assert_eq!(noted("/usr/local", &[home]), [""; 0]);
        let notes = noted("/opt/tuff", &[home]);
        assert_eq!(notes.len(), 1);
        let line = "export VK_DRIVER_FILES='/opt/tuff/share/vulkan/icd.d/tuff_icd.json'";
        assert!(notes[0].contains(line), "{notes:?}");
        let elsewhere = [home, ("XDG_DATA_HOME", "/data")];
        assert_eq!(noted("/home/ada/.local", &elsewhere).len(), 1);
        let also = [home, ("XDG_DATA_DIRS", "/usr/share:/opt/tuff/share/")];
        assert_eq!(noted("/opt/tuff", &also), [""; 0]);
    }

    #[test]
    fn says_when_a_variable_hides_what_is_installed() {
        let variables = [("HOME", "/home/ada"), ("VK_ICD_FILENAMES", "/x.json")];
        let notes = noted("/usr/local", &variables);
        assert_eq!(notes.len(), 1);
        assert!(notes[0].contains("`unset VK_ICD_FILENAMES`"), "{notes:?}");
    }

    #[test]
    fn uninstall_takes_what_is_there_and_no_more() {
        let prefix = std::env::temp_dir().join(format!("tuff-prefix-{}", std::process::id()));
        let options = Options {
            prefix: Some(prefix.clone()),
        };
        let places = options.places().unwrap();
        for file in [
            &places.library,
            &places.manifest,
            &prefix.join("lib/other.so"),
        ] {
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(file, "").unwrap();
        }
        uninstall(&options).unwrap();
        assert!(prefix.join("lib/other.so").exists());
        assert!(!places.library.exists() && !prefix.join("share").exists());
        let message = uninstall(&options).unwrap_err().to_string();
        assert!(message.contains("is not installed"), "{message}");
        fs::remove_dir_all(&prefix).unwrap();
    }
}
