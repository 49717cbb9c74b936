//! Events of all rays and calls of a batch, for the observers that take them.

use lanes::LaneMask;
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::program::Row;
use traversal::Ray;

use super::batch::Batch;
use super::rays::{alike, operand, record_indices, structure_in};
use super::subgroup::{LaneRef, Role, SubgroupIndex};
use crate::wave::binding_table::ProgramIndex;
use crate::wave::observer::{
    Instruction, Interests, LookupPurpose, Observer, RecordLookup, ShaderCall, StartedRay,
    TableKind,
};

impl<'a> Batch<'a> {
    /// The observer, if it takes such events.
    fn observer_of(&self, takes: impl Fn(Interests) -> bool) -> Option<&'a dyn Observer> {
        let observer = self.dispatch.observer?;
        takes(observer.interests()).then_some(observer)
    }

    /// The rays of a group that has just been started.
    pub(super) fn show_rays(&self, index: u32, instruction: Instruction) {
        let Some(observer) = self.observer_of(|takes| takes.rays) else {
            return;
        };
        let group = &self.worker.ray_groups[index];
        let operands = group.operands(&self.worker.subgroups);
        let rays = group.rays(operands, self.dispatch);
        for lane in group.in_flight {
            let structure = self.dispatch.limits.structure(rays.top_level[lane]);
            observer.ray(&StartedRay {
                instruction,
                has_time: group.has_time,
                place: self.shader_of(group.caller),
                ray: Ray {
                    flags: operands[operand::FLAGS].0[lane],
                    ..rays.ray(lane)
                },
                time: rays.time[lane],
                structure: structure_in(operands, lane),
                kind: structure.map(|structure| structure.kind()),
            });
        }
    }

    /// Hits that intersection shaders of lanes report.
    pub(super) fn show_reports(&self, index: SubgroupIndex, lanes: LaneMask) {
        let worker = &*self.worker;
        let subgroup = &worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        if let Some(observer) = self.observer_of(|takes| takes.rays) {
            for lane in lanes {
                observer.hit_kind(program.number(), subgroup.io(program, 1, lane));
            }
        }
        if self.observer_of(|takes| takes.lookups).is_none() {
            return;
        }
        for lane in lanes {
            let ray = subgroup.of[lane];
            let group = &worker.ray_groups[ray.index()];
            let candidates = group.group_walk.candidates();
            let t = [f32::from_bits(subgroup.io(program, 0, lane)); SUBGROUP_SIZE];
            let at = LaneMask::of(ray.lane());
            let counts = group.group_walk.counts(at, &t);
            if !counts.is_empty() && !candidates.opaque().contains(ray.lane()) {
                let operands = group.operands(&worker.subgroups);
                let records = record_indices(self.dispatch.tier, candidates, operands);
                let boxes = at - candidates.built_in();
                self.show_lookups(LookupPurpose::AnyHitOfReport, &records, at, boxes);
            }
        }
    }

    /// Rays of lanes look up records; hits of `boxes` are on boxes.
    pub(super) fn show_lookups(
        &self,
        purpose: LookupPurpose,
        indices: &Row,
        lanes: LaneMask,
        boxes: LaneMask,
    ) {
        let Some(observer) = self.observer_of(|takes| takes.lookups) else {
            return;
        };
        let tables = &self.dispatch.tables;
        let region = match purpose.table() {
            TableKind::RayGeneration => &tables.raygen,
            TableKind::Miss => &tables.miss,
            TableKind::Hit => &tables.hit,
            TableKind::Callable => &tables.callable,
        };
        for (lanes, is_box) in [(lanes - boxes, false), (lanes & boxes, true)] {
            let mut rest = lanes;
            while !rest.is_empty() {
                let index = indices[rest.first()];
                let same = alike(indices, rest);
                rest -= same;
                let record = region.handle(index);
                observer.look_up(&RecordLookup {
                    purpose,
                    region: region.region(),
                    index,
                    record: record
                        .map(|(_, handle)| (handle, self.dispatch.shaders.group(&handle))),
                    is_box,
                    rays: same.count(),
                });
            }
        }
    }

    /// Calls of a shader, each for what `of` names, which are about to be made.
    #[cold]
    pub(super) fn show_calls(
        &self,
        (program, role): (ProgramIndex, Role),
        calls: impl Iterator<Item = LaneRef>,
    ) {
        if let Some(observer) = self.observer_of(|takes| takes.rays) {
            for of in calls {
                observer.call(&self.call_of(program, role, of));
            }
        }
    }

    fn call_of(&self, program: ProgramIndex, role: Role, of: LaneRef) -> ShaderCall {
        let programs = &self.dispatch.shaders.programs;
        let stack = |program: u32| u64::from(programs[program as usize].stack_size_bytes());
        let (mut stack_bytes, mut depth) = (stack(program), 0);
        let (mut role, mut of) = (role, of);
        while role != Role::RayGeneration {
            let mut waits = of;
            if role != Role::Callable {
                depth += 1;
                waits = LaneRef::new(self.worker.ray_groups[of.index()].caller, of.lane());
            }
            let subgroup = &self.worker.subgroups[waits.index()];
            stack_bytes += stack(subgroup.program);
            (role, of) = (subgroup.role, subgroup.of[waits.lane()]);
        }
        ShaderCall {
            place: programs[program as usize].number(),
            depth,
            stack_bytes,
        }
    }

    /// Tells the shaders of the process apart.
    fn shader_of(&self, index: SubgroupIndex) -> u64 {
        let program = self.worker.subgroups[index].program;
        self.dispatch.shaders.programs[program as usize].number()
    }
}
