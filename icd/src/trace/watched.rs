//! The calls of an observer during a batch. Nothing here runs without one that takes events of
//! rays.

use lanes::LaneMask;
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::program::{IO_DATA_ROW, Row, Trace};
use traversal::Ray;

use super::batch::Batch;
use super::rays::{operand, record_indices, skips_closest_hit, structure_in};
use super::subgroup::{Role, SubgroupIndex};
use crate::wave::observer::{
    Instruction, LookupPurpose, Observation, Observer, RayStart, ReportVerdict, Reported,
    TableOperands,
};
use crate::wave::queries::Seen;

impl<'a> Batch<'a> {
    /// The observer and the lane of the observed invocation, if it is one of some lanes of a
    /// subgroup.
    fn observed(&self, index: SubgroupIndex, lanes: LaneMask) -> Option<(&'a dyn Observer, usize)> {
        if !self.takes_events {
            return None;
        }
        let observer = self.dispatch.observer?;
        let [x, y, z] = observer.invocation()?;
        if z != self.layer {
            return None;
        }
        let launch = &self.worker.subgroups[index].launch;
        let here = LaneMask::holding(&launch.x, x) & LaneMask::holding(&launch.y, y) & lanes;
        Some((observer, here.iter().next()?))
    }

    /// The observer's view of a subgroup whose queries proceed.
    #[cold]
    pub(super) fn seen(&self, index: SubgroupIndex) -> Seen<'a> {
        let subgroup = &self.worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        Seen {
            one: self.observed(index, program.event_mask(&subgroup.rows)),
            counted: self.counted(index),
        }
    }

    /// Words of the payload or callable data that a lane of a subgroup keeps for what it waits for.
    fn data_of_lane(&self, index: SubgroupIndex, lane: usize) -> Vec<u32> {
        let sources = self.sources();
        let data = sources.data_of(index);
        data.iter().map(|row| row.0[lane]).collect()
    }

    /// Rays that a trace instruction has started.
    #[cold]
    pub(super) fn watch_rays(&self, index: u32, trace: Trace) {
        if !self.takes_events {
            return;
        }
        let instruction = match trace.to_hit_object {
            true => Instruction::HitObjectTrace,
            false => Instruction::TraceRay,
        };
        self.show_rays(index, instruction);
        self.watch_ray(index, instruction);
    }

    /// The observed ray of a group that starts, if it is there.
    #[cold]
    pub(super) fn watch_ray(&self, index: u32, instruction: Instruction) {
        let group = &self.worker.ray_groups[index];
        let Some((observer, lane)) = self.observed(group.caller, group.in_flight) else {
            return;
        };
        let caller = &self.worker.subgroups[group.caller];
        let program = &self.dispatch.shaders.programs[caller.program as usize];
        let operands = group.operands(&self.worker.subgroups);
        let rays = group.rays(operands, self.dispatch);
        let word = |row: usize| operands[row].0[lane];
        let executes = instruction == Instruction::HitObjectExecute;
        observer.observe(Observation::Ray(Box::new(RayStart {
            instruction,
            place: program.place_of(&caller.rows),
            ray: Ray {
                flags: word(operand::FLAGS),
                ..rays.ray(lane)
            },
            pipeline_flags: self.dispatch.pipeline_ray_flags,
            time: rays.time[lane],
            structure: structure_in(operands, lane),
            operands: (!executes).then(|| TableOperands {
                offset: word(operand::SBT_OFFSET),
                stride: word(operand::SBT_STRIDE),
                miss_index: word(operand::MISS_INDEX),
            }),
            payload: self.data_of_lane(group.caller, lane),
        })));
    }

    /// Candidates of lanes of a group whose records are looked up now.
    #[cold]
    pub(super) fn watch_candidates(&mut self, index: u32, lanes: LaneMask, records: &Row) {
        let group = &self.worker.ray_groups[index];
        let candidates = group.group_walk.candidates();
        let triangles = candidates.built_in();
        for (purpose, lanes) in [
            (LookupPurpose::AnyHit, lanes & triangles),
            (LookupPurpose::Intersection, lanes - triangles),
        ] {
            self.show_lookups(purpose, records, lanes, lanes - triangles);
        }
        let Some((_, lane)) = self.observed(group.caller, lanes) else {
            return;
        };
        let (hit, record) = (candidates.hit(lane), records[lane]);
        let role = match triangles.contains(lane) {
            true => Role::AnyHit,
            false => Role::Intersection,
        };
        let shader = self.find_decider(record, role).map(|found| found.0);
        self.observe(Observation::Candidate {
            hit,
            record,
            shader,
        });
    }

    fn observe(&self, event: Observation) {
        if let Some(observer) = self.dispatch.observer {
            observer.observe(event);
        }
    }

    /// Hits that intersection shaders of lanes report.
    #[cold]
    pub(super) fn watch_reports(
        &mut self,
        index: SubgroupIndex,
        lanes: LaneMask,
        attribute_words: usize,
    ) {
        self.show_reports(index, lanes);
        let Some((_, lane)) = self.observed(index, lanes) else {
            return;
        };
        let subgroup = &self.worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let ray = subgroup.of[lane];
        let t = f32::from_bits(subgroup.io(program, 0, lane));
        let hit_kind = subgroup.io(program, 1, lane) as u8;
        let words = 0..attribute_words;
        let attributes = words.map(|word| subgroup.io(program, IO_DATA_ROW + word, lane));
        let attributes = attributes.collect();
        let group = &self.worker.ray_groups[ray.index()];
        let candidates = group.group_walk.candidates();
        let at = LaneMask::of(ray.lane());
        let counts = group.group_walk.counts(at, &[t; SUBGROUP_SIZE]);
        let is_opaque = candidates.opaque().contains(ray.lane());
        let operands = group.operands(&self.worker.subgroups);
        let record = record_indices(self.dispatch.tier, candidates, operands)[ray.lane()];
        let verdict = match () {
            () if counts.is_empty() => ReportVerdict::OutsideInterval,
            () if is_opaque => ReportVerdict::Committed,
            () => match self.find_decider(record, Role::AnyHit) {
                Some(_) => ReportVerdict::Asked,
                None => ReportVerdict::Committed,
            },
        };
        self.observe(Observation::Report(Box::new(Reported {
            t,
            hit_kind,
            attributes,
            verdict,
        })));
    }

    /// The walks of a group are over.
    #[cold]
    pub(super) fn watch_end_of_walks(&mut self, index: u32, records: &Row) {
        self.note_walks(index);
        if !self.takes_events {
            return;
        }
        let group = &self.worker.ray_groups[index];
        let lanes = group.in_flight;
        let operands = group.operands(&self.worker.subgroups);
        let hits = group.group_walk.hits.found & lanes;
        let silent = hits & skips_closest_hit(operands);
        let fills = group.fills_hit_object;
        if !fills {
            let boxes = hits.iter().filter(|&lane| {
                let hit = group.group_walk.hits.get(lane);
                hit.is_some_and(|hit| !hit.is_built_in())
            });
            let boxes = boxes.fold(LaneMask::NONE, |boxes, lane| boxes | LaneMask::of(lane));
            for (purpose, lanes) in [
                (LookupPurpose::ClosestHit, hits - silent),
                (LookupPurpose::SkippedClosestHit, silent),
                (LookupPurpose::Miss, lanes - hits),
            ] {
                self.show_lookups(purpose, records, lanes, boxes);
            }
        }
        let Some((_, lane)) = self.observed(group.caller, lanes) else {
            return;
        };
        let hit = group.group_walk.hits.get(lane);
        let is_reported = hit.is_some_and(|hit| !hit.is_built_in());
        let procedural = group.procedural().filter(|_| is_reported);
        let attributes = procedural.map_or(Vec::new(), |rays| {
            rays.attributes.iter().map(|row| row[lane]).collect()
        });
        let record = records[lane];
        let (shaders, tables) = (self.dispatch.shaders, &self.dispatch.tables);
        let (table, skips) = match hit {
            Some(_) => (&tables.hit, silent.contains(lane)),
            None => (&tables.miss, false),
        };
        let found = self.worker.records.find(shaders, table, record);
        let shader = found.and_then(|(group, _)| match hit {
            Some(_) => group.closest_hit,
            None => group.general,
        });
        self.observe(Observation::Settled {
            hit,
            attributes,
            record,
            shader: shader.filter(|_| !fills && !skips),
        });
    }

    /// Lanes of a subgroup call callables.
    #[cold]
    pub(super) fn watch_callables(
        &mut self,
        index: SubgroupIndex,
        callables: &Row,
        lanes: LaneMask,
    ) {
        self.show_lookups(LookupPurpose::Callable, callables, lanes, LaneMask::NONE);
        let Some((_, lane)) = self.observed(index, lanes) else {
            return;
        };
        let (shaders, table) = (self.dispatch.shaders, &self.dispatch.tables.callable);
        let found = self.worker.records.find(shaders, table, callables[lane]);
        self.observe(Observation::Callable {
            index: callables[lane],
            shader: found.and_then(|(group, _)| group.general),
        });
    }

    /// A called subgroup is about to run.
    #[cold]
    pub(super) fn watch_start(&self, index: SubgroupIndex, records: &[u64; SUBGROUP_SIZE]) {
        let subgroup = &self.worker.subgroups[index];
        self.count_call(index);
        let Some((observer, lane)) = self.observed(index, subgroup.lanes) else {
            return;
        };
        observer.observe(Observation::Begin {
            program: subgroup.program,
            record: records[lane],
            data: self.callers_data(index, lane),
        });
    }

    /// The payload or callable data of the caller of a lane.
    fn callers_data(&self, index: SubgroupIndex, lane: usize) -> Vec<u32> {
        let subgroup = &self.worker.subgroups[index];
        let of = subgroup.of[lane];
        let caller = match subgroup.role {
            Role::Callable => of.index(),
            _ => self.worker.ray_groups[of.index()].caller,
        };
        self.data_of_lane(caller, of.lane())
    }

    /// A called subgroup has ended; its results are not copied yet.
    #[cold]
    pub(super) fn watch_end(&self, index: SubgroupIndex) {
        let subgroup = &self.worker.subgroups[index];
        let Some((observer, lane)) = self.observed(index, subgroup.lanes) else {
            return;
        };
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let mut data = self.callers_data(index, lane);
        let mut outputs = 0..program.output_rows() as usize;
        let mut decision = 0;
        match subgroup.role {
            Role::AnyHit | Role::AnyHitOfReport => {
                decision = subgroup.io(program, 0, lane);
                outputs.next();
            }
            // Its outputs are none of the payload.
            Role::Intersection => outputs = 0..0,
            _ => {}
        }
        for (word, row) in data.iter_mut().zip(outputs) {
            *word = subgroup.io(program, row, lane);
        }
        observer.observe(Observation::End { data, decision });
    }
}
