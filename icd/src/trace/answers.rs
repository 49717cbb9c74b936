//! What a yield asks for and what an end leaves: traces, calls and reports begin here, and are answered here.

use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::program::{AlignedRow, IO_DATA_ROW, SiteKind};
use traversal::Verdict;

use super::batch::Batch;
use super::calls::Call;
use super::rays::Report;
use super::subgroup::{LaneRef, Role, SubgroupIndex, by_subgroup, in_place, lanes_of};
use crate::validate::{Instruction, Need};

impl Batch<'_> {
    /// Starts what a yield asks for, lane by lane.
    pub(super) fn answer(&mut self, index: SubgroupIndex, site: SiteKind) {
        let subgroup = &mut self.worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let mask = program.event_mask(&subgroup.rows);
        subgroup.pending = mask;
        subgroup.data_words = match site {
            SiteKind::TraceRay { payload_words }
            | SiteKind::TraceRayMotion { payload_words }
            | SiteKind::HitObjectTraceRay { payload_words }
            | SiteKind::HitObjectTraceRayMotion { payload_words }
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
            return;
        }
        match site {
            SiteKind::TraceRay { .. } => return self.trace_rays(index, mask, false, false),
            SiteKind::TraceRayMotion { .. } => return self.trace_rays(index, mask, false, true),
            SiteKind::HitObjectTraceRay { .. } => return self.trace_rays(index, mask, true, false),
            SiteKind::HitObjectTraceRayMotion { .. } => {
                return self.trace_rays(index, mask, true, true);
            }
            _ => {}
        }
        for lane in lanes_of(mask) {
            let caller = LaneRef {
                subgroup: index,
                lane: lane as u8,
            };
            match site {
                SiteKind::HitObjectExecute { .. } => self.execute_hit_object(caller),
                SiteKind::HitObjectGet { fact } => self.answer_fact(caller, fact),
                SiteKind::ReportIntersection { attribute_words } => {
                    self.report_intersection(caller, attribute_words)
                }
                SiteKind::ExecuteCallable { .. } => self.execute_callable(caller),
                // Barriers exist in compute alone; a ray tracing module that has one is refused.
                _ => self.answered(caller),
            }
        }
        if mask == 0 {
            self.make_ready(index);
        }
    }

    /// A lane's event is over; the last one makes its subgroup ready.
    pub(super) fn answered(&mut self, lane: LaneRef) {
        let subgroup = &mut self.worker.subgroups[lane.subgroup];
        subgroup.pending &= !(1 << lane.lane);
        if subgroup.pending == 0 {
            self.make_ready(lane.subgroup);
        }
    }

    /// As [`Self::answered`], for all `lanes` at once.
    fn answered_lanes(&mut self, lanes: u16, waiting: &[LaneRef; SUBGROUP_SIZE]) {
        for (index, lanes) in by_subgroup(lanes, waiting) {
            let answered = lanes_of(lanes).fold(0, |mask, lane| mask | 1 << waiting[lane].lane);
            let subgroup = &mut self.worker.subgroups[index];
            subgroup.pending &= !answered;
            if subgroup.pending == 0 {
                self.make_ready(index);
            }
        }
    }

    /// Starts the rays that a subgroup's lanes ask for.
    fn trace_rays(
        &mut self,
        index: SubgroupIndex,
        lanes: u16,
        fills_hit_object: bool,
        motion: bool,
    ) {
        let worker = &mut *self.worker;
        let subgroup = &worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let operands = subgroup.rows[program.layout().io..]
            .first_chunk()
            .expect("a state has a yield's operands");
        for lane in lanes_of(lanes) {
            let caller = LaneRef {
                subgroup: index,
                lane: lane as u8,
            };
            let ray_index = worker.rays.take();
            let ray = &mut worker.rays[ray_index];
            let launch = subgroup.launch[lane];
            ray.start(caller, launch, operands, self.dispatch, motion);
            ray.fills_hit_object = fills_hit_object;
            self.walking.push((ray_index, Verdict::Continue));
        }
        if let Some(traced) = self.dispatch.checks {
            let instruction = Instruction {
                fills_hit_object,
                has_time: motion,
            };
            self.check_rays(traced, index, lanes, instruction);
        }
        if lanes == 0 {
            self.make_ready(index);
        }
    }

    fn execute_callable(&mut self, caller: LaneRef) {
        let subgroup = &self.worker.subgroups[caller.subgroup];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let callable = subgroup.io(program, 0, caller.lane as usize);
        let launch = subgroup.launch[caller.lane as usize];
        if let Some(traced) = self.dispatch.checks {
            self.check_record(traced, Need::Callable, callable);
        }
        let shaders = self.dispatch.shaders;
        let found = self
            .worker
            .records
            .find(shaders, &self.dispatch.tables.callable, callable);
        match found.and_then(|(group, record)| Some((group.general?, record))) {
            Some((program, record)) => {
                self.calls.push(Call {
                    program,
                    role: Role::Callable,
                    record,
                    ray: 0,
                    caller,
                    launch,
                });
            }
            None => self.answered(caller),
        }
    }

    /// A hit that an intersection shader reports: counts if it is in the ray's interval as it stands; the any-hit shader, if
    /// the geometry is not opaque and there is one, has the last word.
    fn report_intersection(&mut self, reporter: LaneRef, attribute_words: u32) {
        let lane = reporter.lane as usize;
        let subgroup = &self.worker.subgroups[reporter.subgroup];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let index = subgroup.ray[lane];
        if let Some(traced) = self.dispatch.checks {
            self.check_hit_kind(traced, reporter, subgroup.io(program, 1, lane));
        }
        let io = &subgroup.rows[program.layout().io..];
        let mut report = Report {
            t: f32::from_bits(io[0].0[lane]),
            hit_kind: io[1].0[lane] as u8,
            reporter,
            ..Report::default()
        };
        let words = &io[IO_DATA_ROW..][..attribute_words as usize];
        for (attribute, row) in report.attributes.iter_mut().zip(words) {
            *attribute = row.0[lane];
        }
        let ray = &mut self.worker.rays[index];
        let walk = ray.walk();
        // Written so that a NaN is outside.
        let inside = report.t >= walk.t_min() && report.t <= walk.t_max();
        if !inside || ray.over {
            return self.decide_report(reporter, 0);
        }
        let candidate = *walk.candidate();
        let opaque = candidate.opaque;
        let record = ray.hit_record_index(&candidate);
        let launch = ray.launch;
        if let Some(traced) = self.dispatch.checks.filter(|_| !opaque) {
            self.check_hit_record(traced, Need::AnyHit, record, &candidate);
        }
        let shaders = self.dispatch.shaders;
        let found = if opaque {
            None
        } else {
            self.worker
                .records
                .find(shaders, &self.dispatch.tables.hit, record)
        };
        match found.and_then(|(group, record)| Some((group.any_hit?, record))) {
            Some((program, record)) => {
                let role = Role::AnyHitOfReport;
                self.worker.rays[index].details_mut().report = report;
                self.calls.push(Call {
                    program,
                    role,
                    record,
                    ray: index,
                    caller: reporter,
                    launch,
                });
            }
            None => self.commit_report(index, &report, false),
        }
    }

    /// The any-hit shader accepts the reported hit.
    fn accept_report(&mut self, index: u32, terminate: bool) {
        let report = self.worker.rays[index].details_mut().report;
        self.commit_report(index, &report, terminate);
    }

    /// Commits a reported hit and tells the intersection invocation.
    fn commit_report(&mut self, index: u32, report: &Report, terminate: bool) {
        let ray = &mut self.worker.rays[index];
        ray.details_mut().attributes = report.attributes;
        let over = ray.walk_mut().commit_procedural(report.t, report.hit_kind);
        ray.over |= terminate;
        self.decide_report(report.reporter, if over || terminate { 2 } else { 1 });
    }

    /// The any-hit shader ignores the reported hit.
    fn reject_report(&mut self, index: u32) {
        let reporter = self.worker.rays[index].details_mut().report.reporter;
        self.decide_report(reporter, 0);
    }

    fn decide_report(&mut self, reporter: LaneRef, verdict: u32) {
        let subgroup = &mut self.worker.subgroups[reporter.subgroup];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        subgroup.set_io(program, 0, reporter.lane as usize, verdict);
        self.answered(reporter);
    }

    /// All invocations of a subgroup have ended: copies what they leave to those who wait.
    pub(super) fn end(&mut self, index: SubgroupIndex) {
        let worker = &mut *self.worker;
        let subgroup = &mut worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let (role, lanes, rays) = (subgroup.role, subgroup.lanes, subgroup.ray);
        // Out of the list, for the others to be written meanwhile.
        let rows = std::mem::take(&mut subgroup.rows);
        worker.queries.release(&mut subgroup.queries);
        let waiting = match role {
            Role::RayGeneration => [LaneRef::default(); SUBGROUP_SIZE],
            Role::Callable => subgroup.caller,
            _ => rays.map(|ray| worker.rays[ray].caller),
        };
        let layout = program.layout();
        self.state_bytes -= layout.rows * size_of::<AlignedRow>();
        let outputs = &rows[layout.io..][..program.output_rows() as usize];
        match role {
            Role::RayGeneration => {}
            Role::Callable => {
                self.copy_outputs(outputs, lanes, &waiting);
                self.answered_lanes(lanes, &waiting);
            }
            Role::ClosestHit | Role::Miss => {
                self.copy_outputs(outputs, lanes, &waiting);
                self.answered_lanes(lanes, &waiting);
                for lane in lanes_of(lanes) {
                    self.worker.rays.remove(rays[lane]);
                }
            }
            Role::AnyHit => {
                self.copy_outputs(&outputs[1..], lanes, &waiting);
                for lane in lanes_of(lanes) {
                    let verdict = match outputs[0].0[lane] {
                        0 => Verdict::Accept,
                        1 => Verdict::Continue,
                        _ => Verdict::AcceptAndTerminate,
                    };
                    self.walking.push((rays[lane], verdict));
                }
            }
            Role::AnyHitOfReport => {
                self.copy_outputs(&outputs[1..], lanes, &waiting);
                for lane in lanes_of(lanes) {
                    match outputs[0].0[lane] {
                        1 => self.reject_report(rays[lane]),
                        verdict => self.accept_report(rays[lane], verdict != 0),
                    }
                }
            }
            Role::Intersection => {
                for lane in lanes_of(lanes) {
                    let verdict = match self.worker.rays[rays[lane]].over {
                        true => Verdict::Terminate,
                        false => Verdict::Continue,
                    };
                    self.walking.push((rays[lane], verdict));
                }
            }
        }
        let subgroup = &mut self.worker.subgroups[index];
        subgroup.rows = rows;
        subgroup.lanes = 0;
        self.worker.subgroups.remove(index);
    }

    /// Copies what lanes leave over the data that those stand with who wait for them.
    fn copy_outputs(
        &mut self,
        outputs: &[AlignedRow],
        lanes: u16,
        waiting: &[LaneRef; SUBGROUP_SIZE],
    ) {
        for (index, lanes) in by_subgroup(lanes, waiting) {
            let target = &mut self.worker.subgroups[index];
            let program = &self.dispatch.shaders.programs[target.program as usize];
            let data = &mut target.rows[program.layout().io + IO_DATA_ROW..];
            let words = data
                .iter_mut()
                .zip(outputs)
                .take(target.data_words as usize);
            if in_place(lanes, waiting) {
                for (to, from) in words {
                    for lane in 0..SUBGROUP_SIZE {
                        let copied = lanes & 1 << lane != 0;
                        to.0[lane] = if copied { from.0[lane] } else { to.0[lane] };
                    }
                }
            } else {
                for (to, from) in words {
                    for lane in lanes_of(lanes) {
                        to.0[waiting[lane].lane as usize % SUBGROUP_SIZE] = from.0[lane];
                    }
                }
            }
        }
    }

    pub(super) fn finish_ray(&mut self, index: u32) {
        self.answered(self.worker.rays[index].caller);
        self.worker.rays.remove(index);
    }
}
