//! The shaders that decide on candidates of a batch's rays, and the callers that wait for the rays.

use lanes::LaneMask;
use smallvec::SmallVec;
use traversal::{GroupWalk, GroupWalks, RayRows, Start, Walker};

use super::batch::Batch;
use super::rays::{
    alike, load_rays, load_varying_rays, record_indices, shows_first_hit, skips_closest_hit,
};
use super::subgroup::Role;
use crate::wave::Stopped;
use crate::wave::binding_table::ProgramIndex;

impl GroupWalks for Batch<'_> {
    type Stop = Stopped;

    fn rays(&self, index: u32, rays: &mut RayRows) -> Start {
        let group = &self.worker.ray_groups[index];
        let operands = group.operands(&self.worker.subgroups);
        load_rays(self.dispatch.tier, group, operands, self.dispatch, rays);
        Start {
            lanes: group.in_flight - group.walked_alone.unwrap_or_default(),
            are_alike: false,
            shows_first_hit: shows_first_hit(operands, group.in_flight, group.fills_hit_object),
            shows_order: false,
        }
    }

    fn next_rays(&self, index: u32, (before, start): (u32, Start), rays: &mut RayRows) -> Start {
        let group = &self.worker.ray_groups[index];
        if !group.shares_setting(&self.worker.ray_groups[before]) {
            return self.rays(index, rays);
        }
        let operands = group.operands(&self.worker.subgroups);
        load_varying_rays(self.dispatch.tier, operands, group.uniform_operands, rays);
        let lanes = group.in_flight - group.walked_alone.unwrap_or_default();
        Start {
            lanes,
            are_alike: true,
            ..start
        }
    }

    fn group_walk(&mut self, index: u32) -> &mut GroupWalk {
        &mut self.worker.ray_groups[index].group_walk
    }

    fn settled(&mut self, index: u32) -> Result<(), Stopped> {
        match self.worker.ray_groups[index].group_walk.candidates().found {
            LaneMask::NONE => self.end_walks(index),
            lanes => self.ask_about_candidates(index, lanes),
        }
    }

    fn out_of_fuel(&mut self, index: u32) -> Result<(), Stopped> {
        let caller = self.worker.ray_groups[index].caller;
        let checked = self.dispatch.limits.check();
        checked.inspect_err(|_| self.note_stop(caller))
    }
}

impl Batch<'_> {
    /// Advances all rays until a shader has to run, or to their ends.
    pub(super) fn advance_walks(&mut self) -> Result<(), Stopped> {
        let mut starting = std::mem::take(&mut self.walks.starting);
        let mut apart = std::mem::take(&mut self.walks.apart);
        if self.counting.is_some() {
            self.walk_alone(&mut starting)?;
            self.walk_alone(&mut apart)?;
        }
        let started = self.start_clock();
        let walker = self.worker.walker.take();
        let mut walker = walker.expect("it is there between traces");
        // SAFETY: the application keeps the structures that a trace may reach built and bound until
        // the dispatch is complete (VUID-vkCmdTraceRaysKHR-None-03429 and the build commands'
        // rules).
        let mut advanced = unsafe { walker.trace(&starting, &apart, self) };
        (self.walks.starting, self.walks.apart) = (recycled(starting), recycled(apart));
        if advanced.is_ok() {
            advanced = self.resume_walks(&mut walker);
        }
        self.worker.walker = Some(walker);
        advanced?;
        self.count_walks(started)
    }

    /// Goes on with the rays of a line after decisions about their candidates.
    pub(super) fn resume_decided(&mut self) -> Result<(), Stopped> {
        let started = self.start_clock();
        let walker = self.worker.walker.take();
        let mut walker = walker.expect("it is there between traces");
        let resumed = self.resume_walks(&mut walker);
        self.worker.walker = Some(walker);
        resumed?;
        self.count_walks(started)
    }

    /// Goes on with rays whose candidates are decided on.
    fn resume_walks(&mut self, walker: &mut Walker) -> Result<(), Stopped> {
        // Those about whose candidates no shader has a say can go on again at once.
        while !self.walks.going_on.is_empty() {
            let going_on = std::mem::take(&mut self.walks.going_on);
            // SAFETY: the application keeps the structures, as for their start.
            let resumed = unsafe { walker.resume(&going_on, self) };
            if self.walks.going_on.is_empty() {
                self.walks.going_on = recycled(going_on);
            }
            resumed?;
        }
        Ok(())
    }

    /// Walks groups of rays that go together until a shader has to run, or to their ends; the
    /// others are put off.
    pub(super) fn walk_together(&mut self, groups: &mut Vec<u32>) -> Result<(), Stopped> {
        if self.counting.is_some() {
            self.walk_alone(groups)?;
        }
        let started = self.start_clock();
        let walker = self.worker.walker.take();
        let mut walker = walker.expect("it is there between traces");
        let mut apart = std::mem::take(&mut self.walks.apart);
        // SAFETY: as in `advance_walks`.
        let walked = unsafe { walker.trace_together(groups, &mut apart, self) };
        self.walks.apart = apart;
        self.worker.walker = Some(walker);
        walked?;
        self.count_walks(started)
    }

    /// Calls the shaders that decide on the candidates of rays. Where a group has none, triangles
    /// count.
    fn ask_about_candidates(&mut self, index: u32, lanes: LaneMask) -> Result<(), Stopped> {
        let worker = &*self.worker;
        let group = &worker.ray_groups[index];
        let candidates = group.group_walk.candidates();
        let records = record_indices(
            self.dispatch.tier,
            candidates,
            group.operands(&worker.subgroups),
        );
        let triangles = candidates.built_in();
        if self.is_watched {
            self.watch_candidates(index, lanes, &records);
        }
        let (mut rest, mut undecided) = (lanes, LaneMask::NONE);
        let mut callees: SmallVec<[_; 4]> = SmallVec::new();
        while !rest.is_empty() {
            let first = rest.first();
            let (role, of_role) = match triangles.contains(first) {
                true => (Role::AnyHit, rest & triangles),
                false => (Role::Intersection, rest - triangles),
            };
            let alike = alike(&records, of_role);
            rest -= alike;
            if let Some((program, record)) = self.find_decider(records[first], role) {
                undecided |= alike;
                callees.push(((program, role, record), alike));
            } else if role == Role::AnyHit {
                self.worker.ray_groups[index].group_walk.accept(alike);
            }
        }
        self.worker.ray_groups[index].undecided = undecided;
        if undecided.is_empty() {
            self.walks.going_on.push(index);
        }
        for (callee, lanes) in callees {
            self.call(callee, index, lanes)?;
        }
        Ok(())
    }

    /// Shaders have decided on the candidates of rays; after the last ones of a group it goes on.
    pub(super) fn decided(&mut self, index: u32, lanes: LaneMask) {
        let group = &mut self.worker.ray_groups[index];
        group.undecided -= lanes;
        if group.undecided.is_empty() {
            self.walks.going_on.push(index);
        }
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

    /// All walks of a group are over: the closest-hit and the miss shaders run, where there are
    /// any.
    pub(super) fn end_walks(&mut self, index: u32) -> Result<(), Stopped> {
        let worker = &*self.worker;
        let group = &worker.ray_groups[index];
        let lanes = group.in_flight;
        if group.fills_hit_object {
            if self.is_watched {
                let operands = group.operands(&worker.subgroups);
                let records = record_indices(self.dispatch.tier, &group.group_walk.hits, operands);
                self.watch_end_of_walks(index, &records);
            }
            self.fill_hit_objects(index, lanes);
            return Ok(());
        }
        let operands = group.operands(&worker.subgroups);
        let records = record_indices(self.dispatch.tier, &group.group_walk.hits, operands);
        let hits = group.group_walk.hits.found & lanes;
        let mut silent = match hits {
            LaneMask::NONE => hits,
            _ => hits & skips_closest_hit(operands),
        };
        if self.is_watched {
            self.watch_end_of_walks(index, &records);
        }
        let (tables, shaders) = (&self.dispatch.tables, self.dispatch.shaders);
        let mut rest = lanes - silent;
        while !rest.is_empty() {
            let first = rest.first();
            let is_hit = hits.contains(first);
            let alike = alike(&records, rest & if is_hit { hits } else { !hits });
            rest -= alike;
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

/// An emptied list, for its memory.
pub(super) fn recycled<T>(mut list: Vec<T>) -> Vec<T> {
    list.clear();
    list
}
