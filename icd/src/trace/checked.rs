//! Checks of validation during a batch. Nothing here runs while validation is off.

use lanes::LaneMask;
use spirv_jit::SUBGROUP_SIZE;
use traversal::{Hit, Ray};

use super::batch::Batch;
use super::rays::{operand, record_indices, structure_in};
use super::subgroup::{LaneRef, Role, SubgroupIndex};
use crate::validate::{Instruction, Lookup, Need, Traced};
use crate::wave::table::{Live, ProgramIndex};

impl Batch<'_> {
    /// The rays of a group that has just been started.
    #[cold]
    pub(super) fn check_rays(&self, traced: &Traced, index: u32, instruction: Instruction) {
        let group = &self.worker.ray_groups[index];
        let operands = group.operands(&self.worker.subgroups);
        let rays = group.rays(operands, self.dispatch);
        for lane in group.in_flight {
            let as_given = Ray {
                flags: operands[operand::FLAGS].0[lane],
                ..rays.ray(lane)
            };
            let structure = self.dispatch.limits.structure(rays.top_level[lane]);
            let kind = structure.map(|structure| structure.kind());
            let (place, named) = (self.shader_of(group.caller), structure_in(operands, lane));
            traced.ray(instruction, place, &as_given, rays.time[lane], named, kind);
        }
    }

    /// A hit that an intersection shader reports.
    #[cold]
    pub(super) fn check_report(&self, traced: &Traced, index: SubgroupIndex, lane: usize) {
        let worker = &*self.worker;
        let subgroup = &worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        traced.hit_kind(self.shader_of(index), subgroup.io(program, 1, lane));
        let ray = subgroup.of[lane];
        let group = &worker.ray_groups[ray.index()];
        let candidates = group.flight.candidates();
        let t = [f32::from_bits(subgroup.io(program, 0, lane)); SUBGROUP_SIZE];
        let counts = group.flight.counts(LaneMask::of(ray.lane()), &t);
        if !counts.is_empty() && !candidates.opaque().contains(ray.lane()) {
            let records = record_indices(
                self.dispatch.tier,
                candidates,
                group.operands(&worker.subgroups),
            );
            let (record, candidate) = (records[ray.lane()], candidates.hit(ray.lane()));
            self.check_hit_record(traced, Need::AnyHit, record, &candidate);
        }
    }

    /// A record that is looked up for a hit.
    #[cold]
    pub(super) fn check_hit_record(&self, traced: &Traced, need: Need, index: u32, hit: &Hit) {
        let is_box = !hit.is_built_in();
        self.check(traced, need, &self.dispatch.tables.hit, index, is_box);
    }

    /// A record that is looked up for a miss or a callable shader.
    #[cold]
    pub(super) fn check_record(&self, traced: &Traced, need: Need, index: u32) {
        let tables = &self.dispatch.tables;
        let region = match need {
            Need::Callable => &tables.callable,
            _ => &tables.miss,
        };
        self.check(traced, need, region, index, false);
    }

    fn check(&self, traced: &Traced, need: Need, region: &Live, index: u32, is_box: bool) {
        let record = region
            .handle(index)
            .map(|(_, handle)| (handle, self.dispatch.shaders.group(&handle)));
        traced.lookup(&Lookup {
            need,
            region: region.region(),
            index,
            record,
            is_box,
        });
    }

    /// A shader that is about to be called.
    #[cold]
    pub(super) fn check_call(
        &self,
        traced: &Traced,
        program: ProgramIndex,
        role: Role,
        of: LaneRef,
    ) {
        let programs = &self.dispatch.shaders.programs;
        let stack = |program: u32| u64::from(programs[program as usize].stack_size_bytes());
        let (mut bytes, mut depth) = (stack(program), 0);
        let (mut role, mut of) = (role, of);
        while role != Role::RayGeneration {
            let mut waits = of;
            if role != Role::Callable {
                depth += 1;
                waits = LaneRef::new(self.worker.ray_groups[of.index()].caller, of.lane());
            }
            let subgroup = &self.worker.subgroups[waits.index()];
            bytes += stack(subgroup.program);
            (role, of) = (subgroup.role, subgroup.of[waits.lane()]);
        }
        traced.call(programs[program as usize].number(), depth, bytes);
    }

    /// Tells the shaders of the process apart.
    fn shader_of(&self, index: SubgroupIndex) -> u64 {
        let program = self.worker.subgroups[index].program;
        self.dispatch.shaders.programs[program as usize].number()
    }
}
