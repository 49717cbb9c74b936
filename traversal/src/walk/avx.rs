//! The inner tests with 256-bit vectors. Compiled twice: for AVX2, and for AVX-512VL with its mask
//! registers and its 32 vector registers.

use std::arch::x86_64::*;

use super::block;
use super::children::push_children;
use super::entry::Entry;
use super::group;
use super::group_hits::GroupHits;
use super::kernel::{Kernel, T_MARGIN};
use super::leaf::{Leaf, Triangles};
use super::level_ray::LevelRay;
use super::level_rays::{LevelRays, ROW};
use super::meter::{Meter, Unmetered};
use super::opaque::{End, Nearest, Opaque, Pending};
use super::slabs::Slabs;
use super::triangle_ray::LaneOf;
use super::{PACKET, Walk};
use crate::layout::{Block, GROUP, MARGIN_RISE, NodeAt, TriangleGroup, WIDTH};

/// Eight boxes or four triangles in one vector. `WIDE`: with AVX-512.
pub(crate) struct Avx<const WIDE: bool>;

/// The values of a ray that triangle tests need, in every lane.
#[derive(Clone, Copy)]
pub(crate) struct AvxShear {
    origin: [__m128; 3],
    /// Offsets in bytes of the axes in a vertex.
    axes: [usize; 3],
    shear: [__m128; 2],
    inverse_z: __m128,
    t_min: __m128,
}

/// The values of a ray that box tests need, in every lane; see [`LevelRays`].
#[derive(Clone, Copy)]
pub(crate) struct AvxRay {
    origin: [__m256; 3],
    far_origin: [__m256; 3],
    near_inverse: [__m256; 3],
    far_inverse: [__m256; 3],
    near_rows: [usize; 3],
    t_min: __m256,
    t_far: __m256,
}

impl<const WIDE: bool> Kernel for Avx<WIDE> {
    type BoxRay = AvxRay;
    type Shear = AvxShear;
    type Near = __m256;

    #[inline(always)]
    unsafe fn load_level_ray(level_ray: &LevelRay, t_far: f32) -> AvxRay {
        let three = |[x, y, z, _]: [f32; 4]| [x, y, z];
        // SAFETY: the caller guarantees that the machine has AVX.
        unsafe {
            AvxRay {
                origin: eight(three(level_ray.near_origin)),
                far_origin: eight(three(level_ray.far_origin)),
                near_inverse: eight(three(level_ray.near_inverse)),
                far_inverse: eight(three(level_ray.far_inverse)),
                near_rows: [0, 1, 2].map(|axis| level_ray.near_row(axis) * ROW as usize),
                t_min: _mm256_set1_ps(level_ray.t_min),
                t_far: _mm256_set1_ps(t_far),
            }
        }
    }

    #[inline(always)]
    unsafe fn load_lane(level_rays: &LevelRays, lane: usize, t_far: f32) -> AvxRay {
        let row = |axis: usize| level_rays.near_rows[axis][lane] as usize;
        // SAFETY: the caller guarantees that the machine has AVX.
        unsafe {
            AvxRay {
                origin: eight([0, 1, 2].map(|axis| level_rays.origin[axis][lane])),
                far_origin: eight([0, 1, 2].map(|axis| level_rays.far_origin[axis][lane])),
                near_inverse: eight([0, 1, 2].map(|axis| level_rays.near_inverse[axis][lane])),
                far_inverse: eight([0, 1, 2].map(|axis| level_rays.far_inverse[axis][lane])),
                near_rows: [row(0), row(1), row(2)],
                t_min: _mm256_set1_ps(level_rays.t_min[lane]),
                t_far: _mm256_set1_ps(t_far),
            }
        }
    }

    #[inline(always)]
    unsafe fn load_slabs(slabs: &Slabs, lane: usize, t_far: f32) -> AvxRay {
        let lane = lane % PACKET;
        // SAFETY: the caller guarantees that the machine has AVX.
        unsafe {
            AvxRay {
                origin: eight([0, 1, 2].map(|axis| slabs.near_origin[axis][lane])),
                far_origin: eight([0, 1, 2].map(|axis| slabs.far_origin[axis][lane])),
                near_inverse: eight([0, 1, 2].map(|axis| slabs.near_inverse[axis][lane])),
                far_inverse: eight([0, 1, 2].map(|axis| slabs.far_inverse[axis][lane])),
                near_rows: [0, 1, 2].map(|axis| slabs.near_rows[axis][lane] as usize),
                t_min: _mm256_set1_ps(slabs.t_min[lane]),
                t_far: _mm256_set1_ps(t_far),
            }
        }
    }

    #[inline(always)]
    unsafe fn load_shear(level_ray: &LevelRay) -> AvxShear {
        // SAFETY: the caller guarantees that the machine has AVX; axes are below three.
        unsafe {
            let [x, y, z] = level_ray.flat_origin;
            let [x_axis, y_axis, z_axis] = level_ray.axes();
            let axis = size_of::<[f32; GROUP]>();
            AvxShear {
                origin: [_mm_set1_ps(x), _mm_set1_ps(y), _mm_set1_ps(z)],
                axes: [x_axis * axis, y_axis * axis, z_axis * axis],
                shear: [
                    _mm_set1_ps(level_ray.shear[0]),
                    _mm_set1_ps(level_ray.shear[1]),
                ],
                inverse_z: _mm_set1_ps(level_ray.inverse_z),
                t_min: _mm_set1_ps(level_ray.t_min),
            }
        }
    }

    #[inline(always)]
    unsafe fn test_group(ray: &AvxShear, group: &TriangleGroup, t_far: f32) -> u32 {
        // SAFETY: the caller guarantees that the machine has AVX; groups are aligned, and axes are
        // below three.
        unsafe {
            let [ox, oy, oz] = ray.origin;
            let vertex = |i: usize| {
                let base = group.vertices[i].as_ptr().cast::<u8>();
                let axis = |k: usize| _mm_load_ps(base.add(ray.axes[k]).cast());
                let z = _mm_sub_ps(axis(2), oz);
                let x = _mm_sub_ps(_mm_sub_ps(axis(0), ox), _mm_mul_ps(ray.shear[0], z));
                let y = _mm_sub_ps(_mm_sub_ps(axis(1), oy), _mm_mul_ps(ray.shear[1], z));
                (x, y, z)
            };
            let (ax, ay, az) = vertex(0);
            let (bx, by, bz) = vertex(1);
            let (cx, cy, cz) = vertex(2);
            let [at, bt, ct] = [az, bz, cz].map(|z| _mm_mul_ps(z, ray.inverse_z));
            let distance = _mm_andnot_ps(_mm_set1_ps(-0.0), az);
            let edge = |px, py, qx, qy| _mm_sub_ps(_mm_mul_ps(px, qy), _mm_mul_ps(py, qx));
            let u = edge(cx, cy, bx, by);
            let v = edge(ax, ay, cx, cy);
            let w = edge(bx, by, ax, ay);
            let rise = _mm_mul_ps(distance, _mm_set1_ps(MARGIN_RISE));
            let error = _mm_mul_ps(
                _mm_add_ps(distance, _mm_set1_ps(group.margin.reach)),
                _mm_add_ps(_mm_set1_ps(group.margin.slope), rise),
            );
            let minus_error = _mm_xor_ps(error, _mm_set1_ps(-0.0));
            let negative = _mm_cmp_ps::<_CMP_LT_OQ>(_mm_min_ps(u, _mm_min_ps(v, w)), minus_error);
            let positive = _mm_cmp_ps::<_CMP_GT_OQ>(_mm_max_ps(u, _mm_max_ps(v, w)), error);
            let first = _mm_min_ps(at, _mm_min_ps(bt, ct));
            let last = _mm_max_ps(at, _mm_max_ps(bt, ct));
            let beyond = _mm_cmp_ps::<_CMP_GT_OQ>(
                _mm_mul_ps(first, _mm_set1_ps(1.0 - T_MARGIN)),
                _mm_set1_ps(t_far),
            );
            let before =
                _mm_cmp_ps::<_CMP_LT_OQ>(_mm_mul_ps(last, _mm_set1_ps(1.0 + T_MARGIN)), ray.t_min);
            let out = _mm_or_ps(_mm_and_ps(negative, positive), _mm_or_ps(beyond, before));
            !(_mm_movemask_ps(out) as u32) & group.lanes
        }
    }

    #[inline(always)]
    unsafe fn shorten(box_ray: &mut AvxRay, t_far: f32) {
        // SAFETY: the caller guarantees that the machine has AVX.
        box_ray.t_far = unsafe { _mm256_set1_ps(t_far) };
    }

    #[inline(always)]
    unsafe fn intersect_node<const CLOSED: bool>(
        box_ray: &AvxRay,
        node: NodeAt<'_>,
    ) -> (u32, __m256) {
        // SAFETY: the caller guarantees that the machine has AVX; nodes are aligned, and rows are
        // below six.
        unsafe {
            let base = node.bounds();
            let (x_near, x_far) = planes::<CLOSED>(box_ray, base, 0);
            let (y_near, y_far) = planes::<CLOSED>(box_ray, base, 1);
            let (z_near, z_far) = planes::<CLOSED>(box_ray, base, 2);
            if CLOSED {
                // Operand order decides what NaN does: see `level_ray::max`.
                let near = _mm256_max_ps(
                    _mm256_max_ps(x_near, y_near),
                    _mm256_max_ps(z_near, box_ray.t_min),
                );
                let far = _mm256_min_ps(
                    _mm256_min_ps(x_far, y_far),
                    _mm256_min_ps(z_far, box_ray.t_far),
                );
                let mask = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far));
                return (mask as u32, near);
            }
            let near = greater(greater(x_near, y_near), greater(z_near, box_ray.t_min));
            let far = lesser(lesser(x_far, y_far), lesser(z_far, box_ray.t_far));
            let [near_bits, far_bits] = [_mm256_castps_si256(near), _mm256_castps_si256(far)];
            let mask = if WIDE {
                u32::from(_mm256_cmple_epi32_mask(near_bits, far_bits))
            } else {
                let beyond = _mm256_castsi256_ps(_mm256_cmpgt_epi32(near_bits, far_bits));
                !_mm256_movemask_ps(beyond) as u32 & 0xFF
            };
            (mask, near)
        }
    }

    #[inline(always)]
    unsafe fn push<const ANY: bool>(
        near: __m256,
        mask: u32,
        node: NodeAt<'_>,
        place: *mut Entry,
    ) -> (u32, usize) {
        if ANY {
            // SAFETY: the caller guarantees that the machine has the instruction set; there is room
            // for eight entries.
            return unsafe { push_all(mask, node, place) };
        }
        let mut nears = Nears([0.0; WIDTH]);
        // SAFETY: the caller guarantees that the machine has the instruction set; there is room for
        // eight entries.
        unsafe {
            _mm256_store_ps(nears.0.as_mut_ptr(), near);
            push_children::<ANY>(mask, node, &nears.0, place)
        }
    }

    #[inline(always)]
    unsafe fn at_most(these: &[f32; WIDTH], those: &[f32; WIDTH]) -> u32 {
        // SAFETY: the caller guarantees that the machine has AVX.
        unsafe {
            let (these, those) = (
                _mm256_loadu_ps(these.as_ptr()),
                _mm256_loadu_ps(those.as_ptr()),
            );
            _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(these, those)) as u32
        }
    }

    #[inline(always)]
    unsafe fn expand(block: &Block, groups: [&mut TriangleGroup; 2]) -> u32 {
        // SAFETY: the caller guarantees that the machine has AVX2.
        unsafe { block::expand(block, groups) }
    }

    #[inline(always)]
    unsafe fn intersect_leaf(
        level_rays: &LevelRays,
        lane: usize,
        _: &AvxRay,
        groups: [&TriangleGroup; 2],
        lanes: u32,
        interval: [f32; 2],
        found: &mut GroupHits,
    ) -> u32 {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe { group::intersect(LaneOf { level_rays, lane }, groups, lanes, interval, found) }
    }

    #[inline(always)]
    unsafe fn walk_opaque<const ANY: bool>(
        way: &Opaque<'_>,
        best: &mut Nearest,
        pending: &mut Pending<'_>,
        found: &mut GroupHits,
        fuel: &mut u64,
    ) -> End {
        // SAFETY: the caller guarantees that the machine has the instruction set.
        unsafe {
            if WIDE {
                walk_opaque_wide::<ANY>(way, best, pending, found, fuel)
            } else {
                walk_opaque::<ANY>(way, best, pending, found, fuel)
            }
        }
    }

    #[inline(always)]
    unsafe fn walk_opaque_metered<M: Meter, const ANY: bool>(
        way: &Opaque<'_>,
        best: &mut Nearest,
        pending: &mut Pending<'_>,
        found: &mut GroupHits,
        fuel: &mut u64,
        meter: &mut M,
    ) -> End {
        // SAFETY: the caller guarantees that the machine has AVX2.
        unsafe { walk_opaque_metered::<M, ANY>(way, best, pending, found, fuel, meter) }
    }

    #[inline(always)]
    unsafe fn test_leaf(leaf: &Triangles<'_>, walk: &mut Walk, t_far: &mut f32) -> Leaf {
        // SAFETY: the caller guarantees that the machine has AVX2.
        unsafe { test_leaf(leaf, walk, t_far) }
    }
}

/// By mask: the bits that are set, a byte each, and their count in the first byte's upper half.
static BITS_OF: [[u8; WIDTH]; 256] = {
    let mut all = [[0; WIDTH]; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut bit, mut count) = (0, 0);
        while bit < WIDTH {
            if mask >> bit & 1 != 0 {
                all[mask][count] = bit as u8;
                count += 1;
            }
            bit += 1;
        }
        all[mask][0] |= (count as u8) << 4;
        mask += 1;
    }
    all
};

/// Pushes the children in `mask` in the order that [`push_children`] has without a ray, without a
/// branch. Their distances, which nothing asks for, are 0.
///
/// # Safety
/// The machine has AVX2; `mask` is not 0, and there is room for eight entries.
#[inline(always)]
unsafe fn push_all(mask: u32, node: NodeAt<'_>, place: *mut Entry) -> (u32, usize) {
    let bits = &BITS_OF[mask as usize % 256];
    let words = node.children();
    let last = node.child(31 - mask.leading_zeros() as usize);
    // SAFETY: the caller guarantees that the machine has AVX2; `mask` is not 0, and there is room
    // for eight entries; permutations look at the lowest three bits.
    unsafe {
        let order = _mm256_cvtepu8_epi32(_mm_loadl_epi64(bits.as_ptr().cast()));
        let words = _mm256_loadu_si256(words.as_ptr().cast());
        let words = _mm256_permutevar8x32_epi32(words, order);
        let place = place.cast::<__m256i>();
        let low = _mm256_cvtepu32_epi64(_mm256_castsi256_si128(words));
        let high = _mm256_cvtepu32_epi64(_mm256_extracti128_si256::<1>(words));
        _mm256_storeu_si256(place, low);
        _mm256_storeu_si256(place.add(1), high);
    }
    (last, usize::from(bits[0] >> 4) - 1)
}

/// Where the ray meets the near and the far planes of an axis. The inverses of rays of lists have
/// the opposite sign.
#[inline(always)]
unsafe fn planes<const CLOSED: bool>(
    box_ray: &AvxRay,
    base: *const u8,
    axis: usize,
) -> (__m256, __m256) {
    // SAFETY: the callers promise AVX; nodes are aligned, and rows are below six.
    unsafe {
        let row = box_ray.near_rows[axis];
        let near = _mm256_load_ps(base.add(row).cast());
        let far = _mm256_load_ps(base.add(row ^ ROW as usize).cast());
        let (enter, leave) = if CLOSED {
            (
                _mm256_sub_ps(near, box_ray.origin[axis]),
                _mm256_sub_ps(far, box_ray.far_origin[axis]),
            )
        } else {
            (
                _mm256_sub_ps(box_ray.origin[axis], near),
                _mm256_sub_ps(box_ray.far_origin[axis], far),
            )
        };
        (
            _mm256_mul_ps(enter, box_ray.near_inverse[axis]),
            _mm256_mul_ps(leave, box_ray.far_inverse[axis]),
        )
    }
}

/// The greater one, compared as integers, which is faster. From 0 on integers have the order of
/// floats, and negative numbers, NaN included (0 · ∞ has its sign), are below `t_min` and any near
/// plane.
#[inline(always)]
unsafe fn greater(a: __m256, b: __m256) -> __m256 {
    // SAFETY: the callers promise AVX2.
    unsafe {
        let [a, b] = [_mm256_castps_si256(a), _mm256_castps_si256(b)];
        _mm256_castsi256_ps(_mm256_max_epi32(a, b))
    }
}

/// The lesser as integers: see [`greater`].
#[inline(always)]
unsafe fn lesser(a: __m256, b: __m256) -> __m256 {
    // SAFETY: the callers promise AVX2.
    unsafe {
        let [a, b] = [_mm256_castps_si256(a), _mm256_castps_si256(b)];
        _mm256_castsi256_ps(_mm256_min_epi32(a, b))
    }
}

/// Where children are entered; aligned, so that one vector's store meets no line's end.
#[repr(align(32))]
struct Nears([f32; WIDTH]);

/// A component of each axis in every lane.
#[inline(always)]
unsafe fn eight(v: [f32; 3]) -> [__m256; 3] {
    // SAFETY: the callers promise AVX. Not by `map`, whose closure would be compiled without it.
    unsafe {
        [
            _mm256_set1_ps(v[0]),
            _mm256_set1_ps(v[1]),
            _mm256_set1_ps(v[2]),
        ]
    }
}

/// # Safety
/// The machine has AVX2.
#[inline(never)]
#[target_feature(enable = "avx2,bmi1,bmi2")]
unsafe fn test_leaf(leaf: &Triangles<'_>, walk: &mut Walk, t_far: &mut f32) -> Leaf {
    // SAFETY: the caller guarantees that the machine has AVX2.
    unsafe { leaf.test::<Avx<false>>(walk, t_far) }
}

/// # Safety
/// The machine has AVX2.
#[inline(never)]
#[target_feature(enable = "avx2,bmi1,bmi2")]
unsafe fn walk_opaque<const ANY: bool>(
    way: &Opaque<'_>,
    best: &mut Nearest,
    pending: &mut Pending<'_>,
    found: &mut GroupHits,
    fuel: &mut u64,
) -> End {
    // SAFETY: the caller guarantees that the machine has AVX2.
    unsafe { way.run::<Avx<false>, _, ANY>(best, pending, found, fuel, &mut Unmetered) }
}

/// # Safety
/// The machine has AVX2.
#[inline(never)]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
unsafe fn walk_opaque_metered<M: Meter, const ANY: bool>(
    way: &Opaque<'_>,
    best: &mut Nearest,
    pending: &mut Pending<'_>,
    found: &mut GroupHits,
    fuel: &mut u64,
    meter: &mut M,
) -> End {
    // SAFETY: the caller guarantees that the machine has AVX2.
    unsafe { way.run::<Avx<false>, M, ANY>(best, pending, found, fuel, meter) }
}

/// # Safety
/// The machine has these features.
#[inline(never)]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi1,bmi2,popcnt")]
unsafe fn walk_opaque_wide<const ANY: bool>(
    way: &Opaque<'_>,
    best: &mut Nearest,
    pending: &mut Pending<'_>,
    found: &mut GroupHits,
    fuel: &mut u64,
) -> End {
    // SAFETY: the caller guarantees that the machine has the function's features.
    unsafe { way.run::<Avx<true>, _, ANY>(best, pending, found, fuel, &mut Unmetered) }
}
