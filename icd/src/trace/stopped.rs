//! Notes where a dispatch was given up. Nothing of this runs before that.

use spirv_jit::Program;
use spirv_jit::program::AlignedRow;

use super::batch::Batch;
use super::subgroup::{LaneRef, Role, SubgroupIndex};
use crate::wave::StoppedAt;

impl Batch<'_> {
    /// Notes the place of a subgroup.
    #[cold]
    pub(super) fn note_stop(&self, index: SubgroupIndex) {
        let subgroup = &self.worker.subgroups[index];
        let depth = self.depth(subgroup.role, subgroup.of[0]);
        self.note(index, depth);
    }

    /// Notes the place of the shader call for which there was no room.
    #[cold]
    pub(super) fn note_call(&self, role: Role, of: LaneRef) {
        if role != Role::RayGeneration {
            self.note(self.caller(role, of), self.depth(role, of));
        }
    }

    fn note(&self, index: SubgroupIndex, depth: u32) {
        let subgroup = &self.worker.subgroups[index];
        let program = &self.dispatch.shaders.programs[subgroup.program as usize];
        self.note_in_line(program, &subgroup.rows, depth);
    }

    /// Notes the place of a state with so many calls around it.
    #[cold]
    pub(super) fn note_in_line(&self, program: &Program, state: &[AlignedRow], depth: u32) {
        self.dispatch.limits.note(|| StoppedAt {
            place: program.place_of(state),
            depth,
        });
    }

    /// The subgroup that waits for an invocation.
    fn caller(&self, role: Role, of: LaneRef) -> SubgroupIndex {
        match role {
            Role::Callable => of.index(),
            _ => self.worker.ray_groups[of.index()].caller,
        }
    }

    /// Invocations that wait for one, directly and indirectly.
    pub(super) fn depth(&self, mut role: Role, mut of: LaneRef) -> u32 {
        let mut depth = 0;
        while role != Role::RayGeneration {
            depth += 1;
            let caller = &self.worker.subgroups[self.caller(role, of)];
            (role, of) = (caller.role, caller.of[of.lane()]);
        }
        depth
    }
}
