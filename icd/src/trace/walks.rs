//! Advancing the walks of a batch's rays, and what their events call.

use traversal::{PACKET, Verdict, Walk};

use super::Stopped;
use super::batch::{Batch, FUEL};
use super::calls::Call;
use super::rays::RayInFlight;
use super::subgroup::Role;
use crate::validate::Need;

impl Batch<'_> {
    /// Advances every walk until a shader has to run, or to its end.
    pub(super) fn advance_walks(&mut self) -> Result<(), Stopped> {
        let mut walking = std::mem::take(&mut self.walking);
        let mut rest = &walking[..];
        while let Some(&(index, verdict)) = rest.first() {
            if let Some((wave, others)) = rest.split_first_chunk()
                && self.finish_walks(wave)
            {
                rest = others;
            } else {
                self.advance_walk(index, verdict)?;
                rest = &rest[1..];
            }
        }
        walking.clear();
        if self.walking.is_empty() {
            self.walking = walking;
        }
        Ok(())
    }

    /// Takes a subgroup's rays to the ends of their walks together; false if they do not go the same way, or some
    /// have started. What they find is the same, one way or the other.
    fn finish_walks(&mut self, wave: &[(u32, Verdict); PACKET]) -> bool {
        let indices = wave.map(|(index, _)| index);
        let subgroup = |index| self.worker.rays[index].caller.subgroup;
        if subgroup(indices[0]) != subgroup(indices[PACKET - 1])
            || wave
                .iter()
                .any(|&(_, verdict)| verdict != Verdict::Continue)
        {
            return false;
        }
        let Some(rays) = self.worker.rays.many_mut(indices) else {
            return false;
        };
        let mut walks = rays.map(RayInFlight::walk_mut);
        if !Walk::finish_together(&mut walks, &mut self.worker.walker) {
            return false;
        }
        for index in indices {
            self.end_walk(index);
        }
        true
    }

    fn advance_walk(&mut self, index: u32, mut verdict: Verdict) -> Result<(), Stopped> {
        let mut fuel = FUEL;
        loop {
            let ray = &mut self.worker.rays[index];
            let event = ray
                .walk_mut()
                .resume(&mut self.worker.walker, verdict, &mut fuel);
            verdict = match event {
                traversal::Event::OutOfFuel => {
                    self.dispatch.limits.check()?;
                    fuel = FUEL;
                    Verdict::Continue
                }
                traversal::Event::AnyHitCandidate => {
                    match self.call_for_candidate(index, Role::AnyHit) {
                        true => return Ok(()),
                        false => Verdict::Accept,
                    }
                }
                traversal::Event::ProceduralCandidate => {
                    match self.call_for_candidate(index, Role::Intersection) {
                        true => return Ok(()),
                        false => Verdict::Continue,
                    }
                }
                traversal::Event::Done => {
                    self.end_walk(index);
                    return Ok(());
                }
            };
        }
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
