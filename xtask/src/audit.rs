//! `cargo xtask audit`: the driver's tables against the Vulkan registry.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::workspace;

/// Where packages put the registry.
const USUAL: &str = "/usr/share/vulkan/registry/vk.xml";

#[derive(Args)]
pub struct Options {
    /// The registry, vk.xml [default: where VULKAN_SDK or the system has it]
    #[arg(long, value_name = "FILE")]
    registry: Option<PathBuf>,
}

/// Runs the test that compares them, on a registry that must be there.
pub fn audit(options: &Options) -> Result<ExitCode> {
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
    workspace::run(cargo)
}

fn installed() -> PathBuf {
    let sdk = std::env::var_os("VULKAN_SDK");
    let in_sdk = sdk.map(|sdk| PathBuf::from(sdk).join("share/vulkan/registry/vk.xml"));
    in_sdk
        .filter(|path| path.exists())
        .unwrap_or_else(|| USUAL.into())
}
