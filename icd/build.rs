//! Link options of the shared library, and the compiler's identity.

use std::env;
use std::fs;
use std::path::Path;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    // Worker threads and thread-local destructors may outlive the last `dlclose`: the code must
    // stay mapped. On Windows `os::library` keeps it.
    if env::var_os("CARGO_CFG_UNIX").is_some() {
        println!("cargo:rustc-cdylib-link-arg=-Wl,-z,nodelete");
    }
    // Stored programs are read by the compiler that made them only.
    let compiler = ["../spirv-jit/src", "../spirv-jit/images/src"].map(Path::new);
    let mut hash = 0xCBF2_9CE4_8422_2325;
    for folder in compiler {
        println!("cargo:rerun-if-changed={}", folder.display());
        hash = hash_sources(hash, folder);
    }
    println!("cargo:rustc-env=TUFF_COMPILER_HASH={hash:016x}");
}

/// FNV-1a over the names and contents of the files below a folder, in the order of their names.
fn hash_sources(hash: u64, folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<_> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    paths.iter().fold(hash, |hash, path| {
        if path.is_dir() {
            return hash_sources(hash, path);
        }
        let name = path.file_name().unwrap_or_default().as_encoded_bytes();
        let contents = fs::read(path).unwrap_or_default();
        name.iter().chain(&contents).fold(hash, |hash, &byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3)
        })
    })
}
