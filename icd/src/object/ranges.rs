//! The free ranges of an address window.
//!
//! A freed range stays in quarantine before it is reused, so that a stale reference reads zeros for
//! a while. The quarantine is bounded, because repeatedly touching new addresses costs page tables.

use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;

/// Largest size of the quarantine. The last few ranges always stay in it, regardless of their size.
const QUARANTINE_BYTES: u64 = 1 << 30;
const QUARANTINE_LEAST: usize = 4;

/// A taken range.
#[derive(Debug)]
pub struct Taken {
    pub address: u64,
    /// The range was used and freed before.
    pub was_used: bool,
}

/// The addresses from `next` to `end` are free, and so are the freed ranges.
#[derive(Default)]
pub struct Ranges {
    base: u64,
    next: u64,
    end: u64,
    /// Free ranges by start; no two are adjacent.
    free: BTreeMap<u64, u64>,
    /// Oldest first.
    resting: VecDeque<(u64, u64)>,
    resting_bytes: u64,
}

impl Ranges {
    /// Creates a window that is all free.
    pub fn new(base: u64, size_bytes: u64) -> Self {
        Self {
            base,
            next: base,
            end: base + size_bytes,
            ..Self::default()
        }
    }

    /// Whether the window overlaps a range.
    pub fn overlaps(&self, addresses: &Range<u64>) -> bool {
        self.base < addresses.end && addresses.start < self.end
    }

    /// Takes a range.
    pub fn take(&mut self, size_bytes: u64) -> Option<Taken> {
        self.take_free(size_bytes).or_else(|| {
            if self.end - self.next >= size_bytes {
                let address = self.next;
                self.next += size_bytes;
                return Some(Taken {
                    address,
                    was_used: false,
                });
            }
            self.wake(0, 0);
            self.take_free(size_bytes)
        })
    }

    /// Takes the first free range that is long enough.
    fn take_free(&mut self, size_bytes: u64) -> Option<Taken> {
        let (&address, &free) = self.free.iter().find(|&(_, &free)| free >= size_bytes)?;
        self.free.remove(&address);
        if free > size_bytes {
            self.free.insert(address + size_bytes, free - size_bytes);
        }
        Some(Taken {
            address,
            was_used: true,
        })
    }

    /// Takes a given range, from fresh or from freed addresses.
    pub fn take_at(&mut self, addresses: &Range<u64>) -> Option<Taken> {
        let is_fresh = self.next <= addresses.start && addresses.end <= self.end;
        if self.next < addresses.end && addresses.end <= self.end {
            self.add_free(self.next, addresses.end - self.next);
            self.next = addresses.end;
        }
        if !self.take_free_at(addresses) {
            self.wake(0, 0);
            if !self.take_free_at(addresses) {
                return None;
            }
        }
        Some(Taken {
            address: addresses.start,
            was_used: !is_fresh,
        })
    }

    /// Takes a given range, if it is free.
    fn take_free_at(&mut self, addresses: &Range<u64>) -> bool {
        let before = self.free.range(..=addresses.start).next_back();
        let Some((start, end)) = before.map(|(&start, &free)| (start, start + free)) else {
            return false;
        };
        if addresses.end > end {
            return false;
        }
        self.free.remove(&start);
        if addresses.start > start {
            self.free.insert(start, addresses.start - start);
        }
        if end > addresses.end {
            self.free.insert(addresses.end, end - addresses.end);
        }
        true
    }

    /// Frees a range, which may be outside the window.
    pub fn give_back(&mut self, address: u64, size_bytes: u64) {
        self.resting.push_back((address, size_bytes));
        self.resting_bytes += size_bytes;
        self.wake(QUARANTINE_BYTES, QUARANTINE_LEAST);
    }

    /// Releases the oldest ranges from quarantine until it holds at most this many bytes, or only
    /// the last few ranges.
    fn wake(&mut self, bytes: u64, ranges: usize) {
        while self.resting_bytes > bytes && self.resting.len() > ranges {
            let Some((address, size_bytes)) = self.resting.pop_front() else {
                return;
            };
            self.resting_bytes -= size_bytes;
            self.add_free(address, size_bytes);
        }
    }

    /// Adds a free range and merges it with its neighbors.
    fn add_free(&mut self, mut address: u64, mut size_bytes: u64) {
        if let Some((&start, &before)) = self.free.range(..address).next_back()
            && start + before == address
        {
            self.free.remove(&start);
            (address, size_bytes) = (start, before + size_bytes);
        }
        if let Some(after) = self.free.remove(&(address + size_bytes)) {
            size_bytes += after;
        }
        self.free.insert(address, size_bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::super::address_space::GRANULE;
    use super::*;

    #[test]
    fn ranges_rest_join_and_split() {
        let mut ranges = Ranges::new(GRANULE, 1 << 31);
        let take = |ranges: &mut Ranges, size| ranges.take(size).unwrap().address;
        let half = QUARANTINE_BYTES / 2;
        let first: Vec<u64> = (0..4).map(|_| take(&mut ranges, half / 2)).collect();
        for &address in &first {
            ranges.give_back(address, half / 2);
        }
        // All of them rest: fresh addresses.
        assert_eq!(take(&mut ranges, GRANULE), GRANULE + 2 * half);
        ranges.give_back(GRANULE + 2 * half, GRANULE);
        // One came back, the first.
        assert_eq!(take(&mut ranges, GRANULE), GRANULE);
        assert_eq!(take(&mut ranges, half / 2), GRANULE + 2 * half + GRANULE);
        // A certain one is given though it rests.
        let third = first[2]..first[2] + GRANULE;
        assert!(ranges.take_at(&third).unwrap().was_used);
        assert!(ranges.take_at(&third).is_none());
        assert_eq!(take(&mut ranges, GRANULE), 2 * GRANULE);
    }
    #[test]
    fn certain_ranges_are_had_in_any_order() {
        let mut ranges = Ranges::new(0, 100 * GRANULE);
        let part = |from: u64, to: u64| from * GRANULE..to * GRANULE;
        // The first two granules were used for something else before.
        let other = ranges.take(2 * GRANULE).unwrap().address;
        assert!(ranges.take_at(&part(1, 5)).is_none());
        ranges.give_back(other, 2 * GRANULE);
        for (from, to) in [(20, 30), (1, 5), (30, 31), (0, 1), (5, 20), (99, 100)] {
            let taken = ranges.take_at(&part(from, to)).expect("it is free");
            assert_eq!(taken.address, from * GRANULE);
            for (from, to) in [(from, to), (from, from + 1), (to - 1, to)] {
                assert!(ranges.take_at(&part(from, to)).is_none());
            }
        }
        assert!(ranges.take_at(&part(99, 101)).is_none());
        assert_eq!(ranges.take(GRANULE).unwrap().address, 31 * GRANULE);
    }
}
