//! `cargo xtask vuids`: writes docs/valid-usage.md.

use std::process::ExitCode;

use anyhow::Result;

use crate::workspace;

/// Runs the test that compares the table with the rules, in the mode that writes the table.
pub fn write() -> Result<ExitCode> {
    let mut cargo = workspace::cargo();
    cargo.args([
        "test",
        "--quiet",
        "--package",
        "icd",
        "--test",
        "valid_usage",
    ]);
    cargo.env("TUFF_WRITE_DOCS", "1");
    workspace::run(cargo)
}
