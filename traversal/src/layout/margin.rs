//! How far off edge functions in f32 may be.
//!
//! A test moves vertices to the ray's origin and shears them, so that the ray is the z axis: `X = x
//! − s z` with `s = dx / dz`, at most 1 in size, and `Y` likewise. It computes, in f32 with u =
//! 2⁻²⁴,
//!
//! ```text
//! x' = fl(fl(x) − fl(fl(s) fl(z)))               |x' − X| ≤ u (|x| + 3 |s z| + |x'|) ≤ ε = u (2 S + 4 Z)
//! E' = fl(fl(px' qy') − fl(py' qx'))             |E' − E| ≤ 4 u S² + 4 S ε + 2 ε²
//! ```
//!
//! where S bounds |X| and |Y| of both vertices and Z their |z|. With W, the longest side of the box
//! around the triangle, and T, the first vertex's |fl(z)|, we have Z ≤ T + W. If the ray hits the
//! triangle, the z axis meets the sheared one, so S ≤ 2 W; if E' of all three edges are of one
//! sign, it meets the rounded one (rounding is monotone, so those signs are the rounded
//! triangle's), and S ≤ 2 W + 3 ε. In both cases, up to factors of 1 + 40 u,
//!
//! ```text
//! |E' − E| ≤ u (48 W² + 32 W Z + 224 u Z²) ≤ (T + 2.5 W) (32 u W + 224 u² T)
//! ```
//!
//! So a triangle is hit if three edge functions of one sign exceed that, and is missed if two of
//! opposite signs do: were it hit, they would not. The factors here are larger by 1/8 and more,
//! which covers their own rounding. A tiny W counts as 2⁻⁵⁴, which leaves room for underflow. A W
//! above 2⁵⁵ counts as infinite, because products could overflow, so bounds decide nothing.
#![forbid(unsafe_code)]

/// A bound for the edge functions of triangles that are no larger than some size.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub(crate) struct Margin {
    /// Added to the first vertex's distance.
    pub reach: f32,
    /// Times that, for what does not depend on the distance.
    pub slope: f32,
}

/// 2⁻²⁴.
const UNIT: f32 = f32::EPSILON / 2.0;

/// The addition to the slope for each unit of distance.
pub(crate) const MARGIN_RISE: f32 = 256.0 * UNIT * UNIT;

impl Margin {
    /// Nothing is as small.
    pub const NONE: Margin = Margin {
        reach: f32::INFINITY,
        slope: f32::INFINITY,
    };

    /// For triangles with boxes of a longest side.
    #[inline(always)]
    pub fn of_extent(extent: f32) -> Margin {
        const LEAST: f32 = 1.0 / (1u64 << 54) as f32;
        const MOST: f32 = (1u64 << 55) as f32;
        let extent = if extent > LEAST { extent } else { LEAST };
        if extent > MOST {
            return Margin::NONE;
        }
        Margin {
            reach: 2.875 * extent,
            slope: 36.0 * UNIT * extent,
        }
    }

    /// For a triangle.
    #[inline(always)]
    pub fn of(triangle: &[[f32; 3]; 3]) -> Margin {
        Margin::of_extent(longest_side(triangle))
    }

    /// The larger one.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub fn max(self, other: Margin) -> Margin {
        let larger = |a: f32, b: f32| if a > b { a } else { b };
        Margin {
            reach: larger(self.reach, other.reach),
            slope: larger(self.slope, other.slope),
        }
    }

    /// The bound, where the first vertex is so far along the ray's longest axis.
    #[inline(always)]
    pub fn error(self, distance: f32) -> f32 {
        (distance + self.reach) * (self.slope + distance * MARGIN_RISE)
    }
}

/// The longest side of the boxes around some triangles, for their margin.
///
/// Triangles are taken as they are read: what was written number by number a moment ago is slow to
/// be read again in vectors.
#[derive(Clone, Copy, Default)]
pub(crate) struct Extent(Option<f32>);

impl Extent {
    #[inline(always)]
    pub fn add(&mut self, triangle: &[[f32; 3]; 3]) {
        self.0 = Some(larger(longest_side(triangle), self.0.unwrap_or(0.0)));
    }

    pub fn margin(self) -> Margin {
        self.0.map_or(Margin::NONE, Margin::of_extent)
    }
}

/// The larger one of two numbers; the second where one is none.
#[inline(always)]
pub(super) fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The smaller one of two numbers; the second where one is none.
#[inline(always)]
pub(super) fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The longest side of the box around a triangle.
#[inline(always)]
pub(crate) fn longest_side([a, b, c]: &[[f32; 3]; 3]) -> f32 {
    let side = |axis: usize| {
        let [a, b, c] = [a[axis], b[axis], c[axis]];
        larger(larger(a, b), c) - smaller(smaller(a, b), c)
    };
    larger(side(2), larger(side(1), larger(side(0), 0.0)))
}
