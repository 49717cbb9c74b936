//! A ray set up for one level: what its box and triangle tests need.
//!
//! The box test is conservative (Ize 2013): for a plane at `p` it takes `(p − o) · (1/d)` in f32,
//! three roundings, with the reciprocal made smaller for near and larger for far planes by
//! [`MARGIN`]. A triangle that the ray hits by [`intersect`](super::triangle) is hit by the exact
//! ray, so the ray is inside every box around it at the exact distance.
//!
//! Directions far from unit length are brought near it by a power of two, so that distances to
//! boxes neither over- nor underflow: `t = scaled t · scale`.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::*;

use super::options::Accuracy;
use crate::layout::Bounds;

/// Relative widening of box distances, sixteen roundings.
pub(crate) const MARGIN: f32 = 1.0 / (1 << 20) as f32;

/// A ray in the space of one level. Arrays of four have an unused component: they are computed as
/// one vector.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct LevelRay {
    pub origin: [f32; 4],
    pub direction: [f32; 4],
    /// The origin for near planes and for far planes: they differ where the ray itself is
    /// uncertain.
    pub near_origin: [f32; 4],
    pub far_origin: [f32; 4],
    /// The scaled direction's reciprocals, made smaller and larger. Infinite where the direction is
    /// 0; NaN (the axis is not tested) where the reciprocal overflows.
    pub near_inverse: [f32; 4],
    pub far_inverse: [f32; 4],
    /// All bits set where the direction is negative: near planes are the upper ones.
    pub signs: [i32; 4],
    /// The origin by `axes`.
    pub flat_origin: [f32; 3],
    /// One over the third component of the scaled direction.
    pub inverse_z: f32,
    /// The direction's first two over its third component by `axes`.
    pub shear: [f32; 2],
    /// Two axes, then the one along which the direction is longest; swapped if that is negative, so
    /// that winding is kept (Woop, Benthin, Wald 2013).
    axes: [u32; 4],
    /// `t` per scaled `t`, a power of two.
    pub scale: f64,
    /// Lower end of the interval, scaled and rounded down; not negative.
    pub t_min: f32,
    /// [`Accuracy::tolerance`].
    pub tolerance: f32,
}

/// Directions whose longest component is in here are not scaled.
pub(crate) const MODEST: std::ops::RangeInclusive<f32> =
    1.0 / (1u64 << 32) as f32..=(1u64 << 32) as f32;

/// The axis of the longest component: bits are set for |x| > |y|, |x| > |z|, |y| > |z|.
const LONGEST: [u8; 8] = [2, 2, 2, 0, 1, 2, 1, 0];

/// By that axis, and whether the direction is negative there: it and the next two in turn, swapped
/// in that case.
const AXES: [[[u32; 4]; 2]; 3] = [
    [[1, 2, 0, 0], [2, 1, 0, 0]],
    [[2, 0, 1, 0], [0, 2, 1, 0]],
    [[0, 1, 2, 0], [1, 0, 2, 0]],
];

impl LevelRay {
    /// No ray.
    pub const EMPTY: LevelRay = LevelRay {
        origin: [0.0; 4],
        direction: [0.0; 4],
        near_origin: [0.0; 4],
        far_origin: [0.0; 4],
        near_inverse: [0.0; 4],
        far_inverse: [0.0; 4],
        signs: [0; 4],
        flat_origin: [0.0; 3],
        inverse_z: 0.0,
        shear: [0.0; 2],
        axes: [0; 4],
        scale: 1.0,
        t_min: 0.0,
        tolerance: Accuracy::Spec.tolerance(),
    };

    /// Sets up a finite ray. `uncertainty` is how far the ray may be off on each axis.
    #[inline(always)]
    pub fn set(&mut self, origin: [f32; 3], direction: [f32; 3], t_min: f32, uncertainty: f32) {
        let (origin, direction, inverse) = self.start(origin, direction, t_min);
        self.orient(origin, direction, inverse);
        let size = self.direction[self.axes[2] as usize].abs();
        let inverse = if MODEST.contains(&size) {
            inverse
        } else {
            self.rescale(t_min)
        };
        self.bound(origin, direction, inverse, uncertainty);
    }

    /// As [`Self::set`], for tests of boxes alone: what those of triangles need is left as it was.
    #[inline(always)]
    pub fn set_for_boxes(
        &mut self,
        origin: [f32; 3],
        direction: [f32; 3],
        t_min: f32,
        uncertainty: f32,
    ) {
        let (origin, direction, inverse) = self.start(origin, direction, t_min);
        let [x, y, z, _] = direction.map(f32::abs);
        let inverse = if MODEST.contains(&max(x, max(y, z))) {
            inverse
        } else {
            self.orient(origin, direction, inverse);
            self.rescale(t_min)
        };
        self.bound(origin, direction, inverse, uncertainty);
    }

    /// Takes a ray over; returns its origin, its direction and the reciprocals of that.
    #[inline(always)]
    fn start(
        &mut self,
        origin: [f32; 3],
        direction: [f32; 3],
        t_min: f32,
    ) -> ([f32; 4], [f32; 4], [f32; 4]) {
        let origin = [origin[0], origin[1], origin[2], 0.0];
        let direction = [direction[0], direction[1], direction[2], 1.0];
        self.origin = origin;
        self.direction = direction;
        self.scale = 1.0;
        self.t_min = max(t_min, 0.0);
        (origin, direction, reciprocals(direction))
    }

    /// Sets what tests of boxes need.
    #[inline(always)]
    fn bound(
        &mut self,
        origin: [f32; 4],
        direction: [f32; 4],
        inverse: [f32; 4],
        uncertainty: f32,
    ) {
        if self.widen(origin, direction, inverse, uncertainty) {
            self.leave_out_tiny();
        }
    }

    /// Finds the axis of the longest component and what follows from it.
    #[inline(always)]
    fn orient(&mut self, origin: [f32; 4], direction: [f32; 4], inverse: [f32; 4]) {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: SSE2 is part of x86-64; four numbers.
        let order = unsafe {
            let d = _mm_loadu_ps(direction.as_ptr());
            let size = _mm_andnot_ps(_mm_set1_ps(-0.0), d);
            let (first, second) = (
                _mm_shuffle_ps::<0b00_01_00_00>(size, size),
                _mm_shuffle_ps::<0b00_10_10_01>(size, size),
            );
            _mm_movemask_ps(_mm_cmpgt_ps(first, second)) as usize & 7
        };
        #[cfg(not(target_arch = "x86_64"))]
        let order = {
            let [x, y, z] = [0, 1, 2].map(|axis| direction[axis].abs());
            usize::from(x > y) | usize::from(x > z) << 1 | usize::from(y > z) << 2
        };
        let z = LONGEST[order];
        self.axes = AXES[usize::from(z) % 3][usize::from(direction[usize::from(z)] < 0.0)];
        let [x, y, z] = self.axes();
        self.flat_origin = [origin[x], origin[y], origin[z]];
        self.inverse_z = inverse[z];
        // Rounded once: all vertices are moved by what is lost here.
        self.shear = [direction[x] / direction[z], direction[y] / direction[z]];
    }

    /// Brings a direction far from unit length near it; returns the scaled direction's reciprocals.
    #[cold]
    #[inline(never)]
    fn rescale(&mut self, t_min: f32) -> [f32; 4] {
        let direction = self.direction;
        let z = self.axes()[2];
        let length = power_of_two_near(f64::from(direction[z].abs()));
        let mut inverse = direction.map(|d| (length / f64::from(d)) as f32);
        inverse[3] = 1.0;
        self.scale = 1.0 / length;
        self.t_min = max(((f64::from(t_min) * length) as f32).next_down(), 0.0);
        self.inverse_z = inverse[z];
        inverse
    }

    /// Makes reciprocals and origins for near and for far planes; whether a reciprocal overflows.
    #[inline(always)]
    fn widen(
        &mut self,
        origin: [f32; 4],
        direction: [f32; 4],
        inverse: [f32; 4],
        uncertainty: f32,
    ) -> bool {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: SSE2 is part of x86-64; four numbers each, those of the ray aligned.
        unsafe {
            let inverse = _mm_loadu_ps(inverse.as_ptr());
            let d = _mm_loadu_ps(direction.as_ptr());
            let origin = _mm_loadu_ps(origin.as_ptr());
            let far = _mm_mul_ps(inverse, _mm_set1_ps(1.0 + MARGIN));
            let near = _mm_mul_ps(inverse, _mm_set1_ps(1.0 - MARGIN));
            let sign = _mm_set1_ps(-0.0);
            let toward = _mm_or_ps(_mm_and_ps(d, sign), _mm_set1_ps(uncertainty));
            let signs = _mm_srai_epi32::<31>(_mm_castps_si128(d));
            _mm_store_ps(self.near_inverse.as_mut_ptr(), near);
            _mm_store_ps(self.far_inverse.as_mut_ptr(), far);
            _mm_store_ps(self.near_origin.as_mut_ptr(), _mm_add_ps(origin, toward));
            _mm_store_ps(self.far_origin.as_mut_ptr(), _mm_sub_ps(origin, toward));
            _mm_store_si128(self.signs.as_mut_ptr().cast(), signs);
            let infinite = _mm_cmpeq_ps(_mm_andnot_ps(sign, far), _mm_set1_ps(f32::INFINITY));
            let moves = _mm_cmpneq_ps(d, _mm_setzero_ps());
            _mm_movemask_ps(_mm_and_ps(infinite, moves)) != 0
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            let mut overflows = false;
            for i in 0..4 {
                self.near_inverse[i] = inverse[i] * (1.0 - MARGIN);
                self.far_inverse[i] = inverse[i] * (1.0 + MARGIN);
                overflows |= self.far_inverse[i].is_infinite() & (direction[i] != 0.0);
                let toward = uncertainty.copysign(direction[i]);
                self.near_origin[i] = origin[i] + toward;
                self.far_origin[i] = origin[i] - toward;
                self.signs[i] = direction[i].to_bits() as i32 >> 31;
            }
            overflows
        }
    }

    /// The axes by which the triangle test takes coordinates.
    #[inline(always)]
    pub fn axes(&self) -> [usize; 3] {
        let [x, y, z, _] = self.axes;
        [x as usize, y as usize, z as usize]
    }

    /// A tiny component's reciprocal overflows: such an axis is left out, a zero's is not.
    #[cold]
    fn leave_out_tiny(&mut self) {
        for i in 0..3 {
            if self.far_inverse[i].is_infinite() && self.direction[i] != 0.0 {
                self.near_inverse[i] = f32::NAN;
                self.far_inverse[i] = f32::NAN;
            }
        }
    }

    /// Row of [`crate::layout::Node::bounds`] with the near planes of an axis; the far ones are in
    /// the other row of the axis.
    #[inline(always)]
    pub fn near_row(&self, axis: usize) -> usize {
        2 * axis + (self.signs[axis] & 1) as usize
    }

    /// A `t` for comparison with distances of boxes: scaled and rounded up.
    #[inline(always)]
    pub fn scaled_up(&self, t: f32) -> f32 {
        if self.scale == 1.0 {
            t
        } else {
            ((f64::from(t) / self.scale) as f32).next_up()
        }
    }

    /// Where the ray is inside a box, by the node test's formula: scaled, before the ray's own
    /// interval is taken into account. Empty if near is above far.
    #[inline(always)]
    pub fn slab(&self, bounds: &Bounds) -> (f32, f32) {
        let planes = [bounds.min, bounds.max];
        let (mut near, mut far) = (f32::NEG_INFINITY, f32::INFINITY);
        for axis in (0..3).rev() {
            let row = (self.signs[axis] & 1) as usize;
            near = max(
                (planes[row][axis] - self.near_origin[axis]) * self.near_inverse[axis],
                near,
            );
            far = min(
                (planes[1 - row][axis] - self.far_origin[axis]) * self.far_inverse[axis],
                far,
            );
        }
        (near, far)
    }
}

/// One over each number.
#[inline(always)]
fn reciprocals(v: [f32; 4]) -> [f32; 4] {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: SSE2 is part of x86-64; four numbers each.
    unsafe {
        let mut inverse = [0.0; 4];
        let v = _mm_loadu_ps(v.as_ptr());
        _mm_storeu_ps(inverse.as_mut_ptr(), _mm_div_ps(_mm_set1_ps(1.0), v));
        inverse
    }
    #[cfg(not(target_arch = "x86_64"))]
    v.map(|v| 1.0 / v)
}

/// The greater, or `b` if one is NaN: the x86 instruction.
#[inline(always)]
pub(crate) fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The lesser, or `b` if one is NaN: the x86 instruction.
#[inline(always)]
pub(crate) fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The power of two at or below a positive f32's value; 1 for 0.
fn power_of_two_near(value: f64) -> f64 {
    if value == 0.0 {
        1.0
    } else {
        // Every f32 is a normal f64: keep the exponent.
        f64::from_bits(value.to_bits() & 0x7FF0_0000_0000_0000)
    }
}
