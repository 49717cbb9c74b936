//! Requests of yields and results of ends: traces, calls and reports begin here, and are answered
//! here.

use lanes::LaneMask;
use smallvec::SmallVec;
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::program::{AlignedRow, IO_DATA_ROW, Row, SiteKind, Trace};

use super::batch::{Batch, Worker};
use super::calls::Records;
use super::rays::{Report, alike, record_indices};
use super::subgroup::{Callee, LaneRef, Role, SubgroupIndex, by_index, in_place, lanes_named};
use crate::wave::Stopped;
use crate::wave::binding_table::{Live, Shaders};
use crate::wave::rows::{copy_lanes, copy_row, floats, put_word};

impl Batch<'_> {
    /// Starts what a yield asks for, lane by lane.
    pub(super) fn act_on_yield(
        &mut self,
        index: SubgroupIndex,
        site: SiteKind,
    ) -> Result<(), Stopped> {
        let subgroup = &mut self.worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let mask = program.event_mask(&subgroup.rows);
        subgroup.pending = mask;
        subgroup.data_words = match site {
            SiteKind::TraceRay { payload_words, .. }
            | SiteKind::HitObjectExecute { payload_words } => payload_words,
            SiteKind::ExecuteCallable { data_words } => data_words,
            SiteKind::ReportIntersection { .. }
            | SiteKind::HitObjectGet { .. }
            | SiteKind::ReorderThread
            | SiteKind::RayQueryProceed
            | SiteKind::Barrier
            | SiteKind::BarrierArrive
            | SiteKind::BarrierWait => 0,
        };
        if site == SiteKind::ReorderThread && !mask.is_empty() {
            self.reordering.push(index);
            return Ok(());
        }
        if mask.is_empty() {
            self.make_ready(index);
            return Ok(());
        }
        match site {
            SiteKind::TraceRay { trace, .. } => {
                // Other programs write uniform operands in active lanes alone.
                let uniform = match program.output_rows() == 0 && !trace.to_hit_object {
                    true => program.uniform_operands(program.resume_point(&subgroup.rows)),
                    false => 0,
                };
                let group = self.start_rays(index, mask, trace, uniform);
                self.walks.starting.push(group);
            }
            SiteKind::HitObjectExecute { .. } => return self.execute_hit_objects(index, mask),
            SiteKind::ReportIntersection { attribute_words } => {
                return self.report_intersections(index, mask, attribute_words as usize);
            }
            SiteKind::HitObjectGet { fact } => {
                for lane in mask {
                    self.answer_fact(index, lane, fact);
                }
                self.answered(index, mask)
            }
            SiteKind::ExecuteCallable { .. } => return self.execute_callables(index, mask),
            // Barriers exist in compute alone; a ray tracing module that has one is refused.
            _ => self.answered(index, mask),
        }
        Ok(())
    }

    /// The events of some lanes are over; the last one makes their subgroup ready.
    pub(super) fn answered(&mut self, index: SubgroupIndex, lanes: LaneMask) {
        let subgroup = &mut self.worker.subgroups[index];
        subgroup.pending -= lanes;
        if subgroup.pending.is_empty() && !self.goes_on_in_line(index) {
            self.make_ready(index);
        }
    }

    /// Rays of a group are answered.
    pub(super) fn finish_rays(&mut self, index: u32, lanes: LaneMask) {
        if lanes.is_empty() {
            return;
        }
        let group = &mut self.worker.ray_groups[index];
        let caller = group.caller;
        group.in_flight -= lanes;
        if group.in_flight.is_empty() {
            self.worker.ray_groups.remove(index);
        }
        self.answered(caller, lanes);
    }

    /// Makes a group of the rays that a subgroup's lanes ask for. `uniform_operands`: of the
    /// program at the point where the subgroup stands.
    pub(super) fn start_rays(
        &mut self,
        index: SubgroupIndex,
        lanes: LaneMask,
        trace: Trace,
        uniform_operands: u16,
    ) -> u32 {
        let worker = &mut *self.worker;
        let caller = &worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[caller.program as usize];
        let point = (caller.program, program.resume_point(&caller.rows));
        let io = program.layout().io;
        let group_index = worker.ray_groups.take();
        let group = &mut worker.ray_groups[group_index];
        group.start(index, io, lanes);
        group.fills_hit_object = trace.to_hit_object;
        group.has_time = trace.motion;
        group.stand_at(point, uniform_operands);
        if self.is_watched {
            self.watch_rays(group_index, trace);
        }
        group_index
    }

    fn execute_callables(&mut self, index: SubgroupIndex, lanes: LaneMask) -> Result<(), Stopped> {
        let subgroup = &self.worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let callables = subgroup.rows[program.layout().io].0;
        let shaders = self.dispatch.shaders;
        let table = &self.dispatch.tables.callable;
        if self.is_watched {
            self.watch_callables(index, &callables, lanes);
        }
        let (mut rest, mut silent) = (lanes, LaneMask::NONE);
        while !rest.is_empty() {
            let callable = callables[rest.first()];
            let alike = alike(&callables, rest);
            rest -= alike;
            let found = self.worker.records.find(shaders, table, callable);
            match found.and_then(|(group, record)| Some((group.general?, record))) {
                Some((program, record)) => {
                    self.call((program, Role::Callable, record), index, alike)?;
                }
                None => silent |= alike,
            }
        }
        if !silent.is_empty() {
            self.answered(index, silent);
        }
        Ok(())
    }

    /// Hits that intersection shaders report: each counts if it is in its ray's interval as it
    /// stands; the any-hit shader, if the geometry is not opaque and there is one, has the last
    /// word.
    fn report_intersections(
        &mut self,
        index: SubgroupIndex,
        lanes: LaneMask,
        attribute_words: usize,
    ) -> Result<(), Stopped> {
        if self.is_watched {
            self.watch_reports(index, lanes, attribute_words);
        }
        let subgroup = &self.worker.subgroups[index];
        let of = subgroup.of;
        if subgroup.is_in_place {
            return self.report_for_group(index, of[0].index(), (lanes, None), attribute_words);
        }
        for (group, lanes) in by_index(lanes, &of) {
            self.report_for_group(index, group, (lanes, Some(&of)), attribute_words)?;
        }
        Ok(())
    }

    /// The same for rays of one group; `of`: which each lane's is, if not in its own lane.
    fn report_for_group(
        &mut self,
        index: SubgroupIndex,
        group_index: u32,
        (reporters, of): (LaneMask, Option<&[LaneRef; SUBGROUP_SIZE]>),
        attribute_words: usize,
    ) -> Result<(), Stopped> {
        let (shaders, tier) = (self.dispatch.shaders, self.dispatch.tier);
        let Worker {
            subgroups,
            ray_groups,
            records,
            ..
        } = &mut *self.worker;
        let subgroup = &subgroups[index];
        let io = shaders.programs[subgroup.program as usize].layout().io;
        let (numbers, words) = subgroup.rows[io..].split_at(IO_DATA_ROW);
        let words = &words[..attribute_words];
        // From here on by the lanes of the rays.
        let (lanes, t, kinds) = match of {
            None => (reporters, numbers[0].0, numbers[1].0),
            Some(of) => (
                lanes_named(reporters, of),
                spread(&numbers[0].0, reporters, of),
                spread(&numbers[1].0, reporters, of),
            ),
        };
        let t = floats(&t);
        let group = &mut ray_groups[group_index];
        let counts = group.group_walk.counts(lanes, &t);
        let candidates = group.group_walk.candidates();
        let undecided = counts - candidates.opaque();
        let mut callees = SmallVec::new();
        if !undecided.is_empty() {
            let hit_records = record_indices(tier, candidates, group.operands(subgroups));
            let shaders = (shaders, &self.dispatch.tables.hit);
            callees = any_hit_calls(shaders, records, &hit_records, undecided);
        }
        let asked = (callees.iter()).fold(LaneMask::NONE, |asked, (_, lanes)| asked | *lanes);
        let committed = counts - asked;
        let mut over = LaneMask::NONE;
        if !committed.is_empty() {
            if attribute_words > 0 {
                let attributes = &mut group.procedural_mut().attributes;
                for (attribute, row) in attributes.iter_mut().zip(words) {
                    let row = of.map_or(row.0, |of| spread(&row.0, reporters, of));
                    copy_row(tier, attribute, &row, committed);
                }
            }
            over = group.group_walk.report(committed, &t, &kinds);
        }
        let mut verdicts = [0; SUBGROUP_SIZE];
        put_word(tier, &mut verdicts, 1, committed);
        put_word(tier, &mut verdicts, 2, over);
        let mut answered = lanes - asked;
        if let Some(of) = of {
            let by_rays = verdicts;
            answered = LaneMask::NONE;
            for lane in reporters {
                let ray = of[lane].lane();
                verdicts[lane] = by_rays[ray];
                answered.set(lane, !asked.contains(ray));
            }
        }
        for lane in reporters - answered {
            let ray = of.map_or(lane, |of| of[lane].lane());
            let (t, hit_kind) = (t[ray], kinds[ray] as u8);
            let report = report_of(LaneRef::new(index, lane), t, hit_kind, words);
            group.procedural_mut().reports[ray] = report;
        }
        copy_row(tier, &mut subgroups[index].rows[io].0, &verdicts, answered);
        self.answered(index, answered);
        for (callee, lanes) in callees {
            self.call(callee, group_index, lanes)?;
        }
        Ok(())
    }

    /// An any-hit shader has decided on the hit that was reported for a ray: tells the intersection
    /// invocation.
    fn decide_report(&mut self, ray: LaneRef, accepts: bool, terminates: bool) {
        let worker = &mut *self.worker;
        let group = &mut worker.ray_groups[ray.index()];
        let lane = ray.lane();
        let procedural = group.procedural_mut();
        let report = procedural.reports[lane];
        let mut verdict = 0;
        if accepts {
            for (attribute, word) in procedural.attributes.iter_mut().zip(report.attributes) {
                attribute[lane] = word;
            }
            let (t, kinds) = (
                [report.t; SUBGROUP_SIZE],
                [report.hit_kind.into(); SUBGROUP_SIZE],
            );
            let lanes = LaneMask::of(lane);
            let over = !group.group_walk.report(lanes, &t, &kinds).is_empty();
            if terminates {
                group.group_walk.end(lanes);
            }
            verdict = if over || terminates { 2 } else { 1 };
        }
        let (index, lane) = (report.reporter.index(), report.reporter.lane());
        let subgroup = &mut worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        subgroup.set_io(program, 0, lane, verdict);
        self.answered(index, LaneMask::of(lane));
    }

    /// All invocations of a subgroup have ended: copies what they leave to those who wait.
    pub(super) fn end(&mut self, index: SubgroupIndex) {
        let worker = &mut *self.worker;
        let subgroup = &mut worker.subgroups[index];
        if subgroup.role == Role::RayGeneration {
            worker.queries.release(&mut subgroup.queries);
            return self.give_back(index);
        }
        if self.is_watched {
            self.watch_end(index);
        }
        let worker = &mut *self.worker;
        let subgroup = &mut worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let (role, lanes, of) = (subgroup.role, subgroup.lanes, subgroup.of);
        let is_in_place = subgroup.is_in_place;
        // Out of the list, for the others to be written meanwhile.
        let rows = std::mem::take(&mut subgroup.rows);
        worker.queries.release(&mut subgroup.queries);
        let layout = program.layout();
        let outputs = &rows[layout.io..][..program.output_rows() as usize];
        match role {
            Role::RayGeneration => {}
            Role::Callable if is_in_place => {
                let caller = of[0].index();
                self.copy_outputs(outputs, lanes, caller, None);
                self.answered(caller, lanes);
            }
            Role::Callable => {
                for (caller, lanes) in by_index(lanes, &of) {
                    self.copy_outputs(outputs, lanes, caller, Some(&of));
                    self.answered(caller, lanes_named(lanes, &of));
                }
            }
            Role::ClosestHit | Role::Miss if is_in_place => {
                let group = of[0].index();
                let caller = self.worker.ray_groups[group].caller;
                self.copy_outputs(outputs, lanes, caller, None);
                self.finish_rays(group, lanes);
            }
            Role::ClosestHit | Role::Miss => {
                for (group, lanes) in by_index(lanes, &of) {
                    let caller = self.worker.ray_groups[group].caller;
                    self.copy_outputs(outputs, lanes, caller, Some(&of));
                    self.finish_rays(group, lanes_named(lanes, &of));
                }
            }
            Role::AnyHit if is_in_place => self.end_decider(outputs, (of[0].index(), lanes)),
            Role::AnyHit | Role::AnyHitOfReport => {
                if outputs.len() > 1 {
                    for (group, lanes) in by_index(lanes, &of) {
                        let caller = self.worker.ray_groups[group].caller;
                        self.copy_outputs(&outputs[1..], lanes, caller, Some(&of));
                    }
                }
                for lane in lanes {
                    self.decide(role, of[lane], outputs[0].0[lane]);
                }
            }
            Role::Intersection => {
                for (index, lanes) in by_index(lanes, &of) {
                    self.decided(index, lanes_named(lanes, &of));
                }
            }
        }
        self.worker.subgroups[index].rows = rows;
        self.give_back(index);
    }

    /// Any-hit shaders of rays of a group, each in its own lane, have ended with these outputs.
    pub(super) fn end_decider(&mut self, outputs: &[AlignedRow], (group, lanes): (u32, LaneMask)) {
        if outputs.len() > 1 {
            let caller = self.worker.ray_groups[group].caller;
            self.copy_outputs(&outputs[1..], lanes, caller, None);
        }
        self.decide_together(group, lanes, &outputs[0].0);
    }

    /// The decision of an any-hit shader about its ray's candidate: 0 accepts it, 1 ignores it,
    /// other values accept it and terminate the ray.
    fn decide(&mut self, role: Role, ray: LaneRef, decision: u32) {
        if role == Role::AnyHitOfReport {
            return self.decide_report(ray, decision != 1, decision > 1);
        }
        let mut decisions = [0; SUBGROUP_SIZE];
        decisions[ray.lane()] = decision;
        self.decide_together(ray.index(), LaneMask::of(ray.lane()), &decisions);
    }

    /// The same for rays of a group, each in its own lane.
    fn decide_together(&mut self, index: u32, lanes: LaneMask, decisions: &Row) {
        let group = &mut self.worker.ray_groups[index];
        let over = LaneMask::with_any(decisions, !1) & lanes;
        group
            .group_walk
            .accept(lanes - LaneMask::holding(decisions, 1));
        group.group_walk.end(over);
        self.decided(index, lanes);
    }

    /// Copies what lanes leave over the data of a caller that waits for them: `of` says in which of
    /// its lanes, if not in their own.
    pub(super) fn copy_outputs(
        &mut self,
        outputs: &[AlignedRow],
        lanes: LaneMask,
        caller: SubgroupIndex,
        of: Option<&[LaneRef; SUBGROUP_SIZE]>,
    ) {
        let target = &mut self.worker.subgroups[caller];
        let program = &self.dispatch.shaders.programs[target.program as usize];
        let data = &mut target.rows[program.layout().io + IO_DATA_ROW..];
        let words = outputs.len().min(target.data_words as usize);
        match of.filter(|of| !in_place(lanes, of)) {
            None => copy_lanes(self.dispatch.tier, data, &outputs[..words], lanes),
            Some(of) => {
                for (to, from) in data.iter_mut().zip(&outputs[..words]) {
                    for lane in lanes {
                        to.0[of[lane].lane()] = from.0[lane];
                    }
                }
            }
        }
    }
}

/// The any-hit shaders that decide about reported hits, each with its rays. Rays without one are in
/// none.
fn any_hit_calls(
    (shaders, table): (&Shaders, &Live),
    records: &mut Records,
    hit_records: &Row,
    mut undecided: LaneMask,
) -> SmallVec<[(Callee, LaneMask); 1]> {
    let mut calls = SmallVec::new();
    while !undecided.is_empty() {
        let record = hit_records[undecided.first()];
        let alike = alike(hit_records, undecided);
        undecided -= alike;
        let found = records.find(shaders, table, record);
        if let Some((program, record)) =
            found.and_then(|(group, record)| Some((group.any_hit?, record)))
        {
            calls.push(((program, Role::AnyHitOfReport, record), alike));
        }
    }
    calls
}

/// A report that waits for an any-hit shader, with the reporter's attributes.
fn report_of(reporter: LaneRef, t: f32, hit_kind: u8, attributes: &[AlignedRow]) -> Report {
    let mut report = Report {
        t,
        hit_kind,
        reporter,
        ..Report::default()
    };
    for (attribute, row) in report.attributes.iter_mut().zip(attributes) {
        *attribute = row.0[reporter.lane()];
    }
    report
}

/// Puts numbers of lanes where their rays are.
fn spread(row: &Row, lanes: LaneMask, of: &[LaneRef; SUBGROUP_SIZE]) -> Row {
    let mut spread = [0; SUBGROUP_SIZE];
    for lane in lanes {
        spread[of[lane].lane()] = row[lane];
    }
    spread
}
