//! Linux.

use std::ffi::{CStr, OsStr, c_void};
use std::fs::File;
use std::io;
use std::os::unix::fs::{FileExt, PermissionsExt};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The variable that lists the folders of libraries.
pub const LIBRARY_FOLDERS: &str = "LD_LIBRARY_PATH";
/// The separator between the entries of a list in a variable.
pub const LIST_SEPARATOR: &str = ":";

/// Restores SIGPIPE, so that this program ends like others when its reader closes the pipe (`tuff
/// info | head`). Rust programs start with that signal ignored, and panic when they print.
pub fn end_with_the_reader() {
    // SAFETY: the default action is no handler of ours, and no other thread runs yet.
    unsafe { libc::signal(libc::SIGPIPE, libc::SIG_DFL) };
}

/// The number of the machine's online processors.
pub fn processors() -> i64 {
    // SAFETY: a plain system call.
    unsafe { libc::sysconf(libc::_SC_NPROCESSORS_ONLN) }
}

/// Reads from an offset of a file.
pub fn read_at(file: &File, out: &mut [u8], offset: u64) -> io::Result<usize> {
    file.read_at(out, offset)
}

/// Whether a program's name contains its folder.
pub fn names_a_folder(name: &OsStr) -> bool {
    name.as_encoded_bytes().contains(&b'/')
}

/// The files that a program's name may refer to, in order of preference.
pub fn files_of_program(name: &Path) -> Vec<PathBuf> {
    vec![name.into()]
}

/// Whether the file is executable for some user.
pub fn is_executable(path: &Path) -> bool {
    let file = path.metadata();
    file.is_ok_and(|file| file.is_file() && file.permissions().mode() & 0o111 != 0)
}

/// Whether the file is setuid or setgid.
pub fn has_more_rights(path: &Path) -> bool {
    let file = path.metadata();
    file.is_ok_and(|file| file.permissions().mode() & 0o6000 != 0)
}

/// Whether the loader ignores its variables in every program that this one starts. Never on Linux,
/// because programs inherit no rights beyond their user's.
pub fn variables_are_ignored() -> bool {
    false
}

/// The canonical path of a file.
///
/// # Errors
/// The file is missing.
pub fn real_path(path: &Path) -> io::Result<PathBuf> {
    std::fs::canonicalize(path)
}

/// A text as bytes for a shell that reads it from a pipe.
///
/// # Errors
/// None on Linux.
pub fn letters_of_shells(text: &str) -> io::Result<Vec<u8>> {
    Ok(text.into())
}

/// Becomes the program, which gets `name` as its own name. Returns only on failure.
pub fn become_program(program: &mut Command, name: &OsStr) -> io::Error {
    program.arg0(name).exec()
}

/// The library file that a function was loaded from.
pub fn file_of(function: *const c_void) -> Option<PathBuf> {
    let mut found = std::mem::MaybeUninit::<libc::Dl_info>::zeroed();
    // SAFETY: `dladdr` writes the structure; on success its name is a string of the loaded library,
    // which is still open.
    unsafe {
        if libc::dladdr(function, found.as_mut_ptr()) == 0 {
            return None;
        }
        let name = found.assume_init().dli_fname;
        (!name.is_null()).then(|| PathBuf::from(CStr::from_ptr(name).to_str().unwrap_or_default()))
    }
}
