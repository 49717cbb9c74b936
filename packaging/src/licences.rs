//! Licences of the project and of every crate in the packaged binaries.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use serde_json::Value;

/// Names and texts: the project's own, and `THIRD-PARTY.txt`.
///
/// # Errors
/// Cargo does not list the linked crates, or a crate of another project has no licence.
pub fn all(root: &Path, packages: &[&str], platform: &str) -> Result<Vec<(String, String)>> {
    let mut licences = Vec::new();
    for name in ["LICENSE-MIT", "LICENSE-APACHE"] {
        let text =
            std::fs::read_to_string(root.join(name)).with_context(|| format!("reading {name}"))?;
        licences.push((name.to_owned(), text));
    }
    licences.push((
        "THIRD-PARTY.txt".into(),
        third_party(root, packages, platform)?,
    ));
    Ok(licences)
}

fn third_party(root: &Path, packages: &[&str], platform: &str) -> Result<String> {
    let linked = linked(root, packages, platform)?;
    let metadata = cargo(root, &["metadata", "--format-version", "1", "--locked"])?;
    let metadata: Value = serde_json::from_str(&metadata).context("cargo metadata")?;
    let mut text = String::from(
        "Crates that are linked into Tuff, with their licences. The Rust standard library (MIT OR Apache-2.0) is linked, too, and in\n\
         packages for old systems LLVM's libunwind (Apache-2.0 WITH LLVM-exception), in those for Windows the start-up code\n\
         of mingw-w64 (public domain and MIT) and libgcc (GPL-3.0 WITH GCC-exception-3.1).\n",
    );
    // A text that several crates share is written once.
    let mut seen = BTreeSet::new();
    let crates = metadata["packages"]
        .as_array()
        .context("cargo metadata has packages")?;
    for package in crates {
        let field = |name: &str| package[name].as_str().unwrap_or_default();
        let (name, version) = (field("name"), field("version"));
        // A package without a source belongs to the project.
        if package["source"].is_null() || !linked.contains(&format!("{name} v{version}")) {
            continue;
        }
        let licence = field("license");
        let folder = Path::new(field("manifest_path"))
            .parent()
            .context("a crate has a folder")?;
        let mut files = licence_files(folder)?;
        if files.is_empty() {
            let authors = package["authors"].as_array().into_iter().flatten();
            let authors: Vec<&str> = authors.filter_map(Value::as_str).collect();
            let text = without_file(root, licence, &authors)
                .with_context(|| format!("{name} {version} comes without its licence's text"))?;
            files.push((format!("{licence}, of which the crate has no file"), text));
        }
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

/// The text of a licence that a crate names without including a file.
fn without_file(root: &Path, licence: &str, authors: &[&str]) -> Result<String> {
    let names = |wanted: &str| licence.split([' ', '/']).any(|word| word == wanted);
    if names("Apache-2.0") {
        return Ok("LICENSE-APACHE, beside this file, has the text.\n".into());
    }
    ensure!(names("MIT"), "\"{licence}\" is neither MIT nor Apache-2.0");
    let own = std::fs::read_to_string(root.join("LICENSE-MIT")).context("reading LICENSE-MIT")?;
    let (_, terms) = (own.split_once("Permission is hereby granted"))
        .context("LICENSE-MIT has no permission")?;
    let authors: Vec<&str> = (authors.iter())
        .map(|author| author.split('<').next().unwrap_or(author).trim())
        .collect();
    let authors = authors.join(", ");
    Ok(format!(
        "Copyright (c) {authors}\n\nPermission is hereby granted{terms}"
    ))
}

/// Crates that are linked into packages on a platform, as `NAME vVERSION`.
fn linked(root: &Path, packages: &[&str], platform: &str) -> Result<BTreeSet<String>> {
    let mut arguments = vec![
        "tree", "--locked", "--edges", "normal", "--prefix", "none", "--format", "{p}", "--target",
        platform,
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

/// Files of a crate with the names of licences or notices, and their texts.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn root() -> &'static Path {
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
    }

    #[test]
    fn every_linked_crate_has_a_text() {
        let text = |platform| third_party(root(), &["icd", "tuff"], platform).unwrap();
        for (platform, own, others) in [
            ("x86_64-unknown-linux-gnu", "\nx11rb ", "\nwindows-sys "),
            ("x86_64-pc-windows-gnu", "\nwindows-sys ", "\nx11rb "),
        ] {
            let text = text(platform);
            let rule = "=".repeat(72);
            let mut sections = text.split(rule.as_str()).skip(1);
            assert!(text.contains(own) && !text.contains(others), "{text}");
            assert!(sections.all(|section| section.contains("\n--- ")));
        }
    }

    #[test]
    fn licences_without_a_file_name_their_authors() {
        let text = without_file(root(), "MIT", &["Ada <a@b>", "Bob <>"]).unwrap();
        assert!(text.starts_with("Copyright (c) Ada, Bob\n\nPermission is hereby"));
        assert!(without_file(root(), "MIT/Apache-2.0", &[]).is_ok());
        assert!(without_file(root(), "MITX", &[]).is_err());
    }
}
