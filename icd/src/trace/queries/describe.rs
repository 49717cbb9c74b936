//! What getters read: words about a candidate or a committed hit.

use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::facts::Fact;
use spirv_jit::program::{AlignedRow, Row};
use spirv_jit::query::{QueryWord, row};
use traversal::{Hit, HitRows, RayRows, Walk};

use super::super::facts::{Lanes, OfHit, Subjects, Take, Told, take};
use super::super::lanes::copy_lanes;
use crate::wave::Limits;

/// Writes what getters read of the candidates at which walks stand, a row at a time; `walks` has
/// their lanes.
pub(super) fn describe_candidates(
    walks: &[(usize, &Walk)],
    object: &mut [AlignedRow],
    words: &[QueryWord],
    limits: &Limits,
) {
    let (words, _) = split(words);
    if walks.is_empty() || words.is_empty() {
        return;
    }
    let mut candidates = Candidates {
        walks: [None; SUBGROUP_SIZE],
        lanes: 0,
    };
    for &(lane, walk) in walks {
        candidates.walks[lane] = Some(walk);
        candidates.lanes |= 1 << lane;
    }
    let told = Told::default();
    for (to, word) in object[row::WORDS..].iter_mut().zip(words) {
        let (fact, component) = (word.fact, word.component as usize);
        let from = match fact {
            Fact::IntersectionType => {
                (&candidates).take(|_, _| 0, |hit| u32::from(!hit.is_built_in()))
            }
            _ => take(fact, component, &candidates)
                .unwrap_or_else(|| told.row(&candidates, limits, fact, component)),
        };
        copy_lanes(&mut to.0, &from, candidates.lanes);
    }
}

/// Writes what getters read of a lane's walk's committed hit, if there is one.
pub(super) fn describe_committed(
    walk: &Walk,
    lane: usize,
    object: &mut [AlignedRow],
    words: &[QueryWord],
    limits: &Limits,
) {
    let (before, words) = split(words);
    let Some(hit) = walk.committed() else {
        return;
    };
    let (committed, told) = (Committed { walk, hit }, Told::default());
    for (to, word) in object[row::WORDS + before.len()..].iter_mut().zip(words) {
        let (fact, component) = (word.fact, word.component as usize);
        to.0[lane] = match fact {
            Fact::IntersectionType => type_of(hit.is_built_in()),
            _ => take(fact, component, OfHit(hit))
                .unwrap_or_else(|| told.row(&committed, limits, fact, component)[0]),
        };
    }
}

/// `OpRayQueryGetIntersectionTypeKHR` of a committed hit.
fn type_of(built_in: bool) -> u32 {
    if built_in { 1 } else { 2 }
}

/// The words about candidates, and those about committed hits.
fn split(words: &[QueryWord]) -> (&[QueryWord], &[QueryWord]) {
    words.split_at(words.partition_point(|word| !word.committed))
}

/// Whether getters read more of committed hits than whether there is one.
pub(super) fn shows_committed(words: &[QueryWord]) -> bool {
    let (_, committed) = split(words);
    (committed.iter()).any(|word| word.fact != Fact::IntersectionType)
}

/// Writes what getters read of the hits that `lanes` have, a row at a time.
pub(super) fn describe_rows(
    rays: &RayRows,
    hits: &HitRows,
    lanes: u16,
    object: &mut [AlignedRow],
    words: &[QueryWord],
    limits: &Limits,
) {
    let lanes = lanes & hits.found;
    let (candidate, committed) = split(words);
    if lanes == 0 || committed.is_empty() {
        return;
    }
    let (rows, told) = (Rows { rays, hits, lanes }, Told::default());
    let to = &mut object[row::WORDS + candidate.len()..];
    for (to, word) in to.iter_mut().zip(committed) {
        let (fact, component) = (word.fact, word.component as usize);
        let from = match fact {
            Fact::IntersectionType => std::array::from_fn(|lane| type_of(hits.is_built_in(lane))),
            _ => take(fact, component, &rows)
                .unwrap_or_else(|| told.row(&rows, limits, fact, component)),
        };
        copy_lanes(&mut to.0, &from, lanes);
    }
}

/// Walks that stand at candidates.
struct Candidates<'a> {
    walks: Lanes<Option<&'a Walk>>,
    lanes: u16,
}

impl Take for &Candidates<'_> {
    type Taken = Row;

    fn take(self, _: impl Fn(&HitRows, usize) -> u32, hit: impl Fn(&Hit) -> u32) -> Row {
        self.walks
            .map(|walk| walk.map_or(0, |walk| hit(walk.candidate())))
    }
}

impl Subjects for Candidates<'_> {
    fn lanes(&self) -> u16 {
        self.lanes
    }

    fn structures(&self) -> Lanes<u64> {
        self.walks.map(|walk| walk.map_or(0, Walk::top_level))
    }

    fn times(&self) -> Lanes<f32> {
        [0.0; SUBGROUP_SIZE]
    }

    fn instances(&self) -> Row {
        self.take(|_, _| 0, |hit| hit.instance_index)
    }

    fn hit(&self, lane: usize) -> Hit {
        self.walks[lane].map_or(Hit::NONE, |walk| *walk.candidate())
    }

    fn origins(&self) -> [Lanes<f32>; 3] {
        let origin = |walk: Option<&Walk>| walk.map_or([0.0; 3], |walk| walk.ray().origin);
        [0, 1, 2].map(|axis| self.walks.map(|walk| origin(walk)[axis]))
    }

    fn directions(&self) -> [Lanes<f32>; 3] {
        let direction = |walk: Option<&Walk>| walk.map_or([0.0; 3], |walk| walk.ray().direction);
        [0, 1, 2].map(|axis| self.walks.map(|walk| direction(walk)[axis]))
    }
}

/// One walk with what it has committed, as lane 0.
struct Committed<'a> {
    walk: &'a Walk,
    hit: &'a Hit,
}

impl Subjects for Committed<'_> {
    fn lanes(&self) -> u16 {
        1
    }

    fn structures(&self) -> Lanes<u64> {
        [self.walk.top_level(); SUBGROUP_SIZE]
    }

    fn times(&self) -> Lanes<f32> {
        [0.0; SUBGROUP_SIZE]
    }

    fn instances(&self) -> Row {
        [self.hit.instance_index; SUBGROUP_SIZE]
    }

    fn hit(&self, _: usize) -> Hit {
        *self.hit
    }

    fn origins(&self) -> [Lanes<f32>; 3] {
        self.walk.ray().origin.map(|x| [x; SUBGROUP_SIZE])
    }

    fn directions(&self) -> [Lanes<f32>; 3] {
        self.walk.ray().direction.map(|x| [x; SUBGROUP_SIZE])
    }
}

/// Rows of rays and of their hits.
struct Rows<'a> {
    rays: &'a RayRows,
    hits: &'a HitRows,
    lanes: u16,
}

impl Take for &Rows<'_> {
    type Taken = Row;

    fn take(self, rows: impl Fn(&HitRows, usize) -> u32, _: impl Fn(&Hit) -> u32) -> Row {
        std::array::from_fn(|lane| rows(self.hits, lane))
    }
}

impl Subjects for Rows<'_> {
    fn lanes(&self) -> u16 {
        self.lanes
    }

    fn structures(&self) -> Lanes<u64> {
        self.rays.top_level
    }

    fn times(&self) -> Lanes<f32> {
        [0.0; SUBGROUP_SIZE]
    }

    fn instances(&self) -> Row {
        self.hits.instance_index
    }

    fn hit(&self, lane: usize) -> Hit {
        self.hits.hit(lane)
    }

    fn origins(&self) -> [Lanes<f32>; 3] {
        self.rays.origin
    }

    fn directions(&self) -> [Lanes<f32>; 3] {
        self.rays.direction
    }
}
