//! Which addresses are memory that the application has: what physical pointers and addresses in
//! commands may lead to.

use std::sync::Arc;

use parking_lot::Mutex;
use spirv_jit::reach::{Range, Reach};
use traversal::Live;

/// The live allocations of a device, and the address space of its sparse resources.
#[derive(Default)]
pub struct LiveMemory(Mutex<State>);

#[derive(Default)]
struct State {
    ranges: Vec<Range>,
    /// Made of the ranges when they are asked for; gone when those change.
    reach: Option<(Arc<Reach>, Live)>,
}

impl State {
    fn reach(&mut self) -> &(Arc<Reach>, Live) {
        let Self { ranges, reach } = self;
        reach.get_or_insert_with(|| of_reach(Reach::new(ranges.clone())))
    }
}

/// The same for shaders' pointers and for structures.
fn of_reach(reach: Reach) -> (Arc<Reach>, Live) {
    let ranges = (reach.ranges().iter()).map(|range| (range.start, range.size_bytes));
    // SAFETY: what is live is readable until it is freed, and the application frees nothing that is
    // in use. Of what is live everywhere the caller knows what lies there.
    let live = unsafe { Live::new(ranges) };
    (Arc::new(reach), live)
}

impl LiveMemory {
    /// Where everything is live: for work on memory that is not a device's.
    pub fn everywhere() -> Arc<Self> {
        Arc::new(Self(Mutex::new(State {
            ranges: Vec::new(),
            reach: Some(of_reach(Reach::everywhere())),
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

    /// The current live memory.
    pub fn reach(&self) -> Arc<Reach> {
        Arc::clone(&self.0.lock().reach().0)
    }

    /// The same, for what structures refer to.
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
}
