//! What a yield asks for and what an end leaves: traces, calls and reports begin here, and are answered here.

use spirv_jit::program::{AlignedRow, IO_DATA_ROW, SiteKind};
use traversal::Verdict;

use super::batch::Batch;
use super::calls::Call;
use super::rays::Report;
use super::subgroup::{LaneRef, Role, Subgroup, SubgroupIndex, lanes_of};

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
        for lane in lanes_of(mask) {
            let caller = LaneRef {
                subgroup: index,
                lane: lane as u8,
            };
            match site {
                SiteKind::TraceRay { .. } => self.trace_ray(caller, false, false),
                SiteKind::TraceRayMotion { .. } => self.trace_ray(caller, false, true),
                SiteKind::HitObjectTraceRay { .. } => self.trace_ray(caller, true, false),
                SiteKind::HitObjectTraceRayMotion { .. } => self.trace_ray(caller, true, true),
                SiteKind::HitObjectExecute { .. } => self.execute_hit_object(caller),
                SiteKind::HitObjectGet { fact } => self.answer_fact(caller, fact),
                SiteKind::ReportIntersection { attribute_words } => {
                    self.report_intersection(caller, attribute_words)
                }
                SiteKind::ExecuteCallable { .. } => self.execute_callable(caller),
                // Barriers exist in compute alone; a ray tracing module that has one is refused.
                SiteKind::Barrier | SiteKind::ReorderThread | SiteKind::RayQueryProceed => {
                    self.answered(caller)
                }
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

    fn trace_ray(&mut self, caller: LaneRef, fills_hit_object: bool, motion: bool) {
        let index = self.worker.rays.take();
        let subgroup = &self.worker.subgroups[caller.subgroup];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let ray = &mut self.worker.rays[index];
        let flags = self.dispatch.pipeline_ray_flags;
        ray.start(caller, subgroup, program, flags, motion);
        ray.fills_hit_object = fills_hit_object;
        self.walking.push((index, Verdict::Continue));
    }

    fn execute_callable(&mut self, caller: LaneRef) {
        let subgroup = &self.worker.subgroups[caller.subgroup];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let callable = subgroup.io(program, 0, caller.lane as usize);
        let launch = subgroup.launch[caller.lane as usize];
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
        let report = Report {
            t: f32::from_bits(subgroup.io(program, 0, lane)),
            hit_kind: subgroup.io(program, 1, lane) as u8,
            attributes: std::array::from_fn(|word| {
                if (word as u32) < attribute_words {
                    subgroup.io(program, IO_DATA_ROW + word, lane)
                } else {
                    0
                }
            }),
            reporter,
        };
        let ray = &mut self.worker.rays[index];
        let walk = ray.walk();
        // Written so that a NaN is outside.
        let inside = report.t >= walk.t_min() && report.t <= walk.t_max();
        if !inside || ray.over {
            return self.decide_report(reporter, 0);
        }
        let opaque = walk.candidate().opaque;
        let record = ray.hit_record_index(walk.candidate());
        ray.report = report;
        let launch = ray.launch;
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
                self.calls.push(Call {
                    program,
                    role,
                    record,
                    ray: index,
                    caller: reporter,
                    launch,
                });
            }
            None => self.commit_report(index, false),
        }
    }

    /// Commits the reported hit and tells the intersection invocation.
    fn commit_report(&mut self, index: u32, terminate: bool) {
        let ray = &mut self.worker.rays[index];
        let Report {
            t,
            hit_kind,
            attributes,
            reporter,
        } = ray.report;
        ray.attributes = attributes;
        let over = ray.walk_mut().commit_procedural(t, hit_kind);
        ray.over |= terminate;
        self.decide_report(reporter, if over || terminate { 2 } else { 1 });
    }

    fn decide_report(&mut self, reporter: LaneRef, verdict: u32) {
        let subgroup = &mut self.worker.subgroups[reporter.subgroup];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        subgroup.set_io(program, 0, reporter.lane as usize, verdict);
        self.answered(reporter);
    }

    /// All invocations of a subgroup have ended: copies what they leave to those who wait.
    pub(super) fn end(&mut self, index: SubgroupIndex) {
        let mut subgroup = std::mem::take(&mut self.worker.subgroups[index]);
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        self.state_bytes -= program.layout().rows * size_of::<AlignedRow>();
        self.worker.queries.release(&mut subgroup.queries);
        for lane in lanes_of(subgroup.lanes) {
            let ray = subgroup.ray[lane];
            match subgroup.role {
                Role::RayGeneration => {}
                Role::Callable => {
                    self.copy_outputs(&subgroup, 0, lane, subgroup.caller[lane]);
                    self.answered(subgroup.caller[lane]);
                }
                Role::ClosestHit | Role::Miss => {
                    self.copy_outputs(&subgroup, 0, lane, self.worker.rays[ray].caller);
                    self.finish_ray(ray);
                }
                Role::AnyHit => {
                    self.copy_outputs(&subgroup, 1, lane, self.worker.rays[ray].caller);
                    let verdict = match subgroup.io(program, 0, lane) {
                        0 => Verdict::Accept,
                        1 => Verdict::Continue,
                        _ => Verdict::AcceptAndTerminate,
                    };
                    self.walking.push((ray, verdict));
                }
                Role::AnyHitOfReport => {
                    self.copy_outputs(&subgroup, 1, lane, self.worker.rays[ray].caller);
                    match subgroup.io(program, 0, lane) {
                        1 => self.decide_report(self.worker.rays[ray].report.reporter, 0),
                        verdict => self.commit_report(ray, verdict != 0),
                    }
                }
                Role::Intersection => {
                    let over = self.worker.rays[ray].over;
                    self.walking.push((
                        ray,
                        if over {
                            Verdict::Terminate
                        } else {
                            Verdict::Continue
                        },
                    ));
                }
            }
        }
        subgroup.lanes = 0;
        self.worker.subgroups[index] = subgroup;
        self.worker.subgroups.remove(index);
    }

    /// Copies a lane's outputs from row `first` on over the data that `to` stands with.
    fn copy_outputs(&mut self, from: &Subgroup, first: usize, lane: usize, to: LaneRef) {
        let programs = &self.dispatch.shaders.programs;
        let (source, target) = (
            &programs[from.program as usize],
            &mut self.worker.subgroups[to.subgroup],
        );
        let words = (source.output_rows() as usize - first).min(target.data_words as usize);
        let target_program = &programs[target.program as usize];
        for word in 0..words {
            let value = from.io(source, first + word, lane);
            target.set_io(target_program, IO_DATA_ROW + word, to.lane as usize, value);
        }
    }

    pub(super) fn finish_ray(&mut self, index: u32) {
        self.answered(self.worker.rays[index].caller);
        self.worker.rays.remove(index);
    }
}
