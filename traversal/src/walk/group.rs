//! The triangles of a leaf at once, as [`intersect`](super::triangle::intersect) does it for one,
//! operation by operation and so to the same bits. Where bounds do not decide, that function does.
//!
//! Coordinates have the opposite sign here, so that vertices are subtracted where they lie in
//! memory. Edge functions are the same bits, as they are made of products of two.
//!
//! Everything here is inlined into functions that have the instruction set enabled; closures would
//! not be.

use std::arch::x86_64::*;

use super::edge_side;
use super::edge_side::Rim;
use super::group_hits::GroupHits;
use super::triangle::{Intersection, ORDINARY, ROOM, rounding};
use super::triangle_ray::TriangleRay;
use crate::layout::{GROUP, LEAF_TRIANGLES, MARGIN_RISE, Margin, TriangleGroup};

/// Bytes from one vertex to the next.
const VERTEX: usize = size_of::<[[f32; GROUP]; 3]>();

/// Which of some lanes are hit, their edges included, after the interval's start and not after its
/// end. The ray's distances are not scaled.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
pub(crate) unsafe fn intersect<S: TriangleRay>(
    ray: S,
    groups: [&TriangleGroup; 2],
    lanes: u32,
    interval: [f32; 2],
    found: &mut GroupHits,
) -> u32 {
    // SAFETY: the caller guarantees that the machine has AVX2; groups are aligned, and axes are
    // below three.
    unsafe {
        let sides = Sides::new(ray, groups);
        let inside = sides.may_be_hit() & lanes;
        if inside == 0 {
            return 0;
        }
        let place = ScaledHit::new(&sides);
        let decided = sides.is_decided(&place);
        // Surely not in the interval: mostly the surface that the ray starts from. Edge functions
        // that are off by the bound move what is between three distances by three times that at
        // most; a margin's reach is more than twice their extent.
        let inverse_z = ray.inverse_z();
        let reach = 1.5 * groups[0].margin.max(groups[1].margin).reach;
        let t = _mm256_mul_ps(place.z, _mm256_set1_ps(inverse_z));
        let room = _mm256_mul_ps(
            _mm256_mul_ps(sides.error, place.inverse_size),
            _mm256_set1_ps(reach * inverse_z.abs()),
        );
        let (t_min, t_far) = (_mm256_set1_ps(interval[0]), _mm256_set1_ps(interval[1]));
        let apart = _mm256_or_ps(
            _mm256_cmp_ps::<_CMP_LE_OQ>(_mm256_add_ps(t, room), t_min),
            _mm256_cmp_ps::<_CMP_GT_OQ>(_mm256_sub_ps(t, room), t_far),
        );
        let apart = _mm256_and_ps(decided, apart);
        let inside = inside & !(_mm256_movemask_ps(apart) as u32);
        if inside == 0 {
            return 0;
        }
        // Known values go straight to their destination: there are few registers.
        place.store(found);
        let boxes = TriangleBounds::new(ray, &sides);
        let [weight_error, z_error] = place.rough_errors(ray, &boxes);
        let narrow = _mm256_cmp_ps::<_CMP_LT_OQ>(weight_error, _mm256_set1_ps(rounding::MOST));
        let precise = _mm256_and_ps(narrow, place.is_within(ray, z_error));
        let settled = _mm256_and_ps(decided, precise);
        let t = _mm256_div_ps(place.z, _mm256_set1_ps(ray.direction_z()));
        let t = boxes.clamp(t);
        _mm256_store_ps(found.t.as_mut_ptr(), t);
        let accepted = _mm256_and_ps(
            _mm256_cmp_ps::<_CMP_GT_OQ>(t, t_min),
            _mm256_cmp_ps::<_CMP_LE_OQ>(t, t_far),
        );
        let accepted = _mm256_and_ps(settled, accepted);
        let hits = inside & _mm256_movemask_ps(accepted) as u32;
        let rest = inside & !(_mm256_movemask_ps(settled) as u32);
        if rest != 0 {
            return hits | decide_rest(ray, groups, rest, interval, found);
        }
        hits
    }
}

/// Triangles of which rough bounds do not say everything.
///
/// # Safety
/// The machine has AVX2.
#[cold]
#[inline(never)]
#[target_feature(enable = "avx2,bmi1,bmi2")]
unsafe fn decide_rest<S: TriangleRay>(
    ray: S,
    groups: [&TriangleGroup; 2],
    lanes: u32,
    interval: [f32; 2],
    found: &mut GroupHits,
) -> u32 {
    // SAFETY: the caller guarantees that the machine has AVX2; groups are aligned, and axes are
    // below three.
    unsafe {
        let sides = Sides::new(ray, groups);
        let place = ScaledHit::new(&sides);
        let boxes = TriangleBounds::new(ray, &sides);
        let [weight_error, z_error] = place.errors(ray, &sides);
        let narrow = _mm256_cmp_ps::<_CMP_LT_OQ>(weight_error, _mm256_set1_ps(rounding::MOST));
        let precise = _mm256_and_ps(narrow, place.is_within(ray, z_error));
        let precise = _mm256_movemask_ps(precise) as u32;
        let decided = _mm256_movemask_ps(sides.is_decided(&place)) as u32;
        let t = _mm256_div_ps(place.z, _mm256_set1_ps(ray.direction_z()));
        let room = _mm256_mul_ps(z_error, _mm256_set1_ps(ROOM * ray.inverse_z().abs()));
        let (t_min, t_far) = (_mm256_set1_ps(interval[0]), _mm256_set1_ps(interval[1]));
        let apart = _mm256_or_ps(
            _mm256_cmp_ps::<_CMP_LE_OQ>(_mm256_add_ps(t, room), t_min),
            _mm256_cmp_ps::<_CMP_GT_OQ>(_mm256_sub_ps(t, room), t_far),
        );
        let apart = decided & _mm256_movemask_ps(_mm256_and_ps(narrow, apart)) as u32;
        let t = boxes.clamp(t);
        let accepted = _mm256_and_ps(
            _mm256_cmp_ps::<_CMP_GT_OQ>(t, t_min),
            _mm256_cmp_ps::<_CMP_LE_OQ>(t, t_far),
        );
        let hits = lanes & decided & precise & _mm256_movemask_ps(accepted) as u32;
        let rest = lanes & !(decided & precise | apart);
        if rest == 0 {
            return hits;
        }
        // Edge functions of one sign, whatever the bound, and a sum of ordinary size: then the
        // place is the one that was computed. The sign is that of the sum.
        let one_sign = _mm256_or_ps(
            _mm256_cmp_ps::<_CMP_GT_OQ>(sides.least, _mm256_setzero_ps()),
            _mm256_cmp_ps::<_CMP_LT_OQ>(sides.most, _mm256_setzero_ps()),
        );
        let one_sign = _mm256_and_ps(one_sign, place.is_ordinary());
        let mut slabs = Slabs([[0.0; LEAF_TRIANGLES]; 2]);
        _mm256_store_ps(slabs.0[0].as_mut_ptr(), boxes.near);
        _mm256_store_ps(slabs.0[1].as_mut_ptr(), boxes.far);
        let rest = Rest {
            lanes: rest,
            placed: precise & _mm256_movemask_ps(one_sign) as u32,
            positive: place.front(),
            slabs,
        };
        hits | rest.decide(found, ray, groups, interval)
    }
}

/// Where the ray enters and leaves the triangles' boxes.
#[repr(align(32))]
struct Slabs([[f32; LEAF_TRIANGLES]; 2]);

/// Triangles about which bounds do not say everything.
struct Rest {
    lanes: u32,
    /// Those whose place is known once it is certain that they are hit, and which of those are seen
    /// from the front then.
    placed: u32,
    positive: u32,
    slabs: Slabs,
}

impl Rest {
    /// Rays near edges and vertices, and numbers out of all proportion.
    fn decide<S: TriangleRay>(
        &self,
        found: &mut GroupHits,
        ray: S,
        groups: [&TriangleGroup; 2],
        [t_min, t_far]: [f32; 2],
    ) -> u32 {
        let (origin, direction) = ray.world_ray();
        let (mut hits, mut rest) = (0, self.lanes);
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize % LEAF_TRIANGLES;
            rest &= rest - 1;
            let bit = 1 << lane;
            let in_interval = |t: f32| t_min < t && t <= t_far;
            let triangle = groups[lane / GROUP].triangle(lane % GROUP);
            if self.placed & bit != 0 {
                let front = edge_side::faces(origin, direction, &triangle, Rim::Included);
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
                edge_side::intersect_exactly(origin, direction, &triangle, Rim::Included)
            else {
                continue;
            };
            let [near, far] = &self.slabs.0;
            let t = (t as f32).max(near[lane]).min(far[lane]);
            if in_interval(t) {
                let barycentrics = [weights[0] as f32, weights[1] as f32];
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

/// On which sides of triangles' edges the ray passes.
struct Sides {
    vertices: [ShearedVertex; 3],
    edges: [__m256; 3],
    least: __m256,
    most: __m256,
    /// How far off edge functions may be; see [`Margin`](crate::layout::Margin).
    error: __m256,
}

impl Sides {
    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    unsafe fn new<S: TriangleRay>(ray: S, groups: [&TriangleGroup; 2]) -> Sides {
        // SAFETY: the caller guarantees that the machine has AVX2.
        unsafe {
            let vertices = groups.map(|group| group.vertices.as_ptr().cast::<u8>());
            let (a, b, c) = (
                flat(ray, vertices, 0),
                flat(ray, vertices, VERTEX),
                flat(ray, vertices, 2 * VERTEX),
            );
            let [u, v, w] = [edge(c, b), edge(a, c), edge(b, a)];
            let margin = groups[0].margin.max(groups[1].margin);
            Sides {
                vertices: [a, b, c],
                edges: [u, v, w],
                least: _mm256_min_ps(u, _mm256_min_ps(v, w)),
                most: _mm256_max_ps(u, _mm256_max_ps(v, w)),
                error: error(margin, absolute(a.apart[2])),
            }
        }
    }

    /// Those without two edges of surely opposite signs.
    ///
    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    unsafe fn may_be_hit(&self) -> u32 {
        // SAFETY: the caller guarantees that the machine has AVX2.
        unsafe {
            let apart = _mm256_min_ps(self.most, minus(self.least));
            let outside = _mm256_cmp_ps::<_CMP_GT_OQ>(apart, self.error);
            !(_mm256_movemask_ps(outside) as u32)
        }
    }

    /// Whether all edges are surely of one sign, and their sum of ordinary size.
    ///
    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    unsafe fn is_decided(&self, place: &ScaledHit) -> __m256 {
        // SAFETY: the caller guarantees that the machine has AVX2.
        unsafe {
            let within = _mm256_max_ps(self.least, minus(self.most));
            let inside = _mm256_cmp_ps::<_CMP_GT_OQ>(within, self.error);
            _mm256_and_ps(inside, place.is_ordinary())
        }
    }
}

/// Where the ray meets triangles that it passes inside.
struct ScaledHit {
    /// The sum of the edge functions.
    whole: __m256,
    /// One over its size.
    inverse_size: __m256,
    weights: [__m256; 3],
    /// Along the ray, from there to the origin.
    z: __m256,
}

impl ScaledHit {
    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    unsafe fn new(sides: &Sides) -> ScaledHit {
        // SAFETY: the caller guarantees that the machine has AVX2.
        unsafe {
            let [u, v, w] = sides.edges;
            let whole = _mm256_add_ps(_mm256_add_ps(u, v), w);
            let inverse = _mm256_div_ps(_mm256_set1_ps(1.0), whole);
            let [u, v, w] = [
                _mm256_mul_ps(u, inverse),
                _mm256_mul_ps(v, inverse),
                _mm256_mul_ps(w, inverse),
            ];
            let [az, bz, cz] = [
                sides.vertices[0].apart[2],
                sides.vertices[1].apart[2],
                sides.vertices[2].apart[2],
            ];
            let second = _mm256_mul_ps(v, _mm256_sub_ps(bz, az));
            let third = _mm256_mul_ps(w, _mm256_sub_ps(cz, az));
            ScaledHit {
                whole,
                inverse_size: absolute(inverse),
                weights: [u, v, w],
                z: _mm256_add_ps(az, _mm256_add_ps(second, third)),
            }
        }
    }

    /// Those seen from their front, if they are hit.
    ///
    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    unsafe fn front(&self) -> u32 {
        // SAFETY: the caller guarantees that the machine has AVX2.
        unsafe { !_mm256_movemask_ps(self.whole) as u32 }
    }

    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    unsafe fn is_ordinary(&self) -> __m256 {
        // SAFETY: the caller guarantees that the machine has AVX2.
        unsafe {
            let size = absolute(self.whole);
            _mm256_and_ps(
                _mm256_cmp_ps::<_CMP_GT_OQ>(size, _mm256_set1_ps(ORDINARY[0])),
                _mm256_cmp_ps::<_CMP_LT_OQ>(size, _mm256_set1_ps(ORDINARY[1])),
            )
        }
    }

    /// Whether a distance that may be so far off is precise enough.
    ///
    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    unsafe fn is_within<S: TriangleRay>(&self, ray: S, z_error: __m256) -> __m256 {
        // SAFETY: the caller guarantees that the machine has AVX2.
        unsafe {
            let limit = _mm256_mul_ps(_mm256_set1_ps(ray.tolerance()), absolute(self.z));
            _mm256_cmp_ps::<_CMP_LE_OQ>(z_error, limit)
        }
    }

    /// How far off weights and distances may be; see [`rounding`].
    ///
    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    unsafe fn errors<S: TriangleRay>(&self, ray: S, sides: &Sides) -> [__m256; 2] {
        // SAFETY: the caller guarantees that the machine has AVX2.
        unsafe {
            let [a, b, c] = &sides.vertices;
            let [az, bz, cz] = [a.apart[2], b.apart[2], c.apart[2]];
            let [u, v, w] = self.weights;
            let z_mean = _mm256_add_ps(
                _mm256_add_ps(
                    _mm256_mul_ps(u, absolute(az)),
                    _mm256_mul_ps(v, absolute(bz)),
                ),
                _mm256_mul_ps(w, absolute(cz)),
            );
            let (width, height) = (extent(a.x, b.x, c.x), extent(a.y, b.y, c.y));
            let shear_x = rounding::shear(ray.shear(0));
            let shear_y = rounding::shear(ray.shear(1));
            let tiny = _mm256_set1_ps(rounding::LEAST);
            let move_x = _mm256_add_ps(_mm256_mul_ps(z_mean, _mm256_set1_ps(shear_x)), tiny);
            let move_y = _mm256_add_ps(_mm256_mul_ps(z_mean, _mm256_set1_ps(shear_y)), tiny);
            let sheared =
                _mm256_add_ps(_mm256_mul_ps(height, move_x), _mm256_mul_ps(width, move_y));
            let moved = _mm256_add_ps(
                _mm256_mul_ps(
                    _mm256_mul_ps(width, height),
                    _mm256_set1_ps(rounding::WIDTH),
                ),
                sheared,
            );
            let weight_error = _mm256_add_ps(
                _mm256_mul_ps(self.inverse_size, moved),
                _mm256_set1_ps(rounding::WEIGHTS),
            );
            let z_error = _mm256_add_ps(
                _mm256_mul_ps(extent(az, bz, cz), weight_error),
                _mm256_add_ps(
                    _mm256_mul_ps(z_mean, _mm256_set1_ps(rounding::DISTANCE)),
                    tiny,
                ),
            );
            [weight_error, z_error]
        }
    }

    /// No less than [`Self::errors`], where edges are decided, and found with less: see
    /// [`rounding::ROUGH`].
    ///
    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    unsafe fn rough_errors<S: TriangleRay>(&self, ray: S, boxes: &TriangleBounds) -> [__m256; 2] {
        // SAFETY: the caller guarantees that the machine has AVX2.
        unsafe {
            let shear_x = _mm256_set1_ps(ray.shear(0).abs());
            let shear_y = _mm256_set1_ps(ray.shear(1).abs());
            let depth = boxes.sides[2];
            let width = _mm256_add_ps(boxes.sides[0], _mm256_mul_ps(shear_x, depth));
            let height = _mm256_add_ps(boxes.sides[1], _mm256_mul_ps(shear_y, depth));
            let z_mean = _mm256_max_ps(absolute(self.z), depth);
            let sheared = _mm256_mul_ps(
                _mm256_add_ps(
                    _mm256_mul_ps(height, shear_x),
                    _mm256_mul_ps(width, shear_y),
                ),
                _mm256_mul_ps(z_mean, _mm256_set1_ps(rounding::ROUGH * rounding::SHEAR)),
            );
            let moved = _mm256_add_ps(
                _mm256_mul_ps(
                    _mm256_mul_ps(width, height),
                    _mm256_set1_ps(rounding::ROUGH * rounding::WIDTH),
                ),
                sheared,
            );
            let weight_error = _mm256_add_ps(
                _mm256_mul_ps(self.inverse_size, moved),
                _mm256_set1_ps(rounding::ROUGH * rounding::WEIGHTS),
            );
            let z_error = _mm256_add_ps(
                _mm256_mul_ps(depth, weight_error),
                _mm256_add_ps(
                    _mm256_mul_ps(z_mean, _mm256_set1_ps(rounding::ROUGH * rounding::DISTANCE)),
                    _mm256_set1_ps(rounding::ROUGH * rounding::LEAST),
                ),
            );
            [weight_error, z_error]
        }
    }

    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    unsafe fn store(&self, found: &mut GroupHits) {
        let [second, third] = &mut found.barycentrics;
        // SAFETY: the caller guarantees that the machine has AVX2; rows are aligned.
        unsafe {
            found.front = self.front();
            _mm256_store_ps(second.as_mut_ptr(), self.weights[1]);
            _mm256_store_ps(third.as_mut_ptr(), self.weights[2]);
        }
    }
}

/// The boxes around triangles.
struct TriangleBounds {
    /// By the axes of the ray.
    sides: [__m256; 3],
    /// Where the ray is inside them; see [`LevelRay::slab`](super::level_ray::LevelRay::slab).
    near: __m256,
    far: __m256,
}

impl TriangleBounds {
    /// As rounding is monotone, the extreme products are those of the extreme vertices. Operand
    /// order decides what NaN does: where a zero of the direction meets the plane that counts, the
    /// axis does not.
    ///
    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    unsafe fn new<S: TriangleRay>(ray: S, sides: &Sides) -> TriangleBounds {
        let [a, b, c] = &sides.vertices;
        // SAFETY: the caller guarantees that the machine has AVX2.
        unsafe {
            let mut boxes = TriangleBounds {
                sides: a.apart,
                near: _mm256_set1_ps(f32::NEG_INFINITY),
                far: _mm256_set1_ps(f32::INFINITY),
            };
            for axis in [2, 1, 0] {
                let [a, b, c] = [a.apart[axis], b.apart[axis], c.apart[axis]];
                let upper = _mm256_min_ps(_mm256_min_ps(a, b), c);
                let lower = _mm256_max_ps(_mm256_max_ps(a, b), c);
                boxes.sides[axis] = _mm256_sub_ps(lower, upper);
                let inverse = _mm256_set1_ps(ray.near_inverse(axis));
                let enter =
                    _mm256_min_ps(_mm256_mul_ps(upper, inverse), _mm256_mul_ps(lower, inverse));
                let inverse = _mm256_set1_ps(ray.far_inverse(axis));
                let leave =
                    _mm256_max_ps(_mm256_mul_ps(lower, inverse), _mm256_mul_ps(upper, inverse));
                boxes.near = _mm256_max_ps(enter, boxes.near);
                boxes.far = _mm256_min_ps(leave, boxes.far);
            }
            boxes
        }
    }

    /// Brings distances into them.
    ///
    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    unsafe fn clamp(&self, t: __m256) -> __m256 {
        // SAFETY: the caller guarantees that the machine has AVX2.
        unsafe { _mm256_min_ps(_mm256_max_ps(t, self.near), self.far) }
    }
}

/// # Safety
/// The machine has AVX2.
#[inline(always)]
unsafe fn minus(v: __m256) -> __m256 {
    // SAFETY: the caller guarantees that the machine has AVX2.
    unsafe { _mm256_xor_ps(v, _mm256_set1_ps(-0.0)) }
}

/// # Safety
/// The machine has AVX2.
#[inline(always)]
unsafe fn absolute(v: __m256) -> __m256 {
    // SAFETY: the caller guarantees that the machine has AVX2.
    unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), v) }
}

/// How far off edge functions may be; see [`Margin`](crate::layout::Margin). `distance`: the first
/// vertices'.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
unsafe fn error(margin: Margin, distance: __m256) -> __m256 {
    // SAFETY: the caller guarantees that the machine has AVX2.
    unsafe {
        let rise = _mm256_mul_ps(distance, _mm256_set1_ps(MARGIN_RISE));
        _mm256_mul_ps(
            _mm256_add_ps(distance, _mm256_set1_ps(margin.reach)),
            _mm256_add_ps(_mm256_set1_ps(margin.slope), rise),
        )
    }
}

/// From the least to the greatest of three.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
unsafe fn extent(a: __m256, b: __m256, c: __m256) -> __m256 {
    // SAFETY: the caller guarantees that the machine has AVX2.
    unsafe {
        let most = _mm256_max_ps(_mm256_max_ps(a, b), c);
        _mm256_sub_ps(most, _mm256_min_ps(_mm256_min_ps(a, b), c))
    }
}

/// A vertex as seen from the ray's origin, by the axes of the ray.
#[derive(Clone, Copy)]
struct ShearedVertex {
    /// From the vertex to the origin.
    apart: [__m256; 3],
    /// In the plane across the ray.
    x: __m256,
    y: __m256,
}

/// From the vertices at an offset to the origin, along an axis of the ray.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
unsafe fn apart<S: TriangleRay>(
    ray: S,
    vertices: [*const u8; 2],
    offset: usize,
    axis: usize,
) -> __m256 {
    // SAFETY: the caller guarantees that the machine has AVX2; axes are below three, and a vertex
    // has three rows.
    unsafe {
        let row = offset + ray.axis(axis);
        let first = _mm256_castps128_ps256(_mm_load_ps(vertices[0].add(row).cast()));
        let last = _mm_load_ps(vertices[1].add(row).cast());
        let both = _mm256_insertf128_ps::<1>(first, last);
        _mm256_sub_ps(_mm256_set1_ps(ray.origin(axis)), both)
    }
}

/// # Safety
/// The machine has AVX2.
#[inline(always)]
unsafe fn flat<S: TriangleRay>(ray: S, vertices: [*const u8; 2], offset: usize) -> ShearedVertex {
    // SAFETY: the caller guarantees that the machine has AVX2.
    unsafe {
        let x = apart(ray, vertices, offset, 0);
        let y = apart(ray, vertices, offset, 1);
        let z = apart(ray, vertices, offset, 2);
        ShearedVertex {
            apart: [x, y, z],
            x: _mm256_sub_ps(x, _mm256_mul_ps(_mm256_set1_ps(ray.shear(0)), z)),
            y: _mm256_sub_ps(y, _mm256_mul_ps(_mm256_set1_ps(ray.shear(1)), z)),
        }
    }
}

/// # Safety
/// The machine has AVX2.
#[inline(always)]
unsafe fn edge(p: ShearedVertex, q: ShearedVertex) -> __m256 {
    // SAFETY: the caller guarantees that the machine has AVX2.
    unsafe { _mm256_sub_ps(_mm256_mul_ps(p.x, q.y), _mm256_mul_ps(p.y, q.x)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::walk::edge_side::tests::{KINDS, Random, case, count};
    use crate::walk::level_ray::LevelRay;
    use crate::walk::level_rays::LevelRays;
    use crate::walk::triangle_ray::LaneOf;
    use lanes::Tier;

    /// Bounds of a ray and a group: where edges are decided and rough bounds small, those are no
    /// less than the others. How often that is.
    #[target_feature(enable = "avx2,bmi1,bmi2")]
    fn compare(level_rays: &LevelRays, group: &TriangleGroup) -> usize {
        let ray = LaneOf {
            level_rays,
            lane: 0,
        };
        let rows = |v: __m256| -> [f32; LEAF_TRIANGLES] {
            let mut row = [0.0; LEAF_TRIANGLES];
            // SAFETY: eight numbers.
            unsafe { _mm256_storeu_ps(row.as_mut_ptr(), v) };
            row
        };
        // SAFETY: this function's features.
        let (decided, rough, fine) = unsafe {
            let sides = Sides::new(ray, [group; 2]);
            let place = ScaledHit::new(&sides);
            let rough = place.rough_errors(ray, &TriangleBounds::new(ray, &sides));
            let decided = _mm256_movemask_ps(sides.is_decided(&place));
            (decided, rough, place.errors(ray, &sides))
        };
        let [rough_weight, rough_z] = [rows(rough[0]), rows(rough[1])];
        let [weight, z] = [rows(fine[0]), rows(fine[1])];
        let mut compared = 0;
        for i in (0..GROUP).filter(|i| decided >> i & 1 != 0) {
            if rough_weight[i] < rounding::MOST {
                assert!(
                    rough_weight[i] >= weight[i],
                    "{} {}",
                    rough_weight[i],
                    weight[i]
                );
                assert!(rough_z[i] >= z[i], "{} {}", rough_z[i], z[i]);
                compared += 1;
            }
        }
        compared
    }

    /// Needles in front of rays: of any length and width, turned and far.
    fn needle(random: &mut Random) -> ([f32; 3], [f32; 3], [[f32; 3]; 3]) {
        let (origin, direction) = (random.vector(1.0), random.vector(1.0));
        let t = random.size(-2.0, 5.0);
        let width = random.size(-6.0, 0.0);
        let (along, across) = (random.vector(1.0), random.vector(width));
        let length = random.size(-3.0, 3.0);
        let corner = |random: &mut Random| {
            let (a, b) = (random.signed() * length, random.signed() * length);
            std::array::from_fn(|i| {
                let hit = f64::from(origin[i]) + t * f64::from(direction[i]);
                (hit + a * f64::from(along[i]) + b * f64::from(across[i])) as f32
            })
        };
        let triangle = [corner(random), corner(random), corner(random)];
        (origin, direction, triangle)
    }

    #[test]
    fn rough_bounds_are_no_less() {
        if !Tier::Avx2.is_available() {
            return;
        }
        let mut random = Random(0x2545_F491_4F6C_DD1D);
        let mut compared = 0;
        for i in 0..4 * count() {
            let (origin, direction, triangle) = match i % 2 {
                0 => needle(&mut random),
                _ => {
                    let case = case(i / 2 % KINDS, &mut random);
                    (case.origin, case.direction, case.triangle)
                }
            };
            let mut level_ray = LevelRay::EMPTY;
            level_ray.set(origin, direction, 0.0, 0.0);
            if level_ray.scale != 1.0 || direction == [0.0; 3] {
                continue;
            }
            let mut level_rays = LevelRays::EMPTY;
            level_rays.set(0, &level_ray);
            let mut group = TriangleGroup::EMPTY;
            group.set_triangle(0, &triangle);
            group.margin = Margin::of(&triangle);
            // SAFETY: the machine has these features.
            compared += unsafe { compare(&level_rays, &group) };
        }
        println!("{compared} compared");
        assert!(compared > count() / 8);
    }
}
