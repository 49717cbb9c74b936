//! Separates debug information into files of its own, and reads the glibc version that binaries
//! need from their symbols.
//!
//! The tools are from GNU binutils, which come with every C++ compiler on Linux.

use std::fmt;
use std::path::Path;
use std::process::Command;
use std::str::FromStr;

use anyhow::{Context, Result, ensure};

use crate::tree::{Entry, Tree};

/// A binary and its debug information.
pub struct Separated {
    pub stripped: Vec<u8>,
    /// The file name that debuggers search for, and the contents.
    pub debug: (String, Vec<u8>),
}

/// The binutils for an architecture.
pub struct Tools {
    /// The prefix of their names.
    prefix: String,
    /// The time to write into Windows binaries, in seconds since 1970.
    time: u64,
}

impl Tools {
    /// The tools for an architecture, by Rust's name, for Linux or Windows. Tools for another
    /// architecture than this machine's have a prefix with its name. The tools of x86-64 also read
    /// Windows binaries.
    pub fn of(architecture: &str, is_windows: bool, time: u64) -> Tools {
        let of_windows = format!("{architecture}-w64-mingw32-");
        let folders = std::env::var_os("PATH").unwrap_or_default();
        let is_there = |name: String| {
            std::env::split_paths(&folders).any(|folder| folder.join(&name).is_file())
        };
        let prefix = match architecture == std::env::consts::ARCH {
            _ if is_windows && is_there(format!("{of_windows}objcopy")) => of_windows,
            true => String::new(),
            false if is_windows => of_windows,
            false => format!("{architecture}-linux-gnu-"),
        };
        Tools { prefix, time }
    }

    fn tool(&self, name: &str) -> Command {
        Command::new(format!("{}{name}", self.prefix))
    }

    /// Separates a binary's debug information, with files in `scratch`.
    ///
    /// # Errors
    /// The binary or one of the tools is not there.
    pub fn separate(&self, binary: &Path, scratch: &Path) -> Result<Separated> {
        std::fs::create_dir_all(scratch)
            .with_context(|| format!("making {}", scratch.display()))?;
        let name = binary.file_name().context("a binary has a name")?;
        let name = name.to_str().context("a name in UTF-8")?;
        let debug_name = format!("{name}.debug");
        let (stripped, debug) = (scratch.join(name), scratch.join(&debug_name));
        std::fs::copy(binary, &stripped)
            .with_context(|| format!("reading {}", binary.display()))?;
        tool(
            self.tool("objcopy")
                .arg("--only-keep-debug")
                .arg(binary)
                .arg(&debug),
        )?;
        // The link contains a checksum of the debug file.
        let debug_bytes = self.timed(&debug)?;
        std::fs::write(&debug, &debug_bytes)?;
        tool(self.tool("strip").arg("--strip-unneeded").arg(&stripped))?;
        // The link names the file without a folder, so the command runs in the file's folder.
        let mut link = self.tool("objcopy");
        link.current_dir(scratch)
            .arg(format!("--add-gnu-debuglink={debug_name}"))
            .arg(name);
        tool(&mut link)?;
        Ok(Separated {
            stripped: self.timed(&stripped)?,
            debug: (debug_name, debug_bytes),
        })
    }

    /// The bytes of a binary. Windows binaries contain the time at which the tools wrote them, in
    /// the COFF header after the signature, and a checksum that only kernel drivers need (PE
    /// Format, "COFF File Header", "Optional Header Windows-Specific Fields"). They get the
    /// release's time and no checksum.
    fn timed(&self, path: &Path) -> Result<Vec<u8>> {
        const TIME: usize = 8;
        const SUM: usize = 4 + 20 + 64;
        let mut bytes = std::fs::read(path)?;
        if !bytes.starts_with(b"MZ") {
            return Ok(bytes);
        }
        let signature = bytes.get(0x3c..0x40).and_then(|it| it.try_into().ok());
        let signature = signature.map_or(0, u32::from_le_bytes) as usize;
        let header = (signature.checked_add(SUM + 4))
            .and_then(|end| bytes.get_mut(signature..end))
            .filter(|header| header.starts_with(b"PE\0\0"))
            .with_context(|| format!("{} has no PE header", path.display()))?;
        header[TIME..TIME + 4].copy_from_slice(&(self.time as u32).to_le_bytes());
        header[SUM..].fill(0);
        Ok(bytes)
    }
}

fn tool(command: &mut Command) -> Result<String> {
    let name = command.get_program().display().to_string();
    let output = (command.env("LC_ALL", "C").output())
        .with_context(|| format!("starting {name}: install binutils"))?;
    let errors = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{name}: {errors}");
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// A version of the GNU C library.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct GlibcVersion {
    pub major: u32,
    pub minor: u32,
}

impl fmt::Display for GlibcVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.major, self.minor)
    }
}

impl FromStr for GlibcVersion {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        // Some symbols have a third number, which is ignored here: 2.2.5.
        let mut numbers = text.splitn(3, '.').map(|number| number.parse().ok());
        match (numbers.next().flatten(), numbers.next().flatten()) {
            (Some(major), Some(minor)) => Ok(GlibcVersion { major, minor }),
            _ => Err(format!(
                "\"{text}\" is not a version of glibc, such as 2.28"
            )),
        }
    }
}

/// The newest glibc version that a binary of the tree requires; `None` if none requires one.
///
/// # Errors
/// A tool is not there.
pub fn newest_glibc(tree: &Tree, scratch: &Path) -> Result<Option<GlibcVersion>> {
    let mut newest = None;
    for (path, Entry { bytes, .. }) in binaries(tree) {
        let file = scratch.join("looked-at");
        std::fs::write(&file, bytes).with_context(|| format!("writing {path}"))?;
        let text = tool(
            Command::new("readelf")
                .args(["--version-info", "--wide"])
                .arg(&file),
        )?;
        newest = newest.max(asked_for(&text));
    }
    Ok(newest)
}

/// Whether a binary of the tree is linked with a library of this name.
///
/// # Errors
/// A tool is not there.
pub fn is_linked_with(tree: &Tree, library: &str, scratch: &Path) -> Result<bool> {
    for (path, Entry { bytes, .. }) in binaries(tree) {
        let file = scratch.join("looked-at");
        std::fs::write(&file, bytes).with_context(|| format!("writing {path}"))?;
        let text = tool(
            Command::new("readelf")
                .args(["--dynamic", "--wide"])
                .arg(&file),
        )?;
        let names =
            |line: &str| line.contains("(NEEDED)") && line.contains(&format!("[{library}]"));
        if text.lines().any(names) {
            return Ok(true);
        }
    }
    Ok(false)
}

fn binaries(tree: &Tree) -> impl Iterator<Item = (&str, &Entry)> {
    (tree.files()).filter(|(_, entry)| entry.bytes.starts_with(b"\x7fELF"))
}

/// The newest version in the output of `readelf --version-info`.
fn asked_for(text: &str) -> Option<GlibcVersion> {
    text.split("Name: GLIBC_")
        .skip(1)
        .filter_map(|rest| rest.split_whitespace().next()?.parse().ok())
        .max()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_read_and_compared() {
        let text = "  0x0010:   Name: GLIBC_2.2.5  Flags: none  Version: 5\n\
                    0x0020:   Name: GLIBC_2.28  Flags: none  Version: 4\n\
                    0x0030:   Name: GLIBC_2.4  Flags: none  Version: 3\n\
                    0x0040:   Name: GLIBC_PRIVATE  Flags: none  Version: 3\n";
        assert_eq!(
            asked_for(text).map(|it| it.to_string()).as_deref(),
            Some("2.28")
        );
        assert_eq!(asked_for("nothing"), None);
        assert!("2.9".parse::<GlibcVersion>() < "2.28".parse());
        assert!("two".parse::<GlibcVersion>().is_err());
    }

    /// The test program itself is the binary.
    #[test]
    fn binaries_are_taken_apart() {
        let scratch = std::env::temp_dir().join(format!("tuff-symbols-{}", std::process::id()));
        let program = std::env::current_exe().unwrap();
        let here = Tools::of(std::env::consts::ARCH, false, 0);
        let separated = here.separate(&program, &scratch).unwrap();
        let whole = std::fs::metadata(&program).unwrap().len() as usize;
        assert!(separated.stripped.len() < whole / 2);
        assert!(separated.debug.0.ends_with(".debug"));
        let mut tree = Tree::default();
        tree.add("bin/it", Entry::program(separated.stripped));
        let newest = newest_glibc(&tree, &scratch).unwrap();
        std::fs::remove_dir_all(&scratch).unwrap();
        assert!(newest >= "2.17".parse().ok());
    }
}
