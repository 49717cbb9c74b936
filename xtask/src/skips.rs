//! Black-box tests that were skipped because the device lacks a feature. The tests list them in a
//! file.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result};

use crate::workspace;

/// The list of one run.
pub struct Skips(PathBuf);

impl Skips {
    /// An empty list.
    pub fn new() -> Result<Skips> {
        let list = workspace::target()?.join("skipped-tests.txt");
        fs::write(&list, "").context("making the list of skipped tests")?;
        Ok(Skips(list))
    }

    /// Makes tests write to the list.
    pub fn tell(&self, tests: &mut Command) {
        tests.env("TUFF_TEST_SKIPS", &self.0);
    }

    /// Prints the entries of the list; returns their count.
    pub fn print(&self) -> Result<usize> {
        let list = fs::read_to_string(&self.0).context("reading the list of skipped tests")?;
        let mut lines: Vec<_> = list.lines().collect();
        lines.sort_unstable();
        println!("{} black-box tests did not run", lines.len());
        lines.iter().for_each(|line| println!("    {line}"));
        Ok(lines.len())
    }
}
