//! The driver's tables against the registry, `vk.xml`: `cargo xtask audit`. As a test it runs where
//! a registry is installed.

mod checks;
mod condition;
mod registry;

use std::path::PathBuf;

use registry::Registry;

/// Where the registry is: what `VULKAN_REGISTRY` names, or where packages and SDKs put it.
fn registry_path() -> Option<PathBuf> {
    if let Some(path) = std::env::var_os("VULKAN_REGISTRY") {
        return Some(path.into());
    }
    let sdk = std::env::var_os("VULKAN_SDK")
        .map(|sdk| PathBuf::from(sdk).join("share/vulkan/registry/vk.xml"));
    let usual = [
        "/usr/share/vulkan/registry/vk.xml",
        "/usr/local/share/vulkan/registry/vk.xml",
    ];
    sdk.into_iter()
        .chain(usual.map(PathBuf::from))
        .find(|path| path.exists())
}

#[test]
fn the_tables_agree_with_the_registry() {
    let Some(path) = registry_path() else {
        eprintln!("audit: no vk.xml here, nothing to hold the tables against");
        return;
    };
    let text = std::fs::read_to_string(&path)
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let registry =
        Registry::parse(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    assert!(
        !registry.versions.is_empty() && !registry.extensions.is_empty(),
        "{} is not the Vulkan registry",
        path.display()
    );
    let report = checks::run(&registry);
    println!(
        "audit: {} (header version {}): {}",
        path.display(),
        registry.header_version,
        report.summary
    );
    for note in &report.notes {
        println!("note: {note}");
    }
    for finding in &report.findings {
        println!("FINDING: {finding}");
    }
    assert!(
        report.findings.is_empty(),
        "{} findings:\n{}",
        report.findings.len(),
        report.findings.join("\n")
    );
}
