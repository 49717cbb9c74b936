//! Black-box tests that were skipped because the device lacks a feature, or the machine an optional
//! program. The tests list them in a file.

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

    /// Prints the entries of the list. Returns the number of tests that need a feature which the
    /// device lacks.
    pub fn print(&self) -> Result<usize> {
        let list = fs::read_to_string(&self.0).context("reading the list of skipped tests")?;
        let mut lines: Vec<_> = list.lines().collect();
        lines.sort_unstable();
        println!("{} black-box tests did not run", lines.len());
        lines.iter().for_each(|line| println!("    {line}"));
        Ok(count_features(&lines))
    }
}

fn count_features(lines: &[&str]) -> usize {
    let is_feature = |line: &&&str| line.starts_with("skipped: ");
    lines.iter().filter(is_feature).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The lines are those of `tests/src/skip.rs`.
    #[test]
    fn a_missing_program_is_no_missing_feature() {
        let program = "not installed: a_replay needs GFXReconstruct";
        assert_eq!(count_features(&[program]), 0);
        assert_eq!(
            count_features(&[program, "skipped: lines needs wide lines"]),
            1
        );
    }
}
