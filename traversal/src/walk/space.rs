//! A ray set up for one level: what its box and triangle tests need.
//!
//! The box test is conservative (Ize 2013): for a plane at `p` it takes `(p − o) · (1/d)` in f32,
//! three roundings, with the reciprocal made smaller for near and larger for far planes by
//! [`MARGIN`]. That covers the test's own error and, near a box's corners and edges, that of the
//! triangle test's sheared coordinates, so a triangle that the ray hits by
//! [`intersect`](super::triangle) is inside every box around it.
//!
//! Directions far from unit length are brought near it by a power of two, so that distances to
//! boxes neither over- nor underflow: `t = scaled t · scale`.

use super::options::Accuracy;
use crate::layout::Bounds;

/// Relative widening of box distances, sixteen roundings.
pub(crate) const MARGIN: f32 = 1.0 / (1 << 20) as f32;

/// A ray in the space of one level. Arrays of four have a component nobody looks at: they are
/// computed as one vector.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Space {
    pub origin: [f32; 4],
    pub direction: [f32; 4],
    /// The origin for near planes and for far planes: they differ where the ray itself is uncertain.
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
    pub axes: [usize; 3],
    /// `t` per scaled `t`, a power of two.
    pub scale: f64,
    /// Lower end of the interval, scaled and rounded down; not negative.
    pub t_min: f32,
    /// [`Accuracy::reach`].
    pub reach: f32,
}

/// Directions whose longest component is in here are not scaled.
pub(crate) const MODEST: std::ops::RangeInclusive<f32> =
    1.0 / (1u64 << 32) as f32..=(1u64 << 32) as f32;

/// The axis of the longest component: bits are set for |x| > |y|, |x| > |z|, |y| > |z|.
const LONGEST: [u8; 8] = [2, 2, 2, 0, 1, 2, 1, 0];

/// By that axis, and whether the direction is negative there: it and the next two in turn, swapped
/// in that case.
const AXES: [[[usize; 3]; 2]; 3] = [
    [[1, 2, 0], [2, 1, 0]],
    [[2, 0, 1], [0, 2, 1]],
    [[0, 1, 2], [1, 0, 2]],
];

impl Space {
    /// No ray.
    pub const NOWHERE: Space = Space {
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
        axes: [0; 3],
        scale: 1.0,
        t_min: 0.0,
        reach: Accuracy::Spec.reach(),
    };

    /// Sets up a finite ray. `uncertainty` is how far the ray may be off on each axis.
    #[inline(always)]
    pub fn set(&mut self, origin: [f32; 3], direction: [f32; 3], t_min: f32, uncertainty: f32) {
        let [x_size, y_size, z_size] = [direction[0].abs(), direction[1].abs(), direction[2].abs()];
        let order = usize::from(x_size > y_size)
            | usize::from(x_size > z_size) << 1
            | usize::from(y_size > z_size) << 2;
        let z = usize::from(LONGEST[order]);
        let [x, y, z] = AXES[z][usize::from(direction[z] < 0.0)];
        self.origin = [origin[0], origin[1], origin[2], 0.0];
        self.direction = [direction[0], direction[1], direction[2], 1.0];
        self.axes = [x, y, z];
        self.flat_origin = [origin[x], origin[y], origin[z]];
        let mut inverse = [0.0; 4];
        for i in 0..4 {
            inverse[i] = 1.0 / self.direction[i];
        }
        self.shear = [direction[x] * inverse[z], direction[y] * inverse[z]];
        self.scale = 1.0;
        self.t_min = max(t_min, 0.0);
        let size = direction[z].abs();
        if !MODEST.contains(&size) {
            let length = power_of_two_near(f64::from(size));
            for (inverse, d) in inverse.iter_mut().zip(direction) {
                *inverse = (length / f64::from(d)) as f32;
            }
            self.shear = [direction[x] / direction[z], direction[y] / direction[z]];
            self.scale = 1.0 / length;
            self.t_min = max(((f64::from(t_min) * length) as f32).next_down(), 0.0);
        }
        self.inverse_z = inverse[z];
        let mut overflows = false;
        for i in 0..4 {
            self.near_inverse[i] = inverse[i] * (1.0 - MARGIN);
            self.far_inverse[i] = inverse[i] * (1.0 + MARGIN);
            overflows |= self.far_inverse[i].is_infinite() & (self.direction[i] != 0.0);
            let toward = uncertainty.copysign(self.direction[i]);
            self.near_origin[i] = self.origin[i] + toward;
            self.far_origin[i] = self.origin[i] - toward;
            self.signs[i] = self.direction[i].to_bits() as i32 >> 31;
        }
        if overflows {
            self.leave_out_tiny();
        }
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
