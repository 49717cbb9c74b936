//! `cargo xtask install`: puts the driver and its manifest where the Vulkan loader looks.

use std::fs;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::Args;

use crate::driver::{self, Driver};

#[derive(Args)]
pub struct Options {
    /// Where to install [default: ~/.local, which the loader searches for this user]
    #[arg(long, value_name = "DIR")]
    prefix: Option<PathBuf>,
}

pub fn install(options: &Options) -> Result<ExitCode> {
    let built = Driver::build(&[])?;
    let prefix = match &options.prefix {
        Some(prefix) => std::path::absolute(prefix).context("the prefix")?,
        None => PathBuf::from(std::env::var_os("HOME").context("HOME is not set")?).join(".local"),
    };
    let libraries = prefix.join("lib");
    let manifests = prefix.join("share/vulkan/icd.d");
    for directory in [&libraries, &manifests] {
        fs::create_dir_all(directory).with_context(|| format!("making {}", directory.display()))?;
    }
    let library = libraries.join(driver::LIBRARY);
    // A program may have the old library mapped: the new one gets its own inode.
    let incoming = library.with_extension("so.new");
    fs::copy(&built.library, &incoming)
        .and_then(|_| fs::rename(&incoming, &library))
        .with_context(|| format!("writing {}", library.display()))?;
    let manifest = manifests.join(driver::MANIFEST);
    driver::write_manifest(&manifest, &library)?;
    println!("{}\n{}", library.display(), manifest.display());
    Ok(ExitCode::SUCCESS)
}
