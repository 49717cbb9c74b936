//! Subgroups that are ready to run.

#![forbid(unsafe_code)]

use spirv_jit::program::ResumePoint;

use super::subgroup::{SubgroupIndex, Turn};
use crate::wave::binding_table::ProgramIndex;

/// Subgroups of one program that stand at one point.
pub struct Ready {
    pub program: ProgramIndex,
    pub point: ResumePoint,
    pub subgroups: Vec<SubgroupIndex>,
}

/// The ready subgroups of a batch, by [`Turn`].
#[derive(Default)]
pub struct ReadyLists {
    lists: [Vec<Ready>; Turn::COUNT],
    /// By [`Turn`]: the list that got the last subgroup, if it is still there.
    latest: [usize; Turn::COUNT],
    /// Lists of subgroups that are not in use, for their memory.
    spare: Vec<Vec<SubgroupIndex>>,
}

impl ReadyLists {
    /// Adds a subgroup that stands at a point of a program.
    #[inline]
    pub fn add(
        &mut self,
        turn: Turn,
        program: ProgramIndex,
        point: ResumePoint,
        index: SubgroupIndex,
    ) {
        let (ready, latest) = (
            &mut self.lists[turn as usize],
            &mut self.latest[turn as usize],
        );
        let is_there = |r: &Ready| (r.program, r.point) == (program, point);
        // Most come where the one before came.
        if !ready.get(*latest).is_some_and(is_there) {
            *latest = ready.iter().position(is_there).unwrap_or_else(|| {
                ready.push(Ready {
                    program,
                    point,
                    subgroups: self.spare.pop().unwrap_or_default(),
                });
                ready.len() - 1
            });
        }
        ready[*latest].subgroups.push(index);
    }

    pub fn is_empty(&self) -> bool {
        self.lists.iter().all(Vec::is_empty)
    }

    pub fn has_none(&self, turn: Turn) -> bool {
        self.lists[turn as usize].is_empty()
    }

    /// Takes all of a turn.
    pub fn take(&mut self, turn: Turn) -> Vec<Ready> {
        std::mem::take(&mut self.lists[turn as usize])
    }

    /// Takes the list of a turn with the most subgroups.
    #[inline]
    pub fn take_fullest(&mut self, turn: Turn) -> Option<Ready> {
        let ready = &mut self.lists[turn as usize];
        let fullest = (0..ready.len()).max_by_key(|&i| ready[i].subgroups.len())?;
        Some(ready.swap_remove(fullest))
    }

    /// Puts back lists that were taken. The turn has no others.
    pub fn put_back(&mut self, turn: Turn, lists: Vec<Ready>) {
        self.lists[turn as usize] = lists;
    }

    /// Keeps the memory of a list.
    pub fn recycle(&mut self, mut subgroups: Vec<SubgroupIndex>) {
        subgroups.clear();
        self.spare.push(subgroups);
    }
}
