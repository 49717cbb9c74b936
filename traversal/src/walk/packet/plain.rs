//! Packets where there are no vectors of sixteen: loops over lanes that compilers turn into
//! vectors, and leaves one ray after the other.

use lanes::LaneMask;
use lanes::vector;

use super::candidates::{CandidateSearch, MetTriangle, in_full};
use super::kernel::{PacketKernel, compiled};
use super::rays::Rays;
use super::{Packet, Stack, portable};
use crate::layout::{GROUP, InstanceRecord, LEAF_TRIANGLES, NodeAt, TriangleGroup, WIDTH, child};
use crate::structure::Structure;
use crate::walk::Walker;
use crate::walk::facts::InstanceFacts;
use crate::walk::found::Found;
use crate::walk::group_hits::GroupHits;
use crate::walk::kernel::Kernel;
use crate::walk::level::Level;
use crate::walk::level_ray::{max, min};
use crate::walk::level_rays::{AXIS, ROW};
use crate::walk::micromap::{Seen, opacity_at};
use crate::walk::portable::PortableKernel;
use crate::walk::rows::{HitRows, Lanes, RayRows};
use crate::walk::suspended::{Progress, Suspended, SuspendedLeaf};
use crate::walk::triangle::Intersection;

/// The baseline that every machine has.
pub(super) struct PortablePackets;

/// Eight numbers, one for each child or triangle.
type Eight = [f32; WIDTH];

/// As with AVX-512: where the soonest of the rays enters boxes, and where the last leaves them.
#[inline(always)]
fn test_planes(
    rays: &Rays,
    near_planes: [&Eight; 3],
    far_planes: [&Eight; 3],
    t_far: f32,
) -> (Eight, Eight) {
    let interval = &rays.interval;
    let mut near = [interval.t_min; WIDTH];
    let mut far = [t_far; WIDTH];
    for k in 0..3 {
        let (origin, far_origin) = (interval.near_origin[k], interval.far_origin[k]);
        let ([low, high], [far_low, far_high]) =
            (interval.near_inverse[k], interval.far_inverse[k]);
        for i in 0..WIDTH {
            let enter = origin - near_planes[k][i];
            let leave = far_origin - far_planes[k][i];
            near[i] = max(min(enter * low, enter * high), near[i]);
            far[i] = min(max(leave * far_low, leave * far_high), far[i]);
        }
    }
    (near, far)
}

/// A row of a node.
#[inline(always)]
fn planes(node: NodeAt<'_>, row: usize) -> Eight {
    // SAFETY: a row of the node.
    unsafe { node.row(row / ROW as usize).read() }
}

/// As with AVX-512.
#[inline(always)]
fn test_interval(rays: &Rays, node: NodeAt<'_>, t_far: f32) -> (Eight, Eight) {
    let rows = rays.near_rows;
    test_planes(
        rays,
        rows.map(|row| planes(node, row)).each_ref(),
        (rows.map(|row| planes(node, row ^ ROW as usize))).each_ref(),
        t_far,
    )
}

/// As with AVX-512.
#[inline(always)]
fn test_triangles(rays: &Rays, groups: [&TriangleGroup; 2], t_far: f32) -> (Eight, Eight) {
    let (mut near_planes, mut far_planes) = ([[0.0; WIDTH]; 3], [[0.0; WIDTH]; 3]);
    for k in 0..3 {
        let axis = rays.axes[k] / AXIS as usize % 3;
        let (mut low, mut high) = ([0.0; WIDTH], [0.0; WIDTH]);
        for i in 0..LEAF_TRIANGLES {
            let vertices = &groups[i / GROUP].vertices;
            let [a, b, c] = [0, 1, 2].map(|vertex: usize| vertices[vertex][axis][i % GROUP]);
            (low[i], high[i]) = (min(min(a, b), c), max(max(a, b), c));
        }
        (near_planes[k], far_planes[k]) = match rays.is_backward(k) {
            true => (high, low),
            false => (low, high),
        };
    }
    test_planes(rays, near_planes.each_ref(), far_planes.each_ref(), t_far)
}

/// Tests opaque triangles of a leaf, one ray after the other.
///
/// # Safety
/// The machine has the kernel's instruction set.
#[inline(always)]
unsafe fn test_each<K: Kernel>(
    rays: &Rays,
    structure: &Structure,
    groups: [&TriangleGroup; 2],
    (triangles, first_slot): (u32, u32),
    lanes: LaneMask,
    found: &mut Found,
) {
    let mut hits = GroupHits::NONE;
    for lane in lanes {
        // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
        let mut mask = unsafe { hit_in::<K>(rays, lane, groups, triangles, found, &mut hits) };
        while mask != 0 {
            let i = mask.trailing_zeros() as usize % LEAF_TRIANGLES;
            mask &= mask - 1;
            found.offer(structure, lane, first_slot + i as u32, &hit_of(&hits, i));
        }
    }
}

/// Which triangles of a leaf a ray hits, no farther than what it has found.
///
/// # Safety
/// The machine has the kernel's instruction set.
#[inline(always)]
unsafe fn hit_in<K: Kernel>(
    rays: &Rays,
    lane: usize,
    groups: [&TriangleGroup; 2],
    triangles: u32,
    found: &Found,
    hits: &mut GroupHits,
) -> u32 {
    let (level_rays, interval) = (
        &rays.level_rays,
        [rays.level_rays.t_min[lane], found.t[lane]],
    );
    // SAFETY: the caller guarantees that the machine has the kernel's instruction set.
    unsafe {
        let box_ray = K::load_lane(level_rays, lane, interval[1]);
        K::intersect_leaf(
            level_rays, lane, &box_ray, groups, triangles, interval, hits,
        )
    }
}

fn hit_of(hits: &GroupHits, i: usize) -> Intersection {
    Intersection {
        t: hits.t[i],
        barycentrics: [hits.barycentrics[0][i], hits.barycentrics[1][i]],
        front: hits.front >> i & 1 != 0,
    }
}

/// # Safety
/// The machine has the kernels' instruction set.
#[inline(always)]
unsafe fn test_leaf<P: PacketKernel, K: Kernel>(
    rays: &Rays,
    structure: &Structure,
    (word, lanes): (u32, LaneMask),
    t_far: f32,
    found: &mut Found,
) {
    let mut room = None;
    // SAFETY: the caller guarantees that the machine has the kernels' instruction set.
    let leaf = structure.leaf_groups(word, &mut room, |block, room| unsafe {
        K::expand(block, room)
    });
    let Some((groups, there)) = leaf else { return };
    let first_slot = structure.first_slot(word & child::INDEX);
    // SAFETY: the caller guarantees that the machine has the kernels' instruction set.
    unsafe {
        let triangles = match rays.has_bounds {
            true => there & P::test_triangles(rays, groups, t_far),
            false => there,
        };
        if triangles != 0 {
            test_each::<K>(
                rays,
                structure,
                groups,
                (triangles, first_slot),
                lanes,
                found,
            );
        }
    }
}

/// # Safety
/// The machine has the kernels' instruction set.
#[inline(always)]
unsafe fn test_some<P: PacketKernel, K: Kernel>(
    rays: &mut Rays,
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
    let mut rest = match rays.has_bounds {
        // SAFETY: the caller guarantees that the machine has the kernels' instruction set.
        true => there & unsafe { P::test_triangles(rays, groups, t_far) },
        false => there,
    };
    let (mut opaque, mut others) = (0, 0);
    let mut by_parts = [None; LEAF_TRIANGLES];
    while rest != 0 {
        let i = rest.trailing_zeros() as usize % LEAF_TRIANGLES;
        rest &= rest - 1;
        let (group, lane) = (groups[i / GROUP], i % GROUP);
        match Seen::of(level, facts, group.geometries[lane], group.primitives[lane]) {
            Seen::Opaque => opaque |= 1 << i,
            Seen::Candidate => others |= 1 << i,
            Seen::Not => {}
            Seen::ByParts(states) => {
                others |= 1 << i;
                by_parts[i] = Some(states);
            }
        }
    }
    if others == 0 {
        if opaque != 0 {
            // SAFETY: the caller guarantees that the machine has the kernels' instruction set.
            unsafe { test_each::<K>(rays, structure, groups, (opaque, first_slot), lanes, found) };
        }
        return leaf;
    }
    for lane in lanes {
        let mut hits = GroupHits::NONE;
        // Candidates are found with their edges here, and looked at without later.
        // SAFETY: the caller guarantees that the machine has the kernels' instruction set.
        let mut mask =
            unsafe { hit_in::<K>(rays, lane, groups, opaque | others, found, &mut hits) };
        while mask != 0 {
            let i = mask.trailing_zeros() as usize % LEAF_TRIANGLES;
            mask &= mask - 1;
            let hit = hit_of(&hits, i);
            let is_opaque = match &by_parts[i] {
                Some(states) => opacity_at(states, facts, hit.barycentrics),
                None => Some(others >> i & 1 == 0),
            };
            match is_opaque {
                Some(true) => found.offer(structure, lane, first_slot + i as u32, &hit),
                Some(false) => leaf.rest[i].insert(lane),
                None => {}
            }
        }
        rays.hits[lane] = hits;
    }
    rays.hits_of = word;
    leaf
}

/// Weights of a hit that is not near an edge: so far from 0 that no rounding matters.
const INSIDE: f32 = 1.0 / 64.0;

fn is_inside(hit: &Intersection) -> bool {
    let [second, third] = hit.barycentrics;
    (second > INSIDE) & (third > INSIDE) & (1.0 - second - third > INSIDE)
}

/// As with AVX-512.
///
/// # Safety
/// The machine has the kernel's instruction set.
#[inline(always)]
unsafe fn next_candidates<K: Kernel>(
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
        looks_ahead: false,
    };
    let (word, known) = (leaf.word, rays.hits_of);
    search.run(leaf, live, candidates, |(i, groups), _, lanes, rows| {
        let [mut met, mut front, mut undecided] = [LaneMask::NONE; 3];
        for lane in lanes {
            let hit = if known == word {
                hit_of(&rays.hits[lane], i)
            } else {
                let mut hits = GroupHits::NONE;
                // SAFETY: the caller guarantees that the machine has the instruction set.
                if unsafe { hit_in::<K>(rays, lane, groups, 1 << i, found, &mut hits) } == 0 {
                    continue;
                }
                hit_of(&hits, i)
            };
            if hit.t >= found.t[lane] {
                continue;
            }
            if !is_inside(&hit) {
                undecided.insert(lane);
                continue;
            }
            met.insert(lane);
            front.set(lane, hit.front);
            rows.t[lane] = hit.t;
            (rows.barycentrics[0][lane], rows.barycentrics[1][lane]) =
                (hit.barycentrics[0], hit.barycentrics[1]);
        }
        Some(MetTriangle {
            met,
            front,
            undecided,
        })
    });
}

impl PacketKernel for PortablePackets {
    type V = vector::Portable;
    const BY_RAYS: bool = true;

    #[inline(always)]
    unsafe fn least(row: Lanes, lanes: LaneMask) -> f32 {
        portable::least(row, lanes)
    }

    #[inline(always)]
    unsafe fn greatest(row: Lanes, lanes: LaneMask) -> f32 {
        portable::greatest(row, lanes)
    }

    #[inline(always)]
    unsafe fn test_interval(
        rays: &Rays,
        node: NodeAt<'_>,
        t_far: f32,
        soonest: &mut [f32; WIDTH],
    ) -> u32 {
        let (near, far) = test_interval(rays, node, t_far);
        *soonest = near;
        portable::eight_not_greater(&near, &far)
    }

    #[inline(always)]
    unsafe fn test_triangles(rays: &Rays, groups: [&TriangleGroup; 2], t_far: f32) -> u32 {
        let (near, far) = test_triangles(rays, groups, t_far);
        portable::eight_not_greater(&near, &far)
    }

    unsafe fn test_leaf(
        rays: &Rays,
        structure: &Structure,
        leaf: (u32, LaneMask),
        t_far: f32,
        found: &mut Found,
    ) {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { test_leaf::<PortablePackets, PortableKernel>(rays, structure, leaf, t_far, found) }
    }

    unsafe fn test_some(
        rays: &mut Rays,
        level: &Level,
        facts: &InstanceFacts,
        leaf: (u32, LaneMask),
        t_far: f32,
        found: &mut Found,
    ) -> SuspendedLeaf {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe {
            test_some::<PortablePackets, PortableKernel>(rays, level, facts, leaf, t_far, found)
        }
    }

    unsafe fn next_candidates(
        rays: &Rays,
        structure: &Structure,
        facts: &InstanceFacts,
        leaf: &mut SuspendedLeaf,
        live: LaneMask,
        found: &Found,
        candidates: &mut HitRows,
    ) {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe {
            next_candidates::<PortableKernel>(
                rays, structure, facts, leaf, live, found, candidates,
            );
        }
    }

    compiled! { as PortablePackets; }
}
