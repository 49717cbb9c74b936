//! Packages of substitute binaries: their contents, and that the same input gives the same bytes.

mod scratch;

use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Output};

use scratch::Scratch;

const VERSION: &str = env!("CARGO_PKG_VERSION");
const ARCHITECTURE: &str = std::env::consts::ARCH;

/// Packs the packaging program itself as driver, program and loader.
fn pack(scratch: &Path, out: &Path, glibc: &str) -> Output {
    let binary = Path::new(env!("CARGO_BIN_EXE_packaging"));
    for name in ["libvulkan_tuff.so", "tuff", "libvulkan.so.1"] {
        fs::copy(binary, scratch.join(name)).expect("the program can be copied");
    }
    fs::write(scratch.join("LICENSE.txt"), "the loader's").expect("written");
    fs::write(scratch.join("tuff_icd.json"), "{}").expect("written");
    let mut packaging = Command::new(binary);
    packaging
        .current_dir(scratch)
        .env_remove("SOURCE_DATE_EPOCH");
    packaging.args(["--driver", "libvulkan_tuff.so", "--program", "tuff"]);
    packaging.args(["--loader", "libvulkan.so.1", "--manifest", "tuff_icd.json"]);
    packaging.args(["--loader-licence", "LICENSE.txt"]);
    packaging.args(["--glibc", glibc, "--root"]);
    packaging
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."))
        .arg("--out")
        .arg(out);
    packaging.output().expect("the program starts")
}

fn packed(scratch: &Path, out: &Path) {
    let output = pack(scratch, out, "2.99");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

/// Files and folders of a tar, by path: their permissions and sizes.
fn listed(gzip: &[u8]) -> BTreeMap<String, (u32, u64)> {
    let mut tar = tar::Archive::new(flate2::read::GzDecoder::new(gzip));
    let entries = tar.entries().expect("a tar");
    (entries.map(|entry| entry.expect("an entry")))
        .map(|entry| {
            let header = entry.header();
            let path = entry.path().expect("a path").display().to_string();
            (
                path,
                (
                    header.mode().expect("a mode"),
                    header.size().expect("a size"),
                ),
            )
        })
        .collect()
}

#[test]
fn tarballs_have_what_an_installation_has() {
    let scratch = Scratch::new("packages-tarball");
    let out = scratch.0.join("out");
    packed(&scratch.0, &out);
    let name = format!("tuff-vulkan-{VERSION}-linux-{ARCHITECTURE}");
    let files = listed(&fs::read(out.join(format!("{name}.tar.gz"))).expect("a tarball"));
    for (path, mode) in [
        ("bin/tuff", 0o755),
        ("lib/tuff/libvulkan_tuff.so", 0o644),
        ("lib/tuff/loader/libvulkan.so.1", 0o644),
        ("share/vulkan/icd.d/tuff_icd.json", 0o644),
        ("share/doc/tuff-vulkan/LICENSE-MIT", 0o644),
        ("share/doc/tuff-vulkan/LICENSE-APACHE", 0o644),
        ("share/doc/tuff-vulkan/LICENSE-vulkan-loader.txt", 0o644),
        ("share/doc/tuff-vulkan/THIRD-PARTY.txt", 0o644),
    ] {
        let found = files.get(&format!("{name}/{path}"));
        let (found, size) = found.unwrap_or_else(|| panic!("no {path} in {files:?}"));
        assert!(*found == mode && *size > 0, "{path}: {found:o}, {size}");
    }
    let debug = listed(&fs::read(out.join(format!("{name}-debug.tar.gz"))).expect("a tarball"));
    assert!(
        debug.contains_key(&format!("{name}-debug/libvulkan_tuff.so.debug")),
        "{debug:?}"
    );
}

#[test]
fn debian_packages_have_control_and_data() {
    let scratch = Scratch::new("packages-deb");
    let out = scratch.0.join("out");
    packed(&scratch.0, &out);
    let architecture = Command::new("dpkg").arg("--print-architecture").output();
    let architecture = match (&architecture, ARCHITECTURE) {
        // If dpkg exists, it gives this machine's name.
        (Ok(output), _) => String::from_utf8_lossy(&output.stdout).trim().to_owned(),
        (Err(_), "x86_64") => "amd64".into(),
        (Err(_), "aarch64") => "arm64".into(),
        (Err(_), other) => other.into(),
    };
    let path = out.join(format!("tuff-vulkan_{VERSION}_{architecture}.deb"));
    let mut archive = ar::Archive::new(fs::File::open(&path).expect("a package"));
    let mut parts = Vec::new();
    while let Some(part) = archive.next_entry() {
        let mut part = part.expect("a part");
        let name = String::from_utf8_lossy(part.header().identifier()).into_owned();
        let mut bytes = Vec::new();
        part.read_to_end(&mut bytes).expect("its bytes");
        parts.push((name, bytes));
    }
    // deb(5): these three members, in this order.
    let names: Vec<&str> = parts.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["debian-binary", "control.tar.gz", "data.tar.gz"]);
    assert_eq!(parts[0].1, b"2.0\n");
    let data = listed(&parts[2].1);
    for path in [
        "usr/bin/tuff",
        "usr/lib/tuff/libvulkan_tuff.so",
        "usr/share/vulkan/icd.d/tuff_icd.json",
        "usr/share/doc/tuff-vulkan/copyright",
    ] {
        // The crate `tar` omits the leading `./` of the file's paths.
        let has = data.contains_key(path) || data.contains_key(&format!("./{path}"));
        assert!(has, "no {path} in {data:?}");
    }
    // Debian's own loader is recommended, not replaced.
    assert!(
        !data.keys().any(|path| path.contains("libvulkan.so")),
        "{data:?}"
    );
    let mut tar = tar::Archive::new(flate2::read::GzDecoder::new(&parts[1].1[..]));
    let mut control = String::new();
    for entry in tar.entries().expect("a tar") {
        let mut entry = entry.expect("an entry");
        if entry.path().expect("a path").ends_with("control") {
            entry.read_to_string(&mut control).expect("text");
        }
    }
    for line in [
        "Package: tuff-vulkan".to_owned(),
        format!("Version: {VERSION}"),
        format!("Architecture: {architecture}"),
        "Recommends: libvulkan1".to_owned(),
    ] {
        assert!(
            control.lines().any(|it| it == line),
            "no {line} in {control}"
        );
    }
    assert!(control.contains("\nDepends: libc6 (>= 2.99)"), "{control}");
}

#[test]
fn wheels_record_their_files() {
    let scratch = Scratch::new("packages-wheel");
    let out = scratch.0.join("out");
    packed(&scratch.0, &out);
    let name = format!("tuff_vulkan-{VERSION}-py3-none-manylinux_2_99_{ARCHITECTURE}.whl");
    let file = fs::File::open(out.join(name)).expect("a wheel");
    let mut wheel = zip::ZipArchive::new(file).expect("a zip file");
    let info = format!("tuff_vulkan-{VERSION}.dist-info");
    let mut record = String::new();
    let mut recorded = wheel.by_name(&format!("{info}/RECORD")).expect("a record");
    recorded.read_to_string(&mut record).expect("text");
    drop(recorded);
    let names: Vec<String> = (wheel.file_names())
        .map(|name| name.expect("a name").into_owned())
        .collect();
    for name in &names {
        assert!(
            record
                .lines()
                .any(|line| line.starts_with(&format!("{name},"))),
            "{name}"
        );
    }
    assert_eq!(record.lines().count(), names.len());
    for name in ["__init__.py", "__main__.py", "pytest_plugin.py", "py.typed"] {
        assert!(names.contains(&format!("tuff/{name}")), "{name}");
    }
    let program = wheel.by_name("tuff/prefix/bin/tuff").expect("the program");
    assert_eq!(program.unix_mode().map(|mode| mode & 0o777), Some(0o755));
    drop(program);
    let mut metadata = String::new();
    let mut file = wheel
        .by_name(&format!("{info}/METADATA"))
        .expect("metadata");
    file.read_to_string(&mut metadata).expect("text");
    drop(file);
    assert!(metadata.contains("\nName: tuff-vulkan\n"), "{metadata}");
    for line in metadata
        .lines()
        .filter_map(|line| line.strip_prefix("License-File: "))
    {
        assert!(names.contains(&format!("{info}/licenses/{line}")), "{line}");
    }
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    let scratch = Scratch::new("packages-twice");
    let (first, second) = (scratch.0.join("first"), scratch.0.join("second"));
    packed(&scratch.0, &first);
    packed(&scratch.0, &second);
    let sums = |out: &Path| fs::read_to_string(out.join("SHA256SUMS")).expect("sums");
    assert_eq!(sums(&first), sums(&second));
    assert_eq!(sums(&first).lines().count(), 4);
}

#[test]
fn a_promise_of_glibc_is_checked() {
    let scratch = Scratch::new("packages-glibc");
    let output = pack(&scratch.0, &scratch.0.join("out"), "2.1");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success());
    assert!(
        errors.contains("the binaries need glibc 2.") && errors.contains("more than 2.1"),
        "{errors}"
    );
}
