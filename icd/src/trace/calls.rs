//! Shader calls waiting to be run, and the order that makes full subgroups of them.
#![forbid(unsafe_code)]

use super::subgroup::{LaneRef, Role};
use crate::wave::binding_table::{Group, Live, ProgramIndex, Shaders};

/// An invocation to be created.
#[derive(Clone, Copy, Debug)]
pub struct Call {
    /// Address of its shader record.
    pub record: u64,
    /// Where its launch stands in the batch: [`Grid::place`](super::grid::Grid::place).
    pub place: u32,
    /// The subject of the invocation. See [`Subgroup::of`](super::subgroup::Subgroup).
    pub of: LaneRef,
}

/// Calls by shader and role. A launch waits for one at a time, so their order by record and launch
/// is complete: who shares a subgroup does not depend on when they came.
#[derive(Default)]
pub struct Calls {
    /// Those with calls first, in the order of their first ones.
    buckets: Vec<Bucket>,
    used: usize,
    /// Bucket + 1 by program and role.
    places: Vec<u32>,
}

/// Calls of one shader in one role.
#[derive(Default)]
pub struct Bucket {
    pub program: ProgramIndex,
    pub role: Role,
    calls: Vec<Call>,
}

impl Calls {
    /// Nothing has to be called.
    pub fn is_empty(&self) -> bool {
        self.used == 0
    }

    /// Adds a call.
    #[inline]
    pub fn push(&mut self, program: ProgramIndex, role: Role, call: Call) {
        let place = program as usize * Role::COUNT + role as usize;
        let bucket = match self.places.get(place) {
            Some(&known) if known != 0 => known as usize - 1,
            _ => self.add(place, program, role),
        };
        self.buckets[bucket].calls.push(call);
    }

    #[cold]
    fn add(&mut self, place: usize, program: ProgramIndex, role: Role) -> usize {
        if self.places.len() <= place {
            self.places.resize(place + 1, 0);
        }
        if self.used == self.buckets.len() {
            self.buckets.push(Bucket::default());
        }
        let bucket = &mut self.buckets[self.used];
        (bucket.program, bucket.role) = (program, role);
        self.used += 1;
        self.places[place] = self.used as u32;
        self.used - 1
    }

    /// The buckets with calls, by role and shader: an order that follows from the batch alone.
    pub fn sorted(&mut self) -> &mut [Bucket] {
        let buckets = &mut self.buckets[..self.used];
        for bucket in &*buckets {
            self.places[bucket.program as usize * Role::COUNT + bucket.role as usize] = 0;
        }
        buckets.sort_by_key(|bucket| (bucket.role, bucket.program));
        self.used = 0;
        buckets
    }
}

impl Bucket {
    /// The calls, by record and launch.
    pub fn sorted(&mut self) -> &[Call] {
        let key = |call: &Call| (call.record, call.place);
        if !self.calls.is_sorted_by_key(key) {
            self.calls.sort_unstable_by_key(key);
        }
        &self.calls
    }

    /// Forgets the calls.
    pub fn clear(&mut self) {
        self.calls.clear();
    }
}

const REMEMBERED: usize = 64;

/// Groups behind record addresses, remembered for the length of a batch.
pub struct Records {
    /// Record address and group index + 1.
    seen: [(u64, u32); REMEMBERED],
}

impl Default for Records {
    fn default() -> Self {
        Self {
            seen: [(0, 0); REMEMBERED],
        }
    }
}

impl Records {
    /// The group and the address of a record; `None` for an unused group or an index outside the
    /// table.
    pub fn find<'a>(
        &mut self,
        shaders: &'a Shaders,
        region: &Live,
        index: u32,
    ) -> Option<(&'a Group, u64)> {
        let record = region.record(index)?;
        let slot = &mut self.seen[(record >> 5) as usize % REMEMBERED];
        if slot.0 != record {
            let (_, handle) = region.handle(index)?;
            let group = shaders.group_index(&handle).map_or(0, |index| index + 1);
            *slot = (record, group);
        }
        Some((&shaders.groups[slot.1.checked_sub(1)? as usize], record))
    }
}
