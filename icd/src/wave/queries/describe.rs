//! The words that getters read about a candidate or a committed hit.

use lanes::{LaneMask, Tier};
use spirv_jit::SUBGROUP_SIZE;
use spirv_jit::facts::Fact;
use spirv_jit::program::{AlignedRow, Row};
use spirv_jit::query::{QueryWord, row};
use traversal::{Hit, HitRows};

use super::floats;
use crate::wave::Limits;
use crate::wave::hit_facts::{CachedFacts, Lanes, Subjects, Take, take};
use crate::wave::rows::put_lanes;

/// Writes what getters read of the candidates of lanes.
pub(super) fn describe_candidates(
    tier: Tier,
    candidates: &HitRows,
    lanes: LaneMask,
    object: &mut [AlignedRow],
    words: &[QueryWord],
    limits: &Limits,
) {
    let (words, _) = split(words);
    if !lanes.is_empty() && !words.is_empty() {
        describe(tier, candidates, lanes, object, words, 0, limits);
    }
}

/// Writes what getters read of the hits that lanes have committed, those that have.
pub(super) fn describe_committed(
    tier: Tier,
    hits: &HitRows,
    lanes: LaneMask,
    object: &mut [AlignedRow],
    words: &[QueryWord],
    limits: &Limits,
) {
    let (before, words) = split(words);
    let lanes = lanes & hits.found;
    if !lanes.is_empty() && !words.is_empty() {
        describe(tier, hits, lanes, object, words, before.len(), limits);
    }
}

lanes::vectors! {
    /// Writes words of an object, which begin at `at`, a row at a time.
    fn describe<V>(
        v,
        hits: &HitRows,
        lanes: LaneMask,
        object: &mut [AlignedRow],
        words: &[QueryWord],
        at: usize,
        limits: &Limits,
    ) {
        let (rays, to) = object.split_at_mut(row::WORDS);
        let (rows, cached) = (Rows { rays, hits, lanes }, CachedFacts::default());
        for (to, word) in to[at..].iter_mut().zip(words) {
            let (fact, component) = (word.fact, word.component as usize);
            let mut from = [0; SUBGROUP_SIZE];
            if fact == Fact::IntersectionType {
                from = type_of(hits, word.committed);
            } else if let Some(row) = take(fact, component, &rows) {
                from = row;
            } else {
                cached.write_row(&rows, limits, fact, component, &mut from);
            }
            put_lanes(v, &mut to.0, &from, lanes);
        }
    }
}

/// `OpRayQueryGetIntersectionTypeKHR`: of candidates 0 for triangles and 1 for boxes; of committed
/// hits, one more.
#[inline(always)]
fn type_of(hits: &HitRows, committed: bool) -> Row {
    let mut row = [u32::from(committed); SUBGROUP_SIZE];
    for lane in 0..SUBGROUP_SIZE {
        row[lane] += u32::from(!hits.is_built_in(lane));
    }
    row
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

/// Rays, as an object's rows have them, and their hits.
struct Rows<'a> {
    rays: &'a [AlignedRow],
    hits: &'a HitRows,
    lanes: LaneMask,
}

impl Take for &Rows<'_> {
    type Taken = Row;

    #[inline(always)]
    fn take(self, rows: impl Fn(&HitRows, usize) -> u32, _: impl Fn(&Hit) -> u32) -> Row {
        let mut row = [0; SUBGROUP_SIZE];
        for lane in 0..SUBGROUP_SIZE {
            row[lane] = rows(self.hits, lane);
        }
        row
    }
}

impl Subjects for Rows<'_> {
    fn lanes(&self) -> LaneMask {
        self.lanes
    }

    fn structures(&self) -> [Row; 2] {
        [0, 1].map(|word| self.rays[row::STRUCTURE + word].0)
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
        [0, 1, 2].map(|axis| floats(self.rays, row::ORIGIN + axis))
    }

    fn directions(&self) -> [Lanes<f32>; 3] {
        [0, 1, 2].map(|axis| floats(self.rays, row::DIRECTION + axis))
    }
}
