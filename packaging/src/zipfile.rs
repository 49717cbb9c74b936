//! Zip files: the format of wheels, and the archive that Windows opens.

use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use zip::write::SimpleFileOptions;

use crate::Release;
use crate::tree::{Entry, Tree};

/// Writes the relocatable zip, for systems without tarballs.
///
/// # Errors
/// The file cannot be written.
pub fn write(tree: &Tree, release: &Release, out: &Path) -> Result<PathBuf> {
    write_below(&release.name(), tree, release, out)
}

/// Writes the binaries' debug information, for debuggers with the folder in their search path.
///
/// # Errors
/// The file cannot be written.
pub fn write_debug(files: &[(String, Vec<u8>)], release: &Release, out: &Path) -> Result<PathBuf> {
    let mut tree = Tree::default();
    for (file, bytes) in files {
        tree.add(file, Entry::file(bytes.clone()));
    }
    write_below(&format!("{}-debug", release.name()), &tree, release, out)
}

fn write_below(name: &str, tree: &Tree, release: &Release, out: &Path) -> Result<PathBuf> {
    let tree = tree.below(name);
    let bytes = packed(tree.files(), release.time)?;
    let path = out.join(format!("{name}.zip"));
    std::fs::write(&path, bytes).with_context(|| format!("writing {}", path.display()))?;
    Ok(path)
}

/// A zip of files, in their given order.
///
/// # Errors
/// A zip file cannot represent a file's name or the time.
pub fn packed<'a>(files: impl Iterator<Item = (&'a str, &'a Entry)>, time: u64) -> Result<Vec<u8>> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (path, entry) in files {
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
}
