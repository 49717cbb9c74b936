//! The triangles of a leaf at once, as [`intersect`](super::triangle::intersect) does it for one, operation
//! by operation and so to the same bits. Where edge functions in f32 do not decide, that function does.
//!
//! Coordinates have the opposite sign here, so that vertices are subtracted where they lie in memory. Edge functions are
//! the same bits, as they are made of products of two.
//!
//! Everything here is inlined into functions that have the instruction set enabled; closures would
//! not be.

use std::arch::x86_64::*;

use super::kernel::GroupHits;
use super::sight::Sight;
use super::space::Space;
use super::triangle::{ORDINARY, SLACK};
use crate::layout::{GROUP, TriangleGroup};

/// Bytes from one vertex to the next.
const VERTEX: usize = size_of::<[[f32; GROUP]; 3]>();

/// Which of some lanes are hit, their edges included, after the interval's start and not after its end. The ray's distances are not
/// scaled.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
pub(crate) unsafe fn intersect<S: Sight>(
    ray: S,
    groups: [&TriangleGroup; 2],
    lanes: u32,
    interval: [f32; 2],
    found: &mut GroupHits,
) -> u32 {
    // SAFETY: the caller promises AVX2; groups are aligned, and axes are below three.
    unsafe {
        let vertices = groups.map(|group| group.vertices.as_ptr().cast::<u8>());
        let (a, b, c) = (
            flat(ray, vertices, 0),
            flat(ray, vertices, VERTEX),
            flat(ray, vertices, 2 * VERTEX),
        );
        let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
        let zero = _mm256_setzero_ps();
        let least = _mm256_min_ps(u, _mm256_min_ps(v, w));
        let most = _mm256_max_ps(u, _mm256_max_ps(v, w));
        let outside = _mm256_and_ps(
            _mm256_cmp_ps::<_CMP_LT_OQ>(least, zero),
            _mm256_cmp_ps::<_CMP_GT_OQ>(most, zero),
        );
        let inside = !(_mm256_movemask_ps(outside) as u32) & lanes;
        if inside == 0 {
            return 0;
        }
        let front = _mm256_cmp_ps::<_CMP_GT_OQ>(least, zero);
        let back = _mm256_cmp_ps::<_CMP_LT_OQ>(most, zero);
        let whole = _mm256_add_ps(_mm256_add_ps(u, v), w);
        let size = absolute(whole);
        let ordinary = _mm256_and_ps(
            _mm256_cmp_ps::<_CMP_GT_OQ>(size, _mm256_set1_ps(ORDINARY[0])),
            _mm256_cmp_ps::<_CMP_LT_OQ>(size, _mm256_set1_ps(ORDINARY[1])),
        );
        let decided = _mm256_and_ps(_mm256_or_ps(front, back), ordinary);
        let decided = inside & _mm256_movemask_ps(decided) as u32;

        let inverse_whole = _mm256_div_ps(_mm256_set1_ps(1.0), whole);
        let v = _mm256_mul_ps(v, inverse_whole);
        let w = _mm256_mul_ps(w, inverse_whole);
        let [a, b, c] = [a.apart, b.apart, c.apart];
        let t = _mm256_add_ps(
            _mm256_mul_ps(v, _mm256_sub_ps(b[2], a[2])),
            _mm256_mul_ps(w, _mm256_sub_ps(c[2], a[2])),
        );
        let z_hit = _mm256_add_ps(a[2], t);
        let reach = _mm256_max_ps(
            _mm256_max_ps(absolute(a[2]), absolute(b[2])),
            absolute(c[2]),
        );
        let inverse_z = _mm256_set1_ps(ray.inverse_z());
        let modest = _mm256_cmp_ps::<_CMP_LE_OQ>(
            reach,
            _mm256_mul_ps(absolute(z_hit), _mm256_set1_ps(ray.reach())),
        );
        let t = _mm256_mul_ps(z_hit, inverse_z);
        let slack = _mm256_mul_ps(
            _mm256_mul_ps(reach, absolute(inverse_z)),
            _mm256_set1_ps(SLACK),
        );
        let behind =
            _mm256_cmp_ps::<_CMP_LE_OQ>(_mm256_add_ps(t, slack), _mm256_set1_ps(ray.t_min()));
        let inside = inside & !(decided & _mm256_movemask_ps(behind) as u32);
        if inside == 0 {
            return 0;
        }
        let decided = decided & inside & _mm256_movemask_ps(modest) as u32;
        let (near, far) = slab(ray, &[a, b, c]);
        let t = _mm256_min_ps(_mm256_max_ps(t, near), far);
        let accepted = _mm256_and_ps(
            _mm256_cmp_ps::<_CMP_LE_OQ>(near, far),
            _mm256_and_ps(
                _mm256_cmp_ps::<_CMP_GT_OQ>(t, _mm256_set1_ps(interval[0])),
                _mm256_cmp_ps::<_CMP_LE_OQ>(t, _mm256_set1_ps(interval[1])),
            ),
        );
        let hits = decided & _mm256_movemask_ps(accepted) as u32;
        let undecided = inside & !decided;
        if hits | undecided == 0 {
            return 0;
        }
        found.front = _mm256_movemask_ps(front) as u32;
        let [second, third] = &mut found.barycentrics;
        _mm256_store_ps(found.t.as_mut_ptr(), t);
        _mm256_store_ps(second.as_mut_ptr(), v);
        _mm256_store_ps(third.as_mut_ptr(), w);
        if undecided != 0 {
            return hits | exactly(found, &ray.space(), groups, undecided, interval);
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
    groups: [&TriangleGroup; 2],
    mask: u32,
    interval: [f32; 2],
) -> u32 {
    found.intersect_each(space, groups, mask, interval)
}

#[inline(always)]
unsafe fn absolute(v: __m256) -> __m256 {
    // SAFETY: the callers'.
    unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), v) }
}

/// A vertex as seen from the ray's origin, by the axes of the ray.
#[derive(Clone, Copy)]
struct Flat {
    /// From the vertex to the origin.
    apart: [__m256; 3],
    /// In the plane across the ray.
    x: __m256,
    y: __m256,
}

/// From the vertices at an offset to the origin, along an axis of the ray.
#[inline(always)]
unsafe fn apart<S: Sight>(ray: S, vertices: [*const u8; 2], offset: usize, axis: usize) -> __m256 {
    // SAFETY: the callers': axes are below three, and a vertex has three rows.
    unsafe {
        let row = offset + ray.axis(axis);
        let first = _mm256_castps128_ps256(_mm_load_ps(vertices[0].add(row).cast()));
        let last = _mm_load_ps(vertices[1].add(row).cast());
        let both = _mm256_insertf128_ps::<1>(first, last);
        _mm256_sub_ps(_mm256_set1_ps(ray.origin(axis)), both)
    }
}

#[inline(always)]
unsafe fn flat<S: Sight>(ray: S, vertices: [*const u8; 2], offset: usize) -> Flat {
    // SAFETY: the callers'.
    unsafe {
        let x = apart(ray, vertices, offset, 0);
        let y = apart(ray, vertices, offset, 1);
        let z = apart(ray, vertices, offset, 2);
        Flat {
            apart: [x, y, z],
            x: _mm256_sub_ps(x, _mm256_mul_ps(_mm256_set1_ps(ray.shear(0)), z)),
            y: _mm256_sub_ps(y, _mm256_mul_ps(_mm256_set1_ps(ray.shear(1)), z)),
        }
    }
}

#[inline(always)]
unsafe fn edge(p: Flat, q: Flat) -> __m256 {
    // SAFETY: the callers'.
    unsafe { _mm256_sub_ps(_mm256_mul_ps(p.x, q.y), _mm256_mul_ps(p.y, q.x)) }
}

/// Where the ray is inside the triangles' own boxes; see [`Space::slab`](super::space::Space::slab). As rounding is
/// monotone, the extreme products are those of the extreme vertices. Operand order decides what NaN does: where a zero of the
/// direction meets the plane that counts, the axis does not.
#[inline(always)]
unsafe fn slab<S: Sight>(ray: S, vertices: &[[__m256; 3]; 3]) -> (__m256, __m256) {
    // SAFETY: the callers'.
    unsafe {
        let mut near = _mm256_set1_ps(f32::NEG_INFINITY);
        let mut far = _mm256_set1_ps(f32::INFINITY);
        let [a, b, c] = vertices;
        for axis in [2, 1, 0] {
            let upper = _mm256_min_ps(_mm256_min_ps(a[axis], b[axis]), c[axis]);
            let lower = _mm256_max_ps(_mm256_max_ps(a[axis], b[axis]), c[axis]);
            let inverse = _mm256_set1_ps(ray.near_inverse(axis));
            let enter = _mm256_min_ps(_mm256_mul_ps(upper, inverse), _mm256_mul_ps(lower, inverse));
            let inverse = _mm256_set1_ps(ray.far_inverse(axis));
            let leave = _mm256_max_ps(_mm256_mul_ps(lower, inverse), _mm256_mul_ps(upper, inverse));
            near = _mm256_max_ps(enter, near);
            far = _mm256_min_ps(leave, far);
        }
        (near, far)
    }
}
