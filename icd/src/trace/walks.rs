//! Advancing the walks of a batch's rays, and what their events call.

use smallvec::SmallVec;
use traversal::{Event, PACKET, Progress, Verdict, Walk, Walker};

use super::batch::{Batch, FUEL, Worker};
use super::forming::Callee;
use super::rays::{alike, hit_record_index, record_indices, shows_first_hit, skips_closest_hit};
use super::subgroup::{LaneRef, Role, lanes_of};
use crate::validate::Need;
use crate::wave::Stopped;
use crate::wave::table::ProgramIndex;

/// Groups of which rays are walked together: fewer are not worth it, and a stream holds no more.
const ENOUGH: usize = 4;
const MOST: usize = Walker::STREAM_RAYS / PACKET;

impl Batch<'_> {
    /// Advances every walk until a shader has to run, or to its end.
    pub(super) fn advance_walks(&mut self) -> Result<(), Stopped> {
        let starting = std::mem::take(&mut self.starting);
        for &group in &starting {
            self.start_walks(group, starting.len() >= ENOUGH)?;
            if self.streamed.len() >= MOST {
                self.trace_streams()?;
            }
        }
        self.trace_streams()?;
        self.starting = recycled(starting);
        // Those about whose candidates no shader has a say can go on again at once.
        while !self.going_on.is_empty() {
            let going_on = std::mem::take(&mut self.going_on);
            for &group in &going_on {
                match self.worker.ray_groups[group].packet {
                    Some(_) => self.go_on_together(group)?,
                    None => self.go_on_singly(group)?,
                }
            }
            if self.going_on.is_empty() {
                self.going_on = recycled(going_on);
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
            packet,
            ..
        } = &mut *self.worker;
        let group = &mut ray_groups[index];
        let operands = group.operands(subgroups);
        group.load(operands, self.dispatch, rays);
        let lanes = group.in_flight;
        // Together, rays may find another first hit: no shader is to see that.
        if !shows_first_hit(operands, lanes, group.fills_hit_object) {
            // SAFETY: as below.
            let progress = unsafe { walker.trace_packet(rays, lanes, &mut group.hits, packet) };
            if progress != Progress::Singly {
                return self.act_on_packet(index, progress);
            }
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
        let streamed = unsafe {
            let hits = &mut group.hits;
            let streamed = match together {
                true => walker.add_to_stream(rays, lanes, hits, index),
                false => 0,
            };
            if streamed != lanes {
                walker.trace_in_turn(rays, lanes & !streamed, hits, &mut { FUEL }, &mut keep);
            }
            streamed
        };
        if streamed == 0 {
            return self.settle(index, &events);
        }
        self.streamed.push((index, streamed));
        let stopped = events.into_iter();
        (self.stopped).extend(stopped.map(|(lane, event)| (LaneRef::new(index, lane), event)));
        Ok(())
    }

    /// Goes on with rays that walk one by one, after shaders have decided on their candidates.
    fn go_on_singly(&mut self, index: u32) -> Result<(), Stopped> {
        let Worker {
            walker,
            walks,
            ray_groups,
            ..
        } = &mut *self.worker;
        let group = &ray_groups[index];
        // SAFETY: as for their start.
        let mut list = unsafe { walker.list() };
        let mut fuel = FUEL;
        let events: SmallVec<[_; PACKET]> = lanes_of(group.asked)
            .map(|lane| {
                let verdict = match group.over >> lane & 1 {
                    0 => group.verdicts[lane],
                    _ => Verdict::Terminate,
                };
                let walk = &mut walks[group.walks[lane]];
                (lane, list.resume(walk, verdict, &mut fuel))
            })
            .collect();
        self.settle(index, &events)
    }

    /// Takes rays of a group that walk one by one on to candidates on which shaders decide, and calls those; or all to their ends.
    pub(super) fn settle(&mut self, index: u32, events: &[(usize, Event)]) -> Result<(), Stopped> {
        let mut asked = 0;
        let mut callees = [(0, Role::AnyHit, 0); PACKET];
        for &(lane, event) in events {
            if let Some(callee) = self.advance(LaneRef::new(index, lane), event)? {
                asked |= 1 << lane;
                callees[lane] = callee;
            }
        }
        let group = &mut self.worker.ray_groups[index];
        (group.asked, group.undecided) = (asked, asked);
        if asked == 0 {
            return self.end_walks(index);
        }
        while asked != 0 {
            let callee = callees[asked.trailing_zeros() as usize];
            let alike = lanes_of(asked)
                .filter(|&lane| callees[lane] == callee)
                .fold(0, |alike, lane| alike | 1 << lane);
            asked &= !alike;
            self.call(callee, index, alike)?;
        }
        Ok(())
    }

    /// Acts on an event of a walk, and goes on as long as no shader has a say. Returns the one that has; at the end of the walk, puts its
    /// hit down.
    fn advance(&mut self, ray: LaneRef, mut event: Event) -> Result<Option<Callee>, Stopped> {
        loop {
            let (role, otherwise) = match event {
                Event::OutOfFuel => {
                    let caller = self.worker.ray_groups[ray.index()].caller;
                    let checked = self.dispatch.limits.check();
                    checked.inspect_err(|_| self.note_stop(caller))?;
                    event = self.resume(ray, Verdict::Continue);
                    continue;
                }
                Event::Done => break,
                Event::AnyHitCandidate => (Role::AnyHit, Verdict::Accept),
                Event::ProceduralCandidate => (Role::Intersection, Verdict::Continue),
            };
            if let Some((program, record)) = self.decider_of(ray, role) {
                return Ok(Some((program, role, record)));
            }
            event = self.resume(ray, otherwise);
        }
        let worker = &mut *self.worker;
        let group = &mut worker.ray_groups[ray.index()];
        let place = group.walks[ray.lane()];
        if let Some(hit) = worker.walks[place].committed() {
            group.hits.set(ray.lane(), hit);
        }
        worker.walks.remove(place);
        Ok(None)
    }

    fn resume(&mut self, ray: LaneRef, verdict: Verdict) -> Event {
        let Worker {
            walker,
            walks,
            ray_groups,
            ..
        } = &mut *self.worker;
        let walk = &mut walks[ray_groups[ray.index()].walks[ray.lane()]];
        walk.resume(walker, verdict, &mut { FUEL })
    }

    /// The shader that decides on the candidate at which a walk stands, and its record, if its group has one.
    fn decider_of(&mut self, ray: LaneRef, role: Role) -> Option<(ProgramIndex, u64)> {
        let worker = &*self.worker;
        let group = &worker.ray_groups[ray.index()];
        let candidate = worker.walks[group.walks[ray.lane()]].candidate();
        let index = hit_record_index(group.operands(&worker.subgroups), ray.lane(), candidate);
        if let Some(traced) = self.dispatch.checks {
            self.check_hit_record(traced, need(role), index, candidate);
        }
        self.find_decider(index, role)
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

    /// All walks of a group are over: the closest-hit and the miss shaders run, where there are any.
    pub(super) fn end_walks(&mut self, index: u32) -> Result<(), Stopped> {
        let worker = &*self.worker;
        let group = &worker.ray_groups[index];
        let lanes = group.in_flight;
        if group.fills_hit_object {
            self.fill_hit_objects(index, lanes);
            return Ok(());
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
        let mut rest = lanes & !silent;
        while rest != 0 {
            let first = rest.trailing_zeros() as usize;
            let is_hit = hits >> first & 1 != 0;
            let alike = alike(&records, rest & if is_hit { hits } else { !hits });
            rest &= !alike;
            let (role, table) = match is_hit {
                true => (Role::ClosestHit, &tables.hit),
                false => (Role::Miss, &tables.miss),
            };
            let found = self.worker.records.find(shaders, table, records[first]);
            let called = found.and_then(|(group, record)| {
                let program = match is_hit {
                    true => group.closest_hit,
                    false => group.general,
                };
                Some((program?, role, record))
            });
            match called {
                Some(callee) => self.call(callee, index, alike)?,
                None => silent |= alike,
            }
        }
        self.finish_rays(index, silent);
        Ok(())
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
