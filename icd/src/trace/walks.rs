//! Advancing the walks of a batch's rays, and what their events call.

use smallvec::SmallVec;
use traversal::{Event, PACKET, Progress, Verdict, Walk, Walker};

use super::batch::{Batch, FUEL, Worker};
use super::rays::{hit_record_index, record_indices, skips_closest_hit};
use super::subgroup::{LaneRef, Role, lanes_of};
use crate::validate::Need;
use crate::wave::Stopped;
use crate::wave::table::ProgramIndex;

/// Groups of which rays are walked together: fewer are not worth it, and a walker takes up no more.
const ENOUGH: usize = 4;
const MOST: usize = Walker::MOST_ENLISTED / PACKET;

/// What becomes of a walk after an event.
enum Next {
    /// It goes on at once.
    Resume(Verdict),
    /// A shader decides.
    Wait,
    Over,
}

impl Batch<'_> {
    /// Advances every walk until a shader has to run, or to its end.
    pub(super) fn advance_walks(&mut self) -> Result<(), Stopped> {
        let starting = std::mem::take(&mut self.starting);
        for &group in &starting {
            self.start_walks(group, starting.len() >= ENOUGH)?;
            if self.enlisted.len() >= MOST {
                self.trace_enlisted()?;
            }
        }
        self.trace_enlisted()?;
        self.starting = recycled(starting);
        let walking = std::mem::take(&mut self.walking);
        for some in walking.chunks(PACKET) {
            self.resume_walks(some)?;
        }
        self.walking = recycled(walking);
        // Those about whose candidates no shader has a say can go on again at once.
        while !self.going_on.is_empty() {
            for group in std::mem::take(&mut self.going_on) {
                self.go_on(group)?;
            }
        }
        Ok(())
    }

    /// Walks the rays of a group that has just been started. `together`: or has the walker take them up, to be traced with others.
    fn start_walks(&mut self, index: u32, together: bool) -> Result<(), Stopped> {
        let Worker {
            walker,
            walks,
            rays,
            ray_groups,
            subgroups,
            company,
            ..
        } = &mut *self.worker;
        let group = &mut ray_groups[index];
        group.load(group.operands(subgroups), self.dispatch, rays);
        let lanes = group.in_flight;
        // SAFETY: as below.
        let progress = unsafe { walker.set_out(rays, lanes, &mut group.hits, company) };
        if progress != Progress::Apart {
            return self.heed_company(index, lanes, progress);
        }
        let mut events: SmallVec<[(usize, Event); PACKET]> = SmallVec::new();
        let mut keep = |lane: usize, walk: &mut Walk, event| {
            let place = walks.take();
            std::mem::swap(&mut walks[place], walk);
            group.walks[lane] = place;
            events.push((lane, event));
        };
        // SAFETY: the application keeps the structures that a trace may reach built and bound until the dispatch is
        // complete (VUID-vkCmdTraceRaysKHR-None-03429 and the build commands' rules).
        let enlisted = unsafe {
            let hits = &mut group.hits;
            let enlisted = match together {
                true => walker.enlist(rays, lanes, hits, index),
                false => 0,
            };
            if enlisted != lanes {
                walker.trace_in_turn(rays, lanes & !enlisted, hits, &mut { FUEL }, &mut keep);
            }
            enlisted
        };
        if enlisted != 0 {
            self.enlisted.push((index, enlisted));
        }
        let mut done = lanes & !enlisted;
        for (lane, event) in events {
            if !self.is_over(LaneRef::new(index, lane), event)? {
                done &= !(1 << lane);
            }
        }
        self.end_walks(index, done);
        Ok(())
    }

    /// Resumes some walks, most of them likely neighbours.
    fn resume_walks(&mut self, some: &[(LaneRef, Verdict)]) -> Result<(), Stopped> {
        let Worker {
            walker,
            walks,
            ray_groups,
            ..
        } = &mut *self.worker;
        // SAFETY: as for their start.
        let mut list = unsafe { walker.list() };
        let mut fuel = FUEL;
        let events: SmallVec<[_; PACKET]> = (some.iter())
            .map(|&(ray, verdict)| {
                let walk = &mut walks[ray_groups[ray.index()].walks[ray.lane()]];
                list.resume(walk, verdict, &mut fuel)
            })
            .collect();
        let (mut group, mut done) = (some[0].0.index(), 0);
        for (&(ray, _), event) in some.iter().zip(events) {
            if ray.index() != group {
                self.end_walks(group, done);
                (group, done) = (ray.index(), 0);
            }
            if self.is_over(ray, event)? {
                done |= 1 << ray.lane();
            }
        }
        self.end_walks(group, done);
        Ok(())
    }

    /// Heeds an event, and goes on as long as no shader has a say. Whether the walk is over, and its hit put down.
    pub(super) fn is_over(&mut self, ray: LaneRef, mut event: Event) -> Result<bool, Stopped> {
        loop {
            let verdict = match self.heed(ray, event)? {
                Next::Resume(verdict) => verdict,
                Next::Wait => return Ok(false),
                Next::Over => break,
            };
            let Worker {
                walker,
                walks,
                ray_groups,
                ..
            } = &mut *self.worker;
            let walk = &mut walks[ray_groups[ray.index()].walks[ray.lane()]];
            event = walk.resume(walker, verdict, &mut { FUEL });
        }
        let worker = &mut *self.worker;
        let group = &mut worker.ray_groups[ray.index()];
        let place = group.walks[ray.lane()];
        if let Some(hit) = worker.walks[place].committed() {
            group.hits.set(ray.lane(), hit);
        }
        worker.walks.remove(place);
        Ok(true)
    }

    /// Does what a walk's event asks for.
    fn heed(&mut self, ray: LaneRef, event: Event) -> Result<Next, Stopped> {
        let (role, otherwise) = match event {
            Event::OutOfFuel => {
                self.dispatch.limits.check()?;
                return Ok(Next::Resume(Verdict::Continue));
            }
            Event::Done => return Ok(Next::Over),
            Event::AnyHitCandidate => (Role::AnyHit, Verdict::Accept),
            Event::ProceduralCandidate => (Role::Intersection, Verdict::Continue),
        };
        Ok(match self.call_for_candidate(ray, role) {
            true => Next::Wait,
            false => Next::Resume(otherwise),
        })
    }

    /// Calls the shader that decides on a candidate; false if its group has none.
    fn call_for_candidate(&mut self, ray: LaneRef, role: Role) -> bool {
        let worker = &*self.worker;
        let group = &worker.ray_groups[ray.index()];
        let candidate = worker.walks[group.walks[ray.lane()]].candidate();
        let index = hit_record_index(group.operands(&worker.subgroups), ray.lane(), candidate);
        if let Some(traced) = self.dispatch.checks {
            self.check_hit_record(traced, need(role), index, candidate);
        }
        match self.find_decider(index, role) {
            Some((program, record)) => self.calls.push(program, role, record, ray),
            None => return false,
        }
        true
    }

    /// The shader that decides on a candidate, and the record, if the record's group has one.
    pub(super) fn find_decider(&mut self, index: u32, role: Role) -> Option<(ProgramIndex, u64)> {
        let (shaders, table) = (self.dispatch.shaders, &self.dispatch.tables.hit);
        let (group, record) = self.worker.records.find(shaders, table, index)?;
        let program = match role {
            Role::AnyHit => group.any_hit,
            _ => group.intersection,
        };
        Some((program?, record))
    }

    /// Walks of a group are over: the closest-hit or the miss shaders run, where there are any.
    pub(super) fn end_walks(&mut self, index: u32, lanes: u16) {
        if lanes == 0 {
            return;
        }
        let worker = &*self.worker;
        let group = &worker.ray_groups[index];
        if group.fills_hit_object {
            return self.fill_hit_objects(index, lanes);
        }
        let operands = group.operands(&worker.subgroups);
        let records = record_indices(&group.hits, operands);
        let hits = group.hits.found & lanes;
        let mut silent = hits & skips_closest_hit(operands);
        if let Some(traced) = self.dispatch.checks {
            for lane in lanes_of(lanes & !silent) {
                match group.hits.get(lane) {
                    Some(hit) => {
                        self.check_hit_record(traced, Need::ClosestHit, records[lane], &hit)
                    }
                    None => self.check_record(traced, Need::Miss, records[lane]),
                }
            }
        }
        let (tables, shaders) = (&self.dispatch.tables, self.dispatch.shaders);
        // What the lane before was told.
        let mut last = None;
        for lane in lanes_of(lanes & !silent) {
            let is_hit = hits >> lane & 1 != 0;
            let asked = (is_hit, records[lane]);
            let called = match last {
                Some((before, called)) if before == asked => called,
                _ if is_hit => (self.worker.records)
                    .find(shaders, &tables.hit, asked.1)
                    .and_then(|(group, record)| Some((group.closest_hit?, record))),
                _ => (self.worker.records)
                    .find(shaders, &tables.miss, asked.1)
                    .and_then(|(group, record)| Some((group.general?, record))),
            };
            last = Some((asked, called));
            let role = match is_hit {
                true => Role::ClosestHit,
                false => Role::Miss,
            };
            match called {
                Some((program, record)) => {
                    let ray = LaneRef::new(index, lane);
                    self.calls.push(program, role, record, ray);
                }
                None => silent |= 1 << lane,
            }
        }
        self.finish_rays(index, silent);
    }
}

/// What the record of a candidate is looked up for.
pub(super) fn need(role: Role) -> Need {
    match role {
        Role::AnyHit => Need::AnyHit,
        _ => Need::Intersection,
    }
}

/// An emptied list, for its memory.
fn recycled<T>(mut list: Vec<T>) -> Vec<T> {
    list.clear();
    list
}
