//! Measurements in processes of their own: this program, started once more.

use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use serde::de::DeserializeOwned;

/// The command that runs this program with one driver, with a limit of its threads if there is one.
pub fn child(icd: &Path, threads: Option<u32>) -> Result<Command> {
    let icd = std::path::absolute(icd)?;
    ensure!(icd.exists(), "there is no such manifest");
    let mut child = Command::new(std::env::current_exe()?);
    child
        .env("VK_DRIVER_FILES", &icd)
        .env("VK_ICD_FILENAMES", &icd)
        .env_remove("VK_ADD_DRIVER_FILES")
        // A cold pipeline must not come from a cache on disk.
        .env("MESA_SHADER_CACHE_DISABLE", "true")
        .stderr(Stdio::inherit());
    if let Some(threads) = threads {
        child.env("TUFF_THREADS", threads.to_string());
        child.env("LP_NUM_THREADS", threads.to_string());
    }
    Ok(child)
}

/// Runs a child. Returns its measurement: the first line of its output, in JSON.
pub fn answer<T: DeserializeOwned>(mut child: Command) -> Result<T> {
    let output = child.output().context("starting a measurement")?;
    ensure!(
        output.status.success(),
        "the measurement ended with {}",
        output.status
    );
    let line = output
        .stdout
        .split(|&byte| byte == b'\n')
        .next()
        .unwrap_or_default();
    serde_json::from_slice(line).context("the measurement's answer")
}
