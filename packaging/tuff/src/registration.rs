//! `tuff install` and `tuff uninstall` on Windows: drivers are named in the registry.
//!
//! The Khronos loader reads drivers only from `HKEY_LOCAL_MACHINE` (Vulkan-Loader,
//! `loader_windows.c`: it reads `HKEY_CURRENT_USER` for layers). If this user may not write there,
//! `HKEY_CURRENT_USER` gets the same value for loaders that read it, and the user's variable
//! `VK_ADD_DRIVER_FILES` names the manifest for the Khronos loader since 1.3.207. Programs with an
//! administrator's rights read neither.
//!
//! The loader reads names of values in the system's code page, but interprets them as UTF-8. So
//! paths are registered in ASCII, by the folder's short name if it has one.

use std::io::{self, ErrorKind};
use std::path::Path;

use anyhow::{Context, Result, bail};

use crate::os::Hive;

/// The variable with drivers in addition to those of the registry.
pub const VARIABLE: &str = "VK_ADD_DRIVER_FILES";
const SEPARATOR: &str = ";";
/// The file name of Tuff's manifests.
const NAME: &str = "tuff_icd.json";

/// The part of Windows' registry that is read and changed.
pub trait Registry {
    /// The manifests of the enabled drivers.
    ///
    /// # Errors
    /// The key cannot be read.
    fn drivers(&self, hive: Hive) -> io::Result<Vec<String>>;
    /// # Errors
    /// `PermissionDenied` where this user may not write, or the system's error.
    fn register(&self, hive: Hive, manifest: &str) -> io::Result<()>;
    /// # Errors
    /// As [`Registry::register`].
    fn forget(&self, hive: Hive, manifest: &str) -> io::Result<()>;
    /// The short form (8.3) of a folder's path.
    fn short(&self, folder: &Path) -> Option<String>;
    /// The user's [`VARIABLE`].
    fn variable(&self) -> Option<String>;
    /// # Errors
    /// The key cannot be written.
    fn set_variable(&self, value: Option<&str>) -> io::Result<()>;
}

/// This machine's registry.
#[cfg(windows)]
pub struct System;

#[cfg(windows)]
impl Registry for System {
    fn drivers(&self, hive: Hive) -> io::Result<Vec<String>> {
        crate::os::drivers(hive)
    }

    fn register(&self, hive: Hive, manifest: &str) -> io::Result<()> {
        crate::os::register(hive, manifest)
    }

    fn forget(&self, hive: Hive, manifest: &str) -> io::Result<()> {
        crate::os::forget(hive, manifest)
    }

    fn short(&self, folder: &Path) -> Option<String> {
        crate::os::short_path(folder)
    }

    fn variable(&self) -> Option<String> {
        crate::os::users_variable(VARIABLE)
    }

    fn set_variable(&self, value: Option<&str>) -> io::Result<()> {
        crate::os::set_users_variable(VARIABLE, value)
    }
}

/// Registers a manifest for all users or, without the rights for that, for this user. Returns the
/// lines to print.
///
/// # Errors
/// The registry cannot be read or written, or cannot hold the path.
pub fn install(registry: &dyn Registry, manifest: &Path) -> Result<Vec<String>> {
    let long = manifest;
    let manifest = in_ascii(registry, long).with_context(|| {
        format!(
            "the Vulkan loader reads no registered path with letters outside of ASCII, and the folder of {} has no short \
             name: move Tuff to another folder, such as C:\\tuff",
            long.display()
        )
    })?;
    let mut lines = Vec::new();
    let mut add = |line: String| lines.push(line);
    if spelled(&registry.drivers(Hive::Machine)?, &manifest).is_some() {
        add(format!("{manifest} is registered for all users already"));
        forget_users(registry, &manifest)?;
    } else {
        match registry.register(Hive::Machine, &manifest) {
            Ok(()) => {
                add(format!("registered for all users: {manifest}"));
                // A driver with two entries would be loaded twice.
                forget_users(registry, &manifest)?;
            }
            Err(error) if error.kind() == ErrorKind::PermissionDenied => {
                (registry.register(Hive::User, &manifest)).with_context(|| {
                    format!("registering {manifest} in HKEY_CURRENT_USER: {MEND_RIGHTS}")
                })?;
                add_variable(registry, &manifest)?;
                add(format!("registered for this user alone: {manifest}"));
                add(format!(
                    "note: HKEY_LOCAL_MACHINE may be written by administrators only. Programs that run as \
                     administrator read that half alone and do not find Tuff: {MEND_RIGHTS}"
                ));
                add(format!(
                    "note: new programs get {VARIABLE}, since the Khronos loader looks for no drivers in \
                     HKEY_CURRENT_USER. Loaders before 1.3.207 do not read it: update the loader \
                     (winget install KhronosGroup.VulkanRT), or use `tuff run`"
                ));
            }
            Err(error) => {
                return Err(error)
                    .with_context(|| format!("registering {manifest} in HKEY_LOCAL_MACHINE"));
            }
        }
    }
    for other in others(registry, &manifest) {
        add(match Path::new(&other).exists() {
            true => format!(
                "note: another Tuff is registered, too, and programs find both: {other}; \
                 `tuff --manifest \"{other}\" uninstall` takes it out"
            ),
            false => format!(
                "note: a Tuff is registered that is not there any more: {other}; \
                 `tuff --manifest \"{other}\" uninstall` takes it out"
            ),
        });
    }
    Ok(lines)
}

const MEND_RIGHTS: &str =
    "say `tuff install` in a console that was opened by `Run as administrator`";

/// Removes a manifest, which may be missing as a file, from the registry. Returns the lines to
/// print.
///
/// # Errors
/// It is not registered, or this user may not remove it.
pub fn uninstall(registry: &dyn Registry, manifest: &Path) -> Result<Vec<String>> {
    let manifest = in_ascii(registry, manifest)
        .with_context(|| format!("{} is not registered", manifest.display()))?;
    let mut lines = Vec::new();
    if forget_users(registry, &manifest)? {
        lines.push(format!("{manifest} is no longer registered for this user"));
    }
    if let Some(name) = spelled(&registry.drivers(Hive::Machine)?, &manifest) {
        registry.forget(Hive::Machine, name).with_context(|| {
            format!(
                "{manifest} is registered for all users, which only an administrator may change: say `tuff uninstall` \
                 in a console that was opened by `Run as administrator`"
            )
        })?;
        lines.push(format!("{manifest} is no longer registered for all users"));
    }
    if lines.is_empty() {
        let others = others(registry, &manifest);
        let hint = match others.first() {
            Some(other) => {
                format!("; `tuff --manifest \"{other}\" uninstall` takes out the other one")
            }
            None => String::new(),
        };
        bail!("{manifest} is not registered{hint}");
    }
    Ok(lines)
}

/// Registered manifests of Tuff, each once, and whether it is for all users.
pub fn of_tuff(registry: &dyn Registry) -> Vec<(Hive, String)> {
    let mut found: Vec<(Hive, String)> = Vec::new();
    for hive in [Hive::Machine, Hive::User] {
        let drivers = registry.drivers(hive).unwrap_or_default();
        for manifest in drivers.into_iter().filter(|it| is_tuffs(it)) {
            if !found.iter().any(|(_, other)| is_same(other, &manifest)) {
                found.push((hive, manifest));
            }
        }
    }
    found
}

/// A manifest's path in its registered form; `None` if it has no form in ASCII.
fn in_ascii(registry: &dyn Registry, manifest: &Path) -> Option<String> {
    let ascii = |path: &str| path.is_ascii().then(|| path.to_owned());
    if let Some(path) = manifest.to_str().and_then(ascii) {
        return Some(path);
    }
    // Only the folder's short name is needed: the manifest may be missing, and its name is known.
    let name = manifest
        .file_name()
        .and_then(|name| name.to_str())
        .and_then(ascii)?;
    let folder = registry.short(manifest.parent()?)?;
    Some(format!(
        "{}\\{name}",
        ascii(&folder)?.trim_end_matches('\\')
    ))
}

/// Windows' paths are case-insensitive.
fn is_same(a: &str, b: &str) -> bool {
    let plain = |path: &str| path.replace('/', "\\").to_lowercase();
    plain(a) == plain(b)
}

fn is_tuffs(manifest: &str) -> bool {
    manifest
        .rsplit(['\\', '/'])
        .next()
        .is_some_and(|name| is_same(name, NAME))
}

/// A manifest in the form of a list's entry.
fn spelled<'a>(list: &'a [String], manifest: &str) -> Option<&'a str> {
    let mut list = list.iter();
    list.find(|it| is_same(it, manifest)).map(String::as_str)
}

/// Other registered manifests of Tuff.
fn others(registry: &dyn Registry, manifest: &str) -> Vec<String> {
    let all = of_tuff(registry).into_iter().map(|(_, other)| other);
    all.filter(|other| !is_same(other, manifest)).collect()
}

/// Removes a manifest from `HKEY_CURRENT_USER` and the user's variable. Returns whether it was
/// there.
fn forget_users(registry: &dyn Registry, manifest: &str) -> Result<bool> {
    let mut was_there = false;
    if let Some(name) = spelled(&registry.drivers(Hive::User)?, manifest) {
        (registry.forget(Hive::User, name))
            .with_context(|| format!("taking {name} out of HKEY_CURRENT_USER"))?;
        was_there = true;
    }
    let value = registry.variable().unwrap_or_default();
    let listed = || value.split(SEPARATOR).filter(|it| !it.is_empty());
    if listed().any(|it| is_same(it, manifest)) {
        let rest: Vec<&str> = listed().filter(|it| !is_same(it, manifest)).collect();
        let rest = (!rest.is_empty()).then(|| rest.join(SEPARATOR));
        (registry.set_variable(rest.as_deref()))
            .with_context(|| format!("taking {manifest} out of the user's {VARIABLE}"))?;
        was_there = true;
    }
    Ok(was_there)
}

fn add_variable(registry: &dyn Registry, manifest: &str) -> Result<()> {
    let value = registry.variable().unwrap_or_default();
    let mut listed: Vec<&str> = value.split(SEPARATOR).filter(|it| !it.is_empty()).collect();
    if listed.iter().any(|it| is_same(it, manifest)) {
        return Ok(());
    }
    listed.push(manifest);
    (registry.set_variable(Some(&listed.join(SEPARATOR))))
        .with_context(|| format!("setting the user's {VARIABLE}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;

    /// A registry in memory.
    #[derive(Default)]
    struct Fake {
        is_administrators: bool,
        machine: RefCell<Vec<String>>,
        user: RefCell<Vec<String>>,
        variable: RefCell<Option<String>>,
        /// Whether folders have short names.
        has_short_names: bool,
    }

    impl Fake {
        fn list(&self, hive: Hive) -> io::Result<&RefCell<Vec<String>>> {
            match hive {
                Hive::Machine if !self.is_administrators => Err(ErrorKind::PermissionDenied.into()),
                Hive::Machine => Ok(&self.machine),
                Hive::User => Ok(&self.user),
            }
        }
    }

    impl Registry for Fake {
        fn drivers(&self, hive: Hive) -> io::Result<Vec<String>> {
            Ok(match hive {
                Hive::Machine => self.machine.borrow().clone(),
                Hive::User => self.user.borrow().clone(),
            })
        }

        fn register(&self, hive: Hive, manifest: &str) -> io::Result<()> {
            self.list(hive)?.borrow_mut().push(manifest.into());
            Ok(())
        }

        fn forget(&self, hive: Hive, manifest: &str) -> io::Result<()> {
            self.list(hive)?.borrow_mut().retain(|it| it != manifest);
            Ok(())
        }

        fn short(&self, _: &Path) -> Option<String> {
            self.has_short_names.then(|| r"C:\Users\JRGEN~1\".into())
        }

        fn variable(&self) -> Option<String> {
            self.variable.borrow().clone()
        }

        fn set_variable(&self, value: Option<&str>) -> io::Result<()> {
            *self.variable.borrow_mut() = value.map(str::to_owned);
            Ok(())
        }
    }

    const MANIFEST: &str = r"C:\Program Files\tuff\share\vulkan\icd.d\tuff_icd.json";

    #[test]
    fn paths_are_registered_in_ascii() {
        let mut registry = Fake {
            is_administrators: true,
            ..Fake::default()
        };
        // Linux's separators, because this test also runs there.
        let manifest = Path::new("C:/Users/Jürgen Żak/tuff_icd.json");
        let error = format!("{:#}", install(&registry, manifest).unwrap_err());
        assert!(
            error.contains("Jürgen Żak") && error.contains(r"such as C:\tuff"),
            "{error}"
        );
        let error = uninstall(&registry, manifest).unwrap_err().to_string();
        assert!(error.ends_with("is not registered"), "{error}");
        registry.has_short_names = true;
        install(&registry, manifest).unwrap();
        assert_eq!(
            *registry.machine.borrow(),
            [r"C:\Users\JRGEN~1\tuff_icd.json"]
        );
        uninstall(&registry, manifest).unwrap();
        assert!(registry.machine.borrow().is_empty());
    }

    #[test]
    fn administrators_register_for_all_users() {
        let registry = Fake {
            is_administrators: true,
            ..Fake::default()
        };
        registry.user.borrow_mut().push(MANIFEST.to_uppercase());
        registry
            .set_variable(Some(&format!("{MANIFEST};C:\\other.json")))
            .unwrap();
        let lines = install(&registry, Path::new(MANIFEST)).unwrap();
        assert_eq!(lines, [format!("registered for all users: {MANIFEST}")]);
        assert_eq!(*registry.machine.borrow(), [MANIFEST]);
        // A driver with two entries is loaded twice.
        assert!(registry.user.borrow().is_empty());
        assert_eq!(registry.variable().as_deref(), Some(r"C:\other.json"));
        let again = install(&registry, Path::new(MANIFEST)).unwrap();
        assert!(again[0].contains("for all users already"), "{again:?}");
        uninstall(&registry, Path::new(&MANIFEST.to_lowercase())).unwrap();
        assert!(registry.machine.borrow().is_empty());
        let error = uninstall(&registry, Path::new(MANIFEST))
            .unwrap_err()
            .to_string();
        assert!(error.ends_with("is not registered"), "{error}");
    }

    #[test]
    fn other_users_register_for_themselves() {
        let registry = Fake::default();
        registry.set_variable(Some(r"C:\other.json")).unwrap();
        let lines = install(&registry, Path::new(MANIFEST)).unwrap().join("\n");
        assert!(lines.contains("for this user alone"), "{lines}");
        assert!(
            lines.contains("run as administrator read that half alone"),
            "{lines}"
        );
        assert!(lines.contains("before 1.3.207"), "{lines}");
        assert_eq!(*registry.user.borrow(), [MANIFEST]);
        let both = format!("C:\\other.json;{MANIFEST}");
        assert_eq!(registry.variable(), Some(both));
        install(&registry, Path::new(MANIFEST)).unwrap();
        assert_eq!(registry.variable().unwrap().matches("tuff").count(), 2);
        uninstall(&registry, Path::new(MANIFEST)).unwrap();
        assert!(registry.user.borrow().is_empty());
        assert_eq!(registry.variable().as_deref(), Some(r"C:\other.json"));
    }

    #[test]
    fn what_all_users_have_needs_an_administrator() {
        let registry = Fake::default();
        registry.machine.borrow_mut().push(MANIFEST.into());
        // It is registered already, so no rights are needed.
        let lines = install(&registry, Path::new(MANIFEST)).unwrap();
        assert!(lines[0].contains("for all users already"), "{lines:?}");
        let error = format!(
            "{:#}",
            uninstall(&registry, Path::new(MANIFEST)).unwrap_err()
        );
        assert!(error.contains("Run as administrator"), "{error}");
    }

    #[test]
    fn another_version_is_named() {
        let registry = Fake {
            is_administrators: true,
            ..Fake::default()
        };
        registry
            .machine
            .borrow_mut()
            .push(r"D:\old\TUFF_ICD.json".into());
        registry
            .machine
            .borrow_mut()
            .push(r"D:\other\lvp_icd.json".into());
        let lines = install(&registry, Path::new(MANIFEST)).unwrap().join("\n");
        assert!(
            lines.contains("not there any more: D:\\old\\TUFF_ICD.json"),
            "{lines}"
        );
        assert!(
            lines.contains("`tuff --manifest \"D:\\old\\TUFF_ICD.json\" uninstall`"),
            "{lines}"
        );
        assert!(!lines.contains("lvp"), "{lines}");
        let tuffs = of_tuff(&registry);
        assert_eq!(tuffs.len(), 2);
        assert_eq!(tuffs[0].0, Hive::Machine);
    }
}
