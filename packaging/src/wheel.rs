//! The Python wheel (the binary distribution format of packaging.python.org).

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use crate::tree::{Entry, Tree};
use crate::{PackageSystem, Release, hash, zipfile};

/// The distribution's name in file names.
const NAME: &str = "tuff_vulkan";
/// The tree's folder inside the Python package `tuff`.
const PREFIX: &str = "tuff/prefix";

/// Writes `tuff_vulkan-VERSION-py3-none-PLATFORM.whl`, with the Python sources of `sources`.
///
/// # Errors
/// A file cannot be read or written.
pub fn write(tree: &Tree, release: &Release, sources: &Path, out: &Path) -> Result<PathBuf> {
    let tag = tag(release);
    let info = format!("{NAME}-{}.dist-info", release.version);
    let mut wheel = tree.below(PREFIX);
    add_sources(&mut wheel, sources, "tuff")?;
    let mut add = |name: &str, text: String| {
        wheel.add(&format!("{info}/{name}"), Entry::file(text.into_bytes()));
    };
    let readme = sources.join("README.md");
    let readme = std::fs::read_to_string(&readme)
        .with_context(|| format!("reading {}", readme.display()))?;
    add("METADATA", metadata(release, &readme));
    add(
        "WHEEL",
        format!(
            "Wheel-Version: 1.0\nGenerator: tuff packaging\nRoot-Is-Purelib: false\nTag: {tag}\n"
        ),
    );
    add("entry_points.txt", ENTRY_POINTS.into());
    for (path, entry) in tree
        .files()
        .filter(|(path, _)| path.starts_with("share/doc/"))
    {
        let name = path.rsplit('/').next().unwrap_or(path);
        let text = String::from_utf8_lossy(&entry.bytes).into_owned();
        add(&format!("licenses/{name}"), text);
    }
    let record = record(&wheel, &info);
    wheel.add(&format!("{info}/RECORD"), Entry::file(record.into_bytes()));
    let path = out.join(format!("{NAME}-{}-{tag}.whl", release.version));
    let bytes = zipped(&wheel, &info, release.time)?;
    std::fs::write(&path, bytes).with_context(|| format!("writing {}", path.display()))?;
    Ok(path)
}

/// The compatibility tag: any Python 3, and Linux with at least this glibc version (PEP 600), or
/// Windows (PEP 425).
fn tag(release: &Release) -> String {
    let architecture = &release.architecture;
    let platform = match release.system {
        PackageSystem::Linux { glibc, .. } => {
            format!("manylinux_{}_{}_{architecture}", glibc.major, glibc.minor)
        }
        PackageSystem::Windows => match architecture.as_str() {
            "x86_64" => "win_amd64".into(),
            other => format!("win_{other}"),
        },
    };
    format!("py3-none-{platform}")
}

const ENTRY_POINTS: &str = "[console_scripts]
tuff = tuff.__main__:main

[pytest11]
tuff = tuff.pytest_plugin
";

fn metadata(release: &Release, readme: &str) -> String {
    format!(
        "Metadata-Version: 2.4
Name: tuff-vulkan
Version: {}
Summary: A Vulkan driver that traces rays on the CPU: Vulkan programs run without a graphics card
License-Expression: MIT OR Apache-2.0
License-File: LICENSE-MIT
License-File: LICENSE-APACHE
License-File: THIRD-PARTY.txt
Requires-Python: >=3.8
Classifier: Framework :: Pytest
Classifier: Operating System :: {}
Classifier: Topic :: Multimedia :: Graphics :: 3D Rendering
Description-Content-Type: text/markdown

{readme}",
        release.version,
        match release.system {
            PackageSystem::Linux { .. } => "POSIX :: Linux",
            PackageSystem::Windows => "Microsoft :: Windows",
        }
    )
}

/// Python sources below a folder, by their paths in it.
fn add_sources(wheel: &mut Tree, sources: &Path, folder: &str) -> Result<()> {
    let inside = sources.join(folder);
    let entries =
        std::fs::read_dir(&inside).with_context(|| format!("reading {}", inside.display()))?;
    for entry in entries {
        let path = entry?.path();
        let name = path
            .file_name()
            .and_then(|name| name.to_str())
            .context("a name in UTF-8")?;
        let is_source = path.is_file() && (name.ends_with(".py") || name == "py.typed");
        if is_source {
            let bytes = std::fs::read(&path).with_context(|| format!("reading {name}"))?;
            wheel.add(&format!("{folder}/{name}"), Entry::file(bytes));
        }
    }
    Ok(())
}

/// Every file with its hash and size, except the record itself, which has neither.
fn record(wheel: &Tree, info: &str) -> String {
    let mut text = String::new();
    for (path, Entry { bytes, .. }) in wheel.files() {
        text += &format!(
            "{path},sha256={},{}\n",
            hash::base64(&hash::sha256(bytes)),
            bytes.len()
        );
    }
    text + &format!("{info}/RECORD,,\n")
}

/// The format recommends that the metadata comes last.
fn zipped(wheel: &Tree, info: &str, time: u64) -> Result<Vec<u8>> {
    let (last, first): (Vec<_>, Vec<_>) =
        wheel.files().partition(|(path, _)| path.starts_with(info));
    zipfile::packed(first.into_iter().chain(last), time)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_say_what_is_needed() {
        let mut release = Release {
            version: "0.1.0".into(),
            architecture: "x86_64".into(),
            system: PackageSystem::Linux {
                glibc: "2.28".parse().unwrap(),
                needs_libgcc: false,
            },
            time: 0,
        };
        assert_eq!(tag(&release), "py3-none-manylinux_2_28_x86_64");
        release.system = PackageSystem::Windows;
        assert_eq!(tag(&release), "py3-none-win_amd64");
    }
}
