//! Packages for Windows, of binaries that this test makes up byte by byte.

mod scratch;

use std::fs;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Output};

use scratch::Scratch;

const VERSION: &str = env!("CARGO_PKG_VERSION");

/// A folder whose name has a space and letters outside of ASCII.
fn scratch(name: &str) -> Scratch {
    Scratch::new(&format!("windows {name} Jürgen ż"))
}

/// A library of Windows (PE Format) with one import.
fn library(imports_from: &str, function: &str) -> Vec<u8> {
    const HEADERS: usize = 0x400;
    const SECTION: usize = 0x200;
    /// Where the sections lie in memory.
    const CODE: u32 = 0x1000;
    const IMPORTS: u32 = 0x2000;
    let mut file = vec![0; HEADERS + 2 * SECTION];
    let mut at = 0;
    let mut put = |bytes: &[u8]| {
        file[at..at + bytes.len()].copy_from_slice(bytes);
        at += bytes.len();
    };
    put(b"MZ");
    put(&[0; 0x3a]);
    put(&0x40_u32.to_le_bytes());
    put(b"PE\0\0");
    // COFF file header: x86-64, two sections, a library.
    for word in [0x8664_u16, 2, 0, 0, 0, 0, 0, 0, 240, 0x2022] {
        put(&word.to_le_bytes());
    }
    // Optional header: PE32+, sizes, entry, alignments, versions.
    put(&0x020b_u16.to_le_bytes());
    put(&[2, 0]);
    for word in [SECTION as u32, SECTION as u32, 0, CODE, CODE] {
        put(&word.to_le_bytes());
    }
    put(&0x1_8000_0000_u64.to_le_bytes());
    for word in [0x1000_u32, 0x200] {
        put(&word.to_le_bytes());
    }
    for word in [4_u16, 0, 0, 0, 5, 2, 0, 0] {
        put(&word.to_le_bytes());
    }
    for word in [0x3000, HEADERS as u32, 0] {
        put(&word.to_le_bytes());
    }
    for word in [3_u16, 0x0160] {
        put(&word.to_le_bytes());
    }
    for word in [0x20_0000_u64, 0x1000, 0x10_0000, 0x1000] {
        put(&word.to_le_bytes());
    }
    for word in [0, 16, 0, 0, IMPORTS, 0x28] {
        put(&word.to_le_bytes());
    }
    put(&[0; 14 * 8]);
    for (name, memory, place, flags) in [
        (b".text\0\0\0", CODE, HEADERS, 0x6000_0020_u32),
        (b".idata\0\0", IMPORTS, HEADERS + SECTION, 0xc000_0040),
    ] {
        put(name);
        for word in [
            SECTION as u32,
            memory,
            SECTION as u32,
            place as u32,
            0,
            0,
            0,
            flags,
        ] {
            put(&word.to_le_bytes());
        }
    }
    file[HEADERS] = 0xc3;
    // A descriptor and the empty one that ends them, twice the list of functions, names.
    let mut place = |offset: u32, bytes: &[u8]| {
        let start = HEADERS + SECTION + offset as usize;
        file[start..start + bytes.len()].copy_from_slice(bytes);
    };
    for (index, word) in [IMPORTS + 0x40, 0, 0, IMPORTS + 0xc0, IMPORTS + 0x60]
        .iter()
        .enumerate()
    {
        place(index as u32 * 4, &word.to_le_bytes());
    }
    for list in [0x40, 0x60] {
        place(list, &u64::from(IMPORTS + 0x80).to_le_bytes());
    }
    place(0x82, function.as_bytes());
    place(0xc0, imports_from.as_bytes());
    file
}

/// Packs one library as driver, program and loader.
fn pack(scratch: &Path, out: &Path, binary: &[u8]) -> Output {
    for name in ["vulkan_tuff.dll", "tuff.exe", "vulkan-1.dll"] {
        fs::write(scratch.join(name), binary).expect("written");
    }
    fs::write(scratch.join("LICENSE.txt"), "the loader's").expect("written");
    fs::write(scratch.join("tuff_icd.json"), "{}").expect("written");
    let mut packaging = Command::new(env!("CARGO_BIN_EXE_packaging"));
    packaging
        .current_dir(scratch)
        .env_remove("SOURCE_DATE_EPOCH");
    packaging.args(["--windows", "--architecture", "x86_64"]);
    packaging.args(["--driver", "vulkan_tuff.dll", "--program", "tuff.exe"]);
    packaging.args(["--loader", "vulkan-1.dll", "--manifest", "tuff_icd.json"]);
    packaging.args(["--loader-licence", "LICENSE.txt"]);
    packaging
        .arg("--root")
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."))
        .arg("--out")
        .arg(out);
    packaging.output().expect("the program starts")
}

#[track_caller]
fn packed(scratch: &Path, out: &Path) {
    let output = pack(scratch, out, &library("KERNEL32.dll", "ExitProcess"));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
}

fn opened(path: &Path) -> zip::ZipArchive<fs::File> {
    let file = fs::File::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    zip::ZipArchive::new(file).expect("a zip file")
}

/// The files of an installation.
const FILES: [&str; 8] = [
    "bin/tuff.exe",
    "lib/tuff/vulkan_tuff.dll",
    "lib/tuff/loader/vulkan-1.dll",
    "share/vulkan/icd.d/tuff_icd.json",
    "share/doc/tuff-vulkan/LICENSE-MIT",
    "share/doc/tuff-vulkan/LICENSE-APACHE",
    "share/doc/tuff-vulkan/LICENSE-vulkan-loader.txt",
    "share/doc/tuff-vulkan/THIRD-PARTY.txt",
];

#[test]
fn zips_and_wheels_have_what_an_installation_has() {
    let scratch = scratch("files");
    let out = scratch.0.join("out");
    packed(&scratch.0, &out);
    let name = format!("tuff-vulkan-{VERSION}-windows-x86_64");
    let mut zip = opened(&out.join(format!("{name}.zip")));
    let mut wheel = opened(&out.join(format!("tuff_vulkan-{VERSION}-py3-none-win_amd64.whl")));
    for file in FILES {
        let zipped = zip.by_name(&format!("{name}/{file}")).expect(file).size();
        let in_wheel = wheel
            .by_name(&format!("tuff/prefix/{file}"))
            .expect(file)
            .size();
        assert!(
            zipped > 0 && in_wheel == zipped,
            "{file}: {zipped}, {in_wheel}"
        );
    }
    assert_eq!(zip.len(), FILES.len());
    let mut licences = String::new();
    zip.by_name(&format!("{name}/share/doc/tuff-vulkan/THIRD-PARTY.txt"))
        .expect("licences")
        .read_to_string(&mut licences)
        .expect("text");
    assert!(
        licences.contains("\nwindows-sys ") && !licences.contains("\nx11rb "),
        "{licences}"
    );
    let mut metadata = String::new();
    (wheel.by_name(&format!("tuff_vulkan-{VERSION}.dist-info/METADATA")))
        .expect("metadata")
        .read_to_string(&mut metadata)
        .expect("text");
    assert!(metadata.contains("\nClassifier: Operating System :: Microsoft :: Windows\n"));
    let mut debug = opened(&out.join(format!("{name}-debug.zip")));
    for file in ["vulkan_tuff.dll.debug", "tuff.exe.debug"] {
        assert!(
            debug
                .by_name(&format!("{name}-debug/{file}"))
                .expect(file)
                .size()
                > 0
        );
    }
    // Neither of Debian nor a tarball.
    let sums = fs::read_to_string(out.join("SHA256SUMS")).expect("sums");
    assert_eq!(sums.lines().count(), 3, "{sums}");
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    let scratch = scratch("twice");
    let (first, second) = (scratch.0.join("first"), scratch.0.join("second"));
    packed(&scratch.0, &first);
    // Times in binaries are in seconds.
    std::thread::sleep(std::time::Duration::from_millis(1100));
    packed(&scratch.0, &second);
    let sums = |out: &Path| fs::read_to_string(out.join("SHA256SUMS")).expect("sums");
    assert_eq!(sums(&first), sums(&second));
}

#[test]
fn what_some_windows_10_lacks_is_refused() {
    let scratch = scratch("imports");
    let out = scratch.0.join("out");
    for (library_name, function) in [
        ("libgcc_s_seh-1.dll", "_Unwind_Resume"),
        ("libwinpthread-1.dll", "pthread_create"),
        ("KERNEL32.dll", "VirtualAlloc2"),
    ] {
        let output = pack(&scratch.0, &out, &library(library_name, function));
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success(), "{library_name} was taken");
        let expected = format!("bin/tuff.exe: {function} of {library_name}");
        assert!(errors.contains(&expected), "{errors}");
    }
    let output = pack(
        &scratch.0,
        &out,
        &library("api-ms-win-core-synch-l1-2-0.dll", "WaitOnAddress"),
    );
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

#[test]
fn a_file_where_the_folder_should_be_is_named() {
    let scratch = scratch("file");
    let out = scratch.0.join("out");
    fs::write(&out, "").expect("written");
    let output = pack(&scratch.0, &out, &library("KERNEL32.dll", "ExitProcess"));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(
        !output.status.success() && errors.contains("out"),
        "{errors}"
    );
}
