//! Packages of `cargo xtask package` are installed and work there; docs/compatibility.md tells its
//! sizes.

use std::path::{Path, PathBuf};
use std::process::Command;

use commands::{Scratch, Variables, of_the_shell, root, succeed, xtask};

/// How far a size in the documentation may be from what is packed: compilers and compression differ
/// a little.
const TOLERANCE: f64 = 0.1;

/// The package whose name ends so.
fn package(out: &Path, end: &str) -> PathBuf {
    let entries = out.read_dir().expect("a folder of packages");
    let mut files = entries.map(|entry| entry.expect("an entry").path());
    let is_it = |path: &PathBuf| path.to_string_lossy().ends_with(end);
    files
        .find(is_it)
        .unwrap_or_else(|| panic!("no package {end}"))
}

fn run(shell: &Variables, program: &Path, words: &[&str]) -> String {
    let mut command = Command::new(program);
    let output = command.args(words).env_clear().envs(shell).output();
    succeed(&output.expect("the program starts"))
}

#[test]
fn the_wheel_works_in_a_fresh_environment() {
    let scratch = Scratch::new("wheel");
    let (out, fresh) = (scratch.0.join("packages"), scratch.0.join("fresh"));
    let text = |path: &Path| path.to_str().expect("UTF-8").to_owned();
    let shell = of_the_shell();
    succeed(&xtask(
        &shell,
        &["package", "--glibc", "here", "--out", &text(&out)],
    ));
    let wheel = package(&out, ".whl");
    run(&shell, Path::new("python3"), &["-m", "venv", &text(&fresh)]);
    let pip = [
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-index",
        &text(&wheel),
    ];
    run(&shell, &fresh.join("bin/python"), &pip);
    let told = run(&shell, &fresh.join("bin/tuff"), &["info"]);
    assert!(told.contains("  device      Tuff ("), "{told}");
    assert!(
        told.contains(&format!("  manifest    {}", text(&fresh))),
        "{told}"
    );
    let by_module = run(
        &shell,
        &fresh.join("bin/python"),
        &["-m", "tuff", "--version"],
    );
    assert!(by_module.starts_with("tuff "), "{by_module}");
    // The distribution's loader came along, and would do where there is none.
    let code = "import ctypes, tuff; ctypes.CDLL(str(tuff.loader())).vkGetInstanceProcAddr";
    run(&shell, &fresh.join("bin/python"), &["-c", code]);
    if std::env::consts::ARCH == "x86_64" {
        let folder = run(
            &shell,
            &fresh.join("bin/python"),
            &["-c", "import tuff; print(tuff.manifest())"],
        );
        let driver = Path::new(folder.trim())
            .ancestors()
            .nth(4)
            .expect("the prefix");
        sizes_are_told(&driver.join("lib/tuff/libvulkan_tuff.so"), &out);
    }
}

/// Compares the table of docs/compatibility.md with the packages.
fn sizes_are_told(driver: &Path, out: &Path) {
    let page = std::fs::read_to_string(root().join("docs/compatibility.md"));
    let page = page.expect("the page can be read");
    let architecture = std::env::consts::ARCH;
    let mut wrong = Vec::new();
    for (row, file) in [
        ("the driver, stripped", driver.to_path_buf()),
        ("the `.deb`", package(out, ".deb")),
        (
            "the tarball",
            package(out, &format!("{architecture}.tar.gz")),
        ),
        ("the wheel", package(out, ".whl")),
        ("debug information", package(out, "-debug.tar.gz")),
    ] {
        let size = std::fs::metadata(&file).expect("its size").len() as f64 / 1e6;
        let told = page.lines().find_map(|line| {
            let rest = line.strip_prefix(&format!("| {row} | "))?;
            rest.trim_end_matches(" |").parse::<f64>().ok()
        });
        println!("| {row} | {size:.1} |");
        if !told.is_some_and(|told| (told / size - 1.0).abs() <= TOLERANCE) {
            wrong.push(format!("| {row} | {size:.1} | is told as {told:?}"));
        }
    }
    assert!(wrong.is_empty(), "docs/compatibility.md: {wrong:#?}");
}
