//! Leaves whose triangles are not all opaque: rays stop there for candidates.

use lanes::LaneMask;

use super::rays::Rays;
#[cfg(target_arch = "x86_64")]
use super::register::{Register, lanes_of, rays_of};
#[cfg(target_arch = "x86_64")]
use super::triangle::{intersect_triangle, take_hits, test_triangle};
use crate::layout::{Block, GROUP, LEAF_TRIANGLES, TriangleGroup, child, geometry_word};
#[cfg(target_arch = "x86_64")]
use crate::micromap::TriangleStates;
use crate::ray::Hit;
use crate::structure::Structure;
use crate::walk::PACKET;
use crate::walk::edge_side::Rim;
use crate::walk::facts::InstanceFacts;
use crate::walk::found::Found;
#[cfg(target_arch = "x86_64")]
use crate::walk::level::Level;
#[cfg(target_arch = "x86_64")]
use crate::walk::micromap::{Seen, opacity_at};
use crate::walk::rows::{HitRows, Lanes};
use crate::walk::suspended::SuspendedLeaf;
use crate::walk::triangle::intersect;

/// Tests the opaque triangles of a leaf, and the opaque parts of triangles with micromaps; notes at
/// which others rays have to look.
///
/// # Safety
/// The machine has the register's instruction set, here and below.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(super) unsafe fn test_some<R: Register>(
    rays: &Rays,
    level: &Level,
    facts: &InstanceFacts,
    (word, lanes): (u32, LaneMask),
    t_far: f32,
    found: &mut Found,
) -> SuspendedLeaf {
    let structure = &level.structure;
    let mut leaf = SuspendedLeaf {
        word,
        ..SuspendedLeaf::EMPTY
    };
    let mut room = None;
    let Some((groups, there)) = structure.leaf_groups(word, &mut room, in_full) else {
        return leaf;
    };
    let first_slot = structure.first_slot(word & child::INDEX);
    let mut rest = there;
    if rays.has_bounds {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        rest &= unsafe { rays.test_triangles(groups, t_far) };
    }
    while rest != 0 {
        let i = rest.trailing_zeros() as usize % LEAF_TRIANGLES;
        rest &= rest - 1;
        let (group, lane) = (groups[i / GROUP], i % GROUP);
        let (place, slot) = ((group, lane), first_slot + i as u32);
        match Seen::of(level, facts, group.geometries[lane], group.primitives[lane]) {
            // SAFETY: the caller guarantees that the machine has the instruction set.
            Seen::Opaque => unsafe {
                test_triangle::<R>(rays, structure, place, slot, lanes, found);
            },
            Seen::Candidate => leaf.rest[i] = lanes,
            Seen::Not => {}
            Seen::ByParts(states) => {
                let seen = (facts, &states);
                // SAFETY: the caller guarantees that the machine has the instruction set.
                leaf.rest[i] =
                    unsafe { test_parts::<R>(rays, structure, seen, (place, slot), lanes, found) };
            }
        }
    }
    leaf
}

/// Tests a triangle with a micromap: takes the hits of opaque parts, and returns the rays that meet
/// parts about which a shader is asked.
///
/// # Safety
/// The machine has the register's instruction set.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
unsafe fn test_parts<R: Register>(
    rays: &Rays,
    structure: &Structure,
    (facts, states): (&InstanceFacts, &TriangleStates),
    (place, slot): ((&TriangleGroup, usize), u32),
    lanes: LaneMask,
    found: &mut Found,
) -> LaneMask {
    let (mut asked, mut undecided) = (LaneMask::NONE, LaneMask::NONE);
    for part in 0..PACKET / R::RAYS {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe {
            let here = (part, rays_of::<R>(lanes, part));
            let t_far = R::load(&found.t, part);
            let Some(mut meeting) = intersect_triangle(rays, place, here, t_far) else {
                continue;
            };
            undecided |= lanes_of::<R>(meeting.undecided, part);
            let met = lanes_of::<R>(meeting.rays & meeting.t.le(t_far), part);
            if met.is_empty() {
                continue;
            }
            let mut weights = [[0.0; PACKET]; 2];
            for (row, weight) in weights.iter_mut().zip(meeting.weights) {
                weight.store(row, part);
            }
            let mut opaque = LaneMask::NONE;
            for lane in met {
                let is_opaque = opacity_at(states, facts, [weights[0][lane], weights[1][lane]]);
                opaque.set(lane, is_opaque == Some(true));
                asked.set(lane, is_opaque == Some(false));
            }
            meeting.rays = rays_of::<R>(opaque, part);
            take_hits(structure, slot, &meeting, (part, t_far), found);
        }
    }
    if !undecided.is_empty() {
        let triangle = place.0.triangle(place.1);
        let seen = (facts, states);
        asked |= test_parts_exactly(rays, structure, seen, &triangle, slot, undecided, found);
    }
    asked
}

/// As [`test_parts`], one ray after the other, where rays meet edges and vertices.
#[cfg(target_arch = "x86_64")]
#[cold]
#[inline(never)]
fn test_parts_exactly(
    rays: &Rays,
    structure: &Structure,
    (facts, states): (&InstanceFacts, &TriangleStates),
    triangle: &[[f32; 3]; 3],
    slot: u32,
    lanes: LaneMask,
    found: &mut Found,
) -> LaneMask {
    let mut asked = LaneMask::NONE;
    for lane in lanes {
        let Some(hit) = intersect(&rays.level_rays.of_lane(lane), triangle, Rim::Included) else {
            continue;
        };
        if hit.t > rays.level_rays.t_min[lane] {
            match opacity_at(states, facts, hit.barycentrics) {
                Some(true) => found.offer(structure, lane, slot, &hit),
                Some(false) => asked.insert(lane),
                None => {}
            }
        }
    }
    asked
}

/// As [`Block::expand`], with the indices and flags of the triangles.
pub(super) fn in_full(block: &Block, groups: [&mut TriangleGroup; 2]) -> u32 {
    for (group, found) in groups.into_iter().zip(block.groups()) {
        *group = found;
    }
    block.lanes()
}

/// Looks for one candidate for each of the rays of `live`, in the leaf where they stand.
///
/// # Safety
/// The machine has the register's instruction set.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(super) unsafe fn next_candidates<R: Register>(
    rays: &Rays,
    structure: &Structure,
    facts: &InstanceFacts,
    leaf: &mut SuspendedLeaf,
    live: LaneMask,
    found: &Found,
    candidates: &mut HitRows,
) {
    let search = CandidateSearch {
        rays,
        structure,
        facts,
        found,
        looks_ahead: true,
    };
    search.run(leaf, live, candidates, |_, place, lanes, rows| {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { meet_triangle::<R>(rays, place, lanes, found, rows) }
    });
}

/// Where rays meet a triangle nearer than the hits so far, written into `rows`.
///
/// # Safety
/// The machine has the register's instruction set.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
unsafe fn meet_triangle<R: Register>(
    rays: &Rays,
    place: (&TriangleGroup, usize),
    lanes: LaneMask,
    found: &Found,
    rows: &mut IntersectionRows,
) -> Option<MetTriangle> {
    let mut triangle = MetTriangle::NONE;
    for part in 0..PACKET / R::RAYS {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe {
            let here = (part, rays_of::<R>(lanes, part));
            let t_far = R::load(&found.t, part);
            let Some(meeting) = intersect_triangle(rays, place, here, t_far) else {
                continue;
            };
            meeting.t.store(&mut rows.t, part);
            for (weights, weight) in rows.barycentrics.iter_mut().zip(meeting.weights) {
                weight.store(weights, part);
            }
            triangle.met |= lanes_of::<R>(meeting.rays & meeting.t.lt(t_far), part);
            triangle.front |= lanes_of::<R>(meeting.front & !meeting.undecided, part);
            triangle.undecided |= lanes_of::<R>(meeting.undecided, part);
        }
    }
    (!(triangle.met | triangle.undecided).is_empty()).then_some(triangle)
}

/// The rays that meet a triangle nearer than the hits so far.
pub(super) struct MetTriangle {
    pub met: LaneMask,
    /// Those that see its front.
    pub front: LaneMask,
    /// Rays near an edge, which the exact rule decides on.
    pub undecided: LaneMask,
}

#[cfg(target_arch = "x86_64")]
impl MetTriangle {
    const NONE: MetTriangle = MetTriangle {
        met: LaneMask::NONE,
        front: LaneMask::NONE,
        undecided: LaneMask::NONE,
    };
}

/// The search for candidates of a packet's rays in one instance.
pub(super) struct CandidateSearch<'a> {
    pub rays: &'a Rays,
    pub structure: &'a Structure,
    pub facts: &'a InstanceFacts,
    pub found: &'a Found,
    /// Rays that have a candidate are tested, too, where that takes no longer: so they do not look
    /// again at triangles that they do not meet.
    pub looks_ahead: bool,
}

impl CandidateSearch<'_> {
    /// Looks for one candidate for each of the rays of `live` in a leaf. `intersect` tests some
    /// rays with the triangle of a number in a lane of one of the leaf's groups, and writes where
    /// they meet it; `None`: they do not.
    #[inline(always)]
    pub fn run(
        &self,
        leaf: &mut SuspendedLeaf,
        live: LaneMask,
        candidates: &mut HitRows,
        mut intersect: impl FnMut(
            (usize, [&TriangleGroup; 2]),
            (&TriangleGroup, usize),
            LaneMask,
            &mut IntersectionRows,
        ) -> Option<MetTriangle>,
    ) {
        candidates.found = LaneMask::NONE;
        if !leaf.has_rest(live) {
            return;
        }
        let mut room = None;
        let structure = self.structure;
        let Some((groups, _)) = structure.leaf_groups(leaf.word, &mut room, in_full) else {
            return;
        };
        let first_slot = structure.first_slot(leaf.word & child::INDEX);
        for i in 0..LEAF_TRIANGLES {
            let there = leaf.rest[i] & live;
            let lanes = there - candidates.found;
            if there.is_empty() || lanes.is_empty() && !self.looks_ahead {
                continue;
            }
            let tested = if self.looks_ahead { there } else { lanes };
            leaf.rest[i] -= tested;
            let place = (groups[i / GROUP], i % GROUP);
            let mut rows = IntersectionRows::ZERO;
            let Some(mut triangle) = intersect((i, groups), place, tested, &mut rows) else {
                continue;
            };
            if self.looks_ahead {
                leaf.rest[i] |= (triangle.met | triangle.undecided) - lanes;
                triangle.met &= lanes;
                triangle.undecided &= lanes;
            }
            if !triangle.undecided.is_empty() {
                let corners = place.0.triangle(place.1);
                let exactly =
                    rows.intersect_exactly(self.rays, &corners, triangle.undecided, self.found);
                triangle.met |= exactly.0;
                triangle.front |= exactly.1;
            }
            let hit = candidate(self.facts, place, first_slot + i as u32);
            rows.write((triangle.met, triangle.front), &hit, self.facts, candidates);
        }
    }
}

/// The part of a candidate that all rays at a triangle share.
#[inline(always)]
fn candidate(facts: &InstanceFacts, (group, lane): (&TriangleGroup, usize), slot: u32) -> Hit {
    Hit {
        geometry_index: group.geometries[lane] & geometry_word::INDEX,
        primitive_index: group.primitives[lane],
        slot,
        ..facts.hit()
    }
}

/// Where rays meet a triangle, in memory.
pub(super) struct IntersectionRows {
    pub t: Lanes,
    pub barycentrics: [Lanes; 2],
}

impl IntersectionRows {
    pub const ZERO: Self = Self {
        t: [0.0; PACKET],
        barycentrics: [[0.0; PACKET]; 2],
    };

    /// Writes the candidates of the rays that meet the triangle, and of those that see its front.
    #[inline(always)]
    pub fn write(
        &self,
        (met, front): (LaneMask, LaneMask),
        hit: &Hit,
        facts: &InstanceFacts,
        candidates: &mut HitRows,
    ) {
        let kinds = [false, true].map(|front| facts.hit_kind(front));
        candidates.set_triangle((met, front), hit, &self.t, &self.barycentrics, kinds);
    }

    /// One ray after the other, by the rule that gives an edge to one of its triangles. Returns
    /// those that meet the triangle nearer than what was found, and those of them that see its
    /// front.
    #[cold]
    #[inline(never)]
    pub fn intersect_exactly(
        &mut self,
        rays: &Rays,
        triangle: &[[f32; 3]; 3],
        lanes: LaneMask,
        found: &Found,
    ) -> (LaneMask, LaneMask) {
        let [mut met, mut front] = [LaneMask::NONE; 2];
        for lane in lanes {
            if let Some(hit) = intersect(&rays.level_rays.of_lane(lane), triangle, Rim::Owned)
                && hit.t > rays.level_rays.t_min[lane]
                && hit.t < found.t[lane]
            {
                met.insert(lane);
                front.set(lane, hit.front);
                self.t[lane] = hit.t;
                for (weights, weight) in self.barycentrics.iter_mut().zip(hit.barycentrics) {
                    weights[lane] = weight;
                }
            }
        }
        (met, front)
    }
}
