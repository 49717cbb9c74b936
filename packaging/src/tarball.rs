//! Tarballs: one that can be unpacked anywhere, and one of debug information.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use flate2::Compression;
use flate2::write::GzEncoder;

use crate::Release;
use crate::tree::{Entry, Tree};

/// A gzip-compressed tar of a tree, folders included; paths start with `start`.
///
/// # Errors
/// A path is too long for tar.
pub fn packed(tree: &Tree, start: &str, time: u64) -> Result<Vec<u8>> {
    let mut tar = tar::Builder::new(GzEncoder::new(Vec::new(), Compression::best()));
    let header = |kind: tar::EntryType, mode: u32, size: usize| {
        let mut header = tar::Header::new_gnu();
        header.set_entry_type(kind);
        header.set_mode(mode);
        header.set_size(size as u64);
        header.set_mtime(time);
        header.set_uid(0);
        header.set_gid(0);
        header
    };
    for folder in tree.folders() {
        let mut header = header(tar::EntryType::Directory, 0o755, 0);
        tar.append_data(&mut header, format!("{start}{folder}/"), &[][..])?;
    }
    for (path, entry) in tree.files() {
        let mut header = header(tar::EntryType::Regular, entry.mode(), entry.bytes.len());
        tar.append_data(&mut header, format!("{start}{path}"), &entry.bytes[..])?;
    }
    Ok(tar.into_inner()?.finish()?)
}

/// Writes the relocatable tarball.
///
/// # Errors
/// The file cannot be written.
pub fn write(tree: &Tree, release: &Release, out: &Path) -> Result<PathBuf> {
    let name = release.name();
    write_file(
        &tree.below(&name),
        release,
        &out.join(format!("{name}.tar.gz")),
    )
}

/// Writes the binaries' debug information, for debuggers with the folder in their search path.
///
/// # Errors
/// The file cannot be written.
pub fn write_debug(files: &[(String, Vec<u8>)], release: &Release, out: &Path) -> Result<PathBuf> {
    let name = format!("{}-debug", release.name());
    let mut tree = Tree::default();
    for (file, bytes) in files {
        tree.add(file, Entry::file(bytes.clone()));
    }
    write_file(
        &tree.below(&name),
        release,
        &out.join(format!("{name}.tar.gz")),
    )
}

fn write_file(tree: &Tree, release: &Release, path: &Path) -> Result<PathBuf> {
    let bytes = packed(tree, "", release.time)?;
    (std::fs::File::create(path).and_then(|mut file| file.write_all(&bytes)))
        .with_context(|| format!("writing {}", path.display()))?;
    Ok(path.into())
}
