//! Rays of one group, while they wait for decisions about candidates: as a packet, or one by one.

use lanes::LaneMask;

use super::entry::Entry;
use super::found::Found;
use super::rows::{HitRows, Lanes, RayRows, Words, blend};
use super::slabs::{Common, Slabs};
use super::{Event, PACKET, Verdict, Walk, WalkState};
use crate::layout::LEAF_TRIANGLES;
use crate::ray::Hit;

/// Rays that are enough to copy rows instead of lanes.
const MANY: u32 = 5;

/// How far rays have come that walk together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Progress {
    /// The rays diverge, or reach a node that packets do not support: the walk has not started.
    Singly,
    /// These go one way, the others go others: the walk has not started.
    Apart(LaneMask),
    /// All are at their ends; their hits are in the rows.
    Done,
    /// [`Suspended::candidates`] are to be decided on.
    Candidates,
    /// From here on these go one by one: [`Suspended::split_all`]. The others are at their ends.
    Split(LaneMask),
}

impl Progress {
    /// The progress of rays of which these go the same way.
    pub(crate) fn apart(alike: LaneMask) -> Progress {
        match alike {
            LaneMask::NONE => Progress::Singly,
            alike => Progress::Apart(alike),
        }
    }
}

/// Rays that wait for decisions about candidates, one each at most.
pub(crate) struct Suspended {
    /// Those that started.
    pub(crate) started: LaneMask,
    /// Those that no decision has ended.
    pub(crate) lanes: LaneMask,
    /// The first hit of a ray ends it.
    pub(crate) any: bool,
    pub(crate) patience: u32,
    pub(crate) found: Found,
    pub(crate) candidates: HitRows,
    /// Pending entries of the top level and of the instance.
    pub(crate) top: Ahead,
    pub(crate) bottom: Ahead,
    /// The instance they are in, and those that entered it.
    pub(crate) instance: Option<(u32, LaneMask)>,
    pub(crate) leaf: SuspendedLeaf,
    /// Rays that decisions have ended since they wait.
    pub(crate) ended: LaneMask,
    /// They go one by one: of what is above, only candidates and ends of intervals are theirs.
    pub(crate) is_single: bool,
    /// By lane, where they go one by one.
    walks: Vec<Walk>,
    /// Of those, the ones whose candidates, triangles, are accepted.
    accepted: LaneMask,
    /// Of those, the ones that only lack fuel.
    out_of_fuel: LaneMask,
    /// Of those, the ones that stay where they are when the others go on.
    held: LaneMask,
    /// Those of them that may have committed hits that are not in the rows yet.
    stale: LaneMask,
    /// Of those, the ones that are set up for boxes.
    pub(crate) slabs: Slabs,
}

/// Rays that waited, and the decisions about them.
#[derive(Clone, Copy)]
pub(crate) struct Decided {
    pub lanes: LaneMask,
    pub accepted: LaneMask,
    pub ended: LaneMask,
}

impl Decided {
    /// Rays that are on their way, about which there is no decision.
    pub fn going_on(lanes: LaneMask) -> Decided {
        Decided {
            lanes,
            accepted: LaneMask::NONE,
            ended: LaneMask::NONE,
        }
    }

    /// The decision about a ray.
    #[inline(always)]
    pub fn verdict(&self, lane: usize) -> Verdict {
        match (self.accepted.contains(lane), self.ended.contains(lane)) {
            (false, false) => Verdict::Continue,
            (false, true) => Verdict::Terminate,
            (true, false) => Verdict::Accept,
            (true, true) => Verdict::AcceptAndTerminate,
        }
    }
}

/// Children that are to be visited yet, and by which rays.
#[derive(Default)]
pub(crate) struct Ahead {
    pub entries: Vec<Entry>,
    /// As many.
    pub lanes: Vec<LaneMask>,
}

impl Ahead {
    pub fn clear(&mut self) {
        self.entries.clear();
        self.lanes.clear();
    }

    /// Whether there are some for any of these rays.
    fn is_for(&self, lanes: LaneMask) -> bool {
        self.lanes.iter().any(|&all| !(all & lanes).is_empty())
    }

    /// Those that a ray is to visit.
    fn of(&self, lane: usize) -> impl Iterator<Item = Entry> {
        let all = self.entries.iter().zip(&self.lanes);
        all.filter_map(move |(&entry, lanes)| lanes.contains(lane).then_some(entry))
    }
}

/// The leaf at which rays stand.
#[derive(Clone, Copy)]
pub(crate) struct SuspendedLeaf {
    pub word: u32,
    /// By triangle: rays that have not been tested against it yet.
    pub rest: [LaneMask; LEAF_TRIANGLES],
}

impl SuspendedLeaf {
    pub const EMPTY: SuspendedLeaf = SuspendedLeaf {
        word: 0,
        rest: [LaneMask::NONE; LEAF_TRIANGLES],
    };

    /// Whether rays of `live` still have triangles to look at.
    #[inline(always)]
    pub fn has_rest(&self, live: LaneMask) -> bool {
        let rest = self.rest.iter().fold(LaneMask::NONE, |all, &one| all | one);
        !(rest & live).is_empty()
    }

    /// Rays have been tested against all of it.
    pub fn is_over(&self) -> bool {
        self.rest.iter().all(|lanes| lanes.is_empty())
    }
}

impl Default for Suspended {
    /// Of no rays.
    fn default() -> Suspended {
        Suspended {
            started: LaneMask::NONE,
            lanes: LaneMask::NONE,
            any: false,
            patience: 0,
            found: Found::NOTHING,
            candidates: HitRows::NONE,
            top: Ahead::default(),
            bottom: Ahead::default(),
            instance: None,
            leaf: SuspendedLeaf::EMPTY,
            ended: LaneMask::NONE,
            is_single: false,
            walks: Vec::new(),
            accepted: LaneMask::NONE,
            out_of_fuel: LaneMask::NONE,
            held: LaneMask::NONE,
            stale: LaneMask::NONE,
            slabs: Slabs::NONE,
        }
    }
}

impl Suspended {
    /// The candidates: `found` says which rays have one. Of a box, `t` is the lower end of the
    /// ray's interval.
    #[inline]
    pub(crate) fn candidates(&self) -> &HitRows {
        &self.candidates
    }

    /// Upper ends of the rays' intervals now.
    #[inline]
    pub(crate) fn t_max(&self) -> &[f32; PACKET] {
        &self.found.t
    }

    /// Commits candidates of rays, triangles. `hits` are the rows that the rays started with, here
    /// and below.
    pub(crate) fn accept(&mut self, lanes: LaneMask, hits: &mut HitRows) {
        if self.is_single {
            self.accepted |= lanes;
            return;
        }
        if lanes.count() < MANY {
            for lane in lanes {
                let hit = self.candidates.hit(lane);
                self.commit(lane, &hit, hits);
            }
            return;
        }
        hits.take(&self.candidates, lanes);
        let found = &mut self.found;
        blend(&mut found.t, &self.candidates.t, lanes);
        found.hit -= lanes;
        found.outside |= lanes;
    }

    /// Which of some rays a hit at `t` counts for: it is in the ray's interval as it stands, and no
    /// decision has ended the ray. The candidates are boxes.
    pub(crate) fn counts(&self, lanes: LaneMask, t: &Lanes) -> LaneMask {
        let (t_min, t_max) = (&self.candidates.t, &self.found.t);
        // Written so that a NaN is outside.
        let inside = LaneMask::from_fn(|lane| (t[lane] >= t_min[lane]) & (t[lane] <= t_max[lane]));
        inside & (lanes - self.ended)
    }

    /// Commits hits that intersection shaders reported for rays' candidates, each in its ray's
    /// interval as it stands. Returns which rays are over by it.
    pub(crate) fn report(
        &mut self,
        lanes: LaneMask,
        t: &Lanes,
        kinds: &Words,
        hits: &mut HitRows,
    ) -> LaneMask {
        let mut over = if self.any { lanes } else { LaneMask::NONE };
        if self.is_single {
            let ends =
                |lane: &usize| self.walks[*lane].commit_procedural(t[*lane], kinds[*lane] as u8);
            over = lanes.iter().filter(ends).collect();
            self.stale -= lanes;
        }
        if lanes.count() < MANY {
            for lane in lanes {
                let hit = Hit {
                    t: t[lane],
                    hit_kind: kinds[lane] as u8,
                    ..self.candidates.hit(lane)
                };
                self.commit(lane, &hit, hits);
            }
        } else {
            hits.take(&self.candidates, lanes);
            hits.report(lanes, t, kinds);
            let found = &mut self.found;
            blend(&mut found.t, t, lanes);
            found.hit -= lanes;
            found.outside |= lanes;
        }
        over
    }

    fn commit(&mut self, lane: usize, hit: &Hit, hits: &mut HitRows) {
        self.found.set_outside(lane, hit.t);
        hits.set(lane, hit);
    }

    /// Whether a packet is at its end after the decisions about its candidates, with all hits in
    /// the rows.
    pub(crate) fn is_at_end(&self) -> bool {
        let mut live = self.lanes - self.ended;
        if self.any {
            live -= self.found.outside;
        }
        let is_ahead = self.top.is_for(live) || self.bottom.is_for(live);
        self.found.hit.is_empty() && !is_ahead && !self.leaf.has_rest(live)
    }

    /// Ends rays with what is committed.
    pub(crate) fn end(&mut self, lanes: LaneMask) {
        self.ended |= lanes;
    }

    /// From here on rays go one by one; none is kept yet.
    pub(crate) fn start_singles(&mut self) {
        self.is_single = true;
        self.accepted = LaneMask::NONE;
        self.ended = LaneMask::NONE;
        self.out_of_fuel = LaneMask::NONE;
        self.held = LaneMask::NONE;
        self.candidates.found = LaneMask::NONE;
    }

    /// Lets rays stay when the others go on next.
    pub(crate) fn hold(&mut self, lanes: LaneMask) {
        self.held = lanes & self.candidates.found;
    }

    /// Forgets rays that wait, and what was decided about them.
    pub(crate) fn forget(&mut self, lanes: LaneMask) {
        self.candidates.found -= lanes;
        self.accepted -= lanes;
        self.ended -= lanes;
        self.out_of_fuel -= lanes;
    }

    /// Copies the commits so far of singly walked rays to their hits.
    pub(crate) fn update_hits(&mut self, hits: &mut HitRows) {
        for lane in self.candidates.found & self.stale {
            if let Some(hit) = self.walks[lane].committed() {
                hits.set(lane, hit);
            }
        }
        self.stale -= self.candidates.found;
    }

    /// Moves a ray that waits for a decision; both groups' go one by one.
    pub(crate) fn move_ray(&mut self, lane: usize, to: &mut Suspended, to_lane: usize) {
        if self.candidates.found.contains(lane) {
            self.candidates.found.remove(lane);
            to.keep(to_lane, &mut self.walks[lane], Event::AnyHitCandidate);
            to.slabs.take(&self.slabs, lane, to_lane);
        }
    }

    /// Some rays wait for decisions or for fuel.
    pub(crate) fn waits(&self) -> bool {
        !(self.candidates.found | self.out_of_fuel).is_empty()
    }

    /// Keeps a walk that stopped, by changing places with it.
    pub(crate) fn keep(&mut self, lane: usize, walk: &mut Walk, event: Event) {
        std::mem::swap(self.room(lane), walk);
        self.slabs.lanes.remove(lane);
        self.note(lane, event);
    }

    /// Room for the walk of a ray.
    pub(crate) fn room(&mut self, lane: usize) -> &mut Walk {
        if self.walks.is_empty() {
            self.walks.resize_with(PACKET, Walk::default);
        }
        &mut self.walks[lane]
    }

    /// Records the reason why the walk of a ray stopped, except its end.
    pub(crate) fn note(&mut self, lane: usize, event: Event) {
        self.stale.insert(lane);
        self.stop_in_boxes(lane, event);
    }

    /// As [`Self::note`], for a walk without a new commit since the last update of the rows of
    /// hits.
    pub(crate) fn stop_in_boxes(&mut self, lane: usize, event: Event) {
        if event == Event::OutOfFuel {
            self.out_of_fuel.insert(lane);
            return;
        }
        let walk = &self.walks[lane];
        self.candidates.set(lane, walk.candidate());
        self.found.t[lane] = walk.t_max();
    }

    /// Records that the walk of a ray is over.
    pub(crate) fn finish(&mut self, lane: usize, hits: &mut HitRows) {
        let walk = &mut self.walks[lane];
        walk.state = WalkState::Done;
        if self.stale.contains(lane)
            && let Some(hit) = walk.committed()
        {
            hits.set(lane, hit);
        }
    }

    /// Takes the stopped walks with their decisions, and marks them as running.
    pub(crate) fn decided(&mut self) -> Decided {
        let decided = Decided {
            lanes: self.candidates.found - self.held,
            accepted: self.accepted,
            ended: self.ended,
        };
        let held = self.held;
        self.start_singles();
        self.candidates.found = held;
        decided
    }

    /// A ray that only lacked fuel, which is on its way again.
    pub(crate) fn take_out_of_fuel(&mut self) -> Option<usize> {
        let lane = self.out_of_fuel.iter().next()?;
        self.out_of_fuel.remove(lane);
        Some(lane)
    }

    /// The walk of a ray, where they go one by one.
    pub(crate) fn walk(&mut self, lane: usize) -> &mut Walk {
        &mut self.walks[lane]
    }

    /// The rays that are in the same instance as the first of some lanes, and their common data.
    pub(crate) fn in_same_instance(&self, lanes: LaneMask) -> (LaneMask, Common) {
        let common = |lane: usize| {
            let walk = &self.walks[lane];
            Common::new(walk.top_level(), walk.ray(), walk.instance)
        };
        let first = common(lanes.first());
        let together = lanes.iter().filter(|&lane| common(lane) == first);
        (together.collect(), first)
    }

    /// Rays that go one by one, by rows.
    pub(crate) fn rays(&self, lanes: LaneMask) -> RayRows {
        let mut rays = RayRows::NONE;
        for lane in lanes {
            let walk = &self.walks[lane];
            rays.set(lane, walk.top_level(), walk.ray(), walk.time());
        }
        rays
    }

    /// The walk of a ray that is set up for boxes, and how.
    pub(crate) fn walk_in_boxes(&mut self, lane: usize) -> (&mut Walk, &Slabs) {
        (&mut self.walks[lane], &self.slabs)
    }

    /// Makes a packet's rays go one by one.
    ///
    /// # Safety
    /// As for [`Walk::new`].
    pub(crate) unsafe fn split_all(&mut self, lanes: LaneMask, rays: &RayRows, hits: &HitRows) {
        self.start_singles();
        let mut walk = Walk::OVER;
        for lane in lanes {
            // SAFETY: the caller keeps the contract of `Walk::new`.
            unsafe { self.split(lane, rays, hits, &mut walk) };
            self.keep(lane, &mut walk, Event::OutOfFuel);
        }
    }

    /// The walk of a ray that goes singly from here on. It is to be resumed.
    ///
    /// # Safety
    /// As for [`Walk::new`].
    unsafe fn split(&self, lane: usize, rays: &RayRows, hits: &HitRows, walk: &mut Walk) {
        // SAFETY: the caller keeps the contract of `Walk::new`.
        unsafe { walk.restart(rays.top_level[lane], &rays.ray(lane)) };
        walk.set_time(rays.time[lane]);
        let instance =
            (self.instance.filter(|(_, lanes)| lanes.contains(lane))).map(|(index, _)| index);
        walk.go_on_from(
            hits.get(lane),
            self.top.of(lane),
            instance,
            self.bottom.of(lane),
        );
    }
}
