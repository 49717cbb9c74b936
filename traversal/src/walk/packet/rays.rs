//! The rays of a packet, set up for one level.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::*;

use lanes::LaneMask;
use lanes::vector::Vector;

#[cfg(target_arch = "x86_64")]
use crate::layout::TriangleGroup;
use crate::layout::{NodeAt, WIDTH};
use crate::walk::PACKET;
use crate::walk::group_hits::GroupHits;
#[cfg(target_arch = "x86_64")]
use crate::walk::level_rays::AXIS;
use crate::walk::level_rays::{LevelRays, ROW};
use crate::walk::rows::load_row;

/// Inverses of directions that are not along a plane.
pub(super) const STEEP: f32 = 1.0e30;

/// Rays that have their axes and the signs of their directions in common.
pub(crate) struct Rays {
    pub level_rays: LevelRays,
    /// Offsets in bytes of the rows of a node with the near planes.
    pub(super) near_rows: [usize; 3],
    /// Offsets in bytes of the axes in a vertex.
    pub axes: [usize; 3],
    pub(super) interval: Interval,
    /// The interval is set up; it is not where there is one leaf.
    pub(super) has_bounds: bool,
    /// Where rays hit the triangles of a leaf, for those that look at it ray by ray, and its word;
    /// 0 is none.
    pub(super) hits: [GroupHits; PACKET],
    pub(super) hits_of: u32,
}

/// The interval of all rays, for a test of eight boxes: lower and upper ends.
pub(super) struct Interval {
    /// The origin for near planes and for far planes.
    pub near_origin: [f32; 3],
    pub far_origin: [f32; 3],
    pub near_inverse: [[f32; 2]; 3],
    pub far_inverse: [[f32; 2]; 3],
    pub t_min: f32,
}

impl Rays {
    pub const EMPTY: Rays = Rays {
        level_rays: LevelRays::EMPTY,
        near_rows: [0; 3],
        axes: [0; 3],
        interval: Interval {
            near_origin: [0.0; 3],
            far_origin: [0.0; 3],
            near_inverse: [[0.0; 2]; 3],
            far_inverse: [[0.0; 2]; 3],
            t_min: 0.0,
        },
        has_bounds: false,
        hits: [GroupHits::NONE; PACKET],
        hits_of: 0,
    };

    /// Which rays meet a child's box before `t_far`.
    #[inline(always)]
    pub(super) fn test_box<V: Vector>(
        &self,
        v: V,
        node: NodeAt<'_>,
        child: usize,
        t_far: V::F,
    ) -> LaneMask {
        let (child, level_rays) = (child % WIDTH, &self.level_rays);
        let mut near = load_row(v, &level_rays.t_min);
        let mut far = t_far;
        for k in 0..3 {
            let row = self.near_rows[k] / ROW as usize % 6;
            let first = v.splat(node.bound(row, child));
            let last = v.splat(node.bound(row ^ 1, child));
            let enter = v.mul(
                v.sub(load_row(v, &level_rays.origin[k]), first),
                load_row(v, &level_rays.near_inverse[k]),
            );
            let leave = v.mul(
                v.sub(load_row(v, &level_rays.far_origin[k]), last),
                load_row(v, &level_rays.far_inverse[k]),
            );
            near = v.max(enter, near);
            far = v.min(leave, far);
        }
        LaneMask::from_bits(v.ge(far, near))
    }

    /// Whether near planes of one of the rays' axes are the upper ones.
    #[inline]
    pub fn is_backward(&self, k: usize) -> bool {
        self.near_rows[k] & ROW as usize != 0
    }
}

#[cfg(target_arch = "x86_64")]
impl Rays {
    /// Which of eight boxes any of the rays might meet, by their near and their far planes, and
    /// where at the soonest.
    ///
    /// # Safety
    /// The machine has AVX2, here and below.
    #[inline(always)]
    unsafe fn test_planes(
        &self,
        near_planes: [__m256; 3],
        far_planes: [__m256; 3],
        t_far: f32,
    ) -> (u32, __m256) {
        let interval = &self.interval;
        // SAFETY: the caller guarantees that the machine has AVX2.
        unsafe {
            let mut near = _mm256_set1_ps(interval.t_min);
            let mut far = _mm256_set1_ps(t_far);
            for k in 0..3 {
                let enter = _mm256_sub_ps(_mm256_set1_ps(interval.near_origin[k]), near_planes[k]);
                let leave = _mm256_sub_ps(_mm256_set1_ps(interval.far_origin[k]), far_planes[k]);
                let [low, high] = interval.near_inverse[k];
                let enter = _mm256_min_ps(
                    _mm256_mul_ps(enter, _mm256_set1_ps(low)),
                    _mm256_mul_ps(enter, _mm256_set1_ps(high)),
                );
                let [low, high] = interval.far_inverse[k];
                let leave = _mm256_max_ps(
                    _mm256_mul_ps(leave, _mm256_set1_ps(low)),
                    _mm256_mul_ps(leave, _mm256_set1_ps(high)),
                );
                near = _mm256_max_ps(enter, near);
                far = _mm256_min_ps(leave, far);
            }
            let mask = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far));
            (mask as u32, near)
        }
    }

    /// A row of a node: eight planes.
    ///
    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    unsafe fn planes(node: NodeAt<'_>, row: usize) -> __m256 {
        // SAFETY: the caller guarantees that the machine has AVX2; eight numbers.
        unsafe { _mm256_loadu_ps(node.row(row / ROW as usize).cast()) }
    }

    /// Which children's boxes any of the rays might meet, and where at the soonest.
    ///
    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    pub unsafe fn test_interval(
        &self,
        node: NodeAt<'_>,
        t_far: f32,
        near: &mut [f32; WIDTH],
    ) -> u32 {
        let [x, y, z] = self.near_rows;
        let [far_x, far_y, far_z] = [x ^ ROW as usize, y ^ ROW as usize, z ^ ROW as usize];
        // SAFETY: the caller guarantees that the machine has AVX2; eight numbers.
        unsafe {
            let near_planes = [
                Self::planes(node, x),
                Self::planes(node, y),
                Self::planes(node, z),
            ];
            let far_planes = [
                Self::planes(node, far_x),
                Self::planes(node, far_y),
                Self::planes(node, far_z),
            ];
            let (mask, soonest) = self.test_planes(near_planes, far_planes, t_far);
            _mm256_storeu_ps(near.as_mut_ptr(), soonest);
            mask
        }
    }

    /// An axis of a vertex of the triangles of two groups.
    ///
    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    unsafe fn row(groups: [&TriangleGroup; 2], vertex: usize, axis: usize) -> __m256 {
        let (low, high) = (
            &groups[0].vertices[vertex][axis],
            &groups[1].vertices[vertex][axis],
        );
        // SAFETY: the caller guarantees that the machine has AVX2; four numbers each.
        unsafe { _mm256_loadu2_m128(high.as_ptr(), low.as_ptr()) }
    }

    /// Which triangles' boxes any of the rays might meet, of two groups (or one twice).
    ///
    /// # Safety
    /// The machine has AVX2.
    #[inline(always)]
    pub unsafe fn test_triangles(&self, groups: [&TriangleGroup; 2], t_far: f32) -> u32 {
        // SAFETY: the caller guarantees that the machine has AVX2.
        unsafe {
            let mut near_planes = [_mm256_setzero_ps(); 3];
            let mut far_planes = near_planes;
            for k in 0..3 {
                let axis = self.axes[k] / AXIS as usize % 3;
                let a = Self::row(groups, 0, axis);
                let b = Self::row(groups, 1, axis);
                let c = Self::row(groups, 2, axis);
                let low = _mm256_min_ps(_mm256_min_ps(a, b), c);
                let high = _mm256_max_ps(_mm256_max_ps(a, b), c);
                let upper = self.near_rows[k] & ROW as usize != 0;
                (near_planes[k], far_planes[k]) = if upper { (high, low) } else { (low, high) };
            }
            self.test_planes(near_planes, far_planes, t_far).0
        }
    }
}
