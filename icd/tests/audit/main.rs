//! The driver's tables against the registry, `vk.xml`: `cargo xtask audit`. As a test it runs where
//! a registry is installed. `cargo xtask audit --profiles` holds them against profiles, too.

mod answers;
mod checks;
mod condition;
mod layout;
mod profiles;
mod registry;
mod xml;

use std::path::{Path, PathBuf};

use ash::vk;
use registry::Registry;
use vulkan_tuff::capabilities::extensions::of_system;
use vulkan_tuff::capabilities::limits::API_VERSION;
use vulkan_tuff::format;

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

fn text_of(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn registry(path: &Path) -> Registry {
    let registry = Registry::parse(&text_of(path))
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    assert!(
        !registry.versions.is_empty() && !registry.extensions.is_empty(),
        "{} is not the Vulkan registry",
        path.display()
    );
    registry
}

/// The driver, through its tables.
struct Driver;

impl profiles::Device for Driver {
    fn version(&self) -> [u32; 3] {
        [
            vk::api_version_major(API_VERSION),
            vk::api_version_minor(API_VERSION),
            vk::api_version_patch(API_VERSION),
        ]
    }

    fn extension(&self, name: &str) -> Option<u32> {
        let mut all = of_system();
        let extension = all.find(|it| it.name().to_str() == Ok(name))?;
        Some(extension.version())
    }

    fn structure(&self, registry: &Registry, name: &str) -> Option<Vec<u8>> {
        match name {
            "VkPhysicalDeviceFeatures" => Some(answers::core_features()),
            "VkPhysicalDeviceProperties" => Some(answers::core_properties()),
            _ => answers::chained(registry.structures.get(name)?),
        }
    }

    fn format(&self, format: i32) -> [u64; 3] {
        let features = format::features(vk::Format::from_raw(format));
        let (image, buffer) = (features.image.as_raw(), features.buffer.as_raw());
        [image, image, buffer]
    }
}

/// Holds the tables against the profiles of the files that `VULKAN_PROFILES` lists, as `PATH` lists
/// folders.
#[test]
fn the_tables_have_what_profiles_ask_for() {
    let Some(list) = std::env::var_os("VULKAN_PROFILES") else {
        return;
    };
    let path = registry_path().expect("a vk.xml, to read the profiles with");
    let files: Vec<serde_json::Value> = std::env::split_paths(&list)
        .map(|path| {
            let file = serde_json::from_str(&text_of(&path));
            file.unwrap_or_else(|error| panic!("{}: {error}", path.display()))
        })
        .collect();
    let all = profiles::missing(&registry(&path), &Driver, &files);
    let all = all.unwrap_or_else(|error| panic!("profiles: {error}"));
    let mut count = 0;
    for (profile, missing) in &all {
        println!("profile: {profile}: {} missing", missing.len());
        for what in missing {
            println!("MISSING: {profile}: {what}");
        }
        count += missing.len();
    }
    assert_eq!(count, 0, "the driver lacks what profiles ask for");
}

#[test]
fn the_tables_agree_with_the_registry() {
    let Some(path) = registry_path() else {
        eprintln!("audit: no vk.xml here, nothing to hold the tables against");
        return;
    };
    let registry = registry(&path);
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
