//! `cargo xtask audit`: the driver's tables against the Vulkan registry, and the house style of
//! comments and pages.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::{prose, workspace};

/// The registry's path in packages.
const USUAL: &str = "/usr/share/vulkan/registry/vk.xml";

#[derive(Args)]
pub struct Options {
    /// The registry, vk.xml [default: where VULKAN_SDK or the system has it]
    #[arg(long, value_name = "FILE")]
    registry: Option<PathBuf>,
    /// Files of profiles, as Vulkan-Profiles publishes them: lists the missing capabilities for
    /// each
    #[arg(long, value_name = "FILES", num_args = 1..)]
    profiles: Vec<PathBuf>,
}

/// Checks the style, then runs the tests that compare the tables with a registry, which must exist,
/// and with profiles.
pub fn audit(options: &Options) -> Result<ExitCode> {
    let findings = prose::findings()?;
    ensure!(
        findings.is_empty(),
        "comments and pages against the house style:\n{}",
        findings.join("\n")
    );
    let registry = match &options.registry {
        Some(path) => std::path::absolute(path).context("the registry's path")?,
        None => installed(),
    };
    ensure!(
        registry.exists(),
        "there is no {}: install the registry (package libvulkan-dev) or name a vk.xml with --registry",
        registry.display()
    );
    let mut cargo = workspace::cargo();
    cargo.args(["test", "--quiet", "--package", "icd", "--test", "audit"]);
    cargo.args(["--", "--nocapture"]);
    cargo.env("VULKAN_REGISTRY", registry);
    if !options.profiles.is_empty() {
        let mut files = Vec::new();
        for path in &options.profiles {
            ensure!(path.is_file(), "there is no {}", path.display());
            files.push(std::path::absolute(path).context("a file of profiles")?);
        }
        let list = std::env::join_paths(files).context("the files of profiles")?;
        cargo.env("VULKAN_PROFILES", list);
    }
    workspace::run(cargo)
}

fn installed() -> PathBuf {
    let sdk = std::env::var_os("VULKAN_SDK");
    let in_sdk = sdk.map(|sdk| PathBuf::from(sdk).join("share/vulkan/registry/vk.xml"));
    in_sdk
        .filter(|path| path.exists())
        .unwrap_or_else(|| USUAL.into())
}
