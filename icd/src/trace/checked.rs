//! What validation looks at while a batch is turned. Nothing of this runs where it is off.

use traversal::{Hit, Ray, Structure};

use super::batch::Batch;
use super::calls::Call;
use super::subgroup::{LaneRef, Role, SubgroupIndex};
use super::table::{Region, read_handle};
use crate::validate::{Instruction, Lookup, Need, Traced};

impl Batch<'_> {
    /// The rays that a subgroup's lanes have just started: the last that are to walk.
    #[cold]
    pub(super) fn check_rays(
        &self,
        traced: &Traced,
        index: SubgroupIndex,
        lanes: u16,
        instruction: Instruction,
    ) {
        let subgroup = &self.worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        let first = self.walking.len() - lanes.count_ones() as usize;
        for &(ray, _) in &self.walking[first..] {
            let ray = &self.worker.rays[ray];
            let word = |row| u64::from(subgroup.io(program, row, ray.caller.lane as usize));
            let named = word(0) | word(1) << 32;
            let as_given = Ray {
                flags: ray.flags,
                ..*ray.walk().ray()
            };
            // SAFETY: an address that leads nowhere is 0 here; what lies at others is kept by the application, as for the walk.
            let kind = unsafe { Structure::at(ray.structure) }.map(|structure| structure.kind());
            let place = program.number();
            traced.ray(instruction, place, &as_given, ray.time, named, kind);
        }
    }

    /// A hit kind that is reported.
    #[cold]
    pub(super) fn check_hit_kind(&self, traced: &Traced, reporter: LaneRef, kind: u32) {
        traced.hit_kind(self.shader_of(reporter), kind);
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

    fn check(&self, traced: &Traced, need: Need, region: &Region, index: u32, is_box: bool) {
        let record = region.record(index).map(|record| {
            let handle = read_handle(record);
            (handle, self.dispatch.shaders.group(&handle))
        });
        traced.lookup(&Lookup {
            need,
            region,
            index,
            record,
            is_box,
        });
    }

    /// A shader that is about to be called.
    #[cold]
    pub(super) fn check_call(&self, traced: &Traced, call: &Call) {
        let programs = &self.dispatch.shaders.programs;
        let stack = |program: u32| u64::from(programs[program as usize].stack_size_bytes());
        let mut bytes = stack(call.program);
        let mut depth = u32::from(call.role != Role::Callable);
        let mut waits = Some(match call.role {
            Role::Callable => call.caller,
            _ => self.worker.rays[call.ray].caller,
        });
        while let Some(lane) = waits {
            let subgroup = &self.worker.subgroups[lane.subgroup];
            bytes += stack(subgroup.program);
            waits = match subgroup.role {
                Role::RayGeneration => None,
                Role::Callable => Some(subgroup.caller[lane.lane as usize]),
                _ => {
                    depth += 1;
                    Some(self.worker.rays[subgroup.ray[lane.lane as usize]].caller)
                }
            };
        }
        traced.call(programs[call.program as usize].number(), depth, bytes);
    }

    /// Tells the shaders of the process apart.
    fn shader_of(&self, lane: LaneRef) -> u64 {
        let program = self.worker.subgroups[lane.subgroup].program;
        self.dispatch.shaders.programs[program as usize].number()
    }
}
