//! Four triangles at once, as [`intersect`](super::triangle::intersect) does it for one, operation
//! by operation and so to the same bits. Where edge functions in f32 do not decide, that function does.
//!
//! Everything here is inlined into functions that have the instruction set enabled; closures would
//! not be.

use std::arch::x86_64::*;

use super::kernel::GroupHits;
use super::space::Space;
use super::triangle::{ORDINARY, REACH, SLACK};
use crate::layout::{GROUP, TriangleGroup};

/// Bytes from one axis of a vertex to the next.
const AXIS: usize = size_of::<[f32; GROUP]>();

/// Which lanes are hit, their edges included, with `t_min < t <= t_far`. The ray's distances are not
/// scaled.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
pub(crate) unsafe fn intersect(
    space: &Space,
    group: &TriangleGroup,
    t_min: f32,
    t_far: f32,
    found: &mut GroupHits,
) -> u32 {
    // SAFETY: the caller promises AVX2; groups are aligned, and axes are below three.
    unsafe {
        let vertices = group.vertices.as_ptr().cast::<u8>();
        let (a, b, c) = (
            flat(space, vertices),
            flat(space, vertices.add(3 * AXIS)),
            flat(space, vertices.add(6 * AXIS)),
        );
        let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
        let zero = _mm_setzero_ps();
        let least = _mm_min_ps(u, _mm_min_ps(v, w));
        let most = _mm_max_ps(u, _mm_max_ps(v, w));
        let outside = _mm_and_ps(
            _mm_cmp_ps::<_CMP_LT_OQ>(least, zero),
            _mm_cmp_ps::<_CMP_GT_OQ>(most, zero),
        );
        let inside = !(_mm_movemask_ps(outside) as u32) & group.lanes & 0xF;
        if inside == 0 {
            return 0;
        }
        let front = _mm_cmp_ps::<_CMP_GT_OQ>(least, zero);
        let back = _mm_cmp_ps::<_CMP_LT_OQ>(most, zero);
        let whole = _mm_add_ps(_mm_add_ps(u, v), w);
        let size = absolute(whole);
        let ordinary = _mm_and_ps(
            _mm_cmp_ps::<_CMP_GT_OQ>(size, _mm_set1_ps(ORDINARY[0])),
            _mm_cmp_ps::<_CMP_LT_OQ>(size, _mm_set1_ps(ORDINARY[1])),
        );
        let decided = _mm_and_ps(_mm_or_ps(front, back), ordinary);
        let decided = inside & _mm_movemask_ps(decided) as u32;

        let inverse_whole = _mm_div_ps(_mm_set1_ps(1.0), whole);
        let v = _mm_mul_ps(v, inverse_whole);
        let w = _mm_mul_ps(w, inverse_whole);
        let t = _mm_add_ps(
            _mm_mul_ps(v, _mm_sub_ps(b.2, a.2)),
            _mm_mul_ps(w, _mm_sub_ps(c.2, a.2)),
        );
        let z_hit = _mm_add_ps(a.2, t);
        let reach = _mm_max_ps(_mm_max_ps(absolute(a.2), absolute(b.2)), absolute(c.2));
        let modest =
            _mm_cmp_ps::<_CMP_LE_OQ>(reach, _mm_mul_ps(absolute(z_hit), _mm_set1_ps(REACH)));
        let t = _mm_mul_ps(z_hit, _mm_set1_ps(space.inverse_z));
        let slack = _mm_mul_ps(
            _mm_mul_ps(reach, absolute(_mm_set1_ps(space.inverse_z))),
            _mm_set1_ps(SLACK),
        );
        let behind = _mm_cmp_ps::<_CMP_LE_OQ>(_mm_add_ps(t, slack), _mm_set1_ps(space.t_min));
        let inside = inside & !(decided & _mm_movemask_ps(behind) as u32);
        if inside == 0 {
            return 0;
        }
        let decided = decided & inside & _mm_movemask_ps(modest) as u32;
        let (near, far) = slab(space, vertices);
        let t = _mm_min_ps(_mm_max_ps(t, near), far);
        let accepted = _mm_and_ps(
            _mm_cmp_ps::<_CMP_LE_OQ>(near, far),
            _mm_and_ps(
                _mm_cmp_ps::<_CMP_GT_OQ>(t, _mm_set1_ps(t_min)),
                _mm_cmp_ps::<_CMP_LE_OQ>(t, _mm_set1_ps(t_far)),
            ),
        );
        let hits = decided & _mm_movemask_ps(accepted) as u32;
        let undecided = inside & !decided;
        if hits | undecided == 0 {
            return 0;
        }
        found.front = _mm_movemask_ps(front) as u32;
        let [second, third] = &mut found.barycentrics;
        _mm_store_ps(found.t.as_mut_ptr(), t);
        _mm_store_ps(second.as_mut_ptr(), v);
        _mm_store_ps(third.as_mut_ptr(), w);
        if undecided != 0 {
            return hits | exactly(found, space, group, undecided, t_min, t_far);
        }
        hits
    }
}

/// Rays along edges and vertices, and numbers out of all proportion.
#[cold]
#[inline(never)]
fn exactly(
    found: &mut GroupHits,
    space: &Space,
    group: &TriangleGroup,
    mask: u32,
    t_min: f32,
    t_far: f32,
) -> u32 {
    found.intersect_each(space, group, mask, t_min, t_far)
}

#[inline(always)]
unsafe fn absolute(v: __m128) -> __m128 {
    // SAFETY: the callers'.
    unsafe { _mm_andnot_ps(_mm_set1_ps(-0.0), v) }
}

/// A row of a vertex, by the axes of the ray.
#[inline(always)]
unsafe fn load(space: &Space, vertex: *const u8, axis: usize) -> __m128 {
    // SAFETY: the callers': axes are below three, and a vertex has three rows.
    unsafe { _mm_load_ps(vertex.add(space.axes()[axis] * AXIS).cast()) }
}

type Flat = (__m128, __m128, __m128);

/// A vertex in the plane across the ray, and how far along it.
#[inline(always)]
unsafe fn flat(space: &Space, vertex: *const u8) -> Flat {
    // SAFETY: the callers'.
    unsafe {
        let origin = &space.flat_origin;
        let x = _mm_sub_ps(load(space, vertex, 0), _mm_set1_ps(origin[0]));
        let y = _mm_sub_ps(load(space, vertex, 1), _mm_set1_ps(origin[1]));
        let z = _mm_sub_ps(load(space, vertex, 2), _mm_set1_ps(origin[2]));
        (
            _mm_sub_ps(x, _mm_mul_ps(_mm_set1_ps(space.shear[0]), z)),
            _mm_sub_ps(y, _mm_mul_ps(_mm_set1_ps(space.shear[1]), z)),
            z,
        )
    }
}

#[inline(always)]
unsafe fn edge(p: Flat, q: Flat) -> __m128 {
    // SAFETY: the callers'.
    unsafe { _mm_sub_ps(_mm_mul_ps(p.0, q.1), _mm_mul_ps(p.1, q.0)) }
}

/// Where the ray is inside the triangles' own boxes; see [`Space::slab`].
#[inline(always)]
unsafe fn slab(space: &Space, vertices: *const u8) -> (__m128, __m128) {
    // SAFETY: the callers'.
    unsafe {
        let mut near = _mm_set1_ps(f32::NEG_INFINITY);
        let mut far = _mm_set1_ps(f32::INFINITY);
        for axis in [2, 1, 0] {
            let a = _mm_load_ps(vertices.add(axis * AXIS).cast());
            let b = _mm_load_ps(vertices.add((3 + axis) * AXIS).cast());
            let c = _mm_load_ps(vertices.add((6 + axis) * AXIS).cast());
            let low = _mm_min_ps(_mm_min_ps(a, b), c);
            let high = _mm_max_ps(_mm_max_ps(a, b), c);
            let swap = _mm_castsi128_ps(_mm_set1_epi32(space.signs[axis]));
            let first = _mm_blendv_ps(low, high, swap);
            let last = _mm_blendv_ps(high, low, swap);
            let enter = _mm_sub_ps(first, _mm_set1_ps(space.near_origin[axis]));
            let leave = _mm_sub_ps(last, _mm_set1_ps(space.far_origin[axis]));
            near = _mm_max_ps(
                _mm_mul_ps(enter, _mm_set1_ps(space.near_inverse[axis])),
                near,
            );
            far = _mm_min_ps(_mm_mul_ps(leave, _mm_set1_ps(space.far_inverse[axis])), far);
        }
        (near, far)
    }
}
