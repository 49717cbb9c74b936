//! The times of test programs in their last run, to estimate the remaining time.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Seconds by name, kept in a file from run to run.
pub struct Times {
    file: PathBuf,
    seconds: BTreeMap<String, f64>,
}

impl Times {
    /// The contents of the file; nothing if it does not exist.
    pub fn read(file: &Path) -> Times {
        let text = std::fs::read_to_string(file).unwrap_or_default();
        let line = |line: &str| {
            let (seconds, name) = line.split_once(' ')?;
            Some((name.to_owned(), seconds.parse().ok()?))
        };
        Times {
            file: file.into(),
            seconds: text.lines().filter_map(line).collect(),
        }
    }

    /// Records a time, for this run and the next. If the file cannot be written, only the estimate
    /// is lost.
    pub fn note(&mut self, name: &str, took: Duration) {
        self.seconds.insert(name.into(), took.as_secs_f64());
        let lines = self.seconds.iter();
        let lines: String = lines
            .map(|(name, took)| format!("{took:.1} {name}\n"))
            .collect();
        let _ = std::fs::write(&self.file, lines);
    }

    /// The recorded seconds, if any.
    pub fn of(&self, name: &str) -> Option<f64> {
        self.seconds.get(name).copied()
    }

    /// An estimate of the remaining seconds for these programs, each with its number of tests, with
    /// this many at a time. So far `tests_done` tests took `seconds_done` of all programs together.
    /// Programs without a recorded time take the average for each test. `None` without any data.
    pub fn left(
        &self,
        programs: &[(&str, usize)],
        at_a_time: usize,
        (tests_done, seconds_done): (usize, f64),
    ) -> Option<f64> {
        let each = (tests_done > 0).then(|| seconds_done / tests_done as f64);
        let mut sum = 0.0;
        let mut longest = 0.0f64;
        for &(name, tests) in programs {
            let seconds = match (self.of(name), each) {
                (Some(seconds), _) => seconds,
                (None, Some(each)) => each * tests.max(1) as f64,
                (None, None) => return None,
            };
            sum += seconds;
            longest = longest.max(seconds);
        }
        Some(longest.max(sum / at_a_time as f64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_kept_and_what_is_left_follows() {
        let file = std::env::temp_dir().join(format!("tuff-times-{}", std::process::id()));
        let mut times = Times::read(&file);
        assert_eq!(times.left(&[("a", 3)], 2, (0, 0.0)), None);
        times.note("a", Duration::from_secs(4));
        times.note("of two words", Duration::from_millis(1500));
        let times = Times::read(&file);
        std::fs::remove_file(&file).unwrap();
        assert_eq!(times.of("of two words"), Some(1.5));
        // The longest program bounds the time, even if others run in parallel.
        let both = [("a", 3), ("of two words", 1)];
        assert_eq!(times.left(&both, 1, (0, 0.0)), Some(5.5));
        assert_eq!(times.left(&both, 2, (0, 0.0)), Some(4.0));
        // Ten tests took five seconds: six others take three.
        assert_eq!(times.left(&[("unknown", 6)], 2, (10, 5.0)), Some(3.0));
    }
}
