//! The application's live memory: the addresses to which physical pointers and addresses in
//! commands may lead.

use std::collections::BTreeMap;
use std::sync::Arc;

use parking_lot::Mutex;
use spirv_jit::reach::{Range, Reach};
use traversal::Live;

/// The live allocations of a device, and the address space of its sparse resources.
#[derive(Default)]
pub struct LiveMemory(Mutex<LiveRanges>);

#[derive(Default)]
struct LiveRanges {
    ranges: Vec<Range>,
    /// Parts of sparse resources without memory: start to end.
    unbound: BTreeMap<u64, u64>,
    /// Computed from the ranges on demand, and discarded when they change.
    reach: Option<(Arc<Reach>, Live)>,
}

impl LiveRanges {
    fn reach(&mut self) -> &(Arc<Reach>, Live) {
        let Self {
            ranges,
            unbound,
            reach,
        } = self;
        reach.get_or_insert_with(|| {
            let unbound = unbound.iter().map(|(&start, &end)| Range {
                start,
                size_bytes: end - start,
            });
            of_reach(Reach::new(ranges.clone()).with_unbound(unbound.collect()))
        })
    }

    /// Removes a range from the unbound ranges.
    fn cut(&mut self, start: u64, end: u64) {
        while let Some((&first, &last)) = self.unbound.range(..end).next_back()
            && last > start
        {
            self.unbound.remove(&first);
            if last > end {
                self.unbound.insert(end, last);
            }
            if first < start {
                self.unbound.insert(first, start);
            }
        }
        self.reach = None;
    }
}

/// Snapshots for shaders' pointers and for structures.
fn of_reach(reach: Reach) -> (Arc<Reach>, Live) {
    let ranges = (reach.ranges().iter()).map(|range| (range.start, range.size_bytes));
    // SAFETY: live memory is readable until it is freed, and the application frees no memory that
    // is in use. With everything live, the caller knows the memory.
    let live = unsafe { Live::new(ranges) };
    (Arc::new(reach), live)
}

impl LiveMemory {
    /// A set in which all addresses are live, for memory that belongs to no device.
    pub fn everywhere() -> Arc<Self> {
        Arc::new(Self(Mutex::new(LiveRanges {
            reach: Some(of_reach(Reach::everywhere())),
            ..LiveRanges::default()
        })))
    }

    /// Adds a range. A range may be added more than once.
    pub fn add(&self, start: u64, size_bytes: u64) {
        let mut state = self.0.lock();
        state.ranges.push(Range { start, size_bytes });
        state.reach = None;
    }

    /// Removes an added range.
    pub fn remove(&self, start: u64, size_bytes: u64) {
        let mut state = self.0.lock();
        let gone = Range { start, size_bytes };
        if let Some(index) = state.ranges.iter().position(|range| *range == gone) {
            state.ranges.swap_remove(index);
            state.reach = None;
        }
    }

    /// Marks a part of a sparse resource as bound.
    pub fn bind(&self, start: u64, size_bytes: u64) {
        self.0.lock().cut(start, start + size_bytes);
    }

    /// Marks a part of a sparse resource as unbound.
    pub fn unbind(&self, start: u64, size_bytes: u64) {
        let mut state = self.0.lock();
        state.cut(start, start + size_bytes);
        state.unbound.insert(start, start + size_bytes);
    }

    /// The current live memory.
    pub fn reach(&self) -> Arc<Reach> {
        Arc::clone(&self.0.lock().reach().0)
    }

    /// The current live memory, for references between structures.
    pub fn structures(&self) -> Live {
        self.0.lock().reach().1.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_added_twice_is_removed_twice() {
        let live = LiveMemory::default();
        live.add(0x1000, 0x1000);
        live.add(0x1000, 0x1000);
        live.remove(0x1000, 0x1000);
        assert!(live.reach().contains(0x1000, 0x1000));
        live.remove(0x1000, 0x1000);
        assert!(live.reach().find(0x1000).is_none());
    }

    #[test]
    fn parts_are_bound_and_unbound() {
        let live = LiveMemory::default();
        live.unbind(0x1000, 0x8000);
        live.bind(0x2000, 0x1000);
        live.bind(0x5000, 0x1000);
        live.unbind(0x2800, 0x3000);
        let unbound = |live: &LiveMemory| -> Vec<_> {
            let unbound = live.reach().unbound();
            let ends = |range: &Range| [range.start, range.start + range.size_bytes];
            unbound.iter().map(ends).collect()
        };
        assert_eq!(
            unbound(&live),
            [[0x1000, 0x2000], [0x2800, 0x5800], [0x6000, 0x9000]]
        );
        live.bind(0x1800, 0x7000);
        assert_eq!(unbound(&live), [[0x1000, 0x1800], [0x8800, 0x9000]]);
        live.bind(0, 0x10000);
        assert!(unbound(&live).is_empty());
    }
}
