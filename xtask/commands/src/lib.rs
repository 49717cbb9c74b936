//! `cargo xtask` as a person types it: the harness of tests that start it.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Variables of a shell.
pub type Variables = BTreeMap<OsString, OsString>;

/// The root of the repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The variables of the shell that this test was started from, as far as that can be told: without
/// what cargo, rustup and `cargo xtask test` set, and without those that point at another driver.
pub fn of_the_shell() -> Variables {
    let all: Variables = std::env::vars_os().collect();
    let value = |name: &str| all.get(&OsString::from(name)).cloned();
    let is_default = |name: &str, folder: &str| {
        let home = value("HOME").map(|home| Path::new(&home).join(folder).into_os_string());
        home.is_some() && home == value(name)
    };
    let has_named_toolchain = value("RUSTUP_TOOLCHAIN_SOURCE").is_some_and(|it| it == "env");
    let is_users = |name: &str| match name {
        "CARGO" | "LD_LIBRARY_PATH" | "RUST_RECURSION_COUNT" | "RUSTUP_TOOLCHAIN_SOURCE" => false,
        "CARGO_MANIFEST_DIR" | "CARGO_MANIFEST_PATH" => false,
        "RUSTUP_TOOLCHAIN" => has_named_toolchain,
        "CARGO_HOME" => !is_default(name, ".cargo"),
        "RUSTUP_HOME" => !is_default(name, ".rustup"),
        _ => !["CARGO_PKG_", "VK_", "TUFF_"]
            .iter()
            .any(|start| name.starts_with(start)),
    };
    let users = all.iter();
    let users = users.filter(|(name, _)| name.to_str().is_some_and(is_users));
    users.map(|(a, b)| (a.clone(), b.clone())).collect()
}

/// Runs `cargo xtask WORDS` with these variables and no others.
pub fn xtask(variables: &Variables, words: &[&str]) -> Output {
    let mut cargo = Command::new("cargo");
    cargo
        .arg("xtask")
        .args(words)
        .current_dir(root())
        .env_clear()
        .envs(variables);
    cargo.output().expect("cargo starts")
}

/// The output of a command; fails if the command failed.
#[track_caller]
pub fn succeed(output: &Output) -> String {
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}{errors}");
    said
}

/// A folder of a test's own, gone at the end.
pub struct Scratch(pub PathBuf);

impl Scratch {
    pub fn new(name: &str) -> Scratch {
        let name = format!("tuff-commands-{}-{name}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&folder).expect("a folder can be made");
        Scratch(folder)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
