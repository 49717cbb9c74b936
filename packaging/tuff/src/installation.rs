//! The location of the driver, and the variables that point the loader at it.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use crate::shell::Shell;
use crate::{loader, os};

/// The manifest below the folder that a package is unpacked to.
const MANIFEST: &str = "share/vulkan/icd.d/tuff_icd.json";
/// The loader in some packages, for systems without one.
const LOADER_FOLDER: &str = "lib/tuff/loader";

/// The files of one package.
pub struct Installation {
    /// The manifest's path; the file may be missing.
    pub manifest: PathBuf,
    /// The folder of the package's loader; or why it does not work.
    pub own_loader: Result<PathBuf, String>,
}

impl Installation {
    /// The installation of `manifest`, or else of this program.
    ///
    /// # Errors
    /// This program's own path is not known.
    pub fn find(manifest: Option<&Path>) -> Result<Installation> {
        let program = std::env::current_exe().context("this program's path")?;
        // PREFIX/bin/tuff.
        let prefix = program
            .ancestors()
            .nth(2)
            .context("a folder above this program's")?;
        // On Windows with Windows' separators.
        let own =
            |path: &str| std::path::absolute(prefix.join(path)).context("this program's path");
        let loader = own(LOADER_FOLDER)?;
        Ok(Installation {
            manifest: match manifest {
                Some(manifest) => std::path::absolute(manifest).context("the manifest's path")?,
                None => own(MANIFEST)?,
            },
            own_loader: loader::usable(&loader).map(|()| loader),
        })
    }

    /// Whether a loader that programs find is the package's own, as after `tuff env`.
    pub fn brought(&self, found: &loader::System) -> bool {
        let real = |path: &Path| std::fs::canonicalize(path).ok();
        let own =
            (self.own_loader.as_ref().ok()).and_then(|folder| real(&folder.join(loader::LIBRARY)));
        own.is_some() && own == found.path.as_deref().and_then(real)
    }

    /// The library that the manifest names.
    ///
    /// # Errors
    /// The manifest is missing or not a manifest, or the library is missing.
    pub fn library(&self) -> Result<PathBuf> {
        let shown = self.manifest.display();
        let text = std::fs::read_to_string(&self.manifest)
            .with_context(|| format!("the manifest {shown} cannot be read"))?;
        let json: serde_json::Value =
            serde_json::from_str(&text).with_context(|| format!("{shown} is not a manifest"))?;
        let named = (json["ICD"]["library_path"].as_str())
            .with_context(|| format!("{shown} names no library"))?;
        // A name with a folder is relative to the manifest. The system searches for a name without
        // one.
        let library = PathBuf::from(named);
        if !os::names_a_folder(library.as_os_str()) {
            return Ok(library);
        }
        let folder = self.manifest.parent().unwrap_or(Path::new("/"));
        let library = folder.join(library);
        os::real_path(&library)
            .with_context(|| format!("the driver {} cannot be read", library.display()))
    }

    /// Variables that make programs see Tuff and no other driver: `VK_DRIVER_FILES` for loaders
    /// since 1.3.207, `VK_ICD_FILENAMES` for older ones, and the path to the package's loader if
    /// the system has none.
    pub fn variables(&self) -> Vec<(&'static str, OsString)> {
        let manifest = self.manifest.clone().into_os_string();
        let mut variables = vec![
            ("VK_DRIVER_FILES", manifest.clone()),
            ("VK_ICD_FILENAMES", manifest),
        ];
        if let Some(folder) = self.needed_loader() {
            let path = std::env::var_os(os::LIBRARY_FOLDERS).filter(|path| !path.is_empty());
            let with_own = match path {
                Some(mut path) => {
                    path.push(os::LIST_SEPARATOR);
                    path.push(folder);
                    path
                }
                None => folder.into(),
            };
            variables.push((os::LIBRARY_FOLDERS, with_own));
        }
        variables
    }

    /// The folder of the package's loader, if the system has none.
    fn needed_loader(&self) -> Option<&Path> {
        let own = self.own_loader.as_ref().ok();
        own.filter(|_| loader::System::find().is_none())
            .map(PathBuf::as_path)
    }

    /// Lines for a shell to evaluate.
    pub fn exports(&self, shell: Shell) -> String {
        let mut lines = vec![shell.unset("VK_ADD_DRIVER_FILES")];
        for (name, value) in self.variables() {
            // Unix shells on Windows have their own form of `PATH`.
            lines.push(match self.needed_loader() {
                Some(folder) if shell == Shell::Sh && name == "PATH" => format!(
                    "{}; export PATH=\"$PATH:$(cygpath \"$folder\")\"; unset folder",
                    shell.set("folder", folder.as_os_str())
                ),
                _ => shell.set(name, &value),
            });
        }
        lines.join("\n") + "\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_manifest(name: &str, text: &str) -> (PathBuf, Installation) {
        let folder = std::env::temp_dir().join(format!("tuff-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let manifest = folder.join("it's.json");
        std::fs::write(&manifest, text).unwrap();
        let installation = Installation::find(Some(&manifest)).unwrap();
        (folder, installation)
    }

    #[test]
    fn libraries_lie_where_manifests_say() {
        let (folder, installation) =
            with_manifest("manifest", r#"{"ICD": {"library_path": "../lib.so"}}"#);
        let message = format!("{:#}", installation.library().unwrap_err());
        assert!(message.contains("lib.so cannot be read"), "{message}");
        let library = folder.parent().unwrap().join("lib.so");
        std::fs::write(&library, "").unwrap();
        let found = installation.library().unwrap();
        std::fs::remove_file(&library).unwrap();
        assert_eq!(
            found,
            os::real_path(folder.parent().unwrap())
                .unwrap()
                .join("lib.so")
        );
        std::fs::write(&installation.manifest, "{").unwrap();
        let message = format!("{:#}", installation.library().unwrap_err());
        assert!(message.contains("is not a manifest"), "{message}");
        std::fs::remove_dir_all(&folder).unwrap();
        let message = format!("{:#}", installation.library().unwrap_err());
        assert!(message.contains("it's.json cannot be read"), "{message}");
    }

    #[test]
    fn the_loader_that_came_along_is_known_by_its_file() {
        let (folder, mut installation) = with_manifest("loader", "{}");
        let found = |path: &Path| loader::System {
            path: Some(path.into()),
        };
        let own = folder.join(loader::LIBRARY);
        std::fs::write(&own, "").unwrap();
        std::fs::write(folder.join("other"), "").unwrap();
        assert!(!installation.brought(&found(&own)));
        installation.own_loader = Ok(folder.clone());
        let brought = [
            loader::LIBRARY.to_owned(),
            format!("./{}", loader::LIBRARY),
            "other".into(),
            "none".into(),
        ]
        .map(|name| installation.brought(&found(&folder.join(name))));
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(brought, [true, true, false, false]);
    }

    #[cfg(unix)]
    #[test]
    fn shells_read_the_lines() {
        let (folder, installation) = with_manifest("exports", "{}");
        let script = format!(
            "{}\nprintf %s \"$VK_DRIVER_FILES\"",
            installation.exports(Shell::Sh)
        );
        let shell = std::process::Command::new("sh")
            .args(["-c", &script])
            .output()
            .unwrap();
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(
            String::from_utf8(shell.stdout).unwrap(),
            installation.manifest.to_str().unwrap()
        );
    }
}
