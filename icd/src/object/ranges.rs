//! Which ranges of a window of addresses are free.
//!
//! A range that was freed rests in a quarantine before it is used again, so that a stale reference reads zeros there for a while. The
//! quarantine is bounded: what is touched over and over costs page tables.

use std::collections::{BTreeMap, VecDeque};

use super::pages::{GRANULE, map_zero_pages};

/// Bytes that may rest. The last few ranges always do, whatever their size.
const QUARANTINE_BYTES: u64 = 1 << 30;
const QUARANTINE_LEAST: usize = 4;

/// A range that was taken.
pub struct Taken {
    pub address: u64,
    /// It was freed before.
    pub was_used: bool,
}

/// Free are all addresses from `next` to `end`, and what was freed.
pub struct Ranges {
    base: u64,
    next: u64,
    end: u64,
    /// By start; none of them touch.
    free: BTreeMap<u64, u64>,
    /// Oldest first.
    resting: VecDeque<(u64, u64)>,
    resting_bytes: u64,
    /// Mapped outside the window, to give captured addresses again: the device that captured them had another one.
    outside: Vec<(u64, u64)>,
}

impl Ranges {
    /// All of a window is free.
    pub fn new(base: u64, size_bytes: u64) -> Self {
        Self {
            base,
            next: base,
            end: base + size_bytes,
            free: BTreeMap::new(),
            resting: VecDeque::new(),
            resting_bytes: 0,
            outside: Vec::new(),
        }
    }

    /// Memory mapped outside the window.
    pub fn outside(&self) -> &[(u64, u64)] {
        &self.outside
    }

    /// Takes a range, at a certain place if it is `wanted` there.
    pub fn take(&mut self, size_bytes: u64, wanted: Option<u64>) -> Option<Taken> {
        if let Some(address) = wanted {
            return self.take_at(address, size_bytes);
        }
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

    fn take_at(&mut self, address: u64, size_bytes: u64) -> Option<Taken> {
        let last = address.checked_add(size_bytes)?;
        if !address.is_multiple_of(GRANULE) {
            return None;
        }
        if self.next <= address && last <= self.end {
            if address > self.next {
                self.add_free(self.next, address - self.next);
            }
            self.next = last;
            return Some(Taken {
                address,
                was_used: false,
            });
        }
        self.wake(0, 0);
        self.take_free_at(address, last).or_else(|| {
            if self.base < last && address < self.end {
                return None;
            }
            map_zero_pages(address, size_bytes, libc::MAP_FIXED_NOREPLACE)?;
            self.outside.push((address, size_bytes));
            Some(Taken {
                address,
                was_used: false,
            })
        })
    }

    fn take_free_at(&mut self, address: u64, last: u64) -> Option<Taken> {
        let (&start, &free) = self.free.range(..=address).next_back()?;
        let end = start + free;
        if last > end {
            return None;
        }
        self.free.remove(&start);
        if address > start {
            self.free.insert(start, address - start);
        }
        if end > last {
            self.free.insert(last, end - last);
        }
        Some(Taken {
            address,
            was_used: true,
        })
    }

    /// Frees a range.
    pub fn give_back(&mut self, address: u64, size_bytes: u64) {
        self.resting.push_back((address, size_bytes));
        self.resting_bytes += size_bytes;
        self.wake(QUARANTINE_BYTES, QUARANTINE_LEAST);
    }

    /// Ends the rest of the oldest until no more are left than so many bytes, or so few ranges.
    fn wake(&mut self, bytes: u64, ranges: usize) {
        while self.resting_bytes > bytes && self.resting.len() > ranges {
            let Some((address, size_bytes)) = self.resting.pop_front() else {
                return;
            };
            self.resting_bytes -= size_bytes;
            self.add_free(address, size_bytes);
        }
    }

    /// Adds a free range, joined with its neighbours.
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
    use super::*;

    #[test]
    fn ranges_rest_join_and_split() {
        let mut ranges = Ranges::new(GRANULE, 1 << 31);
        let take = |ranges: &mut Ranges, size| ranges.take(size, None).unwrap().address;
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
        assert!(ranges.take(GRANULE, Some(first[2])).unwrap().was_used);
        assert!(ranges.take(GRANULE, Some(first[2])).is_none());
        assert_eq!(take(&mut ranges, GRANULE), 2 * GRANULE);
    }
}
