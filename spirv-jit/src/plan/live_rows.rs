//! Allocation of state rows to live values. A value keeps its row while it lives.
#![forbid(unsafe_code)]

use std::collections::BTreeSet;

/// Rows from 0. A value takes the first free row, or the first free pair with an even first row.
#[derive(Default)]
pub(super) struct LiveRows {
    /// Free rows with taken neighbors.
    singles: BTreeSet<u32>,
    /// First rows of free pairs below the end.
    pairs: BTreeSet<u32>,
    /// The end of the last taken pair.
    end: u32,
}

impl LiveRows {
    /// Takes one or two rows.
    pub fn take(&mut self, wide: bool) -> u32 {
        if !wide && let Some(row) = self.singles.pop_first() {
            return row;
        }
        let pair = self.pairs.pop_first().unwrap_or_else(|| {
            self.end += 2;
            self.end - 2
        });
        if !wide {
            self.singles.insert(pair + 1);
        }
        pair
    }

    /// Frees one or two rows.
    pub fn release(&mut self, row: u32, wide: bool) {
        if !wide && !self.singles.remove(&(row ^ 1)) {
            self.singles.insert(row);
            return;
        }
        self.pairs.insert(row & !1);
        while self.pairs.last().is_some_and(|&pair| pair + 2 == self.end) {
            self.pairs.pop_last();
            self.end -= 2;
        }
    }

    /// The end of the last taken row.
    pub fn end(&self) -> u32 {
        self.end - u32::from(self.end > 0 && self.singles.contains(&(self.end - 1)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_taken_once_and_given_back() {
        let mut random = fastrand::Rng::with_seed(1);
        let (mut rows, mut held) = (LiveRows::default(), Vec::<(u32, bool)>::new());
        for round in 0..4000 {
            if random.usize(0..4000) > round && random.bool() {
                let wide = random.u8(..) < 80;
                held.push((rows.take(wide), wide));
            } else if !held.is_empty() {
                let (row, wide) = held.swap_remove(random.usize(0..held.len()));
                rows.release(row, wide);
            }
            let mut taken = BTreeSet::new();
            for &(row, wide) in &held {
                assert!(taken.insert(row) && (!wide || row % 2 == 0 && taken.insert(row + 1)));
            }
            assert_eq!(rows.end(), taken.last().map_or(0, |last| last + 1));
        }
    }

    #[test]
    fn the_first_free_rows_are_taken() {
        let mut rows = LiveRows::default();
        let taken = [false, true, false, true, false].map(|wide| rows.take(wide));
        assert_eq!(taken, [0, 2, 1, 4, 6]);
        rows.release(2, true);
        assert_eq!([rows.take(false), rows.take(true)], [7, 2]);
        rows.release(1, false);
        assert_eq!(rows.take(false), 1);
    }
}
