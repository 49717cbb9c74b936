//! The Python wheel (the binary distribution format of packaging.python.org).

use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use zip::write::SimpleFileOptions;

use crate::tree::{Entry, Tree};
use crate::{Release, hash};

/// The distribution's name, as file names have it.
const NAME: &str = "tuff_vulkan";
/// Where the tree goes, inside the Python package `tuff`.
const PREFIX: &str = "tuff/prefix";

/// Writes `tuff_vulkan-VERSION-py3-none-manylinux….whl`, with the Python sources of `sources`.
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

/// The compatibility tag: any Python 3, and a Linux with this glibc or a newer one (PEP 600).
fn tag(release: &Release) -> String {
    let glibc = release.glibc;
    format!(
        "py3-none-manylinux_{}_{}_{}",
        glibc.major, glibc.minor, release.architecture
    )
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
Classifier: Operating System :: POSIX :: Linux
Classifier: Topic :: Multimedia :: Graphics :: 3D Rendering
Description-Content-Type: text/markdown

{readme}",
        release.version
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

/// Every file with its hash and size; the record itself has neither.
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

fn zipped(wheel: &Tree, info: &str, time: u64) -> Result<Vec<u8>> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    // The format recommends that the metadata comes last.
    let (last, first): (Vec<_>, Vec<_>) =
        wheel.files().partition(|(path, _)| path.starts_with(info));
    for (path, entry) in first.into_iter().chain(last) {
        let options = SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Deflated)
            .compression_level(Some(9))
            .last_modified_time(zip_time(time)?)
            .unix_permissions(entry.mode());
        zip.start_file(path, options)?;
        zip.write_all(&entry.bytes)?;
    }
    Ok(zip.finish()?.into_inner())
}

/// A day of the calendar from seconds since 1970, at midnight (the algorithm is Howard Hinnant's
/// `civil_from_days`).
fn zip_time(seconds: u64) -> Result<zip::DateTime> {
    let days = seconds / 86_400 + 719_468;
    let era = days / 146_097;
    let day_of_era = days % 146_097;
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 {
        shifted + 3
    } else {
        shifted - 9
    };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    zip::DateTime::from_date_and_time(year as u16, month as u8, day as u8, 0, 0, 0)
        .map_err(|_| anyhow::anyhow!("a zip file cannot name the year {year}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_the_calendar() {
        // `date -u -d @SECONDS`.
        for (seconds, expected) in [
            (315_532_800, (1980, 1, 1)),
            (951_782_400, (2000, 2, 29)),
            (1_790_000_000, (2026, 9, 21)),
            (1_798_675_200, (2026, 12, 31)),
        ] {
            let day = zip_time(seconds).unwrap();
            assert_eq!((day.year(), day.month(), day.day()), expected);
        }
    }

    #[test]
    fn tags_say_what_is_needed() {
        let release = Release {
            version: "0.1.0".into(),
            architecture: "x86_64".into(),
            glibc: "2.28".parse().unwrap(),
            needs_libgcc: false,
            time: 0,
        };
        assert_eq!(tag(&release), "py3-none-manylinux_2_28_x86_64");
    }
}
