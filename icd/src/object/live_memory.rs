//! Which addresses are memory that the application has: what physical pointers and addresses in commands may lead to.

#![forbid(unsafe_code)]

use std::sync::Arc;

use parking_lot::Mutex;
use spirv_jit::reach::{Range, Reach};

/// The live allocations of a device, and the address space of its sparse resources.
#[derive(Default)]
pub struct LiveMemory(Mutex<State>);

#[derive(Default)]
struct State {
    ranges: Vec<Range>,
    /// Made of the ranges when it is asked for; gone when they change.
    reach: Option<Arc<Reach>>,
}

impl LiveMemory {
    /// Where everything is live: for work on memory that is not a device's.
    pub fn everywhere() -> Arc<Self> {
        Arc::new(Self(Mutex::new(State {
            ranges: Vec::new(),
            reach: Some(Arc::new(Reach::everywhere())),
        })))
    }

    /// Adds a range; the same one may be added more than once.
    pub fn add(&self, start: u64, size_bytes: u64) {
        let mut state = self.0.lock();
        state.ranges.push(Range { start, size_bytes });
        state.reach = None;
    }

    /// Takes a range away that was added.
    pub fn remove(&self, start: u64, size_bytes: u64) {
        let mut state = self.0.lock();
        let gone = Range { start, size_bytes };
        if let Some(index) = state.ranges.iter().position(|range| *range == gone) {
            state.ranges.swap_remove(index);
            state.reach = None;
        }
    }

    /// What is live now.
    pub fn reach(&self) -> Arc<Reach> {
        let State { ranges, reach } = &mut *self.0.lock();
        Arc::clone(reach.get_or_insert_with(|| Arc::new(Reach::new(ranges.clone()))))
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
}
