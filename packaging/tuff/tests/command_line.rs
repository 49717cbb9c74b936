//! The program as a shell sees it: its exit codes, and its output on each stream.

#![cfg(unix)]

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output};

/// A folder with a manifest and the library that it names, removed at the end.
struct Installed(PathBuf);

impl Installed {
    fn new(name: &str) -> Installed {
        let folder = std::env::temp_dir().join(format!("tuff-cli-{}-{name}", std::process::id()));
        fs::create_dir_all(&folder).expect("a folder can be made");
        fs::write(folder.join("lib.so"), "").expect("written");
        let manifest = r#"{"ICD": {"library_path": "./lib.so"}}"#;
        fs::write(folder.join("tuff.json"), manifest).expect("written");
        Installed(folder)
    }

    fn tuff(&self, words: &[&str]) -> Output {
        let mut tuff = Command::new(env!("CARGO_BIN_EXE_tuff"));
        tuff.arg("--manifest")
            .arg(self.0.join("tuff.json"))
            .args(words);
        tuff.env("VK_ADD_DRIVER_FILES", "/other.json");
        tuff.output().expect("it starts")
    }
}

impl Drop for Installed {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[track_caller]
fn expect(output: &Output, code: i32, error: &str) {
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{errors}");
    assert!(
        errors.starts_with("tuff: ") && errors.contains(error),
        "{errors}"
    );
    assert!(output.stdout.is_empty(), "{output:?}");
}

#[test]
fn shells_are_pointed_at_drivers_that_are_there() {
    let installed = Installed::new("env");
    let lines = String::from_utf8(installed.tuff(&["env"]).stdout).expect("text");
    let manifest = installed.0.join("tuff.json").display().to_string();
    assert!(
        lines.contains(&format!("export VK_DRIVER_FILES='{manifest}'\n")),
        "{lines}"
    );
    assert!(
        lines.contains(&format!("export VK_ICD_FILENAMES='{manifest}'\n")),
        "{lines}"
    );
    assert!(lines.contains("unset VK_ADD_DRIVER_FILES\n"), "{lines}");
    fs::remove_file(installed.0.join("lib.so")).expect("removed");
    expect(&installed.tuff(&["env"]), 1, "lib.so cannot be read");
    expect(
        &installed.tuff(&["run", "true"]),
        1,
        "lib.so cannot be read",
    );
    fs::remove_file(installed.0.join("tuff.json")).expect("removed");
    expect(&installed.tuff(&["env"]), 1, "tuff.json cannot be read");
}

#[test]
fn programs_that_cannot_run_have_a_shells_codes() {
    let installed = Installed::new("run");
    let missing = installed.tuff(&["run", "--", "no-such-program", "--option"]);
    expect(&missing, 127, "no-such-program: no such program");
    let folder = installed.0.display().to_string();
    expect(&installed.tuff(&["run", &folder]), 126, "is a folder");
    let wrong = installed.tuff(&["run", "--conformance=1.4", "true"]);
    let errors = String::from_utf8_lossy(&wrong.stderr);
    assert_eq!(wrong.status.code(), Some(2), "{errors}");
    assert!(errors.contains("is like 1.4.0.0"), "{errors}");
    let library = installed.0.join("lib.so").display().to_string();
    expect(
        &installed.tuff(&["run", &library]),
        126,
        "is not executable",
    );
}

#[test]
fn a_conformance_version_is_for_one_program() {
    let installed = Installed::new("conformance");
    let code = "printf %s \"$TUFF_CONFORMANCE\"";
    for (words, expected) in [
        (
            vec!["run", "--conformance", "--", "sh", "-c", code],
            "1.4.0.0",
        ),
        (
            vec!["run", "--conformance=1.3.8.0", "sh", "-c", code],
            "1.3.8.0",
        ),
        (vec!["run", "--", "sh", "-c", code], ""),
    ] {
        let output = installed.tuff(&words);
        // Without any loader, nothing is run.
        if output.status.success() {
            assert_eq!(String::from_utf8_lossy(&output.stdout), expected);
        } else {
            expect(&output, 1, "there is no Vulkan loader");
        }
    }
}

#[test]
fn info_tells_what_is_wrong_and_fails() {
    let installed = Installed::new("info");
    fs::remove_file(installed.0.join("tuff.json")).expect("removed");
    let info = installed.tuff(&["info"]);
    let text = String::from_utf8_lossy(&info.stdout);
    assert_eq!(info.status.code(), Some(1), "{text}");
    assert!(
        text.contains("problem: the manifest ") && text.contains("   mend: "),
        "{text}"
    );
    assert!(
        text.contains("VK_ADD_DRIVER_FILES names /other.json, which is not there"),
        "{text}"
    );
}
