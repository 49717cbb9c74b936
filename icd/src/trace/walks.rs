//! Advancing the walks of a batch's rays, and what their events call.

use smallvec::SmallVec;
use traversal::{Event, PACKET, Step, Verdict, Walk};

use super::Stopped;
use super::batch::{Batch, FUEL};
use super::calls::Call;
use super::subgroup::Role;
use crate::validate::Need;

impl Batch<'_> {
    /// Advances every walk until a shader has to run, or to its end.
    pub(super) fn advance_walks(&mut self) -> Result<(), Stopped> {
        let mut walking = std::mem::take(&mut self.walking);
        let mut rest = &walking[..];
        while !rest.is_empty() {
            let (some, others) = rest.split_at(self.count_beside(rest));
            self.advance_some(some)?;
            rest = others;
        }
        walking.clear();
        if self.walking.is_empty() {
            self.walking = walking;
        }
        Ok(())
    }

    /// How many of the next rays come from one subgroup.
    fn count_beside(&self, walking: &[(u32, Verdict)]) -> usize {
        let subgroup = |&(index, _): &(u32, _)| self.worker.rays[index].caller.subgroup;
        let first = subgroup(&walking[0]);
        let beside = walking.iter().take(PACKET);
        beside.take_while(|entry| subgroup(entry) == first).count()
    }

    /// Advances up to [`PACKET`] walks: together if they go the same way. What they find is the same, one way or the other.
    fn advance_some(&mut self, some: &[(u32, Verdict)]) -> Result<(), Stopped> {
        let mut sorted: SmallVec<[_; PACKET]> = some.into();
        sorted.sort_unstable_by_key(|&(index, _)| index);
        let indices = sorted.iter().map(|&(index, _)| index);
        let rays = self.worker.rays.ascending_mut(indices);
        let mut steps: SmallVec<[_; PACKET]> = (rays.zip(&sorted))
            .map(|(ray, &(_, verdict))| Step::new(ray.walk_mut(), verdict))
            .collect();
        let mut fuel = FUEL;
        if !Walk::finish_together(&mut steps, &mut self.worker.walker) {
            Walk::resume_all(&mut steps, &mut self.worker.walker, &mut fuel);
        }
        let events: SmallVec<[_; PACKET]> = steps.iter().map(|step| step.event).collect();
        drop(steps);
        for (&(index, _), event) in sorted.iter().zip(events) {
            if let Some(verdict) = self.heed(index, event)? {
                self.advance_walk(index, verdict)?;
            }
        }
        Ok(())
    }

    fn advance_walk(&mut self, index: u32, mut verdict: Verdict) -> Result<(), Stopped> {
        loop {
            let walk = self.worker.rays[index].walk_mut();
            let event = walk.resume(&mut self.worker.walker, verdict, &mut { FUEL });
            match self.heed(index, event)? {
                Some(next) => verdict = next,
                None => return Ok(()),
            }
        }
    }

    /// Does what a walk's event asks for; a verdict if the walk goes on at once.
    fn heed(&mut self, index: u32, event: Event) -> Result<Option<Verdict>, Stopped> {
        let (role, otherwise) = match event {
            Event::OutOfFuel => {
                self.dispatch.limits.check()?;
                return Ok(Some(Verdict::Continue));
            }
            Event::Done => {
                self.end_walk(index);
                return Ok(None);
            }
            Event::AnyHitCandidate => (Role::AnyHit, Verdict::Accept),
            Event::ProceduralCandidate => (Role::Intersection, Verdict::Continue),
        };
        let called = self.call_for_candidate(index, role);
        Ok((!called).then_some(otherwise))
    }

    /// Calls the shader that decides on a candidate; false if its group has none.
    fn call_for_candidate(&mut self, index: u32, role: Role) -> bool {
        let ray = &self.worker.rays[index];
        let candidate = ray.walk().candidate();
        let record = ray.hit_record_index(candidate);
        if let Some(traced) = self.dispatch.checks {
            let need = match role {
                Role::AnyHit => Need::AnyHit,
                _ => Need::Intersection,
            };
            self.check_hit_record(traced, need, record, candidate);
        }
        let found =
            self.worker
                .records
                .find(self.dispatch.shaders, &self.dispatch.tables.hit, record);
        let Some((group, record)) = found else {
            return false;
        };
        let Some(program) = (if role == Role::AnyHit {
            group.any_hit
        } else {
            group.intersection
        }) else {
            return false;
        };
        self.calls.push(Call {
            program,
            role,
            record,
            ray: index,
            caller: ray.caller,
            launch: ray.launch,
        });
        true
    }

    /// A walk is over: the closest-hit or the miss shader runs, if there is one.
    pub(super) fn end_walk(&mut self, index: u32) {
        let ray = &self.worker.rays[index];
        if ray.fills_hit_object {
            return self.fill_hit_object(index);
        }
        let (caller, launch) = (ray.caller, ray.launch);
        if let Some(traced) = self.dispatch.checks {
            match ray.committed() {
                Some(_) if ray.flags & traversal::ray_flags::SKIP_CLOSEST_HIT_SHADER != 0 => {}
                Some(hit) => {
                    let record = ray.hit_record_index(hit);
                    self.check_hit_record(traced, Need::ClosestHit, record, hit);
                }
                None => self.check_record(traced, Need::Miss, ray.miss_index),
            }
        }
        let (tables, shaders) = (&self.dispatch.tables, self.dispatch.shaders);
        let records = &mut self.worker.records;
        let call = match ray.committed() {
            Some(_) if ray.flags & traversal::ray_flags::SKIP_CLOSEST_HIT_SHADER != 0 => None,
            Some(hit) => records
                .find(shaders, &tables.hit, ray.hit_record_index(hit))
                .and_then(|(group, record)| Some((group.closest_hit?, Role::ClosestHit, record))),
            None => records
                .find(shaders, &tables.miss, ray.miss_index)
                .and_then(|(group, record)| Some((group.general?, Role::Miss, record))),
        };
        match call {
            Some((program, role, record)) => {
                self.calls.push(Call {
                    program,
                    role,
                    record,
                    ray: index,
                    caller,
                    launch,
                });
            }
            None => self.finish_ray(index),
        }
    }
}
