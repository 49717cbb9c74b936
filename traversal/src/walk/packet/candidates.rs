//! Leaves whose triangles are not all opaque: rays stop there for candidates.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::*;

use lanes::LaneMask;

use super::rays::Rays;
#[cfg(target_arch = "x86_64")]
use super::rays::{load, store};
#[cfg(target_arch = "x86_64")]
use super::triangle::{intersect_triangle, test_triangle};
use crate::layout::{Block, TriangleGroup};
#[cfg(target_arch = "x86_64")]
use crate::layout::{GROUP, LEAF_TRIANGLES, child, geometry_word};
#[cfg(target_arch = "x86_64")]
use crate::ray::Hit;
#[cfg(target_arch = "x86_64")]
use crate::structure::Structure;
#[cfg(target_arch = "x86_64")]
use crate::walk::PACKET;
use crate::walk::decide::Rim;
#[cfg(target_arch = "x86_64")]
use crate::walk::facts::InstanceFacts;
use crate::walk::found::Found;
#[cfg(target_arch = "x86_64")]
use crate::walk::rows::HitRows;
use crate::walk::rows::Lanes;
#[cfg(target_arch = "x86_64")]
use crate::walk::suspended::SuspendedLeaf;
use crate::walk::triangle::intersect;

/// Tests the opaque triangles of a leaf, and notes at which others rays have to look.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
pub(super) fn test_some(
    rays: &Rays,
    structure: &Structure,
    facts: &InstanceFacts,
    (word, lanes): (u32, LaneMask),
    t_far: f32,
    found: &mut Found,
) -> SuspendedLeaf {
    let mut leaf = SuspendedLeaf {
        word,
        ..SuspendedLeaf::EMPTY
    };
    let mut room = None;
    let Some((groups, there)) = structure.leaf_groups(word, &mut room, in_full) else {
        return leaf;
    };
    let first_slot = structure.first_slot(word & child::INDEX);
    let mut rest = there & rays.test_triangles(groups, t_far);
    while rest != 0 {
        let i = rest.trailing_zeros() as usize % LEAF_TRIANGLES;
        rest &= rest - 1;
        let (group, lane) = (groups[i / GROUP], i % GROUP);
        match facts.opacity(group.geometries[lane]) {
            Some(true) => {
                let slot = first_slot + i as u32;
                test_triangle(rays, structure, (group, lane), slot, lanes, found);
            }
            Some(false) => leaf.rest[i] = lanes,
            None => {}
        }
    }
    leaf
}

/// As [`Block::expand`], with what is known of the triangles besides.
pub(super) fn in_full(block: &Block, groups: [&mut TriangleGroup; 2]) -> u32 {
    for (group, found) in groups.into_iter().zip(block.groups()) {
        *group = found;
    }
    block.lanes()
}

/// Looks for one candidate for each of the rays of `live`, in the leaf where they stand.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
pub(super) fn next_candidates(
    rays: &Rays,
    structure: &Structure,
    facts: &InstanceFacts,
    leaf: &mut SuspendedLeaf,
    live: LaneMask,
    found: &Found,
    candidates: &mut HitRows,
) {
    candidates.found = LaneMask::NONE;
    let rest = (leaf.rest.iter()).fold(LaneMask::NONE, |all, &lanes| all | lanes) & live;
    if rest.is_empty() {
        return;
    }
    let mut room = None;
    let Some((groups, _)) = structure.leaf_groups(leaf.word, &mut room, in_full) else {
        return;
    };
    let first_slot = structure.first_slot(leaf.word & child::INDEX);
    for i in 0..LEAF_TRIANGLES {
        let lanes = leaf.rest[i] & (live - candidates.found);
        if lanes.is_empty() {
            continue;
        }
        leaf.rest[i] -= lanes;
        let (group, lane) = (groups[i / GROUP], i % GROUP);
        let Some(meeting) = intersect_triangle(rays, (group, lane), lanes, load(&found.t)) else {
            continue;
        };
        let slot = first_slot + i as u32;
        let hit = Hit {
            geometry_index: group.geometries[lane] & geometry_word::INDEX,
            primitive_index: group.primitives[lane],
            slot,
            ..facts.hit()
        };
        let mut place = IntersectionRows {
            t: [0.0; PACKET],
            barycentrics: [[0.0; PACKET]; 2],
        };
        store(&mut place.t, meeting.t);
        for (weights, weight) in place.barycentrics.iter_mut().zip(meeting.weights) {
            store(weights, weight);
        }
        let t_far = load(&found.t);
        let nearer = LaneMask::from_bits(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(meeting.t, t_far));
        let mut met = meeting.lanes & nearer;
        let mut front = meeting.front;
        if !meeting.undecided.is_empty() {
            let triangle = group.triangle(lane);
            let exactly = place.intersect_exactly(rays, &triangle, meeting.undecided, found);
            met |= exactly.0;
            front = (front - meeting.undecided) | exactly.1;
        }
        let kinds = [false, true].map(|front| facts.hit_kind(front));
        candidates.set_triangle((met, front), &hit, &place.t, &place.barycentrics, kinds);
    }
}

/// Where rays meet a triangle, in memory.
pub(super) struct IntersectionRows {
    pub t: Lanes,
    pub barycentrics: [Lanes; 2],
}

impl IntersectionRows {
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
            if let Some(hit) = intersect(&rays.beams.space(lane), triangle, Rim::Owned)
                && hit.t > rays.beams.t_min[lane]
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
