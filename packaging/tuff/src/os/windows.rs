//! Windows.

mod registry;

use std::ffi::{OsStr, OsString, c_void};
use std::fs::File;
use std::io;
use std::os::windows::ffi::{OsStrExt, OsStringExt};
use std::os::windows::fs::FileExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::ptr::{null, null_mut};

use windows_sys::Win32::Foundation::{CloseHandle, HANDLE, HMODULE, MAX_PATH};
use windows_sys::Win32::Globalization::{
    CP_UTF8, GetOEMCP, WC_NO_BEST_FIT_CHARS, WideCharToMultiByte,
};
use windows_sys::Win32::Security::{
    GetSidSubAuthority, GetSidSubAuthorityCount, GetTokenInformation, TOKEN_MANDATORY_LABEL,
    TOKEN_QUERY, TokenIntegrityLevel,
};
use windows_sys::Win32::Storage::FileSystem::GetShortPathNameW;
use windows_sys::Win32::System::Console::{
    CTRL_BREAK_EVENT, CTRL_C_EVENT, GetConsoleOutputCP, SetConsoleCtrlHandler,
};
use windows_sys::Win32::System::LibraryLoader::{
    GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS, GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT,
    GetModuleFileNameW, GetModuleHandleExW,
};
use windows_sys::Win32::System::Threading::{
    ALL_PROCESSOR_GROUPS, GetActiveProcessorCount, GetCurrentProcess, OpenProcessToken,
};

pub use registry::{drivers, forget, register, set_users_variable, users_variable};

/// The variable that lists the folders of libraries, and of programs.
pub const LIBRARY_FOLDERS: &str = "PATH";
/// The separator between the entries of a list in a variable.
pub const LIST_SEPARATOR: &str = ";";

/// A reader that has seen enough ends no program here.
pub fn end_with_the_reader() {}

/// Processors of the machine that are at work.
pub fn processors() -> i64 {
    // SAFETY: a plain system call.
    match unsafe { GetActiveProcessorCount(ALL_PROCESSOR_GROUPS) } {
        // Not known.
        0 => std::thread::available_parallelism().map_or(1, |count| count.get() as i64),
        count => i64::from(count),
    }
}

/// Reads from an offset of a file.
pub fn read_at(file: &File, out: &mut [u8], offset: u64) -> io::Result<usize> {
    file.seek_read(out, offset)
}

/// Whether a program's name says in which folder it lies.
pub fn names_a_folder(name: &OsStr) -> bool {
    let bytes = name.as_encoded_bytes();
    bytes.iter().any(|byte| matches!(byte, b'/' | b'\\' | b':'))
}

/// The endings of programs, with their dots.
fn endings() -> Vec<String> {
    let set = std::env::var("PATHEXT").unwrap_or_else(|_| ".COM;.EXE;.BAT;.CMD".into());
    let endings = set.split(';').filter(|ending| ending.len() > 1);
    endings.map(str::to_lowercase).collect()
}

fn has_ending_of_programs(path: &Path) -> bool {
    let name = path.to_string_lossy().to_lowercase();
    endings().iter().any(|ending| name.ends_with(ending))
}

/// The files that a program's name may mean, the first choice first.
pub fn files_of_program(name: &Path) -> Vec<PathBuf> {
    let with = |ending: String| {
        let mut file = OsString::from(name);
        file.push(ending);
        PathBuf::from(file)
    };
    let mut files: Vec<PathBuf> = endings().into_iter().map(with).collect();
    let at = if has_ending_of_programs(name) {
        0
    } else {
        files.len()
    };
    files.insert(at, name.into());
    files
}

/// Whether the file can be started, which its ending says.
pub fn is_executable(path: &Path) -> bool {
    path.is_file() && has_ending_of_programs(path)
}

/// Whether the program in the file asks for more rights when it starts: Windows asks the user.
pub fn has_more_rights(_: &Path) -> bool {
    false
}

/// Whether the loader ignores its variables in every program that this one starts: the process has
/// an administrator's rights (integrity level high), which its children inherit.
pub fn variables_are_ignored() -> bool {
    const HIGH: u32 = 0x3000;
    let mut token: HANDLE = null_mut();
    // Of eight-byte alignment, and large enough for the label and the longest SID.
    let mut label = [0u64; 16];
    let mut length = 0;
    // SAFETY: the system writes the token and at most as many bytes as `label` has; the SID in it
    // has at least one authority (MS-DTYP, section 2.4.4.14), and lies in `label`.
    unsafe {
        if OpenProcessToken(GetCurrentProcess(), TOKEN_QUERY, &raw mut token) == 0 {
            return false;
        }
        let told = GetTokenInformation(
            token,
            TokenIntegrityLevel,
            label.as_mut_ptr().cast(),
            size_of_val(&label) as u32,
            &raw mut length,
        );
        CloseHandle(token);
        if told == 0 {
            return false;
        }
        let sid = (*label.as_ptr().cast::<TOKEN_MANDATORY_LABEL>()).Label.Sid;
        let count = u32::from(*GetSidSubAuthorityCount(sid));
        count > 0 && *GetSidSubAuthority(sid, count - 1) >= HIGH
    }
}

/// Runs the program to its end, with which this one ends, too; returns only if the program does not
/// start. It is in no job object: that would hide limits of an outer one from the driver.
pub fn become_program(program: &mut Command, _: &OsStr) -> io::Error {
    // Programs do not inherit a handler, as they would the setting that ignores Ctrl-C.
    // SAFETY: the handler touches nothing of this process.
    unsafe { SetConsoleCtrlHandler(Some(leave_to_the_program), 1) };
    match program.status() {
        Ok(status) => std::process::exit(status.code().unwrap_or(1)),
        Err(error) => error,
    }
}

/// The console tells each of its processes of Ctrl-C: the program decides, and this one waits.
unsafe extern "system" fn leave_to_the_program(event: u32) -> i32 {
    i32::from(matches!(event, CTRL_C_EVENT | CTRL_BREAK_EVENT))
}

/// The path of a file without `..`.
///
/// # Errors
/// The file is not there.
pub fn real_path(path: &Path) -> io::Result<PathBuf> {
    path.metadata()?;
    // Not the canonical path: its `\\?\` is nothing that a person would type.
    std::path::absolute(path)
}

/// A text as the shells of the console read it from a pipe: in the console's code page.
///
/// # Errors
/// The code page lacks one of the letters.
pub fn letters_of_shells(text: &str) -> io::Result<Vec<u8>> {
    // SAFETY: plain system calls. A process without a console has no code page of it.
    let page = match unsafe { GetConsoleOutputCP() } {
        0 => unsafe { GetOEMCP() },
        page => page,
    };
    if page == CP_UTF8 || text.is_ascii() {
        return Ok(text.into());
    }
    let wide: Vec<u16> = text.encode_utf16().collect();
    let length = i32::try_from(wide.len()).map_err(io::Error::other)?;
    let mut lacks = 0;
    // No code page has more than four bytes a letter.
    let mut bytes = vec![0u8; wide.len() * 4];
    // SAFETY: both lengths are those of the buffers.
    let written = unsafe {
        WideCharToMultiByte(
            page,
            WC_NO_BEST_FIT_CHARS,
            wide.as_ptr(),
            length,
            bytes.as_mut_ptr(),
            bytes.len() as i32,
            null(),
            &raw mut lacks,
        )
    };
    if written <= 0 || lacks != 0 {
        return Err(io::Error::other(format!(
            "the console's code page {page} lacks letters of the driver's path: say `chcp 65001` first"
        )));
    }
    bytes.truncate(written as usize);
    Ok(bytes)
}

/// The short form (8.3) of a path that is there, if the drive has such names.
pub fn short_path(path: &Path) -> Option<String> {
    let wide: Vec<u16> = path.as_os_str().encode_wide().chain([0]).collect();
    // SAFETY: the path ends with a zero; the first call writes nothing, the second one at most as
    // many letters as `short` has.
    let short = unsafe {
        let length = GetShortPathNameW(wide.as_ptr(), null_mut(), 0);
        let mut short = vec![0u16; length as usize];
        let written = GetShortPathNameW(wide.as_ptr(), short.as_mut_ptr(), length);
        short
            .get(..written as usize)
            .filter(|_| written > 0)?
            .to_vec()
    };
    String::from_utf16(&short).ok()
}

/// The file that a function was loaded from. Its library is open.
pub fn file_of(function: *const c_void) -> Option<PathBuf> {
    let flags =
        GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS | GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT;
    let mut library: HMODULE = null_mut();
    let mut name = vec![0u16; MAX_PATH as usize];
    // SAFETY: the system writes the handle and at most as many letters as `name` has.
    unsafe {
        if GetModuleHandleExW(flags, function.cast(), &raw mut library) == 0 {
            return None;
        }
        loop {
            let length = GetModuleFileNameW(library, name.as_mut_ptr(), name.len() as u32);
            match length as usize {
                0 => return None,
                length if length < name.len() => {
                    return Some(OsString::from_wide(&name[..length]).into());
                }
                // Cut off.
                _ => name.resize(name.len() * 2, 0),
            }
        }
    }
}
