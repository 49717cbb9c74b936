//! Rays of one subgroup that walk together, while they wait for decisions about candidates.

use super::entry::Entry;
use super::found::Found;
use super::rows::{HitRows, Lanes, RayRows, Words, blend, lanes_of};
use super::{PACKET, Walk};
use crate::layout::LEAF_TRIANGLES;
use crate::ray::Hit;

/// Rays that are enough to copy rows instead of lanes.
const MANY: u32 = 5;

/// How far rays have come that walk together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// They do not go the same way, or meet what is not done together: nothing has happened.
    Singly,
    /// All are at their ends; their hits are in the rows.
    Done,
    /// [`SuspendedPacket::candidates`] are to be decided on.
    Candidates,
    /// From here on these go singly: [`SuspendedPacket::split`]. The others are at their ends.
    Split(u16),
}

/// Rays that wait for decisions about candidates, one each at most.
pub struct SuspendedPacket {
    /// Those that started.
    pub(crate) started: u16,
    /// Those that no decision has ended.
    pub(crate) lanes: u16,
    /// The first hit of a ray ends it.
    pub(crate) any: bool,
    pub(crate) patience: u32,
    pub(crate) found: Found,
    pub(crate) candidates: HitRows,
    /// What is to be visited yet in the top level, and in the instance.
    pub(crate) top: Ahead,
    pub(crate) bottom: Ahead,
    /// The instance they are in, and those that entered it.
    pub(crate) instance: Option<(u32, u16)>,
    pub(crate) leaf: Standing,
}

/// Children that are to be visited yet, and by which rays.
#[derive(Default)]
pub(crate) struct Ahead {
    pub entries: Vec<Entry>,
    /// As many.
    pub lanes: Vec<u16>,
}

impl Ahead {
    pub fn clear(&mut self) {
        self.entries.clear();
        self.lanes.clear();
    }

    /// Those that a ray is to visit.
    fn of(&self, lane: usize) -> impl Iterator<Item = Entry> {
        let all = self.entries.iter().zip(&self.lanes);
        all.filter_map(move |(&entry, lanes)| (lanes >> lane & 1 != 0).then_some(entry))
    }
}

/// The leaf at which rays stand.
#[derive(Clone, Copy)]
pub(crate) struct Standing {
    pub word: u32,
    /// By triangle: rays that have not been tested against it yet.
    pub rest: [u16; LEAF_TRIANGLES],
}

impl Standing {
    pub const NOWHERE: Standing = Standing {
        word: 0,
        rest: [0; LEAF_TRIANGLES],
    };
}

impl Default for SuspendedPacket {
    /// Of no rays.
    fn default() -> SuspendedPacket {
        SuspendedPacket {
            started: 0,
            lanes: 0,
            any: false,
            patience: 0,
            found: Found::NOTHING,
            candidates: HitRows::NONE,
            top: Ahead::default(),
            bottom: Ahead::default(),
            instance: None,
            leaf: Standing::NOWHERE,
        }
    }
}

impl SuspendedPacket {
    /// The candidates: `found` says which rays have one. Of a box, `t` is the lower end of the ray's interval.
    #[inline]
    pub fn candidates(&self) -> &HitRows {
        &self.candidates
    }

    /// Upper ends of the rays' intervals now.
    #[inline]
    pub fn t_max(&self) -> &[f32; PACKET] {
        &self.found.t
    }

    /// Commits candidates of rays, triangles. `hits` are the rows that the rays started with, here and below.
    pub fn accept(&mut self, lanes: u16, hits: &mut HitRows) {
        if lanes.count_ones() < MANY {
            for lane in lanes_of(lanes) {
                let hit = self.candidates.hit(lane);
                self.commit(lane, &hit, hits);
            }
            return;
        }
        hits.take(&self.candidates, lanes);
        let found = &mut self.found;
        blend(&mut found.t, &self.candidates.t, lanes);
        found.hit &= !lanes;
        found.outside |= lanes;
    }

    /// Commits hits that intersection shaders reported for rays' candidates, each in its ray's interval as it stands. Returns whether
    /// the rays are over by it.
    pub fn report_all(&mut self, lanes: u16, t: &Lanes, kinds: &Words, hits: &mut HitRows) -> bool {
        hits.take(&self.candidates, lanes);
        hits.report(lanes, t, kinds);
        let found = &mut self.found;
        blend(&mut found.t, t, lanes);
        found.hit &= !lanes;
        found.outside |= lanes;
        self.any
    }

    /// Commits a hit that an intersection shader reported for a ray's candidate, in the ray's interval as it stands. Returns
    /// whether the ray is over by it.
    pub fn report(&mut self, lane: usize, t: f32, hit_kind: u8, hits: &mut HitRows) -> bool {
        let candidate = self.candidates.hit(lane);
        let hit = Hit {
            t,
            hit_kind,
            ..candidate
        };
        self.commit(lane, &hit, hits);
        self.any
    }

    fn commit(&mut self, lane: usize, hit: &Hit, hits: &mut HitRows) {
        self.found.set_outside(lane, hit.t);
        hits.set(lane, hit);
    }

    /// Ends rays with what is committed.
    pub fn end(&mut self, lanes: u16) {
        self.lanes &= !lanes;
    }

    /// The walk of a ray that goes singly from here on. It is to be resumed.
    ///
    /// # Safety
    /// As for [`Walk::new`].
    pub unsafe fn split(&self, lane: usize, rays: &RayRows, hits: &HitRows, walk: &mut Walk) {
        // SAFETY: the caller's promise.
        unsafe { walk.restart(rays.top_level[lane], &rays.ray(lane)) };
        walk.set_time(rays.time[lane]);
        let instance =
            (self.instance.filter(|(_, lanes)| lanes >> lane & 1 != 0)).map(|(index, _)| index);
        walk.go_on_from(
            hits.get(lane),
            self.top.of(lane),
            instance,
            self.bottom.of(lane),
        );
    }
}
