//! The order in which workers take parts of work: those first that took longest the last time.
//!
//! A worker does a part alone, so work ends when its last part does. The order changes no result.

#![forbid(unsafe_code)]

use std::cmp::Reverse;

use parking_lot::Mutex;

/// Works whose times are kept: those of a frame, such as a shadow map's pass and the window's.
const WORKS: usize = 4;

/// The times of the parts of works, kept from one time to the next. `Key` tells works apart.
pub struct Costs<Key> {
    /// The newest last.
    works: Mutex<Vec<(Key, Vec<u32>)>>,
}

impl<Key> Default for Costs<Key> {
    fn default() -> Self {
        Self {
            works: Mutex::default(),
        }
    }
}

impl<Key: Copy + PartialEq> Costs<Key> {
    /// Sorts parts of a work by their last times, the longest first. Times below the same power of
    /// two count as equal, so that neighbours mostly follow each other.
    pub fn sort(&self, key: Key, parts: &mut [usize]) {
        let works = self.works.lock();
        if let Some((_, times)) = works.iter().find(|(other, _)| *other == key) {
            let bits = |part: usize| (times.get(part)).map_or(0, |time| 32 - time.leading_zeros());
            parts.sort_by_key(|&part| Reverse(bits(part)));
        }
    }

    /// Keeps times of a work of `count` parts: pairs of a part's index and nanoseconds.
    pub fn keep(&self, key: Key, count: usize, measured: &[(usize, u32)]) {
        let mut works = self.works.lock();
        let index = match works.iter().position(|(other, _)| *other == key) {
            Some(index) => index,
            None => {
                if works.len() == WORKS {
                    works.remove(0);
                }
                works.push((key, Vec::new()));
                works.len() - 1
            }
        };
        let times = &mut works[index].1;
        times.resize(count, 0);
        for &(part, nanoseconds) in measured {
            if let Some(time) = times.get_mut(part) {
                *time = nanoseconds;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_parts_come_first() {
        let costs = Costs::default();
        let mut parts = [0, 1, 3];
        costs.sort('a', &mut parts);
        assert_eq!(parts, [0, 1, 3]);
        costs.keep('a', 4, &[(0, 10), (1, 40), (3, 20)]);
        costs.keep('b', 5, &[(0, 5), (4, 50)]);
        costs.sort('a', &mut parts);
        assert_eq!(parts, [1, 3, 0]);
        let mut parts = [0, 2, 4];
        costs.sort('b', &mut parts);
        assert_eq!(parts, [4, 0, 2]);
        // The oldest work is forgotten.
        for key in ['c', 'd', 'e'] {
            costs.keep(key, 1, &[(0, 1)]);
        }
        let mut parts = [0, 1, 3];
        costs.sort('a', &mut parts);
        assert_eq!(parts, [0, 1, 3]);
    }
}
