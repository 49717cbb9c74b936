//! The triangles of a leaf at once, as [`intersect`](super::triangle::intersect) does it for one, operation
//! by operation and so to the same bits. Where bounds do not decide, that function does.
//!
//! Coordinates have the opposite sign here, so that vertices are subtracted where they lie in memory. Edge functions are
//! the same bits, as they are made of products of two.
//!
//! Everything here is inlined into functions that have the instruction set enabled; closures would
//! not be.

use std::arch::x86_64::*;

use super::decide;
use super::decide::Rim;
use super::group_hits::GroupHits;
use super::sight::Sight;
use super::triangle::{Intersection, ORDINARY, rounding};
use crate::layout::{GROUP, LEAF_TRIANGLES, MARGIN_RISE, Margin, TriangleGroup};

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
        let least = _mm256_min_ps(u, _mm256_min_ps(v, w));
        let most = _mm256_max_ps(u, _mm256_max_ps(v, w));
        let margin = groups[0].margin.max(groups[1].margin);
        let error = error(margin, absolute(a.apart[2]));
        let sign = _mm256_set1_ps(-0.0);
        // Two of opposite signs.
        let apart = _mm256_min_ps(most, _mm256_xor_ps(least, sign));
        let outside = _mm256_cmp_ps::<_CMP_GT_OQ>(apart, error);
        let inside = !(_mm256_movemask_ps(outside) as u32) & lanes;
        if inside == 0 {
            return 0;
        }
        let front = _mm256_cmp_ps::<_CMP_GT_OQ>(least, error);
        let back = _mm256_cmp_ps::<_CMP_LT_OQ>(most, _mm256_xor_ps(error, sign));
        let whole = _mm256_add_ps(_mm256_add_ps(u, v), w);
        let size = absolute(whole);
        let ordinary = _mm256_and_ps(
            _mm256_cmp_ps::<_CMP_GT_OQ>(size, _mm256_set1_ps(ORDINARY[0])),
            _mm256_cmp_ps::<_CMP_LT_OQ>(size, _mm256_set1_ps(ORDINARY[1])),
        );
        let decided = _mm256_and_ps(_mm256_or_ps(front, back), ordinary);
        let decided = inside & _mm256_movemask_ps(decided) as u32;

        let inverse_whole = _mm256_div_ps(_mm256_set1_ps(1.0), whole);
        let size = absolute(inverse_whole);
        let [v_weight, w_weight] = [
            _mm256_mul_ps(v, inverse_whole),
            _mm256_mul_ps(w, inverse_whole),
        ];
        let [az, bz, cz] = [a.apart[2], b.apart[2], c.apart[2]];
        let z_hit = _mm256_add_ps(
            az,
            _mm256_add_ps(
                _mm256_mul_ps(v_weight, _mm256_sub_ps(bz, az)),
                _mm256_mul_ps(w_weight, _mm256_sub_ps(cz, az)),
            ),
        );
        // Surely not in the interval: mostly the surface that the ray starts from. Edge functions that are off by the bound
        // move what is between three distances by three times that at most; a margin's reach is more than twice their extent.
        let inverse_z = _mm256_set1_ps(ray.inverse_z());
        let length = absolute(inverse_z);
        let t = _mm256_mul_ps(z_hit, inverse_z);
        let room = _mm256_mul_ps(
            _mm256_mul_ps(_mm256_mul_ps(error, size), length),
            _mm256_set1_ps(1.5 * margin.reach),
        );
        let t_min = _mm256_set1_ps(interval[0]);
        let t_far = _mm256_set1_ps(interval[1]);
        let apart = _mm256_or_ps(
            _mm256_cmp_ps::<_CMP_LE_OQ>(_mm256_add_ps(t, room), t_min),
            _mm256_cmp_ps::<_CMP_GT_OQ>(_mm256_sub_ps(t, room), t_far),
        );
        let inside = inside & !(decided & _mm256_movemask_ps(apart) as u32);
        if inside == 0 {
            return 0;
        }
        let u_weight = _mm256_mul_ps(u, inverse_whole);
        let z_mean = _mm256_add_ps(
            _mm256_add_ps(
                _mm256_mul_ps(u_weight, absolute(az)),
                _mm256_mul_ps(v_weight, absolute(bz)),
            ),
            _mm256_mul_ps(w_weight, absolute(cz)),
        );
        let (width, height) = (extent(a.x, b.x, c.x), extent(a.y, b.y, c.y));
        let shear_x = rounding::shear(ray.shear(0));
        let shear_y = rounding::shear(ray.shear(1));
        let tiny = _mm256_set1_ps(rounding::LEAST);
        let move_x = _mm256_add_ps(_mm256_mul_ps(z_mean, _mm256_set1_ps(shear_x)), tiny);
        let move_y = _mm256_add_ps(_mm256_mul_ps(z_mean, _mm256_set1_ps(shear_y)), tiny);
        let sheared = _mm256_add_ps(_mm256_mul_ps(height, move_x), _mm256_mul_ps(width, move_y));
        let moved = _mm256_add_ps(
            _mm256_mul_ps(
                _mm256_mul_ps(width, height),
                _mm256_set1_ps(rounding::WIDTH),
            ),
            sheared,
        );
        let weight_error = _mm256_add_ps(
            _mm256_mul_ps(size, moved),
            _mm256_set1_ps(rounding::WEIGHTS),
        );
        let z_error = _mm256_add_ps(
            _mm256_mul_ps(extent(az, bz, cz), weight_error),
            _mm256_add_ps(
                _mm256_mul_ps(z_mean, _mm256_set1_ps(rounding::DISTANCE)),
                tiny,
            ),
        );
        let precise = _mm256_and_ps(
            _mm256_cmp_ps::<_CMP_LE_OQ>(
                z_error,
                _mm256_mul_ps(_mm256_set1_ps(ray.tolerance()), absolute(z_hit)),
            ),
            _mm256_cmp_ps::<_CMP_LT_OQ>(weight_error, _mm256_set1_ps(rounding::MOST)),
        );
        let (near, far) = slab(ray, &[a.apart, b.apart, c.apart]);
        let t = _mm256_div_ps(z_hit, _mm256_set1_ps(ray.direction_z()));
        let t = _mm256_min_ps(_mm256_max_ps(t, near), far);
        let accepted = _mm256_and_ps(
            _mm256_cmp_ps::<_CMP_GT_OQ>(t, t_min),
            _mm256_cmp_ps::<_CMP_LE_OQ>(t, t_far),
        );
        let precise = _mm256_movemask_ps(precise) as u32;
        let hits = decided & precise & inside & _mm256_movemask_ps(accepted) as u32;
        let rest = inside & !(decided & precise);
        if hits | rest == 0 {
            return 0;
        }
        found.front = _mm256_movemask_ps(front) as u32;
        let [second, third] = &mut found.barycentrics;
        _mm256_store_ps(found.t.as_mut_ptr(), t);
        _mm256_store_ps(second.as_mut_ptr(), v_weight);
        _mm256_store_ps(third.as_mut_ptr(), w_weight);
        if rest != 0 {
            // Edge functions of one sign, whatever the bound, and a sum of ordinary size: then the place is the one that was
            // computed. The sign is that of the sum.
            let one_sign = _mm256_or_ps(
                _mm256_cmp_ps::<_CMP_GT_OQ>(least, _mm256_setzero_ps()),
                _mm256_cmp_ps::<_CMP_LT_OQ>(most, _mm256_setzero_ps()),
            );
            let mut slabs = Slabs([[0.0; LEAF_TRIANGLES]; 2]);
            _mm256_store_ps(slabs.0[0].as_mut_ptr(), near);
            _mm256_store_ps(slabs.0[1].as_mut_ptr(), far);
            let rest = Rest {
                lanes: rest,
                placed: precise & _mm256_movemask_ps(_mm256_and_ps(one_sign, ordinary)) as u32,
                positive: !_mm256_movemask_ps(whole) as u32,
                slabs,
            };
            return hits | rest.decide(found, ray, groups, interval);
        }
        hits
    }
}

/// Where the ray enters and leaves the triangles' boxes.
#[repr(align(32))]
struct Slabs([[f32; LEAF_TRIANGLES]; 2]);

/// Triangles about which bounds do not say everything.
struct Rest {
    lanes: u32,
    /// Those whose place is known once it is certain that they are hit, and which of those are seen from the front then.
    placed: u32,
    positive: u32,
    slabs: Slabs,
}

impl Rest {
    /// Rays near edges and vertices, and numbers out of all proportion.
    #[cold]
    #[inline(never)]
    fn decide<S: Sight>(
        &self,
        found: &mut GroupHits,
        ray: S,
        groups: [&TriangleGroup; 2],
        [t_min, t_far]: [f32; 2],
    ) -> u32 {
        let (origin, direction) = ray.given();
        let (mut hits, mut rest) = (0, self.lanes);
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize % LEAF_TRIANGLES;
            rest &= rest - 1;
            let bit = 1 << lane;
            let in_interval = |t: f32| t_min < t && t <= t_far;
            let triangle = groups[lane / GROUP].triangle(lane % GROUP);
            if self.placed & bit != 0 {
                let front = decide::faces(origin, direction, &triangle, Rim::Included);
                if front == Some(self.positive & bit != 0) {
                    found.front = found.front & !bit | self.positive & bit;
                    hits |= if in_interval(found.t[lane]) { bit } else { 0 };
                    continue;
                }
                if front.is_none() {
                    continue;
                }
            }
            let Some((front, t, weights)) =
                decide::meet(origin, direction, &triangle, Rim::Included)
            else {
                continue;
            };
            let [near, far] = self.slabs.0.map(|row| row[lane]);
            let t = (t as f32).max(near).min(far);
            if in_interval(t) {
                let barycentrics = weights.map(|weight| weight as f32);
                found.set(
                    lane,
                    &Intersection {
                        t,
                        barycentrics,
                        front,
                    },
                );
                hits |= bit;
            }
        }
        hits
    }
}

#[inline(always)]
unsafe fn absolute(v: __m256) -> __m256 {
    // SAFETY: the callers'.
    unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), v) }
}

/// How far off edge functions may be; see [`Margin`](crate::layout::Margin). `distance`: the first vertices'.
#[inline(always)]
unsafe fn error(margin: Margin, distance: __m256) -> __m256 {
    // SAFETY: the callers'.
    unsafe {
        let rise = _mm256_mul_ps(distance, _mm256_set1_ps(MARGIN_RISE));
        _mm256_mul_ps(
            _mm256_add_ps(distance, _mm256_set1_ps(margin.reach)),
            _mm256_add_ps(_mm256_set1_ps(margin.slope), rise),
        )
    }
}

/// From the least to the greatest of three.
#[inline(always)]
unsafe fn extent(a: __m256, b: __m256, c: __m256) -> __m256 {
    // SAFETY: the callers'.
    unsafe {
        let most = _mm256_max_ps(_mm256_max_ps(a, b), c);
        _mm256_sub_ps(most, _mm256_min_ps(_mm256_min_ps(a, b), c))
    }
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
