//! What a yield asks for and what an end leaves: traces, calls and reports begin here, and are answered here.

use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::program::{AlignedRow, IO_DATA_ROW, Row, SiteKind, Trace};
use traversal::{Hit, SuspendedPacket, Verdict, Walk};

use super::batch::{Batch, Worker};
use super::rays::{RayGroup, Report, alike, hit_record_index, operand, record_indices};
use super::slab::Slab;
use super::subgroup::{
    LaneRef, Role, Subgroup, SubgroupIndex, by_index, copy_lanes, in_place, lanes_named, lanes_of,
};
use crate::validate::{Instruction, Need};
use crate::wave::Stopped;

impl Batch<'_> {
    /// Starts what a yield asks for, lane by lane.
    pub(super) fn answer(&mut self, index: SubgroupIndex, site: SiteKind) -> Result<(), Stopped> {
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
            | SiteKind::Barrier => 0,
        };
        if site == SiteKind::ReorderThread && mask != 0 {
            self.reordering.push(index);
            return Ok(());
        }
        if mask == 0 {
            self.make_ready(index);
            return Ok(());
        }
        match site {
            SiteKind::TraceRay { trace, .. } => self.trace_rays(index, mask, trace),
            SiteKind::HitObjectExecute { .. } => return self.execute_hit_objects(index, mask),
            SiteKind::ReportIntersection { attribute_words } => {
                return self.report_intersections(index, mask, attribute_words as usize);
            }
            SiteKind::HitObjectGet { fact } => {
                lanes_of(mask).for_each(|lane| self.answer_fact(index, lane, fact));
                self.answered(index, mask)
            }
            SiteKind::ExecuteCallable { .. } => return self.execute_callables(index, mask),
            // Barriers exist in compute alone; a ray tracing module that has one is refused.
            _ => self.answered(index, mask),
        }
        Ok(())
    }

    /// The events of some lanes are over; the last one makes their subgroup ready.
    pub(super) fn answered(&mut self, index: SubgroupIndex, lanes: u16) {
        let subgroup = &mut self.worker.subgroups[index];
        subgroup.pending &= !lanes;
        if subgroup.pending == 0 {
            self.make_ready(index);
        }
    }

    /// Rays of a group are answered.
    pub(super) fn finish_rays(&mut self, index: u32, lanes: u16) {
        if lanes == 0 {
            return;
        }
        let group = &mut self.worker.ray_groups[index];
        let caller = group.caller;
        group.in_flight &= !lanes;
        if group.in_flight == 0 {
            self.worker.ray_groups.remove(index);
        }
        self.answered(caller, lanes);
    }

    /// Starts the rays that a subgroup's lanes ask for.
    fn trace_rays(&mut self, index: SubgroupIndex, lanes: u16, trace: Trace) {
        let worker = &mut *self.worker;
        let program = worker.subgroups[index].program;
        let io = self.dispatch.shaders.programs[program as usize].layout().io;
        let group_index = worker.ray_groups.take();
        let group = &mut worker.ray_groups[group_index];
        group.start(index, io, lanes);
        group.fills_hit_object = trace.to_hit_object;
        group.has_time = trace.motion;
        self.starting.push(group_index);
        if let Some(traced) = self.dispatch.checks {
            let instruction = Instruction {
                fills_hit_object: trace.to_hit_object,
                has_time: trace.motion,
            };
            self.check_rays(traced, group_index, instruction);
        }
    }

    fn execute_callables(&mut self, index: SubgroupIndex, lanes: u16) -> Result<(), Stopped> {
        let subgroup = &self.worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let callables = subgroup.rows[program.layout().io].0;
        let shaders = self.dispatch.shaders;
        let table = &self.dispatch.tables.callable;
        if let Some(traced) = self.dispatch.checks {
            lanes_of(lanes).for_each(|lane| {
                self.check_record(traced, Need::Callable, callables[lane]);
            });
        }
        let (mut rest, mut silent) = (lanes, 0);
        while rest != 0 {
            let callable = callables[rest.trailing_zeros() as usize];
            let alike = alike(&callables, rest);
            rest &= !alike;
            let found = self.worker.records.find(shaders, table, callable);
            match found.and_then(|(group, record)| Some((group.general?, record))) {
                Some((program, record)) => {
                    self.call((program, Role::Callable, record), index, alike)?;
                }
                None => silent |= alike,
            }
        }
        if silent != 0 {
            self.answered(index, silent);
        }
        Ok(())
    }

    /// Hits that intersection shaders report: each counts if it is in its ray's interval as it stands; the any-hit shader, if
    /// the geometry is not opaque and there is one, has the last word.
    fn report_intersections(
        &mut self,
        index: SubgroupIndex,
        lanes: u16,
        attribute_words: usize,
    ) -> Result<(), Stopped> {
        let subgroup = &self.worker.subgroups[index];
        let group = subgroup.of[0].index();
        if subgroup.is_in_place && self.worker.ray_groups[group].packet.is_some() {
            return self.report_together(index, group, lanes, attribute_words);
        }
        if let Some(traced) = self.dispatch.checks {
            lanes_of(lanes).for_each(|lane| self.check_report(traced, index, lane));
        }
        let shaders = self.dispatch.shaders;
        let Worker {
            subgroups,
            ray_groups,
            walks,
            packets,
            records,
            ..
        } = &mut *self.worker;
        let subgroup = &subgroups[index];
        let io = shaders.programs[subgroup.program as usize].layout().io;
        let (numbers, words) = subgroup.rows[io..].split_at(IO_DATA_ROW);
        let words = &words[..attribute_words];
        let (mut verdicts, mut decided) = ([0; SUBGROUP_SIZE], lanes);
        let mut callees = [(0, Role::AnyHitOfReport, 0); SUBGROUP_SIZE];
        let of = subgroup.of;
        for lane in lanes_of(lanes) {
            let ray = subgroup.of[lane];
            let group = &mut ray_groups[ray.index()];
            let t = f32::from_bits(numbers[0].0[lane]);
            let hit_kind = numbers[1].0[lane] as u8;
            let decider = Decider::of(group, subgroups, walks, packets, ray.lane());
            if !decider.is_inside(t) || group.over >> ray.lane() & 1 != 0 {
                continue;
            }
            let any_hit = if decider.candidate.opaque {
                None
            } else {
                let operands = group.operands(subgroups);
                let record = hit_record_index(operands, ray.lane(), &decider.candidate);
                (records.find(shaders, &self.dispatch.tables.hit, record))
                    .and_then(|(group, record)| Some((group.any_hit?, record)))
            };
            if let Some((program, record)) = any_hit {
                let mut report = Report {
                    t,
                    hit_kind,
                    reporter: LaneRef::new(index, lane),
                    ..Report::default()
                };
                for (attribute, row) in report.attributes.iter_mut().zip(words) {
                    *attribute = row.0[lane];
                }
                group.procedural_mut().reports[ray.lane()] = report;
                callees[lane] = (program, Role::AnyHitOfReport, record);
                decided &= !(1 << lane);
                continue;
            }
            if attribute_words > 0 {
                let attributes = &mut group.procedural_mut().attributes;
                for (attribute, row) in attributes.iter_mut().zip(words) {
                    attribute[ray.lane()] = row.0[lane];
                }
            }
            let over = commit(group, walks, packets, ray.lane(), (t, hit_kind));
            verdicts[lane] = if over { 2 } else { 1 };
        }
        let row = &mut subgroups[index].rows[io].0;
        for lane in lanes_of(decided) {
            row[lane] = verdicts[lane];
        }
        let mut rest = lanes & !decided;
        self.answered(index, decided);
        while rest != 0 {
            let first = rest.trailing_zeros() as usize;
            let (group, callee) = (of[first].index(), callees[first]);
            let alike = lanes_of(rest)
                .filter(|&lane| of[lane].index() == group && callees[lane] == callee)
                .fold(0, |alike, lane| alike | 1 << lane);
            rest &= !alike;
            self.call(callee, group, lanes_named(alike, &of))?;
        }
        Ok(())
    }

    /// The same for rays that walk together and are asked about together: all by one record.
    fn report_together(
        &mut self,
        index: SubgroupIndex,
        group_index: u32,
        lanes: u16,
        attribute_words: usize,
    ) -> Result<(), Stopped> {
        if let Some(traced) = self.dispatch.checks {
            lanes_of(lanes).for_each(|lane| self.check_report(traced, index, lane));
        }
        let shaders = self.dispatch.shaders;
        let Worker {
            subgroups,
            ray_groups,
            packets,
            records,
            ..
        } = &mut *self.worker;
        let subgroup = &subgroups[index];
        let io = shaders.programs[subgroup.program as usize].layout().io;
        let (numbers, words) = subgroup.rows[io..].split_at(IO_DATA_ROW);
        let (t, kinds) = (numbers[0].0.map(f32::from_bits), &numbers[1].0);
        let words = &words[..attribute_words];
        let group = &mut ray_groups[group_index];
        let Some(packet) = group.packet.map(|place| &mut packets[place]) else {
            return Ok(());
        };
        let operands = group.operands(subgroups);
        let (t_min, t_max) = (&operands[operand::T_MIN].0, packet.t_max());
        let (mut counts, mut opaque) = (0, 0);
        for lane in 0..SUBGROUP_SIZE {
            // Written so that a NaN is outside.
            let inside = (t[lane] >= f32::from_bits(t_min[lane])) & (t[lane] <= t_max[lane]);
            counts |= u16::from(inside) << lane;
            opaque |= u16::from(packet.candidates().is_opaque(lane)) << lane;
        }
        counts &= lanes & !group.over;
        let mut callee = None;
        if counts & !opaque != 0 {
            let lane = lanes.trailing_zeros() as usize % SUBGROUP_SIZE;
            let record = record_indices(packet.candidates(), operands)[lane];
            callee = (records.find(shaders, &self.dispatch.tables.hit, record))
                .and_then(|(group, record)| Some((group.any_hit?, Role::AnyHitOfReport, record)));
        }
        let asked = match callee {
            Some(_) => counts & !opaque,
            None => 0,
        };
        let committed = counts & !asked;
        let mut verdict = 1;
        if committed != 0 {
            if attribute_words > 0 {
                let attributes = &mut group.procedural_mut().attributes;
                for (attribute, row) in attributes.iter_mut().zip(words) {
                    copy_lanes(attribute, &row.0, committed);
                }
            }
            if packet.report_all(committed, &t, kinds, &mut group.hits) {
                verdict = 2;
            }
        }
        for lane in lanes_of(asked) {
            let mut report = Report {
                t: t[lane],
                hit_kind: kinds[lane] as u8,
                reporter: LaneRef::new(index, lane),
                ..Report::default()
            };
            for (attribute, row) in report.attributes.iter_mut().zip(words) {
                *attribute = row.0[lane];
            }
            group.procedural_mut().reports[lane] = report;
        }
        let row = &mut subgroups[index].rows[io].0;
        copy_lanes(row, &[0; SUBGROUP_SIZE], lanes & !asked);
        copy_lanes(row, &[verdict; SUBGROUP_SIZE], committed);
        self.answered(index, lanes & !asked);
        match callee {
            Some(callee) => self.call(callee, group_index, asked),
            None => Ok(()),
        }
    }

    /// An any-hit shader has decided on the hit that was reported for a ray: tells the intersection invocation.
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
            let reported = (report.t, report.hit_kind);
            let over = commit(
                group,
                &mut worker.walks,
                &mut worker.packets,
                lane,
                reported,
            );
            group.over |= u16::from(terminates) << lane;
            verdict = if over || terminates { 2 } else { 1 };
        }
        let (index, lane) = (report.reporter.index(), report.reporter.lane());
        let subgroup = &mut worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        subgroup.set_io(program, 0, lane, verdict);
        self.answered(index, 1 << lane);
    }

    /// All invocations of a subgroup have ended: copies what they leave to those who wait.
    pub(super) fn end(&mut self, index: SubgroupIndex) {
        let worker = &mut *self.worker;
        let subgroup = &mut worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let (role, lanes, of) = (subgroup.role, subgroup.lanes, subgroup.of);
        let is_in_place = subgroup.is_in_place;
        // Out of the list, for the others to be written meanwhile.
        let rows = std::mem::take(&mut subgroup.rows);
        worker.queries.release(&mut subgroup.queries);
        let layout = program.layout();
        self.state_bytes -= layout.rows * size_of::<AlignedRow>();
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
            Role::AnyHit if is_in_place => {
                let group = of[0].index();
                if outputs.len() > 1 {
                    let caller = self.worker.ray_groups[group].caller;
                    self.copy_outputs(&outputs[1..], lanes, caller, None);
                }
                self.decide_together(group, lanes, &outputs[0].0);
            }
            Role::AnyHit | Role::AnyHitOfReport => {
                if outputs.len() > 1 {
                    for (group, lanes) in by_index(lanes, &of) {
                        let caller = self.worker.ray_groups[group].caller;
                        self.copy_outputs(&outputs[1..], lanes, caller, Some(&of));
                    }
                }
                for lane in lanes_of(lanes) {
                    self.decide(role, of[lane], outputs[0].0[lane]);
                }
            }
            Role::Intersection => {
                for (index, lanes) in by_index(lanes, &of) {
                    let lanes = lanes_named(lanes, &of);
                    let group = &mut self.worker.ray_groups[index];
                    lanes_of(lanes).for_each(|lane| group.verdicts[lane] = Verdict::Continue);
                    self.decided(index, lanes);
                }
            }
        }
        let subgroup = &mut self.worker.subgroups[index];
        subgroup.rows = rows;
        subgroup.lanes = 0;
        self.worker.subgroups.remove(index);
    }

    /// What an any-hit shader says of its ray's candidate: 0 accepts it, 1 ignores it, all else accepts and terminates.
    fn decide(&mut self, role: Role, ray: LaneRef, decision: u32) {
        if role == Role::AnyHitOfReport {
            return self.decide_report(ray, decision != 1, decision > 1);
        }
        let mut decisions = [0; SUBGROUP_SIZE];
        decisions[ray.lane()] = decision;
        self.decide_together(ray.index(), 1 << ray.lane(), &decisions);
    }

    /// The same for rays of a group, each in its own lane.
    fn decide_together(&mut self, index: u32, lanes: u16, decisions: &Row) {
        let group = &mut self.worker.ray_groups[index];
        let (mut accepted, mut over) = (0, 0);
        for (lane, &decision) in decisions.iter().enumerate() {
            accepted |= u16::from(decision != 1) << lane;
            over |= u16::from(decision > 1) << lane;
        }
        if group.packet.is_some() {
            group.over |= over & lanes;
            if accepted & lanes != 0 {
                self.accept(index, accepted & lanes);
            }
        } else {
            for lane in lanes_of(lanes) {
                group.verdicts[lane] = match decisions[lane] {
                    0 => Verdict::Accept,
                    1 => Verdict::Continue,
                    _ => Verdict::AcceptAndTerminate,
                };
            }
        }
        self.decided(index, lanes);
    }

    /// Copies what lanes leave over the data of a caller that waits for them: `of` says in which of its lanes, if not in their own.
    fn copy_outputs(
        &mut self,
        outputs: &[AlignedRow],
        lanes: u16,
        caller: SubgroupIndex,
        of: Option<&[LaneRef; SUBGROUP_SIZE]>,
    ) {
        let target = &mut self.worker.subgroups[caller];
        let program = &self.dispatch.shaders.programs[target.program as usize];
        let data = &mut target.rows[program.layout().io + IO_DATA_ROW..];
        let words = data
            .iter_mut()
            .zip(outputs)
            .take(target.data_words as usize);
        match of.filter(|of| !in_place(lanes, of)) {
            None => words.for_each(|(to, from)| copy_lanes(&mut to.0, &from.0, lanes)),
            Some(of) => {
                for (to, from) in words {
                    for lane in lanes_of(lanes) {
                        to.0[of[lane].lane()] = from.0[lane];
                    }
                }
            }
        }
    }
}

/// What decides whether a reported hit counts.
pub(super) struct Decider {
    pub candidate: Hit,
    t_min: f32,
    t_max: f32,
}

impl Decider {
    pub fn of(
        group: &RayGroup,
        subgroups: &Slab<Subgroup>,
        walks: &Slab<Walk>,
        packets: &Slab<Box<SuspendedPacket>>,
        lane: usize,
    ) -> Decider {
        let t_min = group.operands(subgroups)[operand::T_MIN].0[lane];
        let (candidate, t_max) = match group.packet {
            Some(place) => {
                let packet = &packets[place];
                (packet.candidates().hit(lane), packet.t_max()[lane])
            }
            None => {
                let walk = &walks[group.walks[lane]];
                (*walk.candidate(), walk.t_max())
            }
        };
        Decider {
            candidate,
            t_min: f32::from_bits(t_min),
            t_max,
        }
    }

    /// Written so that a NaN is outside.
    pub fn is_inside(&self, t: f32) -> bool {
        t >= self.t_min && t <= self.t_max
    }
}

/// Commits a hit that was reported for the candidate of a ray. Returns whether the ray is over by it.
fn commit(
    group: &mut RayGroup,
    walks: &mut Slab<Walk>,
    packets: &mut Slab<Box<SuspendedPacket>>,
    lane: usize,
    (t, hit_kind): (f32, u8),
) -> bool {
    match group.packet {
        Some(place) => packets[place].report(lane, t, hit_kind, &mut group.hits),
        None => walks[group.walks[lane]].commit_procedural(t, hit_kind),
    }
}
