//! Who shares a subgroup of hit, miss, any-hit, intersection and callable shaders.
//!
//! Lanes of one subgroup that call one record of one shader by one instruction stay together, each
//! in its own lane, if they are [`MANY`]. The others form full subgroups at the end of the step,
//! whatever subgroups they come from: in the order of their records and launches.

use lanes::{LaneMask, by_lane};
use spirv_jit::SUBGROUP_SIZE;

use super::batch::Batch;
use super::calls::{Call, Calls};
use super::grid::Launches;
use super::subgroup::{Callee, LaneRef, Role};
use crate::wave::Stopped;
use crate::wave::binding_table::ProgramIndex;

/// Lanes that are enough for a subgroup of their own.
pub(super) const MANY: u32 = 8;

impl Batch<'_> {
    /// Calls a shader for lanes of a group of rays, or for callables of a subgroup.
    pub(super) fn call(
        &mut self,
        callee: Callee,
        caller: u32,
        lanes: LaneMask,
    ) -> Result<(), Stopped> {
        let (program, role, record) = callee;
        if lanes.count() >= MANY {
            if self.lines.is_answered && self.runs_in_line(program, role) {
                self.worker.line.call(callee, caller, lanes);
                return Ok(());
            }
            return self.form_in_place(callee, caller, lanes);
        }
        let launch = match role {
            Role::Callable => &self.worker.subgroups[caller].launch,
            _ => &self.worker.subgroups[self.worker.ray_groups[caller].caller].launch,
        };
        let calls = match role {
            Role::AnyHit | Role::AnyHitOfReport | Role::Intersection => &mut self.deciding,
            _ => &mut self.calls,
        };
        for lane in lanes {
            let call = Call {
                record,
                place: self.grid.place(launch.x[lane], launch.y[lane]),
                of: LaneRef::new(caller, lane),
            };
            calls.push(program, role, call);
        }
        Ok(())
    }

    /// Makes a subgroup of lanes that stay where they are.
    pub(super) fn form_in_place(
        &mut self,
        (program, role, record): Callee,
        caller: u32,
        lanes: LaneMask,
    ) -> Result<(), Stopped> {
        let of = by_lane(|lane| LaneRef::new(caller, lane));
        if self.is_watched {
            self.show_calls((program, role), lanes.iter().map(|lane| of[lane]));
        }
        let index = self.new_subgroup(program, role, lanes);
        let index = index.inspect_err(|_| self.note_call(role, of[0]))?;
        let worker = &mut *self.worker;
        let waiting = match role {
            Role::Callable => caller,
            _ => worker.ray_groups[caller].caller,
        };
        let launch = worker.subgroups[waiting].launch;
        let subgroup = &mut worker.subgroups[index];
        (subgroup.of, subgroup.launch) = (of, launch);
        subgroup.is_in_place = true;
        self.fill_inputs(index, &[record; SUBGROUP_SIZE]);
        if self.is_watched {
            self.watch_start(index, &[record; SUBGROUP_SIZE]);
        }
        self.make_ready(index);
        Ok(())
    }

    /// Makes subgroups of the waiting calls of shaders that decide on candidates.
    pub(super) fn form_deciders(&mut self) -> Result<(), Stopped> {
        let mut calls = std::mem::take(&mut self.deciding);
        let formed = self.form_subgroups(&mut calls);
        self.deciding = calls;
        formed
    }

    /// Makes subgroups of the waiting calls of hit, miss and callable shaders.
    pub(super) fn form_callees(&mut self) -> Result<(), Stopped> {
        let mut calls = std::mem::take(&mut self.calls);
        let formed = self.form_subgroups(&mut calls);
        self.calls = calls;
        formed
    }

    /// Makes subgroups of calls: full ones of one shader each, whatever the divergence of those who
    /// called.
    fn form_subgroups(&mut self, calls: &mut Calls) -> Result<(), Stopped> {
        for bucket in calls.sorted() {
            let (program, role) = (bucket.program, bucket.role);
            for calls in bucket.sorted().chunks(SUBGROUP_SIZE) {
                self.form_subgroup(program, role, calls)?;
            }
            bucket.clear();
        }
        Ok(())
    }

    fn form_subgroup(
        &mut self,
        program: ProgramIndex,
        role: Role,
        calls: &[Call],
    ) -> Result<(), Stopped> {
        if self.is_watched {
            self.show_calls((program, role), calls.iter().map(|call| call.of));
        }
        let lanes = LaneMask::full(calls.len());
        let index = self.new_subgroup(program, role, lanes);
        let index = index.inspect_err(|_| self.note_call(role, calls[0].of))?;
        let mut records = [calls[0].record; SUBGROUP_SIZE];
        let mut of = [calls[0].of; SUBGROUP_SIZE];
        for (lane, call) in calls.iter().enumerate() {
            (records[lane], of[lane]) = (call.record, call.of);
        }
        let worker = &mut *self.worker;
        let mut launch = Launches::default();
        for (lane, of) in of.iter().enumerate() {
            let caller = match role {
                Role::Callable => of.index(),
                _ => worker.ray_groups[of.index()].caller,
            };
            let from = &worker.subgroups[caller].launch;
            (launch.x[lane], launch.y[lane]) = (from.x[of.lane()], from.y[of.lane()]);
        }
        let subgroup = &mut worker.subgroups[index];
        (subgroup.of, subgroup.launch) = (of, launch);
        subgroup.is_in_place = false;
        self.fill_inputs(index, &records);
        if self.is_watched {
            self.watch_start(index, &records);
        }
        self.make_ready(index);
        Ok(())
    }
}
