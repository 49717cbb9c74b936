//! Where physical pointers may lead: the memory that is there while a program runs.
#![forbid(unsafe_code)]

use std::sync::{Arc, Mutex};

/// Addresses from `start` on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Range {
    pub start: u64,
    pub size_bytes: u64,
}

impl Range {
    /// How much of the range there is from an address on; 0 for addresses that are not in it.
    #[inline(always)]
    pub fn bytes_from(self, address: u64) -> u64 {
        let offset = address.wrapping_sub(self.start);
        self.size_bytes.saturating_sub(offset)
    }
}

/// Ranges in ascending order, none of which touch.
#[derive(Clone, Debug, Default)]
pub struct Reach {
    ranges: Vec<Range>,
    /// Parts of sparse resources without memory, in ascending order.
    unbound: Arc<[Range]>,
}

impl Reach {
    /// Of ranges in any order, which may overlap.
    pub fn new(mut ranges: Vec<Range>) -> Self {
        ranges.sort_unstable();
        ranges.dedup_by(|later, earlier| {
            let end = earlier.start + earlier.size_bytes;
            let joins = later.start <= end;
            if joins {
                let last = end.max(later.start + later.size_bytes);
                earlier.size_bytes = last - earlier.start;
            }
            joins
        });
        Self {
            ranges,
            unbound: Arc::default(),
        }
    }

    /// With parts of sparse resources that have no memory, in ascending order; they do not overlap.
    pub fn with_unbound(self, unbound: Arc<[Range]>) -> Self {
        Self { unbound, ..self }
    }

    /// The parts of sparse resources without memory.
    pub fn unbound(&self) -> Arc<[Range]> {
        Arc::clone(&self.unbound)
    }

    /// Whether no part of these bytes belongs to a sparse resource and has no memory.
    pub fn is_bound(&self, address: u64, size_bytes: u64) -> bool {
        let end = address.saturating_add(size_bytes);
        let after = self.unbound.partition_point(|range| range.start < end);
        let last = self.unbound[..after].last();
        last.is_none_or(|range| range.start + range.size_bytes <= address)
    }

    /// All memory that a process can have mapped, except the lowest addresses, which never are: for
    /// memory that does not belong to the device.
    pub fn everywhere() -> Self {
        const LOWEST: u64 = 1 << 16;
        Self::new(vec![Range {
            start: LOWEST,
            size_bytes: (1 << 47) - LOWEST,
        }])
    }

    /// All ranges, in ascending order.
    pub fn ranges(&self) -> &[Range] {
        &self.ranges
    }

    /// A range that pointers are likely to lead to.
    pub fn likely(&self) -> Range {
        self.ranges.first().copied().unwrap_or_default()
    }

    /// The range that an address is in.
    pub fn find(&self, address: u64) -> Option<Range> {
        let after = self.ranges.partition_point(|range| range.start <= address);
        let range = self.ranges[..after].last()?;
        (range.bytes_from(address) > 0).then_some(*range)
    }

    /// How many of the bytes at an address there are.
    pub fn clip(&self, address: u64, size_bytes: u64) -> u64 {
        self.find(address)
            .map_or(0, |range| range.bytes_from(address).min(size_bytes))
    }

    /// Whether all of the bytes at an address are there.
    pub fn contains(&self, address: u64, size_bytes: u64) -> bool {
        self.clip(address, size_bytes) == size_bytes
    }
}

/// An instruction that followed a pointer to nowhere, or one less aligned than it said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stray {
    /// The program, by its number.
    pub program: u64,
    /// The instruction, by a number of the program's own.
    pub site: usize,
    /// The first pointer.
    pub address: u64,
    /// The alignment that the address lacks; 0 if it leads nowhere.
    pub alignment: u64,
    pub count: u64,
}

/// Accesses that went wrong, by instruction.
#[derive(Debug, Default)]
pub struct Strays(Mutex<Vec<Stray>>);

impl Strays {
    /// Counts one; `alignment` as a [`Stray`] has it.
    pub fn count(&self, program: u64, site: usize, address: u64, alignment: u64) {
        let mut strays = self
            .0
            .lock()
            .unwrap_or_else(|poisoned| poisoned.into_inner());
        match strays
            .iter_mut()
            .find(|it| (it.program, it.site, it.alignment) == (program, site, alignment))
        {
            Some(stray) => stray.count += 1,
            None => strays.push(Stray {
                program,
                site,
                address,
                alignment,
                count: 1,
            }),
        }
    }

    /// Takes the counts so far and resets them.
    pub fn take(&self) -> Vec<Stray> {
        std::mem::take(
            &mut *self
                .0
                .lock()
                .unwrap_or_else(|poisoned| poisoned.into_inner()),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range(start: u64, size_bytes: u64) -> Range {
        Range { start, size_bytes }
    }

    #[test]
    fn ranges_that_touch_are_one() {
        let reach = Reach::new(vec![
            range(0x3000, 0x1000),
            range(0x1000, 0x1000),
            range(0x2000, 0x800),
            range(0x2400, 0xC00),
            range(0x9000, 0x10),
        ]);
        assert_eq!(reach.find(0x1000), Some(range(0x1000, 0x3000)));
        assert_eq!(reach.find(0x3FFF), Some(range(0x1000, 0x3000)));
        assert_eq!(reach.find(0x4000), None);
        assert_eq!(reach.find(0xFFF), None);
        assert_eq!(reach.clip(0x3F00, 0x200), 0x100);
        assert_eq!(reach.clip(0x9000, 8), 8);
        assert!(reach.contains(0x9008, 8) && !reach.contains(0x9009, 8));
        assert_eq!(Reach::default().find(0), None);
        assert_eq!(Reach::everywhere().find(0), None);
        assert!(Reach::everywhere().contains(0x7FFF_0000_0000, 64));
        assert_eq!(Reach::everywhere().clip(u64::MAX, 1), 0);
    }

    #[test]
    fn bytes_are_bound_outside_of_the_unbound_ranges() {
        let unbound = [range(0x1000, 0x1000), range(0x3000, 0x1000)];
        let reach = Reach::everywhere().with_unbound(unbound.into());
        assert!(reach.is_bound(0xFF0, 16) && !reach.is_bound(0xFF8, 16));
        assert!(!reach.is_bound(0x1000, 4) && !reach.is_bound(0x1FFF, 1));
        assert!(reach.is_bound(0x2000, 0x1000) && !reach.is_bound(0x2000, 0x1001));
        assert!(reach.is_bound(0x4000, 8) && Reach::default().is_bound(0, 8));
    }

    #[test]
    fn strays_are_counted_by_site() {
        let strays = Strays::default();
        strays.count(1, 5, 0xAA, 0);
        strays.count(1, 6, 0xBB, 0);
        strays.count(1, 5, 0xCC, 0);
        strays.count(1, 5, 0xAA, 4);
        let taken = strays.take();
        assert_eq!(taken.len(), 3);
        assert_eq!((taken[0].address, taken[0].count), (0xAA, 2));
        assert!(strays.take().is_empty());
    }
}
