//! The imports of Windows binaries. Every version of Windows 10 has them.

use anyhow::{Context, Result};
use object::LittleEndian;
use object::read::pe::PeFile64;

use crate::tree::{Entry, Tree};

/// Libraries of every version of Windows 10. Names that start with [`SETS`] are API sets, which the
/// system maps to its libraries.
const LIBRARIES: [&str; 23] = [
    "advapi32.dll",
    "bcrypt.dll",
    "bcryptprimitives.dll",
    "cfgmgr32.dll",
    "crypt32.dll",
    "dxgi.dll",
    "gdi32.dll",
    "kernel32.dll",
    "kernelbase.dll",
    "ktmw32.dll",
    "msvcrt.dll",
    "ntdll.dll",
    "ole32.dll",
    "oleaut32.dll",
    "powrprof.dll",
    "psapi.dll",
    "rpcrt4.dll",
    "shell32.dll",
    "shlwapi.dll",
    "ucrtbase.dll",
    "user32.dll",
    "userenv.dll",
    "ws2_32.dll",
];
const SETS: [&str; 2] = ["api-ms-win-core-", "api-ms-win-crt-"];

/// Functions of later versions of Windows 10. A library that imports one does not load on older
/// systems, and so cannot report the missing function.
const NEWER: [&str; 10] = [
    "CreateFileMapping2",
    "GetThreadDescription",
    "MapViewOfFile3",
    "MapViewOfFile3FromApp",
    "MapViewOfFileNuma2",
    "SetThreadDescription",
    "UnmapViewOfFile2",
    "VirtualAlloc2",
    "VirtualAlloc2FromApp",
    "VirtualAllocFromApp",
];

/// The imports that some version of Windows 10 lacks, each with the file that has it.
///
/// # Errors
/// A file with the name of a binary is not one.
pub fn missing(tree: &Tree) -> Result<Vec<String>> {
    let mut missing = Vec::new();
    for (path, Entry { bytes, .. }) in tree.files().filter(|(path, _)| is_binary(path)) {
        let imports = imports(bytes).with_context(|| format!("{path} is not a Windows binary"))?;
        for (library, function) in imports {
            let name = library.to_lowercase();
            let is_there =
                LIBRARIES.contains(&name.as_str()) || SETS.iter().any(|set| name.starts_with(set));
            if !is_there || NEWER.contains(&function.as_str()) {
                missing.push(format!("{path}: {function} of {library}"));
            }
        }
    }
    Ok(missing)
}

fn is_binary(path: &str) -> bool {
    [".dll", ".exe"].iter().any(|ending| path.ends_with(ending))
}

/// Libraries and their functions. Functions that are imported by number have only the number.
fn imports(bytes: &[u8]) -> Result<Vec<(String, String)>> {
    let file = PeFile64::parse(bytes)?;
    let mut imports = Vec::new();
    let Some(table) = file.import_table()? else {
        return Ok(imports);
    };
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let mut descriptors = table.descriptors()?;
    while let Some(descriptor) = descriptors.next()? {
        let library = text(table.name(descriptor.name.get(LittleEndian))?);
        let first = descriptor.original_first_thunk.get(LittleEndian);
        let first = match first {
            0 => descriptor.first_thunk.get(LittleEndian),
            first => first,
        };
        let mut thunks = table.thunks(first)?;
        while let Some(thunk) = thunks.next::<object::pe::ImageNtHeaders64>()? {
            let function = match table.import::<object::pe::ImageNtHeaders64>(thunk)? {
                object::read::pe::Import::Ordinal(number) => format!("number {number}"),
                object::read::pe::Import::Name(_, name) => text(name),
            };
            imports.push((library.clone(), function));
        }
    }
    Ok(imports)
}
