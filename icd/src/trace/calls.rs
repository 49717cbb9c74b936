//! Shader calls waiting to be run, and the order that makes full subgroups of them.
#![forbid(unsafe_code)]

use super::subgroup::{LaneRef, Role};
use super::table::{Group, ProgramIndex, Region, Shaders, read_handle};

/// An invocation to be created.
#[derive(Clone, Copy, Debug)]
pub struct Call {
    pub program: ProgramIndex,
    pub role: Role,
    /// Address of the shader record.
    pub record: u64,
    /// The ray, for hit and miss shaders.
    pub ray: u32,
    /// Who waits, for callables.
    pub caller: LaneRef,
    /// Linear launch index.
    pub launch: u32,
}

/// Sorts calls by role, shader and record. The sort is stable, so that the order follows from the batch alone.
pub fn sort_calls(calls: &mut [Call]) {
    calls.sort_by_key(|call| (call.role, call.program, call.record));
}

/// The next calls that one subgroup can hold: same shader and role, at most a subgroup's width.
pub fn split_subgroup(calls: &[Call]) -> (&[Call], &[Call]) {
    let first = calls[0];
    let count = calls
        .iter()
        .take(spirv_jit::SUBGROUP_SIZE)
        .take_while(|call| (call.role, call.program) == (first.role, first.program))
        .count();
    calls.split_at(count)
}

const REMEMBERED: usize = 64;

/// Groups behind record addresses, remembered for the length of a batch.
pub struct Records {
    /// Record address and group index + 1.
    seen: [(u64, u32); REMEMBERED],
}

impl Default for Records {
    fn default() -> Self {
        Self {
            seen: [(0, 0); REMEMBERED],
        }
    }
}

impl Records {
    /// The group and the address of a record; `None` for an unused group or an index outside the table.
    pub fn find<'a>(
        &mut self,
        shaders: &'a Shaders,
        region: &Region,
        index: u32,
    ) -> Option<(&'a Group, u64)> {
        let record = region.record(index)?;
        let slot = &mut self.seen[(record >> 5) as usize % REMEMBERED];
        if slot.0 != record {
            *slot = (
                record,
                shaders
                    .group_index(&read_handle(record))
                    .map_or(0, |index| index + 1),
            );
        }
        Some((&shaders.groups[slot.1.checked_sub(1)? as usize], record))
    }
}
