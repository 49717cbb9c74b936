//! Where structures may lie: the memory that is there while they are in use.
//!
//! Shaders and other threads can write into a structure at any time. So each followed address, with
//! the length of the data there, is checked against this memory.

use std::sync::Arc;

/// Addresses from `start` on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Range {
    start: u64,
    size_bytes: u64,
}

impl Range {
    pub const NONE: Range = Range {
        start: 0,
        size_bytes: 0,
    };

    /// How much of the range there is from an address on; 0 for addresses that are not in it.
    #[inline(always)]
    pub fn bytes_from(self, address: u64) -> u64 {
        let offset = address.wrapping_sub(self.start);
        self.size_bytes.saturating_sub(offset)
    }
}

/// Memory that structures, their references and micromaps may lie in.
#[derive(Clone, Debug)]
pub struct Live {
    /// The range that most addresses are in.
    likely: Range,
    /// All ranges, in ascending order and disjoint; `None` if there is one.
    ranges: Option<Arc<[Range]>>,
}

/// All addresses that a process can have, except the lowest, which it never has.
///
/// To follow addresses there, the caller must know that each leads to a structure of ours or is 0.
pub static EVERYWHERE: Live = Live::EVERYWHERE;

impl Live {
    pub(crate) const EVERYWHERE: Live = Live {
        likely: Range {
            start: 1 << 16,
            size_bytes: (1 << 47) - (1 << 16),
        },
        ranges: None,
    };

    /// Ranges, each with its first address and its length, in ascending order and disjoint. Those
    /// that touch should be one: nothing that lies across the border of two is found.
    ///
    /// # Safety
    /// All of it is readable as long as a structure is looked for there, or one that was found is
    /// in use.
    pub unsafe fn new(ranges: impl IntoIterator<Item = (u64, u64)>) -> Live {
        let ranges: Arc<[Range]> = (ranges.into_iter())
            .map(|(start, size_bytes)| Range { start, size_bytes })
            .collect();
        Live {
            likely: ranges.first().copied().unwrap_or(Range::NONE),
            ranges: (ranges.len() > 1).then_some(ranges),
        }
    }

    /// Whether this is the same memory as another, not only equal to it.
    pub(crate) fn is(&self, other: &Live) -> bool {
        let same = match (&self.ranges, &other.ranges) {
            (Some(ours), Some(theirs)) => Arc::ptr_eq(ours, theirs),
            (None, None) => true,
            _ => false,
        };
        same && self.likely == other.likely
    }

    /// The range that an address is in; an empty one if it leads nowhere.
    #[inline(always)]
    pub(crate) fn range_of(&self, address: u64) -> Range {
        match self.likely.bytes_from(address) {
            0 => self.search(address),
            _ => self.likely,
        }
    }

    #[inline(never)]
    fn search(&self, address: u64) -> Range {
        let ranges = self.ranges.as_deref().unwrap_or(&[]);
        let after = ranges.partition_point(|range| range.start <= address);
        (ranges[..after].last()).map_or(Range::NONE, |range| match range.bytes_from(address) {
            0 => Range::NONE,
            _ => *range,
        })
    }

    /// How many of the bytes at an address there are.
    #[inline(always)]
    pub(crate) fn bytes_from(&self, address: u64) -> u64 {
        self.range_of(address).bytes_from(address)
    }

    /// Whether all of the bytes at an address are there.
    pub fn contains(&self, address: u64, size_bytes: u64) -> bool {
        self.bytes_from(address) >= size_bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_found() {
        // SAFETY: nothing is read.
        let live = unsafe { Live::new([(0x1000, 0x1000), (0x4000, 0x800), (0x9000, 0x10)]) };
        for (address, bytes) in [
            (0, 0),
            (0xFFF, 0),
            (0x1000, 0x1000),
            (0x1FFF, 1),
            (0x2000, 0),
            (0x4400, 0x400),
            (0x4800, 0),
            (0x9008, 8),
            (0x9010, 0),
            (u64::MAX, 0),
        ] {
            assert_eq!(live.bytes_from(address), bytes, "{address:#x}");
            assert!(live.contains(address, bytes) && !live.contains(address, bytes + 1));
        }
        // SAFETY: nothing is read.
        let none = unsafe { Live::new([]) };
        assert_eq!(none.bytes_from(0), 0);
        assert!(EVERYWHERE.contains(0x7FFF_0000_0000, 64));
        assert!(!EVERYWHERE.contains(0, 1) && !EVERYWHERE.contains(u64::MAX, 1));
    }

    #[test]
    fn the_same_memory_is_known_again() {
        // SAFETY: nothing is read.
        let make = || unsafe { Live::new([(0x1000, 0x1000), (0x4000, 0x800)]) };
        let live = make();
        assert!(live.is(&live.clone()) && !live.is(&make()) && !live.is(&EVERYWHERE));
        assert!(EVERYWHERE.is(&Live::EVERYWHERE));
    }
}
