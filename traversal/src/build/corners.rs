//! Boxes as eight numbers that unite by minimum, in one vector if the machine has them.

use crate::layout::Bounds;

/// The lower corner, a zero, the negated upper corner, and another zero (infinities in an empty
/// box). The union of two boxes is the minimum of each number.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(crate) struct Corners(pub [f32; 8]);

impl Corners {
    /// The empty box.
    pub const EMPTY: Corners = Corners([f32::INFINITY; 8]);

    pub fn of(bounds: &Bounds) -> Corners {
        let ([a, b, c], [d, e, f]) = (bounds.min, bounds.max);
        Corners([a, b, c, 0.0, -d, -e, -f, 0.0])
    }

    pub fn bounds(&self) -> Bounds {
        let [a, b, c, _, d, e, f, _] = self.0;
        Bounds {
            min: [a, b, c],
            max: [-d, -e, -f],
        }
    }

    /// The union of both boxes.
    #[inline(always)]
    pub fn join(mut self, other: &Corners) -> Corners {
        for i in 0..8 {
            self.0[i] = lesser(self.0[i], other.0[i]);
        }
        self
    }

    /// Twice the center, followed by zero.
    #[inline(always)]
    pub fn center(&self) -> [f32; 4] {
        let c = &self.0;
        [c[0] - c[4], c[1] - c[5], c[2] - c[6], c[3] - c[7]]
    }

    /// The box of a point.
    #[inline(always)]
    pub fn point([x, y, z, w]: [f32; 4]) -> Corners {
        Corners([x, y, z, w, -x, -y, -z, -w])
    }

    /// The lengths of the edges, and zero.
    #[inline(always)]
    pub fn edges(&self) -> [f32; 4] {
        let c = &self.0;
        [-c[4] - c[0], -c[5] - c[1], -c[6] - c[2], -c[7] - c[3]]
    }

    /// Half the surface of a box whose edges are multiplied by `scale`.
    #[inline(always)]
    pub fn half_area(&self, scale: f32) -> f32 {
        let [x, y, z, _] = self.edges();
        let (x, y, z) = (x * scale, y * scale, z * scale);
        x * y + y * z + z * x
    }
}

/// The minimum, or `b` if one is NaN: one instruction.
#[inline(always)]
fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}
