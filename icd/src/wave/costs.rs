//! Parts of work that workers take one by one: those first that took longest the last time.
//!
//! A worker does a part alone, so work ends when its last part does. The order changes no result.

#![forbid(unsafe_code)]

use std::cmp::Reverse;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use parking_lot::Mutex;
use smallvec::SmallVec;

/// Works whose times are kept: those of a frame, such as the rounds of a shadow map's pass and of
/// the window's.
const WORKS: usize = 8;

/// Parts of a work whose order follows from their times, at most.
const TIMED_PARTS: usize = 1 << 16;

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
    /// A queue for so many workers: of the given parts, or of all parts of a work of `count`.
    pub fn queue(
        &self,
        key: Key,
        count: usize,
        parts: Option<Vec<usize>>,
        workers: usize,
    ) -> Queue<'_, Key> {
        let length = parts.as_ref().map_or(count, Vec::len);
        let is_timed = length.min(workers) > 1 && count <= TIMED_PARTS;
        let mut order = match parts {
            Some(parts) => parts,
            None if is_timed => (0..count).collect(),
            None => Vec::new(),
        };
        if is_timed {
            self.sort(key, &mut order);
        }
        Queue {
            costs: is_timed.then_some(self),
            key,
            count,
            order,
            length,
            next: AtomicUsize::new(0),
        }
    }

    /// Sorts parts of a work by their last times, the longest first. Times below the same power of
    /// two count as equal, so that neighbours mostly follow each other.
    fn sort(&self, key: Key, parts: &mut [usize]) {
        let works = self.works.lock();
        if let Some((_, times)) = works.iter().find(|(other, _)| *other == key) {
            let bits = |part: usize| (times.get(part)).map_or(0, |time| 32 - time.leading_zeros());
            parts.sort_by_key(|&part| Reverse(bits(part)));
        }
    }

    /// Keeps times of a work of `count` parts: pairs of a part's index and nanoseconds.
    fn keep(&self, key: Key, count: usize, measured: &[(usize, u32)]) {
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

/// The parts of a work that are still to be done.
pub struct Queue<'a, Key> {
    /// Where there is an order to be found.
    costs: Option<&'a Costs<Key>>,
    key: Key,
    /// Parts of the work, and of the queue.
    count: usize,
    length: usize,
    /// The queue's parts; empty for all in their own order.
    order: Vec<usize>,
    next: AtomicUsize,
}

impl<Key: Copy + PartialEq> Queue<'_, Key> {
    /// Parts of the queue.
    pub fn length(&self) -> usize {
        self.length
    }

    /// Does parts until none is left. Any number of workers may do so at a time.
    ///
    /// # Errors
    /// That of a part; then the other workers take no more parts either.
    pub fn work_off<E>(&self, mut part: impl FnMut(usize) -> Result<(), E>) -> Result<(), E> {
        let mut measured: SmallVec<[(usize, u32); 64]> = SmallVec::new();
        let mut begin = self.costs.map(|_| Instant::now());
        loop {
            let index = self.next.fetch_add(1, Ordering::Relaxed);
            if index >= self.length {
                break;
            }
            let index = self.order.get(index).copied().unwrap_or(index);
            part(index).inspect_err(|_| self.next.store(self.length, Ordering::Relaxed))?;
            if let Some(begin) = &mut begin {
                let end = Instant::now();
                measured.push((index, (end - *begin).as_nanos() as u32));
                *begin = end;
            }
        }
        if let Some(costs) = self.costs {
            costs.keep(self.key, self.count, &measured);
        }
        Ok(())
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
        for key in 'c'..='i' {
            costs.keep(key, 1, &[(0, 1)]);
        }
        let mut parts = [0, 1, 3];
        costs.sort('a', &mut parts);
        assert_eq!(parts, [0, 1, 3]);
    }

    #[test]
    fn each_part_is_done_once() {
        let costs = Costs::default();
        for (parts, expected) in [(None, vec![0, 1, 2, 3, 4]), (Some(vec![4, 1]), vec![1, 4])] {
            for workers in [1, 3] {
                let queue = costs.queue('a', 5, parts.clone(), workers);
                assert_eq!(queue.length(), expected.len());
                let mut done = Vec::new();
                let work = |part| -> Result<(), ()> {
                    done.push(part);
                    Ok(())
                };
                assert_eq!(queue.work_off(work), Ok(()));
                done.sort_unstable();
                assert_eq!(done, expected);
                assert_eq!(queue.work_off(|_| Err(())), Ok(()));
            }
        }
    }

    #[test]
    fn an_error_empties_the_queue() {
        let costs = Costs::default();
        let queue = costs.queue('a', 5, None, 2);
        assert_eq!(queue.work_off(|_| Err("no")), Err("no"));
        assert_eq!(queue.work_off(|_| Err("again")), Ok(()));
    }
}
