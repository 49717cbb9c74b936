//! Rays of many groups on their way: how each walks, as a packet, in a stream or by itself, is
//! decided here and known nowhere else.

use lanes::LaneMask;

use super::level::Entered;
use super::rows::{HitRows, Lanes, RayRows, Words};
use super::streaming::Caller;
use super::suspended::{Progress, Suspended};
use super::{Event, PACKET, Verdict, Walk, Walker, packet, run};
use crate::ray::Hit;

/// Groups of which rays are walked in streams: fewer are not worth it, and a stream holds no more.
const ENOUGH: usize = 4;
const MOST: usize = Walker::STREAM_RAYS / PACKET;

/// Rays of one group between their start and their ends. Where all have ended, their hits are in
/// `hits`.
#[derive(Default)]
pub struct GroupWalk {
    pub hits: HitRows,
    suspended: Option<Box<Suspended>>,
}

static NO_CANDIDATES: HitRows = HitRows::NONE;

impl GroupWalk {
    /// The candidates that are to be decided on: `found` says which rays have one, and they wait
    /// for each other. Of a box, `t` is the lower end of the ray's interval.
    #[inline]
    pub fn candidates(&self) -> &HitRows {
        (self.suspended.as_ref()).map_or(&NO_CANDIDATES, |suspended| suspended.candidates())
    }

    /// Upper ends of the rays' intervals now.
    #[inline]
    pub fn t_max(&self) -> &Lanes {
        (self.suspended.as_ref()).map_or(&self.hits.t, |suspended| suspended.t_max())
    }

    /// Commits candidates of rays, triangles. What is not accepted is ignored.
    pub fn accept(&mut self, lanes: LaneMask) {
        if let Some(suspended) = &mut self.suspended {
            suspended.accept(lanes, &mut self.hits);
        }
    }

    /// Which of some rays a hit with their candidates, boxes, counts for: it is in the ray's
    /// interval as it stands, and no decision has ended the ray.
    pub fn counts(&self, lanes: LaneMask, t: &Lanes) -> LaneMask {
        (self.suspended.as_ref()).map_or(LaneMask::NONE, |suspended| suspended.counts(lanes, t))
    }

    /// Commits hits that intersection shaders reported for rays' candidates, which count. Returns
    /// which rays are over by it, so that those shaders end at once.
    pub fn report(&mut self, lanes: LaneMask, t: &Lanes, kinds: &Words) -> LaneMask {
        let suspended = self.suspended.as_mut();
        suspended.map_or(LaneMask::NONE, |suspended| {
            suspended.report(lanes, t, kinds, &mut self.hits)
        })
    }

    /// Ends rays with what is committed.
    pub fn end(&mut self, lanes: LaneMask) {
        if let Some(suspended) = &mut self.suspended {
            suspended.end(lanes);
        }
    }

    /// Lets rays wait where the next [`Walker::resume`] goes on with the others. This and what
    /// follows is for rays whose order of candidates shows ([`Start::shows_order`]): they walk by
    /// themselves.
    pub fn hold(&mut self, lanes: LaneMask) {
        if let Some(suspended) = &mut self.suspended {
            suspended.hold(lanes);
        }
    }

    /// Forgets rays that wait.
    pub fn forget(&mut self, lanes: LaneMask) {
        if let Some(suspended) = &mut self.suspended {
            suspended.forget(lanes);
        }
    }

    /// Puts what rays that wait have committed so far into the hits.
    pub fn update_hits(&mut self) {
        if let Some(suspended) = &mut self.suspended {
            suspended.update_hits(&mut self.hits);
        }
    }

    /// Moves a ray that waits to another group, as its lane `to_lane`.
    pub fn move_ray(&mut self, lane: usize, to: &mut GroupWalk, to_lane: usize) {
        let Some(suspended) = &mut self.suspended else {
            return;
        };
        let others = to.suspended.get_or_insert_with(|| {
            let mut none = Box::<Suspended>::default();
            none.start_singles();
            none
        });
        suspended.move_ray(lane, others, to_lane);
        match self.hits.get(lane) {
            Some(hit) => to.hits.set(to_lane, &hit),
            None => to.hits.found.remove(to_lane),
        }
    }
}

/// The rays of a group.
#[derive(Clone, Copy)]
pub struct Start {
    /// Lanes with a ray.
    pub lanes: LaneMask,
    /// All rays are known to have one structure, the same flags and one mask.
    pub are_alike: bool,
    /// Which hit rays that end with their first hit find is to follow from the ray alone.
    pub shows_first_hit: bool,
    /// Which candidates rays meet, and in which order, is to follow from the ray alone.
    pub shows_order: bool,
}

/// Who has rays traced by [`Walker::trace`].
pub trait GroupWalks {
    /// Why all is over.
    type Stop;

    /// Reads the rays of a group: as it starts, and unchanged whenever it goes on.
    fn rays(&self, group: u32, rays: &mut RayRows) -> Start;

    /// The same after another group, whose rays are in `rays` and which began like this.
    fn next_rays(&self, group: u32, before: (u32, Start), rays: &mut RayRows) -> Start {
        let _ = before;
        self.rays(group, rays)
    }

    /// Where the rays of a group are kept.
    fn group_walk(&mut self, group: u32) -> &mut GroupWalk;

    /// All rays of a group have ended, or wait at [`GroupWalk::candidates`].
    ///
    /// # Errors
    /// All is over.
    fn settled(&mut self, group: u32) -> Result<(), Self::Stop>;

    /// Rays of a group have used up their fuel. They get more.
    ///
    /// # Errors
    /// All is over.
    fn out_of_fuel(&mut self, group: u32) -> Result<(), Self::Stop>;
}

/// Reads the rays of a group after those of the one before.
#[inline(always)]
fn load<F: GroupWalks>(
    group: u32,
    before: &mut Option<(u32, Start)>,
    rays: &mut RayRows,
    group_walks: &F,
) -> Start {
    let start = match *before {
        None => group_walks.rays(group, rays),
        Some(before) => group_walks.next_rays(group, before, rays),
    };
    *before = Some((group, start));
    start
}

impl Walker {
    /// Forgets all rays that are on their way; their [`GroupWalk`]s are started anew before they
    /// are used again.
    pub fn clear(&mut self) {
        self.streamed.clear();
        self.clear_streams();
    }

    /// Takes the rays of groups to their ends or to candidates that need a decision from outside.
    /// Those of `apart` are known not to go together. The hits are those of each ray alone, bit for
    /// bit, except any-hit rays, whose hit is unspecified.
    ///
    /// # Errors
    /// Those of [`GroupWalks`].
    ///
    /// # Safety
    /// As for [`Walk::new`], for every ray.
    pub unsafe fn trace<F: GroupWalks>(
        &mut self,
        groups: &[u32],
        apart: &[u32],
        group_walks: &mut F,
    ) -> Result<(), F::Stop> {
        let in_streams = groups.len() + apart.len() >= ENOUGH;
        let mut rays = RayRows::NONE;
        let mut before = None;
        let all = groups.iter().map(|group| (group, true));
        for (&group, may_cohere) in all.chain(apart.iter().map(|group| (group, false))) {
            let start = load(group, &mut before, &mut rays, group_walks);
            // SAFETY: the caller keeps the contract of `Walk::new` for every ray.
            if may_cohere && unsafe { self.start_together(group, start, &rays, group_walks)? } {
                continue;
            }
            // SAFETY: the caller keeps the contract of `Walk::new` for every ray.
            unsafe { self.start_apart(group, start, in_streams, &rays, group_walks)? };
            if self.streamed.len() >= MOST {
                // SAFETY: the caller keeps the contract of `Walk::new` for every ray.
                unsafe { self.trace_streamed(group_walks)? };
            }
        }
        // SAFETY: the caller keeps the contract of `Walk::new` for every ray.
        unsafe { self.trace_streamed(group_walks) }
    }

    /// As [`Self::trace`], for groups whose rays go together; the others are added to `apart`.
    ///
    /// # Errors
    /// Those of [`GroupWalks`].
    ///
    /// # Safety
    /// As for [`Walk::new`], for every ray.
    pub unsafe fn trace_together<F: GroupWalks>(
        &mut self,
        groups: &[u32],
        apart: &mut Vec<u32>,
        group_walks: &mut F,
    ) -> Result<(), F::Stop> {
        let mut rays = RayRows::NONE;
        let mut before = None;
        for &group in groups {
            let start = load(group, &mut before, &mut rays, group_walks);
            // SAFETY: the caller keeps the contract of `Walk::new` for every ray.
            if !unsafe { self.start_together(group, start, &rays, group_walks)? } {
                apart.push(group);
            }
        }
        Ok(())
    }

    /// Goes on with rays of groups after all their candidates were decided on, but those that are
    /// held.
    ///
    /// # Errors
    /// Those of [`GroupWalks`].
    ///
    /// # Safety
    /// As for their start.
    pub unsafe fn resume<F: GroupWalks>(
        &mut self,
        groups: &[u32],
        group_walks: &mut F,
    ) -> Result<(), F::Stop> {
        let mut rays = RayRows::NONE;
        let mut before = None;
        for &group in groups {
            let Some(mut suspended) = group_walks.group_walk(group).suspended.take() else {
                continue;
            };
            if suspended.is_single {
                self.resume_singles(group, suspended, group_walks)?;
                continue;
            }
            if suspended.is_at_end() {
                self.spare.push(suspended);
                group_walks.settled(group)?;
                continue;
            }
            // All that started, for what they have in common.
            load(group, &mut before, &mut rays, group_walks);
            let hits = &mut group_walks.group_walk(group).hits;
            // SAFETY: the caller keeps the contract of `Walk::new` for every ray.
            unsafe {
                let progress = packet::resume(&rays, hits, self, &mut suspended);
                self.settle_packet(group, progress, &rays, suspended, group_walks)?;
            }
        }
        Ok(())
    }

    /// Walks the rays of a group as a packet; false if they do not go together: then nothing has
    /// happened.
    ///
    /// # Safety
    /// As for [`Walk::new`], for every ray.
    unsafe fn start_together<F: GroupWalks>(
        &mut self,
        group: u32,
        start: Start,
        rays: &RayRows,
        group_walks: &mut F,
    ) -> Result<bool, F::Stop> {
        if !self.takes_packets() || start.shows_first_hit || start.lanes.is_empty() {
            return Ok(false);
        }
        if start.shows_order {
            let first = start.lanes.first();
            let (address, ray) = (rays.top_level[first], rays.ray(first));
            // SAFETY: the caller keeps the contract of `Walk::new` for every ray.
            if unsafe { self.enter_boxes(address, &ray) }.is_some() {
                return Ok(false);
            }
        }
        let group_walk = group_walks.group_walk(group);
        let mut suspended = self.room_in(group_walk);
        // SAFETY: the caller keeps the contract of `Walk::new` for every ray.
        let progress = unsafe {
            let keeps = (!start.shows_order).then_some(&mut *suspended);
            let lanes = (start.lanes, start.are_alike);
            packet::run(rays, lanes, &mut group_walk.hits, self, keeps)
        };
        if progress == Progress::Singly {
            self.spare.push(suspended);
            return Ok(false);
        }
        self.counts.together += 1;
        // SAFETY: the caller keeps the contract of `Walk::new` for every ray.
        unsafe { self.settle_packet(group, progress, rays, suspended, group_walks)? };
        Ok(true)
    }

    /// Walks the rays of a group one by one, or adds them to the stream.
    ///
    /// # Safety
    /// As for [`Walk::new`], for every ray.
    unsafe fn start_apart<F: GroupWalks>(
        &mut self,
        group: u32,
        start: Start,
        in_streams: bool,
        rays: &RayRows,
        group_walks: &mut F,
    ) -> Result<(), F::Stop> {
        let group_walk = group_walks.group_walk(group);
        let mut suspended = self.room_in(group_walk);
        let hits = &mut group_walk.hits;
        suspended.start_singles();
        let mut fuel = self.options.fuel;
        // SAFETY: the caller keeps the contract of `Walk::new` for every ray.
        let in_boxes =
            unsafe { self.start_in_boxes(rays, start.lanes, hits, &mut suspended, &mut fuel) };
        let lanes = start.lanes - in_boxes;
        let mut streamed = LaneMask::NONE;
        if in_streams && !lanes.is_empty() {
            // SAFETY: the caller keeps the contract of `Walk::new` for every ray.
            streamed = unsafe { self.add_to_stream(rays, lanes, hits, group) };
            self.counts.streamed += u64::from(streamed.count());
        }
        if streamed != lanes {
            let mut keep = |lane: usize, walk: &mut Walk, event| suspended.keep(lane, walk, event);
            // SAFETY: the caller keeps the contract of `Walk::new` for every ray.
            unsafe { self.trace_in_turn(rays, lanes - streamed, hits, &mut fuel, &mut keep) };
        }
        if streamed.is_empty() {
            return self.settle_singles(group, suspended, group_walks);
        }
        match suspended.waits() {
            true => group_walk.suspended = Some(suspended),
            false => self.spare.push(suspended),
        }
        self.streamed.push(group);
        Ok(())
    }

    /// Makes a group one without rays that wait.
    pub(crate) fn clear_flight(&mut self, group_walk: &mut GroupWalk) {
        self.spare.extend(group_walk.suspended.take());
    }

    /// Memory for rays of a group that wait: the group's own, if it has any left.
    fn room_in(&mut self, group_walk: &mut GroupWalk) -> Box<Suspended> {
        let left_over = group_walk.suspended.take();
        (left_over.or_else(|| self.spare.pop())).unwrap_or_default()
    }

    /// Walks the rays of the stream.
    ///
    /// # Safety
    /// As for [`Walk::new`], for every ray.
    unsafe fn trace_streamed<F: GroupWalks>(&mut self, group_walks: &mut F) -> Result<(), F::Stop> {
        if self.streamed.is_empty() {
            return Ok(());
        }
        let mut groups = std::mem::take(&mut self.streamed);
        let mut streamed = Streamed {
            group_walks: &mut *group_walks,
            spare: std::mem::take(&mut self.spare),
        };
        let mut fuel = self.options.fuel.saturating_mul(groups.len() as u64);
        // SAFETY: the caller keeps the contract of `Walk::new` for every ray.
        unsafe { self.trace_streams(&mut fuel, &mut streamed) };
        self.spare = streamed.spare;
        for &group in &groups {
            match group_walks.group_walk(group).suspended.take() {
                Some(suspended) => self.settle_singles(group, suspended, group_walks)?,
                None => group_walks.settled(group)?,
            }
        }
        groups.clear();
        self.streamed = groups;
        Ok(())
    }

    /// Does what the progress of a packet calls for.
    ///
    /// # Safety
    /// As for [`Walk::new`], for every ray.
    unsafe fn settle_packet<F: GroupWalks>(
        &mut self,
        group: u32,
        progress: Progress,
        rays: &RayRows,
        mut suspended: Box<Suspended>,
        group_walks: &mut F,
    ) -> Result<(), F::Stop> {
        match progress {
            Progress::Candidates => group_walks.group_walk(group).suspended = Some(suspended),
            Progress::Split(lanes) => {
                self.counts.split += 1;
                // SAFETY: the caller keeps the contract of `Walk::new` for every ray.
                unsafe { suspended.split_all(lanes, rays, &group_walks.group_walk(group).hits) };
                return self.settle_singles(group, suspended, group_walks);
            }
            Progress::Singly | Progress::Apart(_) | Progress::Done => self.spare.push(suspended),
        }
        group_walks.settled(group)
    }

    /// Goes on with rays that walk one by one, after decisions about them.
    fn resume_singles<F: GroupWalks>(
        &mut self,
        group: u32,
        mut suspended: Box<Suspended>,
        group_walks: &mut F,
    ) -> Result<(), F::Stop> {
        let (mut entered, mut fuel) = (Entered::NOTHING, self.options.fuel);
        let hits = &mut group_walks.group_walk(group).hits;
        let decided = suspended.decided();
        let decided = self.resume_in_boxes(decided, hits, &mut suspended, &mut fuel);
        for lane in decided.lanes {
            let verdict = decided.verdict(lane);
            self.step(lane, verdict, &mut suspended, hits, &mut entered, &mut fuel);
        }
        self.settle_singles(group, suspended, group_walks)
    }

    /// Gives more fuel to rays that walk one by one, until each waits for a decision or has ended.
    fn settle_singles<F: GroupWalks>(
        &mut self,
        group: u32,
        mut suspended: Box<Suspended>,
        group_walks: &mut F,
    ) -> Result<(), F::Stop> {
        let mut entered = Entered::NOTHING;
        while let Some(lane) = suspended.take_out_of_fuel() {
            group_walks.out_of_fuel(group)?;
            let (hits, fuel) = (&mut group_walks.group_walk(group).hits, &mut {
                self.options.fuel
            });
            let verdict = Verdict::Continue;
            self.step(lane, verdict, &mut suspended, hits, &mut entered, fuel);
        }
        match suspended.waits() {
            true => group_walks.group_walk(group).suspended = Some(suspended),
            false => self.spare.push(suspended),
        }
        group_walks.settled(group)
    }

    /// Takes a ray that walks by itself on.
    fn step(
        &mut self,
        lane: usize,
        verdict: Verdict,
        suspended: &mut Suspended,
        hits: &mut HitRows,
        entered: &mut Entered,
        fuel: &mut u64,
    ) {
        let walk = suspended.walk(lane);
        match run::run(walk, verdict, self, entered, fuel) {
            Event::Done => {
                if let Some(hit) = walk.committed() {
                    hits.set(lane, hit);
                }
            }
            event => suspended.note(lane, event),
        }
    }
}

/// GroupWalks that hear of the rays of a stream.
struct Streamed<'a, F> {
    group_walks: &'a mut F,
    spare: Vec<Box<Suspended>>,
}

impl<F: GroupWalks> Caller for Streamed<'_, F> {
    fn hit(&mut self, group: u32, lane: usize, hit: &Hit) {
        self.group_walks.group_walk(group).hits.set(lane, hit);
    }

    fn rays(&mut self, group: u32, rays: &mut RayRows) {
        self.group_walks.rays(group, rays);
    }

    fn suspend(&mut self, group: u32, lane: usize, walk: &mut Walk, event: Event) {
        let suspended = &mut self.group_walks.group_walk(group).suspended;
        let suspended = suspended.get_or_insert_with(|| {
            let mut suspended = self.spare.pop().unwrap_or_default();
            suspended.start_singles();
            suspended
        });
        suspended.keep(lane, walk, event);
    }
}
