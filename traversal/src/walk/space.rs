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

use crate::layout::Bounds;

/// Relative widening of box distances, sixteen roundings.
const MARGIN: f32 = 1.0 / (1 << 20) as f32;

/// A ray in the space of one level.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Space {
    pub origin: [f32; 3],
    pub direction: [f32; 3],
    /// The origin for near planes and for far planes: they differ where the ray itself is uncertain.
    pub near_origin: [f32; 3],
    pub far_origin: [f32; 3],
    /// The scaled direction's reciprocals, made smaller and larger. Infinite where the direction is
    /// 0; NaN (the axis is not tested) where the reciprocal overflows.
    pub near_inverse: [f32; 3],
    pub far_inverse: [f32; 3],
    /// Row of [`crate::layout::Node::bounds`] with the near planes of each axis; the far ones are
    /// in the other row of the axis.
    pub near_rows: [usize; 3],
    /// Two axes, then the one along which the direction is longest; swapped if that is negative, so
    /// that winding is kept (Woop, Benthin, Wald 2013).
    pub axes: [usize; 3],
    /// The direction's first two over its third component by `axes`.
    pub shear: [f32; 2],
    /// One over the third component of the scaled direction.
    pub inverse_z: f32,
    /// `t` per scaled `t`, a power of two.
    pub scale: f64,
    /// Lower end of the interval, scaled and rounded down; not negative.
    pub t_min: f32,
}

/// Directions whose longest component is in here are not scaled.
const MODEST: std::ops::RangeInclusive<f32> = 1.0 / (1u64 << 32) as f32..=(1u64 << 32) as f32;

impl Space {
    /// No ray.
    pub const NOWHERE: Space = Space {
        origin: [0.0; 3],
        direction: [0.0; 3],
        near_origin: [0.0; 3],
        far_origin: [0.0; 3],
        near_inverse: [0.0; 3],
        far_inverse: [0.0; 3],
        near_rows: [0; 3],
        axes: [0; 3],
        shear: [0.0; 2],
        inverse_z: 0.0,
        scale: 1.0,
        t_min: 0.0,
    };

    /// Sets up a finite ray. `uncertainty` is how far the ray may be off on each axis.
    #[inline(always)]
    pub fn set(&mut self, origin: [f32; 3], direction: [f32; 3], t_min: f32, uncertainty: f32) {
        let size = direction.map(f32::abs);
        let z = if size[0] > size[1] {
            if size[0] > size[2] { 0 } else { 2 }
        } else if size[1] > size[2] {
            1
        } else {
            2
        };
        // The next two axes in turn; swapped if the third component is negative.
        let [x, y] = if direction[z] < 0.0 {
            [[2, 1], [0, 2], [1, 0]][z]
        } else {
            [[1, 2], [2, 0], [0, 1]][z]
        };
        self.origin = origin;
        self.direction = direction;
        self.axes = [x, y, z];
        let mut inverse = direction.map(|d| 1.0 / d);
        self.shear = [direction[x] * inverse[z], direction[y] * inverse[z]];
        self.scale = 1.0;
        self.t_min = max(t_min, 0.0);
        if !MODEST.contains(&size[z]) {
            let length = power_of_two_near(f64::from(size[z]));
            inverse = direction.map(|d| (length / f64::from(d)) as f32);
            self.shear = [direction[x] / direction[z], direction[y] / direction[z]];
            self.scale = 1.0 / length;
            self.t_min = max(((f64::from(t_min) * length) as f32).next_down(), 0.0);
        }
        self.inverse_z = inverse[z];
        for axis in 0..3 {
            let d = direction[axis];
            let mut near = inverse[axis] * (1.0 - MARGIN);
            let mut far = inverse[axis] * (1.0 + MARGIN);
            // A tiny component's reciprocal overflows: such an axis is left out, a zero's is not.
            if far.is_infinite() && d != 0.0 {
                (near, far) = (f32::NAN, f32::NAN);
            }
            self.near_inverse[axis] = near;
            self.far_inverse[axis] = far;
            let toward = uncertainty.copysign(d);
            self.near_origin[axis] = origin[axis] + toward;
            self.far_origin[axis] = origin[axis] - toward;
            self.near_rows[axis] = 2 * axis + usize::from(d.is_sign_negative());
        }
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
            let row = self.near_rows[axis] & 1;
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
