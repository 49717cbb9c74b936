//! `tuff run`: becomes another program, with the driver selected. On Windows, where a program
//! cannot become another one, it runs that and returns its exit code.

use std::ffi::{OsStr, OsString};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::{Context, Result};

use crate::installation::Installation;
use crate::registered::{self, Registered};
use crate::{loader, os};

/// The exit codes of shells for a missing program, and for one that cannot be started.
const NOT_FOUND: u8 = 127;
const NOT_EXECUTABLE: u8 = 126;

/// Becomes the program, with the given settings of the driver. Returns only on failure.
///
/// # Errors
/// The driver or a loader is missing, so the program would not find Vulkan.
pub fn run(
    installation: &Installation,
    words: &[OsString],
    settings: &[(&str, Option<OsString>)],
) -> Result<ExitCode> {
    installation.library().map_err(with_fix)?;
    let (name, arguments) = words.split_first().context("no program given")?;
    let path = match find(name, std::env::var_os("PATH").as_deref()) {
        Ok(path) => path,
        Err((code, why)) => {
            eprintln!("tuff: {}: {why}", name.display());
            return Ok(ExitCode::from(code));
        }
    };
    if let (Err(why), None) = (&installation.own_loader, loader::System::find()) {
        anyhow::bail!(
            "there is no Vulkan loader ({}; {why}): install it with `{}`",
            loader::LIBRARY,
            loader::install_command()
        );
    }
    tell_of_rights(installation);
    if os::has_more_rights(&path) {
        eprintln!(
            "tuff: note: {} runs with more rights than its user: the loader then ignores VK_DRIVER_FILES, and finds only installed drivers",
            path.display()
        );
    }
    let mut program = Command::new(&path);
    program.args(arguments);
    program.env_remove("VK_ADD_DRIVER_FILES");
    program.envs(installation.variables());
    for (name, value) in settings {
        if let Some(value) = value {
            program.env(name, value);
        }
    }
    Err(os::become_program(&mut program, name))
        .with_context(|| format!("starting {}", path.display()))
}

/// Warns if programs of this process ignore the variables and the driver is not registered for
/// them.
pub fn tell_of_rights(installation: &Installation) {
    let is_own = |it: &Registered| it.is_for_all_users && it.is_of(&installation.manifest);
    if os::variables_are_ignored() && !registered::all().iter().any(is_own) {
        eprintln!(
            "tuff: note: this process runs as administrator: the loader then ignores VK_DRIVER_FILES, and finds only installed drivers; \
             `tuff install` registers this one"
        );
    }
}

/// Adds the problem of the installed driver, and its fix, to an error.
pub fn with_fix(error: anyhow::Error) -> anyhow::Error {
    anyhow::anyhow!(
        "{error:#}: install Tuff again, or name its manifest by --manifest FILE; `tuff info` reports details"
    )
}

/// The file that a name refers to; or an exit code and the problem.
fn find(name: &OsStr, search: Option<&OsStr>) -> Result<PathBuf, (u8, String)> {
    let path = match os::names_a_folder(name) {
        true => {
            let files = os::files_of_program(Path::new(name)).into_iter();
            let mut there = files.filter(|path| path.exists());
            there.next().unwrap_or_else(|| name.into())
        }
        false => std::env::split_paths(search.unwrap_or_default())
            .flat_map(|folder| os::files_of_program(&folder.join(name)))
            .find(|path| os::is_executable(path))
            .ok_or_else(|| (NOT_FOUND, "no such program in the folders of PATH".into()))?,
    };
    match path.metadata() {
        Err(error) => return Err((NOT_FOUND, error.to_string())),
        Ok(file) if file.is_dir() => return Err((NOT_EXECUTABLE, "is a folder".into())),
        Ok(_) if !os::is_executable(&path) => {
            return Err((NOT_EXECUTABLE, "is not executable".into()));
        }
        Ok(_) => {}
    }
    let mut head = Vec::new();
    let read = std::fs::File::open(&path).and_then(|file| file.take(4096).read_to_end(&mut head));
    match read.is_ok() && is_32_bit(&head) {
        true => Err((
            NOT_EXECUTABLE,
            "is a 32-bit program, which cannot load Tuff: use a 64-bit build of it".into(),
        )),
        false => Ok(path),
    }
}

/// Whether a file with these first bytes is an ELF program of class 32 (System V ABI, ELF header)
/// or a PE program for an i386 (PE Format, "COFF File Header"). Programs of .NET have a CLI header:
/// they declare i386, too, but run on any processor.
fn is_32_bit(head: &[u8]) -> bool {
    const I386: &[u8] = &0x014c_u16.to_le_bytes();
    const PE32: &[u8] = &0x010b_u16.to_le_bytes();
    /// Offsets from the signature. The COFF header follows it, then the optional header with the
    /// data directories.
    const OPTIONAL: usize = 4 + 20;
    const CLI_DIRECTORY: usize = OPTIONAL + 96 + 14 * 8;
    if head.starts_with(b"\x7fELF") {
        return head.get(4) == Some(&1);
    }
    let at = head.get(0x3c..0x40).and_then(|bytes| bytes.try_into().ok());
    let signature = at.map_or(0, u32::from_le_bytes) as usize;
    let part = |offset: usize, length: usize| {
        let start = signature.checked_add(offset)?;
        head.get(start..start.checked_add(length)?)
    };
    head.starts_with(b"MZ")
        && part(0, 4) == Some(b"PE\0\0")
        && part(4, 2) == Some(I386)
        && part(OPTIONAL, 2) == Some(PE32)
        && part(CLI_DIRECTORY, 4).is_none_or(|address| address == [0; 4])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_of_32_bits_are_known_by_their_heads() {
        assert!(is_32_bit(b"\x7fELF\x01\x01\x01"));
        assert!(!is_32_bit(b"\x7fELF\x02\x01\x01"));
        assert!(!is_32_bit(b""));
        // PE Format: the signature's offset is at 0x3c, and the machine follows the signature.
        let program = |machine: u16, magic: u16, cli: u32| {
            let mut head = vec![0; 0x200];
            head[..2].copy_from_slice(b"MZ");
            head[0x3c] = 0x80;
            head[0x80..0x84].copy_from_slice(b"PE\0\0");
            head[0x84..0x86].copy_from_slice(&machine.to_le_bytes());
            head[0x98..0x9a].copy_from_slice(&magic.to_le_bytes());
            head[0x168..0x16c].copy_from_slice(&cli.to_le_bytes());
            head
        };
        assert!(is_32_bit(&program(0x014c, 0x010b, 0)));
        assert!(!is_32_bit(&program(0x014c, 0x010b, 0x2008)));
        assert!(!is_32_bit(&program(0x8664, 0x020b, 0)));
        let mut forged = program(0x014c, 0x010b, 0);
        forged[0x3c..0x40].fill(0xff);
        assert!(!is_32_bit(&forged));
    }

    #[cfg(unix)]
    #[test]
    fn what_cannot_be_started_is_told() {
        let find = |name: &str| super::find(OsStr::new(name), Some(OsStr::new("/usr/bin:/bin")));
        assert!(find("sh").is_ok());
        assert!(find("/bin/sh").is_ok());
        let cases = [
            ("no-such-program", NOT_FOUND, "no such program"),
            ("/no/such", NOT_FOUND, "No such file"),
            ("/usr/", NOT_EXECUTABLE, "is a folder"),
            ("/etc/passwd", NOT_EXECUTABLE, "is not executable"),
        ];
        for (name, code, expected) in cases {
            let (found, why) = find(name).unwrap_err();
            assert!(
                found == code && why.contains(expected),
                "{name}: {found} {why}"
            );
        }
        use std::os::unix::fs::PermissionsExt;
        let old = std::env::temp_dir().join(format!("tuff-32-{}", std::process::id()));
        std::fs::write(&old, b"\x7fELF\x01\x01\x01").unwrap();
        std::fs::set_permissions(&old, PermissionsExt::from_mode(0o755)).unwrap();
        let found = find(old.to_str().unwrap());
        std::fs::remove_file(&old).unwrap();
        assert!(found.unwrap_err().1.contains("32-bit program"));
    }
}
