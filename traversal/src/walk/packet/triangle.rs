//! Sixteen rays and a triangle.

use std::arch::x86_64::*;

use super::found::Found;
use super::rays::Rays;
use crate::layout::{GROUP, TriangleGroup, child};
use crate::structure::Structure;
use crate::walk::PACKET;
use crate::walk::space::Space;
use crate::walk::triangle::{ORDINARY, REACH, Rim, SLACK, intersect};

/// Tests the triangles of a leaf.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2")]
pub(super) fn test_leaf(
    rays: &Rays,
    structure: &Structure,
    word: u32,
    lanes: u16,
    found: &mut Found,
) {
    let index = word & child::INDEX;
    let groups = if word & child::TWO_GROUPS != 0 { 2 } else { 1 };
    for index in index..index + groups {
        let Some(group) = structure.group(index) else {
            return;
        };
        for i in 0..GROUP {
            if group.lanes >> i & 1 != 0 {
                let slot = GROUP as u32 * index + i as u32;
                test_triangle(rays, structure, group, slot, lanes, found);
            }
        }
    }
}

type Flat = (__m512, __m512, __m512);

/// As [`intersect`](crate::walk::group::intersect) does it for four triangles and one ray.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2")]
fn test_triangle(
    rays: &Rays,
    structure: &Structure,
    group: &TriangleGroup,
    slot: u32,
    lanes: u16,
    found: &mut Found,
) {
    let i = slot as usize % GROUP;
    let [x_axis, y_axis, z_axis] = rays.axes;
    let moved = |vertex: usize, axis: usize| {
        _mm512_sub_ps(
            _mm512_set1_ps(group.vertices[vertex][axis][i]),
            rays.origin[axis].load(),
        )
    };
    let (shear_x, shear_y) = (rays.shear[0].load(), rays.shear[1].load());
    let flat = |vertex: usize| -> Flat {
        let z = moved(vertex, z_axis);
        (
            _mm512_sub_ps(moved(vertex, x_axis), _mm512_mul_ps(shear_x, z)),
            _mm512_sub_ps(moved(vertex, y_axis), _mm512_mul_ps(shear_y, z)),
            z,
        )
    };
    let edge = |p: Flat, q: Flat| _mm512_sub_ps(_mm512_mul_ps(p.0, q.1), _mm512_mul_ps(p.1, q.0));
    let (a, b, c) = (flat(0), flat(1), flat(2));
    let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
    let zero = _mm512_setzero_ps();
    let least = _mm512_min_ps(u, _mm512_min_ps(v, w));
    let most = _mm512_max_ps(u, _mm512_max_ps(v, w));
    let outside = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(least, zero)
        & _mm512_cmp_ps_mask::<_CMP_GT_OQ>(most, zero);
    let inside = !outside & lanes;
    if inside == 0 {
        return;
    }
    let front = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(least, zero);
    let back = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(most, zero);
    let whole = _mm512_add_ps(_mm512_add_ps(u, v), w);
    let size = _mm512_abs_ps(whole);
    let ordinary = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(size, _mm512_set1_ps(ORDINARY[0]))
        & _mm512_cmp_ps_mask::<_CMP_LT_OQ>(size, _mm512_set1_ps(ORDINARY[1]));
    let decided = (front | back) & ordinary & inside;

    let inverse_whole = _mm512_div_ps(_mm512_set1_ps(1.0), whole);
    let v = _mm512_mul_ps(v, inverse_whole);
    let w = _mm512_mul_ps(w, inverse_whole);
    let t = _mm512_add_ps(
        _mm512_mul_ps(v, _mm512_sub_ps(b.2, a.2)),
        _mm512_mul_ps(w, _mm512_sub_ps(c.2, a.2)),
    );
    let z_hit = _mm512_add_ps(a.2, t);
    let reach = _mm512_max_ps(
        _mm512_max_ps(_mm512_abs_ps(a.2), _mm512_abs_ps(b.2)),
        _mm512_abs_ps(c.2),
    );
    let reach_limit = _mm512_mul_ps(_mm512_abs_ps(z_hit), _mm512_set1_ps(REACH));
    let modest = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(reach, reach_limit);
    let inverse_z = rays.inverse_z.load();
    let t = _mm512_mul_ps(z_hit, inverse_z);
    let slack = _mm512_mul_ps(
        _mm512_mul_ps(reach, _mm512_abs_ps(inverse_z)),
        _mm512_set1_ps(SLACK),
    );
    let behind = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(_mm512_add_ps(t, slack), rays.t_min.load());
    let inside = inside & !(decided & behind);
    let decided = decided & inside & modest;
    let mut near = _mm512_set1_ps(f32::NEG_INFINITY);
    let mut far = _mm512_set1_ps(f32::INFINITY);
    for axis in (0..3).rev() {
        let [a, b, c] = [0, 1, 2].map(|vertex| group.vertices[vertex][axis][i]);
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let (first, last) = if rays.signs[axis] {
            (high, low)
        } else {
            (low, high)
        };
        let origin = rays.origin[axis].load();
        let enter = _mm512_sub_ps(_mm512_set1_ps(first), origin);
        let leave = _mm512_sub_ps(_mm512_set1_ps(last), origin);
        near = _mm512_max_ps(_mm512_mul_ps(enter, rays.near_inverse[axis].load()), near);
        far = _mm512_min_ps(_mm512_mul_ps(leave, rays.far_inverse[axis].load()), far);
    }
    let t = _mm512_min_ps(_mm512_max_ps(t, near), far);
    let t_far = found.t.load();
    let accepted = decided
        & _mm512_cmp_ps_mask::<_CMP_LE_OQ>(near, far)
        & _mm512_cmp_ps_mask::<_CMP_GT_OQ>(t, rays.t_min.load());
    let mut nearer = accepted & _mm512_cmp_ps_mask::<_CMP_LT_OQ>(t, t_far);
    let ties = accepted & _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(t, t_far) & found.hit;
    if ties != 0 {
        nearer |= found.won_ties(structure, slot, ties);
    }
    if nearer != 0 {
        found.t.store(_mm512_mask_blend_ps(nearer, t_far, t));
        for (place, weight) in found.barycentrics.iter_mut().zip([v, w]) {
            place.store(_mm512_mask_blend_ps(nearer, place.load(), weight));
        }
        // SAFETY: sixteen words.
        unsafe {
            let slots = found.slots.as_mut_ptr().cast();
            _mm512_mask_storeu_epi32(slots, nearer, _mm512_set1_epi32(slot as i32));
            let instances = found.instances.as_mut_ptr().cast();
            let instance = _mm512_set1_epi32(found.instance as i32);
            _mm512_mask_storeu_epi32(instances, nearer, instance);
        }
        found.front = found.front & !nearer | front & nearer;
        found.hit |= nearer;
    }
    let undecided = inside & !decided;
    if undecided != 0 {
        test_exactly(rays, structure, group, slot, undecided, found);
    }
}

/// One ray after the other, where rays meet edges and vertices.
#[cold]
#[inline(never)]
fn test_exactly(
    rays: &Rays,
    structure: &Structure,
    group: &TriangleGroup,
    slot: u32,
    lanes: u16,
    found: &mut Found,
) {
    for lane in (0..PACKET).filter(|lane| lanes >> lane & 1 != 0) {
        let mut space = Space::NOWHERE;
        space.set(
            [0, 1, 2].map(|axis| rays.origin[axis].0[lane]),
            [0, 1, 2].map(|axis| rays.direction[axis].0[lane]),
            rays.t_min.0[lane],
            0.0,
        );
        let triangle = group.triangle(slot as usize % GROUP);
        let Some(hit) = intersect(&space, &triangle, Rim::Included) else {
            continue;
        };
        let t_far = found.t.0[lane];
        let wins = hit.t < t_far
            || hit.t == t_far && found.won_ties(structure, slot, (1 << lane) & found.hit) != 0;
        if hit.t > rays.t_min.0[lane] && wins {
            found.t.0[lane] = hit.t;
            found.barycentrics[0].0[lane] = hit.barycentrics[0];
            found.barycentrics[1].0[lane] = hit.barycentrics[1];
            found.slots[lane] = slot;
            found.instances[lane] = found.instance;
            found.front = found.front & !(1 << lane) | u16::from(hit.front) << lane;
            found.hit |= 1 << lane;
        }
    }
}
