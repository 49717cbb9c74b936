//! A subgroup of invocations in flight: its program's state, and the caller of each lane.
#![forbid(unsafe_code)]

use lanes::{LaneMask, by_lane};
use spirv_jit::program::AlignedRow;
use spirv_jit::{Program, SUBGROUP_SIZE};

use super::grid::Launches;
use crate::wave::Stopped;
use crate::wave::binding_table::ProgramIndex;
use crate::wave::queries::Owned;

/// The shader that is called, what for, and the address of its record.
pub type Callee = (ProgramIndex, Role, u64);

/// Index of a [`Subgroup`] in its batch.
pub type SubgroupIndex = u32;

/// One lane of a subgroup of the batch, or the ray of one lane of a
/// [`RayGroup`](super::rays::RayGroup): by index and lane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct LaneRef(u32);

impl LaneRef {
    /// A lane of what has this index.
    #[inline]
    pub fn new(index: u32, lane: usize) -> Self {
        Self(index << 4 | lane as u32 & 0xF)
    }

    /// Of the subgroup, or of the group of rays.
    #[inline]
    pub fn index(self) -> u32 {
        self.0 >> 4
    }

    #[inline]
    pub fn lane(self) -> usize {
        self.0 as usize & 0xF
    }
}

const _: () = assert!(SUBGROUP_SIZE == 16);

/// The reason for an invocation, which determines the callers that wait for it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    #[default]
    RayGeneration,
    /// Decides on its ray's triangle candidate.
    AnyHit,
    /// Decides on a hit that an intersection shader reported for its ray.
    AnyHitOfReport,
    /// Examines its ray's box candidate.
    Intersection,
    ClosestHit,
    Miss,
    Callable,
}

impl Role {
    pub const COUNT: usize = Role::Callable as usize + 1;

    /// When shaders of this role run.
    #[inline]
    pub fn turn(self) -> Turn {
        match self {
            Role::AnyHit | Role::AnyHitOfReport | Role::Intersection => Turn::Deciders,
            Role::ClosestHit | Role::Miss | Role::Callable => Turn::Callees,
            Role::RayGeneration => Turn::Launches,
        }
    }
}

/// Whose turn it is to run, in the order of a round: see [`Batch`](super::batch::Batch).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// Shaders that decide on candidates of rays.
    Deciders,
    /// Hit, miss and callable shaders.
    Callees,
    /// Ray generation shaders.
    Launches,
}

impl Turn {
    pub const COUNT: usize = Turn::Launches as usize + 1;
}

/// Sixteen invocations of one program.
#[derive(Default)]
pub struct Subgroup {
    pub program: ProgramIndex,
    pub role: Role,
    pub rows: Vec<AlignedRow>,
    /// Lanes whose event is not answered yet.
    pub pending: LaneMask,
    /// Lanes that were started.
    pub lanes: LaneMask,
    /// Words of payload or callable data at the yield where the subgroup stands.
    pub data_words: u32,
    pub launch: Launches,
    /// Per lane: the ray, for hit and miss shaders; who waits, for callables.
    pub of: [LaneRef; SUBGROUP_SIZE],
    /// These are all of one group of rays or one subgroup, each the lane of its own number.
    pub is_in_place: bool,
    /// The rays of its queries that wait.
    pub queries: Owned,
}

impl Subgroup {
    /// Reuses the place for `program` with these lanes at its entry.
    ///
    /// # Errors
    /// [`Stopped::OutOfMemory`].
    #[inline]
    pub fn start(
        &mut self,
        index: ProgramIndex,
        program: &Program,
        role: Role,
        lanes: LaneMask,
    ) -> Result<(), Stopped> {
        self.program = index;
        self.role = role;
        self.pending = LaneMask::NONE;
        self.lanes = lanes;
        self.data_words = 0;
        self.queries.clear();
        let rows = program.layout().rows;
        let room = self.rows.try_reserve(rows.saturating_sub(self.rows.len()));
        room.map_err(|_| Stopped::OutOfMemory)?;
        // Keeps the length of the previous use: rows past the program's frame are unused.
        if self.rows.len() < rows {
            self.rows.resize(rows, AlignedRow::default());
        }
        program.start(&mut self.rows, lanes);
        Ok(())
    }

    /// A word of the yield's operands or of the outputs.
    #[inline]
    pub fn io(&self, program: &Program, row: usize, lane: usize) -> u32 {
        self.rows[program.layout().io + row].0[lane]
    }

    /// Overwrites a word of the yield's operands with a result.
    #[inline]
    pub fn set_io(&mut self, program: &Program, row: usize, lane: usize, word: u32) {
        self.rows[program.layout().io + row].0[lane] = word;
    }
}

/// Sorts lanes by what a reference of theirs names: its index, and which of `lanes` name it.
pub fn by_index(
    lanes: LaneMask,
    of: &[LaneRef; SUBGROUP_SIZE],
) -> impl Iterator<Item = (u32, LaneMask)> {
    let mut rest = lanes;
    std::iter::from_fn(move || {
        let index = of[rest.iter().next()?].index();
        let same = LaneMask::holding(&by_lane(|lane| of[lane].index()), index) & rest;
        rest -= same;
        Some((index, same))
    })
}

/// The lanes that these refer to, as a mask.
#[inline]
pub fn lanes_named(lanes: LaneMask, of: &[LaneRef; SUBGROUP_SIZE]) -> LaneMask {
    if in_place(lanes, of) {
        return lanes;
    }
    lanes.iter().map(|lane| of[lane].lane()).collect()
}

/// Whether each of these lanes refers to the lane of its own number.
#[inline]
pub fn in_place(lanes: LaneMask, of: &[LaneRef; SUBGROUP_SIZE]) -> bool {
    let distances = by_lane(|lane| (of[lane].lane() ^ lane) as u32);
    (lanes - LaneMask::holding(&distances, 0)).is_empty()
}
