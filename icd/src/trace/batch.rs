//! One batch: run ready waves, advance walks, form waves of the calls; until nothing is left.

use spirv_jit::program::{AlignedRow, Event, IO_DATA_ROW, ResumePoint, SiteKind, Wave};
use spirv_jit::{SUBGROUP_SIZE, interp::Frame};
use traversal::{PACKET, Verdict, Walk, Walker};

use super::calls::{Call, Records, sort_calls, split_subgroup};
use super::grid::Grid;
use super::inputs::Sources;
use super::queries::Queries;
use super::rays::{RayInFlight, Report};
use super::slab::Slab;
use super::stats::Tally;
use super::subgroup::{LaneRef, Role, Subgroup, SubgroupIndex, lanes_of};
use super::table::ProgramIndex;
use super::{Dispatch, Stopped};

/// Fuel of one run or walk between two looks at the limits.
const FUEL: u64 = 1 << 16;

/// Waves between two looks at the limits.
const PATIENCE: u32 = 256;

/// Subgroup states that a batch may have in flight, in bytes: recursion ends in a device loss there, not in an abort.
const MAX_STATE_BYTES: usize = 1 << 30;

/// A worker's memory, kept warm from batch to batch.
pub struct Worker {
    frame: Frame,
    walker: Box<Walker>,
    pub(super) subgroups: Slab<Subgroup>,
    pub(super) rays: Slab<RayInFlight>,
    pub(super) records: Records,
    /// States without a subgroup, for their memory.
    pub(super) spare_rows: Vec<Vec<AlignedRow>>,
    pub(super) queries: Queries,
}

impl Default for Worker {
    fn default() -> Self {
        Self {
            frame: Frame::default(),
            walker: Walker::new(),
            subgroups: Slab::default(),
            rays: Slab::default(),
            records: Records::default(),
            spare_rows: Vec::new(),
            queries: Queries::default(),
        }
    }
}

/// Subgroups of one program that stand at one point.
struct Ready {
    program: ProgramIndex,
    point: ResumePoint,
    subgroups: Vec<SubgroupIndex>,
}

/// A batch being turned.
pub struct Batch<'a> {
    pub(super) dispatch: &'a Dispatch<'a>,
    grid: &'a Grid,
    pub(super) worker: &'a mut Worker,
    ready: Vec<Ready>,
    /// Rays whose walk can go on.
    walking: Vec<(u32, Verdict)>,
    pub(super) calls: Vec<Call>,
    /// Subgroups that stand at a reorder instruction.
    pub(super) reordering: Vec<SubgroupIndex>,
    pub(super) state_bytes: usize,
    /// Waves until the next look at the limits: a shader that always yields never runs out of fuel.
    patience: u32,
    tally: Option<Tally>,
}

impl<'a> Batch<'a> {
    /// An empty batch of a dispatch.
    pub fn new(dispatch: &'a Dispatch<'a>, grid: &'a Grid, worker: &'a mut Worker) -> Self {
        worker.subgroups.clear();
        worker.rays.clear();
        worker.records = Records::default();
        worker.queries.clear();
        Self {
            dispatch,
            grid,
            worker,
            ready: Vec::new(),
            walking: Vec::new(),
            calls: Vec::new(),
            reordering: Vec::new(),
            state_bytes: 0,
            patience: PATIENCE,
            tally: Tally::new(dispatch.shaders.programs.len()),
        }
    }

    /// Runs the invocations of batch `index` to their end.
    ///
    /// # Errors
    /// A limit was reached.
    pub fn run(mut self, raygen: ProgramIndex, record: u64, index: usize) -> Result<(), Stopped> {
        for mut tile in self.grid.tiles(index) {
            if let Some(mask) = &self.dispatch.mask {
                mask.apply(&mut tile, |launch| self.grid.launch_id(launch));
                if tile.mask == 0 {
                    continue;
                }
            }
            let subgroup = self.new_subgroup(raygen, Role::RayGeneration, tile.mask)?;
            self.worker.subgroups[subgroup].launch = tile.launch;
            self.start(subgroup, &[record; SUBGROUP_SIZE]);
        }
        loop {
            while !self.ready.is_empty() || !self.walking.is_empty() || !self.calls.is_empty() {
                self.run_ready_waves()?;
                self.advance_walks()?;
                self.form_waves()?;
            }
            if self.reordering.is_empty() {
                break;
            }
            self.reorder_threads();
        }
        if let Some(tally) = &mut self.tally {
            tally.close(|index| &self.dispatch.shaders.programs[index]);
        }
        Ok(())
    }

    /// Takes a place for a subgroup at its program's entry.
    fn new_subgroup(
        &mut self,
        program: ProgramIndex,
        role: Role,
        lanes: u16,
    ) -> Result<SubgroupIndex, Stopped> {
        let compiled = &self.dispatch.shaders.programs[program as usize];
        self.state_bytes += compiled.layout().rows * size_of::<AlignedRow>();
        if self.state_bytes > MAX_STATE_BYTES {
            return Err(Stopped::OutOfMemory);
        }
        let index = self.worker.subgroups.take();
        self.worker.subgroups[index].start(program, compiled, role, lanes);
        Ok(index)
    }

    /// Fills a new subgroup's inputs and makes it ready.
    fn start(&mut self, index: SubgroupIndex, records: &[u64; SUBGROUP_SIZE]) {
        let mut subgroup = std::mem::take(&mut self.worker.subgroups[index]);
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let sources = Sources {
            dispatch: self.dispatch,
            grid: self.grid,
            subgroups: &self.worker.subgroups,
            rays: &self.worker.rays,
        };
        sources.fill(program, &mut subgroup, records);
        self.worker.subgroups[index] = subgroup;
        self.make_ready(index);
    }

    pub(super) fn make_ready(&mut self, index: SubgroupIndex) {
        let subgroup = &self.worker.subgroups[index];
        let program = subgroup.program;
        let point = self.dispatch.shaders.programs[program as usize].resume_point(&subgroup.rows);
        match self
            .ready
            .iter_mut()
            .find(|ready| (ready.program, ready.point) == (program, point))
        {
            Some(ready) => ready.subgroups.push(index),
            None => self.ready.push(Ready {
                program,
                point,
                subgroups: vec![index],
            }),
        }
    }

    /// Runs until every subgroup waits for a ray, a verdict or a callee.
    fn run_ready_waves(&mut self) -> Result<(), Stopped> {
        while let Some(fullest) =
            (0..self.ready.len()).max_by_key(|&i| self.ready[i].subgroups.len())
        {
            let Ready {
                program,
                point,
                mut subgroups,
            } = self.ready.swap_remove(fullest);
            let width = self.dispatch.shaders.programs[program as usize]
                .max_wave_subgroups()
                .max(1);
            subgroups.sort_unstable();
            self.compact(program, point, &mut subgroups);
            for wave in subgroups.chunks(width) {
                self.run_wave(program, wave)?;
            }
        }
        Ok(())
    }

    fn run_wave(&mut self, program: ProgramIndex, wave: &[SubgroupIndex]) -> Result<(), Stopped> {
        let compiled = &self.dispatch.shaders.programs[program as usize];
        let mut rows: Vec<_> = wave
            .iter()
            .map(|&index| std::mem::take(&mut self.worker.subgroups[index].rows))
            .collect();
        if let Some(tally) = &mut self.tally {
            tally.count(program, compiled, &rows);
        }
        let mut states: Vec<&mut [AlignedRow]> =
            rows.iter_mut().map(|rows| &mut rows[..]).collect();
        let mut fuel = FUEL;
        let event = compiled.run(
            &mut self.worker.frame,
            &mut Wave {
                states: &mut states,
                shared: std::ptr::null_mut(),
                environment: self.dispatch.environment,
            },
            &mut fuel,
        );
        for (&index, rows) in wave.iter().zip(rows) {
            self.worker.subgroups[index].rows = rows;
        }
        for &index in wave {
            match event {
                Event::End => self.end(index),
                Event::OutOfFuel => self.make_ready(index),
                Event::Yield(site) => match compiled.sites()[site.0 as usize] {
                    SiteKind::RayQueryProceed => self.proceed(index)?,
                    kind => self.answer(index, kind),
                },
            }
        }
        self.patience -= 1;
        if event == Event::OutOfFuel || self.patience == 0 {
            self.patience = PATIENCE;
            self.dispatch.limits.check()
        } else {
            Ok(())
        }
    }

    /// Advances the ray queries of a subgroup, which then goes on.
    fn proceed(&mut self, index: SubgroupIndex) -> Result<(), Stopped> {
        let worker = &mut *self.worker;
        let subgroup = &mut worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        worker.queries.proceed(
            &mut worker.walker,
            program,
            &mut subgroup.rows,
            &mut subgroup.queries,
            self.dispatch.limits,
        )?;
        self.make_ready(index);
        Ok(())
    }

    /// Starts what a yield asks for, lane by lane.
    fn answer(&mut self, index: SubgroupIndex, site: SiteKind) {
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
    fn end(&mut self, index: SubgroupIndex) {
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

    /// Advances every walk until a shader has to run, or to its end.
    fn advance_walks(&mut self) -> Result<(), Stopped> {
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
        let record = ray.hit_record_index(ray.walk().candidate());
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

    /// Makes subgroups of the waiting calls: full ones of one shader each, whatever the divergence of those who called.
    fn form_waves(&mut self) -> Result<(), Stopped> {
        let mut calls = std::mem::take(&mut self.calls);
        sort_calls(&mut calls);
        let mut rest = &calls[..];
        while !rest.is_empty() {
            let (these, others) = split_subgroup(rest);
            self.form_subgroup(these)?;
            rest = others;
        }
        calls.clear();
        self.calls = calls;
        Ok(())
    }

    fn form_subgroup(&mut self, calls: &[Call]) -> Result<(), Stopped> {
        let lanes = u16::MAX >> (SUBGROUP_SIZE - calls.len());
        let index = self.new_subgroup(calls[0].program, calls[0].role, lanes)?;
        let subgroup = &mut self.worker.subgroups[index];
        let mut records = [0; SUBGROUP_SIZE];
        for (lane, record) in records.iter_mut().enumerate() {
            let call = calls.get(lane).unwrap_or(&calls[0]);
            subgroup.ray[lane] = call.ray;
            subgroup.caller[lane] = call.caller;
            subgroup.launch[lane] = call.launch;
            *record = call.record;
        }
        self.start(index, &records);
        Ok(())
    }
}
