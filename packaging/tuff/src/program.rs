//! `tuff run`: becomes another program, with the driver selected.

use std::ffi::{OsStr, OsString};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::{Context, Result};

use crate::installation::Installation;
use crate::{loader, os, refusals};

/// The exit codes of shells for a missing program, and for one that cannot be started.
const NOT_FOUND: u8 = 127;
const NOT_EXECUTABLE: u8 = 126;

/// Becomes the program, to which the driver reports the conformance version if one is given;
/// returns only where that is not possible.
///
/// # Errors
/// The driver or a loader is not there: the program would not find Vulkan.
pub fn run(
    installation: &Installation,
    words: &[OsString],
    conformance: Option<&str>,
) -> Result<ExitCode> {
    installation.library().map_err(with_what_mends)?;
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
    if path.metadata().is_ok_and(|file| os::has_more_rights(&file)) {
        eprintln!(
            "tuff: note: {} runs with more rights than its user: the loader then ignores VK_DRIVER_FILES, and finds only installed drivers",
            path.display()
        );
    }
    let mut program = Command::new(&path);
    program.args(arguments);
    program.env_remove("VK_ADD_DRIVER_FILES");
    program.envs(installation.variables());
    if let Some(version) = conformance {
        program.env(refusals::CONFORMANCE, version);
    }
    Err(os::become_program(&mut program, name))
        .with_context(|| format!("starting {}", path.display()))
}

/// Adds the problem of the installed driver, and its fix, to an error.
pub fn with_what_mends(error: anyhow::Error) -> anyhow::Error {
    anyhow::anyhow!(
        "{error:#}: install Tuff again, or name its manifest by --manifest FILE; `tuff info` tells more"
    )
}

/// The file that a name means; or else an exit code, and what is wrong.
fn find(name: &OsStr, search: Option<&OsStr>) -> Result<PathBuf, (u8, String)> {
    let path = match name.as_encoded_bytes().contains(&b'/') {
        true => PathBuf::from(name),
        false => std::env::split_paths(search.unwrap_or_default())
            .map(|folder| folder.join(name))
            .find(|path| is_executable(path))
            .ok_or_else(|| (NOT_FOUND, "no such program in the folders of PATH".into()))?,
    };
    match path.metadata() {
        Err(error) => return Err((NOT_FOUND, error.to_string())),
        Ok(file) if file.is_dir() => return Err((NOT_EXECUTABLE, "is a folder".into())),
        Ok(_) if !is_executable(&path) => return Err((NOT_EXECUTABLE, "is not executable".into())),
        Ok(_) => {}
    }
    match is_32_bit(&path) {
        true => Err((
            NOT_EXECUTABLE,
            "is a 32-bit program, which cannot load Tuff: use a 64-bit build of it".into(),
        )),
        false => Ok(path),
    }
}

fn is_executable(path: &Path) -> bool {
    path.metadata().is_ok_and(|file| os::is_executable(&file))
}

/// Whether the file is an ELF program of class 32 (System V ABI, ELF header).
fn is_32_bit(path: &Path) -> bool {
    let mut header = [0; 5];
    let read = std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut header));
    read.is_ok() && header == *b"\x7fELF\x01"
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

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
        let old = std::env::temp_dir().join(format!("tuff-32-{}", std::process::id()));
        std::fs::write(&old, b"\x7fELF\x01\x01\x01").unwrap();
        std::fs::set_permissions(&old, PermissionsExt::from_mode(0o755)).unwrap();
        let found = find(old.to_str().unwrap());
        std::fs::remove_file(&old).unwrap();
        assert!(found.unwrap_err().1.contains("32-bit program"));
    }
}
