//! A subgroup of invocations in flight: its program's state, and whom each lane answers.
#![forbid(unsafe_code)]

use spirv_jit::program::AlignedRow;
use spirv_jit::{Program, SUBGROUP_SIZE};

use super::queries::Owned;
use super::table::ProgramIndex;

/// Index of a [`Subgroup`] in its batch.
pub type SubgroupIndex = u32;

/// One lane of one subgroup of the batch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LaneRef {
    pub subgroup: SubgroupIndex,
    pub lane: u8,
}

/// Why an invocation was created: whom its end answers.
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

/// Sixteen invocations of one program.
#[derive(Default)]
pub struct Subgroup {
    pub program: ProgramIndex,
    pub role: Role,
    pub rows: Vec<AlignedRow>,
    /// Lanes whose event is not answered yet.
    pub pending: u16,
    /// Lanes that were started.
    pub lanes: u16,
    /// Words of payload or callable data at the yield where the subgroup stands.
    pub data_words: u32,
    /// Per lane: linear launch index.
    pub launch: [u32; SUBGROUP_SIZE],
    /// Per lane, for hit and miss shaders: the ray.
    pub ray: [u32; SUBGROUP_SIZE],
    /// Its ray queries' suspended walks.
    pub queries: Owned,
    /// Per lane, for callables: who waits.
    pub caller: [LaneRef; SUBGROUP_SIZE],
}

impl Subgroup {
    /// Reuses the place for `program` with these lanes at its entry.
    pub fn start(&mut self, index: ProgramIndex, program: &Program, role: Role, lanes: u16) {
        self.program = index;
        self.role = role;
        self.pending = 0;
        self.lanes = lanes;
        self.data_words = 0;
        self.queries.clear();
        self.rows
            .resize(program.layout().rows, AlignedRow::default());
        program.start(&mut self.rows, lanes);
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

/// Sorts lanes by the subgroup that a reference of theirs names: the subgroup, and which of `lanes` name it.
pub fn by_subgroup(
    lanes: u16,
    of: &[LaneRef; SUBGROUP_SIZE],
) -> impl Iterator<Item = (SubgroupIndex, u16)> {
    let mut rest = lanes;
    std::iter::from_fn(move || {
        let subgroup = of.get(rest.trailing_zeros() as usize)?.subgroup;
        let mut same = 0;
        for (lane, other) in of.iter().enumerate() {
            same |= u16::from(other.subgroup == subgroup) << lane;
        }
        same &= rest;
        rest &= !same;
        Some((subgroup, same))
    })
}

/// Whether each of these lanes refers to the lane of its own number.
pub fn in_place(lanes: u16, of: &[LaneRef; SUBGROUP_SIZE]) -> bool {
    lanes_of(lanes).all(|lane| of[lane].lane as usize == lane)
}

/// The lanes of a mask, lowest first.
pub fn lanes_of(mask: u16) -> impl Iterator<Item = usize> {
    let mut rest = mask;
    std::iter::from_fn(move || {
        let lane = rest.trailing_zeros() as usize;
        rest &= rest.wrapping_sub(1);
        (lane < SUBGROUP_SIZE).then_some(lane)
    })
}
