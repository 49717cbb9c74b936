//! The planes of a record: how depth and barycentric coordinates change over the screen, in f64
//! until they are stored.

#![forbid(unsafe_code)]

use super::screen::{Clip, PIXEL, Screen, ScreenVertex};
use crate::raster::primitive::PlaneEquation;

/// A value at the centre of the origin's pixel, and its change a pixel to the right and a pixel
/// down.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wide {
    pub at: f64,
    pub dx: f64,
    pub dy: f64,
}

impl Wide {
    /// The same everywhere.
    pub fn constant(at: f64) -> Self {
        Self {
            at,
            dx: 0.0,
            dy: 0.0,
        }
    }

    #[inline(always)]
    pub fn times(self, factor: f64) -> Self {
        Self {
            at: self.at * factor,
            dx: self.dx * factor,
            dy: self.dy * factor,
        }
    }

    #[inline(always)]
    pub fn plus(self, other: Self) -> Self {
        Self {
            at: self.at + other.at,
            dx: self.dx + other.dx,
            dy: self.dy + other.dy,
        }
    }

    #[inline(always)]
    pub fn narrow(self) -> PlaneEquation {
        PlaneEquation {
            at: self.at as f32,
            dx: self.dx as f32,
            dy: self.dy as f32,
        }
    }
}

/// The planes of a primitive.
#[derive(Clone, Copy, Debug, Default)]
pub struct Planes {
    pub origin: [i32; 2],
    pub depth: Wide,
    pub perspective: [Wide; 3],
    pub linear: [Wide; 3],
    /// All w are 1: both are the same.
    pub is_affine: bool,
}

/// The barycentric coordinate that is 0 on the side from one vertex to another, at a place in
/// fixed-point units. No closure: it would be called, and its result read from memory in other
/// sizes than it is written in.
#[inline(always)]
fn side(from: &ScreenVertex, to: &ScreenVertex, at: [i64; 2], inverse: f64) -> Wide {
    let a = from.y - to.y;
    let b = to.x - from.x;
    let across = i64::from(a) * (at[0] - i64::from(from.x));
    let down = i64::from(b) * (at[1] - i64::from(from.y));
    let step = inverse * f64::from(PIXEL);
    Wide {
        at: (across + down) as f64 * inverse,
        dx: f64::from(a) * step,
        dy: f64::from(b) * step,
    }
}

/// Of a triangle with all vertices on the screen, from the same positions as its coverage: samples
/// that it covers are within it. `area` is twice its area in fixed-point units, with its sign, not
/// 0.
#[inline(always)]
pub fn of_triangle(vertices: &[&ScreenVertex; 3], area: i64, origin: [i32; 2]) -> Planes {
    let center = |pixel: i32| i64::from(pixel) * i64::from(PIXEL) + i64::from(PIXEL / 2);
    let at = [center(origin[0]), center(origin[1])];
    let inverse = 1.0 / area as f64;
    let [v0, v1, v2] = *vertices;
    let linear = [
        side(v1, v2, at, inverse),
        side(v2, v0, at, inverse),
        side(v0, v1, at, inverse),
    ];
    let depth = Wide::constant(v0.depth)
        .plus(linear[1].times(v1.depth - v0.depth))
        .plus(linear[2].times(v2.depth - v0.depth));
    let is_affine = (v0.inverse_w == 1.0) & (v1.inverse_w == 1.0) & (v2.inverse_w == 1.0);
    let perspective = match is_affine {
        true => linear,
        false => [
            linear[0].times(v0.inverse_w),
            linear[1].times(v1.inverse_w),
            linear[2].times(v2.inverse_w),
        ],
    };
    Planes {
        origin,
        depth,
        perspective,
        linear,
        is_affine,
    }
}

/// Of a triangle of any three vertices, by their positions in pixels times w (Olano and Greer,
/// "Triangle Scan Conversion using 2D Homogeneous Coordinates", 1997). Vertices on the screen count
/// as where they are snapped to, so that a triangle has the same planes clipped and not clipped.
pub fn of_homogeneous(
    screen: &Screen,
    positions: &[Clip; 3],
    vertices: &[&ScreenVertex; 3],
    origin: [i32; 2],
) -> Planes {
    // Relative to the origin's centre, to keep what is near the screen exact.
    let center = origin.map(|pixel| f64::from(pixel) + 0.5);
    let place = |i: usize| {
        let w = positions[i][3];
        if vertices[i].code & super::screen::code::NOWHERE == 0 {
            let scale = 1.0 / f64::from(PIXEL);
            [
                (f64::from(vertices[i].x) * scale - center[0]) * w,
                (f64::from(vertices[i].y) * scale - center[1]) * w,
                w,
            ]
        } else {
            let [x, y] = screen.homogeneous(&positions[i]);
            [x - center[0] * w, y - center[1] * w, w]
        }
    };
    let p = [place(0), place(1), place(2)];
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    };
    let sides = [cross(p[1], p[2]), cross(p[2], p[0]), cross(p[0], p[1])];
    let determinant = p[0][0] * sides[0][0] + p[0][1] * sides[0][1] + p[0][2] * sides[0][2];
    let inverse = 1.0 / determinant;
    let perspective = if determinant == 0.0 || !inverse.is_finite() {
        // Seen from its edge.
        [Wide::constant(1.0), Wide::default(), Wide::default()]
    } else {
        sides.map(|side| Wide {
            at: side[2] * inverse,
            dx: side[0] * inverse,
            dy: side[1] * inverse,
        })
    };
    from_perspective(screen, positions, origin, perspective)
}

/// All planes from those of λᵢ / wᵢ.
pub fn from_perspective(
    screen: &Screen,
    positions: &[Clip; 3],
    origin: [i32; 2],
    perspective: [Wide; 3],
) -> Planes {
    let [p0, p1, p2] = perspective;
    let z = p0
        .times(positions[0][2])
        .plus(p1.times(positions[1][2]))
        .plus(p2.times(positions[2][2]));
    let linear = [
        p0.times(positions[0][3]),
        p1.times(positions[1][3]),
        p2.times(positions[2][3]),
    ];
    Planes {
        origin,
        depth: z
            .times(screen.depth_scale)
            .plus(Wide::constant(screen.depth_offset)),
        perspective,
        linear,
        is_affine: perspective == linear,
    }
}
