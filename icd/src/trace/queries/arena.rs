//! The walks that wait for their shaders.
#![forbid(unsafe_code)]

use traversal::Walk;

use super::super::slab::Slab;
use crate::wave::Stopped;

/// Suspended walks that a worker may keep, at most.
const MAX_SUSPENDED: usize = 1 << 20;

/// Walks that belong together: those of a subgroup or a workgroup, which end with it.
#[derive(Default)]
pub struct Owned(Vec<u32>);

#[derive(Default)]
pub(super) struct Arena {
    suspended: Slab<Suspended>,
    count: usize,
}

#[derive(Default)]
pub(super) struct Suspended {
    pub walk: Walk,
    /// Place in its owner's list; `None` if nobody's.
    place: Option<u32>,
    lane: u8,
}

impl Owned {
    /// Starts over; what was listed has been forgotten.
    pub fn clear(&mut self) {
        self.0.clear();
    }
}

impl Arena {
    /// A lane of one owner becomes a lane of another. What is left of the first may only be moved or released.
    pub fn move_lane(&mut self, from: (&mut Owned, usize), to: (&mut Owned, usize)) {
        let (from, lane) = from;
        let mut rest = 0;
        while let Some(&index) = from.0.get(rest) {
            if self.suspended[index].lane as usize == lane {
                from.0.swap_remove(rest);
                self.give(index, to.1, to.0);
            } else {
                rest += 1;
            }
        }
    }

    /// Forgets all walks; their owners are cleared before they are used again.
    pub fn clear(&mut self) {
        self.suspended.clear();
        self.count = 0;
    }

    /// Forgets the walks that an owner has left.
    #[inline]
    pub fn release(&mut self, owned: &mut Owned) {
        for index in owned.0.drain(..) {
            self.suspended[index].place = None;
            self.suspended.remove(index);
            self.count -= 1;
        }
    }

    /// Takes a place for the walk of an owner's lane; returns its handle.
    ///
    /// # Errors
    /// There are too many.
    pub fn add(&mut self, lane: usize, owned: &mut Owned) -> Result<u32, Stopped> {
        if self.count == MAX_SUSPENDED {
            return Err(Stopped::OutOfMemory);
        }
        self.count += 1;
        let index = self.suspended.take();
        self.give(index, lane, owned);
        Ok(index + 1)
    }

    fn give(&mut self, index: u32, lane: usize, owned: &mut Owned) {
        let suspended = &mut self.suspended[index];
        suspended.place = Some(owned.0.len() as u32);
        suspended.lane = lane as u8;
        owned.0.push(index);
    }

    /// The walk behind a handle that was found to be its owner's.
    pub fn walk(&self, handle: u32) -> Option<&Walk> {
        let index = handle.checked_sub(1)?;
        Some(&self.suspended.get(index)?.walk)
    }

    /// The walk behind a handle, if it is one of this owner's.
    pub fn find(&mut self, handle: u32, owned: &Owned) -> Option<&mut Suspended> {
        let index = handle.checked_sub(1)?;
        let suspended = self.suspended.get_mut(index)?;
        let listed = owned.0.get(suspended.place? as usize) == Some(&index);
        listed.then_some(suspended)
    }

    /// Forgets the walk behind a handle, if it is one of this owner's.
    pub fn remove(&mut self, handle: u32, owned: &mut Owned) {
        let Some(place) = self.find(handle, owned).and_then(|s| s.place.take()) else {
            return;
        };
        owned.0.swap_remove(place as usize);
        if let Some(&moved) = owned.0.get(place as usize) {
            self.suspended[moved].place = Some(place);
        }
        self.suspended.remove(handle - 1);
        self.count -= 1;
    }
}
