//! Sixteen rays and a triangle.

use std::arch::x86_64::*;

use lanes::LaneMask;

use super::rays::{Rays, load, store};
use crate::layout::{GROUP, LEAF_TRIANGLES, MARGIN_RISE, TriangleGroup, child};
use crate::structure::Structure;
use crate::walk::block;
use crate::walk::edge_side::Rim;
use crate::walk::found::Found;
use crate::walk::group;
use crate::walk::group_hits::GroupHits;
use crate::walk::level_rays::AXIS;
use crate::walk::triangle::{Intersection, ORDINARY, intersect, rounding};
use crate::walk::triangle_ray::LaneOf;

/// Tests the triangles of a leaf: those whose boxes any ray might meet, or all for each ray where
/// those are fewer.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
pub(super) fn test_leaf(
    rays: &Rays,
    structure: &Structure,
    word: u32,
    lanes: LaneMask,
    t_far: f32,
    found: &mut Found,
) {
    let mut room = None;
    let Some((groups, there)) = block::leaf_groups(structure, word, &mut room) else {
        return;
    };
    let first_slot = structure.first_slot(word & child::INDEX);
    let mut rest = there & rays.test_triangles(groups, t_far);
    if 2 * lanes.count() <= rest.count_ones() {
        return test_singly(rays, structure, groups, there, first_slot, lanes, found);
    }
    while rest != 0 {
        let i = rest.trailing_zeros() as usize % LEAF_TRIANGLES;
        rest &= rest - 1;
        let place = (groups[i / GROUP], i % GROUP);
        test_triangle(rays, structure, place, first_slot + i as u32, lanes, found);
    }
}

/// All triangles of a leaf at once, one ray after the other.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
fn test_singly(
    rays: &Rays,
    structure: &Structure,
    groups: [&TriangleGroup; 2],
    there: u32,
    first_slot: u32,
    lanes: LaneMask,
    found: &mut Found,
) {
    let mut hits = GroupHits::NONE;
    for lane in lanes {
        let interval = [rays.level_rays.t_min[lane], found.t[lane]];
        // SAFETY: the machine has AVX2.
        let mut mask = unsafe {
            group::intersect(
                LaneOf {
                    level_rays: &rays.level_rays,
                    lane,
                },
                groups,
                there,
                interval,
                &mut hits,
            )
        };
        while mask != 0 {
            let i = mask.trailing_zeros() as usize % LEAF_TRIANGLES;
            mask &= mask - 1;
            let hit = Intersection {
                t: hits.t[i],
                barycentrics: [hits.barycentrics[0][i], hits.barycentrics[1][i]],
                front: hits.front >> i & 1 != 0,
            };
            found.offer(structure, lane, first_slot + i as u32, &hit);
        }
    }
}

type ShearedRow = (__m512, __m512, __m512);

/// Where rays meet a triangle: after the lower ends of their intervals, and not surely after the
/// upper ones.
pub(super) struct TriangleHits {
    /// Those that meet it inside, for sure.
    pub lanes: LaneMask,
    /// Those for which that is to be found out one by one.
    pub undecided: LaneMask,
    pub t: __m512,
    /// Of the second and the third vertex.
    pub weights: [__m512; 2],
    pub front: LaneMask,
}

/// Tests an opaque triangle.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
pub(super) fn test_triangle(
    rays: &Rays,
    structure: &Structure,
    place: (&TriangleGroup, usize),
    slot: u32,
    lanes: LaneMask,
    found: &mut Found,
) {
    let t_far = load(&found.t);
    let Some(meeting) = intersect_triangle(rays, place, lanes, t_far) else {
        return;
    };
    take_hits(structure, slot, &meeting, t_far, found);
    if !meeting.undecided.is_empty() {
        let triangle = place.0.triangle(place.1);
        test_exactly(rays, structure, &triangle, slot, meeting.undecided, found);
    }
}

/// Takes hits that are certainly inside a triangle, where they win over the hits so far. `t_far`:
/// the distances of that.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
pub(super) fn take_hits(
    structure: &Structure,
    slot: u32,
    meeting: &TriangleHits,
    t_far: __m512,
    found: &mut Found,
) {
    let (accepted, t) = (meeting.lanes.bits(), meeting.t);
    let mut nearer = accepted & _mm512_cmp_ps_mask::<_CMP_LT_OQ>(t, t_far);
    let ties = accepted & _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(t, t_far) & found.hit.bits();
    if ties != 0 {
        nearer |= (found.won_ties(structure, slot, LaneMask::from_bits(ties))).bits();
    }
    if nearer != 0 {
        store(&mut found.t, _mm512_mask_blend_ps(nearer, t_far, t));
        for (place, weight) in found.barycentrics.iter_mut().zip(meeting.weights) {
            let weights = _mm512_mask_blend_ps(nearer, load(place), weight);
            store(place, weights);
        }
        // SAFETY: sixteen words.
        unsafe {
            let slots = found.slots.as_mut_ptr().cast();
            _mm512_mask_storeu_epi32(slots, nearer, _mm512_set1_epi32(slot as i32));
            let instances = found.instances.as_mut_ptr().cast();
            let instance = _mm512_set1_epi32(found.instance as i32);
            _mm512_mask_storeu_epi32(instances, nearer, instance);
        }
        found.mark(LaneMask::from_bits(nearer), meeting.front);
    }
}

/// As [`intersect`](crate::walk::group::intersect) does it for a leaf's triangles and one ray;
/// `None` if no ray meets the triangle.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
pub(super) fn intersect_triangle(
    rays: &Rays,
    (group, i): (&TriangleGroup, usize),
    lanes: LaneMask,
    t_far: __m512,
) -> Option<TriangleHits> {
    let level_rays = &rays.level_rays;
    let axes = rays.axes.map(|axis| axis / AXIS as usize % 3);
    let moved = |vertex: usize, k: usize| {
        _mm512_sub_ps(
            load(&level_rays.origin[k]),
            _mm512_set1_ps(group.vertices[vertex][axes[k]][i]),
        )
    };
    let (shear_x, shear_y) = (load(&level_rays.shear[0]), load(&level_rays.shear[1]));
    let flat = |vertex: usize| -> ShearedRow {
        let z = moved(vertex, 2);
        (
            _mm512_sub_ps(moved(vertex, 0), _mm512_mul_ps(shear_x, z)),
            _mm512_sub_ps(moved(vertex, 1), _mm512_mul_ps(shear_y, z)),
            z,
        )
    };
    let edge = |p: ShearedRow, q: ShearedRow| {
        _mm512_sub_ps(_mm512_mul_ps(p.0, q.1), _mm512_mul_ps(p.1, q.0))
    };
    let (a, b, c) = (flat(0), flat(1), flat(2));
    let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
    let least = _mm512_min_ps(u, _mm512_min_ps(v, w));
    let most = _mm512_max_ps(u, _mm512_max_ps(v, w));
    let distance = _mm512_abs_ps(a.2);
    let rise = _mm512_mul_ps(distance, _mm512_set1_ps(MARGIN_RISE));
    let error = _mm512_mul_ps(
        _mm512_add_ps(distance, _mm512_set1_ps(group.margin.reach)),
        _mm512_add_ps(_mm512_set1_ps(group.margin.slope), rise),
    );
    let minus_error = _mm512_xor_ps(error, _mm512_set1_ps(-0.0));
    let outside = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(least, minus_error)
        & _mm512_cmp_ps_mask::<_CMP_GT_OQ>(most, error);
    let inside = !outside & lanes.bits();
    if inside == 0 {
        return None;
    }
    let front = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(least, error);
    let back = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(most, minus_error);
    let whole = _mm512_add_ps(_mm512_add_ps(u, v), w);
    let size = _mm512_abs_ps(whole);
    let ordinary = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(size, _mm512_set1_ps(ORDINARY[0]))
        & _mm512_cmp_ps_mask::<_CMP_LT_OQ>(size, _mm512_set1_ps(ORDINARY[1]));
    let decided = (front | back) & ordinary & inside;

    let inverse_whole = _mm512_div_ps(_mm512_set1_ps(1.0), whole);
    let size = _mm512_abs_ps(inverse_whole);
    let weights = [
        _mm512_mul_ps(v, inverse_whole),
        _mm512_mul_ps(w, inverse_whole),
    ];
    let [v, w] = weights;
    let t = _mm512_add_ps(
        _mm512_mul_ps(v, _mm512_sub_ps(b.2, a.2)),
        _mm512_mul_ps(w, _mm512_sub_ps(c.2, a.2)),
    );
    let z_hit = _mm512_add_ps(a.2, t);
    let inverse_z = load(&level_rays.inverse_z);
    let t = _mm512_mul_ps(z_hit, inverse_z);
    let room = _mm512_mul_ps(
        _mm512_mul_ps(_mm512_mul_ps(error, size), _mm512_abs_ps(inverse_z)),
        _mm512_set1_ps(1.5 * group.margin.reach),
    );
    let apart = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(_mm512_add_ps(t, room), load(&level_rays.t_min))
        | _mm512_cmp_ps_mask::<_CMP_GT_OQ>(_mm512_sub_ps(t, room), t_far);
    let inside = inside & !(decided & apart);
    if inside == 0 {
        return None;
    }
    let u = _mm512_mul_ps(u, inverse_whole);
    let z_mean = _mm512_add_ps(
        _mm512_add_ps(
            _mm512_mul_ps(u, _mm512_abs_ps(a.2)),
            _mm512_mul_ps(v, _mm512_abs_ps(b.2)),
        ),
        _mm512_mul_ps(w, _mm512_abs_ps(c.2)),
    );
    let (width, height) = (extent(a.0, b.0, c.0), extent(a.1, b.1, c.1));
    let tiny = _mm512_set1_ps(rounding::LEAST);
    let factor = |shear| {
        let factor = _mm512_mul_ps(_mm512_abs_ps(shear), _mm512_set1_ps(rounding::SHEAR));
        _mm512_add_ps(factor, tiny)
    };
    let move_x = _mm512_add_ps(_mm512_mul_ps(z_mean, factor(shear_x)), tiny);
    let move_y = _mm512_add_ps(_mm512_mul_ps(z_mean, factor(shear_y)), tiny);
    let sheared = _mm512_add_ps(_mm512_mul_ps(height, move_x), _mm512_mul_ps(width, move_y));
    let moved = _mm512_add_ps(
        _mm512_mul_ps(
            _mm512_mul_ps(width, height),
            _mm512_set1_ps(rounding::WIDTH),
        ),
        sheared,
    );
    let weight_error = _mm512_add_ps(
        _mm512_mul_ps(size, moved),
        _mm512_set1_ps(rounding::WEIGHTS),
    );
    let z_error = _mm512_add_ps(
        _mm512_mul_ps(extent(a.2, b.2, c.2), weight_error),
        _mm512_add_ps(
            _mm512_mul_ps(z_mean, _mm512_set1_ps(rounding::DISTANCE)),
            tiny,
        ),
    );
    let limit = _mm512_mul_ps(_mm512_set1_ps(level_rays.tolerance), _mm512_abs_ps(z_hit));
    let precise = decided
        & inside
        & _mm512_cmp_ps_mask::<_CMP_LE_OQ>(z_error, limit)
        & _mm512_cmp_ps_mask::<_CMP_LT_OQ>(weight_error, _mm512_set1_ps(rounding::MOST));
    let t = _mm512_div_ps(z_hit, load(&level_rays.direction_z));
    let mut near = _mm512_set1_ps(f32::NEG_INFINITY);
    let mut far = _mm512_set1_ps(f32::INFINITY);
    for k in 0..3 {
        let [a, b, c] = [0, 1, 2].map(|vertex: usize| group.vertices[vertex][axes[k]][i]);
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let (first, last) = if rays.is_backward(k) {
            (high, low)
        } else {
            (low, high)
        };
        let origin = load(&level_rays.origin[k]);
        let enter = _mm512_sub_ps(origin, _mm512_set1_ps(first));
        let leave = _mm512_sub_ps(origin, _mm512_set1_ps(last));
        near = _mm512_max_ps(
            _mm512_mul_ps(enter, load(&level_rays.near_inverse[k])),
            near,
        );
        far = _mm512_min_ps(_mm512_mul_ps(leave, load(&level_rays.far_inverse[k])), far);
    }
    let t = _mm512_min_ps(_mm512_max_ps(t, near), far);
    let accepted = precise & _mm512_cmp_ps_mask::<_CMP_GT_OQ>(t, load(&level_rays.t_min));
    Some(TriangleHits {
        lanes: LaneMask::from_bits(accepted),
        undecided: LaneMask::from_bits(inside & !precise),
        t,
        weights,
        front: LaneMask::from_bits(front),
    })
}

/// From the least to the greatest of three.
#[inline]
#[target_feature(enable = "avx512f")]
fn extent(a: __m512, b: __m512, c: __m512) -> __m512 {
    let most = _mm512_max_ps(_mm512_max_ps(a, b), c);
    _mm512_sub_ps(most, _mm512_min_ps(_mm512_min_ps(a, b), c))
}

/// One ray after the other, where rays meet edges and vertices.
#[cold]
#[inline(never)]
fn test_exactly(
    rays: &Rays,
    structure: &Structure,
    triangle: &[[f32; 3]; 3],
    slot: u32,
    lanes: LaneMask,
    found: &mut Found,
) {
    for lane in lanes {
        if let Some(hit) = intersect(&rays.level_rays.of_lane(lane), triangle, Rim::Included)
            && hit.t > rays.level_rays.t_min[lane]
        {
            found.offer(structure, lane, slot, &hit);
        }
    }
}
