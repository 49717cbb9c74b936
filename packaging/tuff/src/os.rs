//! The operating system: no other file of this program names `libc` or `std::os`
//! (`xtask/tests/system.rs`).

use std::ffi::{CStr, OsStr, c_void};
use std::fs::{File, Metadata};
use std::io;
use std::os::unix::fs::{FileExt, PermissionsExt};
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Command;

/// Has a reader that has seen enough (`tuff info | head`) end this program by SIGPIPE, as it ends
/// others. Rust's programs start with that signal ignored, and panic when they print.
pub fn end_with_the_reader() {
    // SAFETY: the default action is no handler of ours, and no other thread runs yet.
    unsafe { libc::signal(libc::SIGPIPE, libc::SIG_DFL) };
}

/// Processors of the machine that are at work.
pub fn processors() -> i64 {
    // SAFETY: a plain system call.
    unsafe { libc::sysconf(libc::_SC_NPROCESSORS_ONLN) }
}

/// Reads from an offset of a file.
pub fn read_at(file: &File, out: &mut [u8], offset: u64) -> io::Result<usize> {
    file.read_at(out, offset)
}

/// Whether some user may start the file.
pub fn is_executable(file: &Metadata) -> bool {
    file.is_file() && file.permissions().mode() & 0o111 != 0
}

/// Whether the program in the file changes its user or group when it starts.
pub fn has_more_rights(file: &Metadata) -> bool {
    file.permissions().mode() & 0o6000 != 0
}

/// Becomes the program, which sees this name as its own; returns only where that is not possible.
pub fn become_program(program: &mut Command, name: &OsStr) -> io::Error {
    program.arg0(name).exec()
}

/// The file that a function was loaded from. Its library is open.
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
