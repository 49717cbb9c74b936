//! Licences of the project, and of every crate that is linked into what is packaged.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use serde_json::Value;

/// Names and texts: the project's own, and `THIRD-PARTY.txt`.
///
/// # Errors
/// Cargo does not tell what is linked, or a crate of somebody else has no licence.
pub fn all(root: &Path, packages: &[&str]) -> Result<Vec<(String, String)>> {
    let mut licences = Vec::new();
    for name in ["LICENSE-MIT", "LICENSE-APACHE"] {
        let text =
            std::fs::read_to_string(root.join(name)).with_context(|| format!("reading {name}"))?;
        licences.push((name.to_owned(), text));
    }
    licences.push(("THIRD-PARTY.txt".into(), third_party(root, packages)?));
    Ok(licences)
}

fn third_party(root: &Path, packages: &[&str]) -> Result<String> {
    let linked = linked(root, packages)?;
    let metadata = cargo(root, &["metadata", "--format-version", "1", "--locked"])?;
    let metadata: Value = serde_json::from_str(&metadata).context("cargo metadata")?;
    let mut text = String::from(
        "Crates that are linked into Tuff, with their licences. The Rust standard library (MIT OR Apache-2.0) is linked, too, and in\n\
         packages for old systems LLVM's libunwind (Apache-2.0 WITH LLVM-exception).\n",
    );
    // A text that many crates share, word for word, stands once.
    let mut seen = BTreeSet::new();
    let crates = metadata["packages"]
        .as_array()
        .context("cargo metadata has packages")?;
    for package in crates {
        let field = |name: &str| package[name].as_str().unwrap_or_default();
        let (name, version) = (field("name"), field("version"));
        // What has no source is the project's own.
        if package["source"].is_null() || !linked.contains(&format!("{name} v{version}")) {
            continue;
        }
        let licence = field("license");
        let folder = Path::new(field("manifest_path"))
            .parent()
            .context("a crate has a folder")?;
        let files = licence_files(folder)?;
        ensure!(
            !licence.is_empty() || !files.is_empty(),
            "{name} {version} has no licence"
        );
        text += &format!(
            "\n{:=<72}\n{name} {version}: {licence}\n{}\n",
            "",
            field("repository")
        );
        for (file, contents) in files {
            let shown = match seen.insert(contents.clone()) {
                true => contents,
                false => "(as above, word for word)".into(),
            };
            text += &format!("\n--- {file}\n{shown}\n");
        }
    }
    Ok(text)
}

/// Crates that packages are linked with, as `NAME vVERSION`.
fn linked(root: &Path, packages: &[&str]) -> Result<BTreeSet<String>> {
    let mut arguments = vec![
        "tree", "--locked", "--edges", "normal", "--prefix", "none", "--format", "{p}",
    ];
    for package in packages {
        arguments.extend(["--package", package]);
    }
    let tree = cargo(root, &arguments)?;
    let name_and_version = |line: &str| {
        let mut words = line.split_whitespace();
        Some(format!("{} {}", words.next()?, words.next()?))
    };
    Ok(tree.lines().filter_map(name_and_version).collect())
}

fn cargo(root: &Path, arguments: &[&str]) -> Result<String> {
    let program = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(program)
        .current_dir(root)
        .args(arguments)
        .output();
    let output = output.context("starting cargo")?;
    let errors = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "cargo {}: {errors}", arguments[0]);
    String::from_utf8(output.stdout).context("cargo prints UTF-8")
}

/// Files of a crate whose names say that they are licences or notices, and their texts.
fn licence_files(folder: &Path) -> Result<Vec<(String, String)>> {
    let entries =
        std::fs::read_dir(folder).with_context(|| format!("reading {}", folder.display()))?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry?.path();
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let upper = name.to_uppercase();
        let is_licence = ["LICENSE", "LICENCE", "COPYING", "NOTICE", "UNLICENSE"];
        if path.is_file() && is_licence.iter().any(|start| upper.starts_with(start)) {
            let bytes =
                std::fs::read(&path).with_context(|| format!("reading {}", path.display()))?;
            files.push((name, String::from_utf8_lossy(&bytes).into_owned()));
        }
    }
    files.sort();
    Ok(files)
}
