//! The ray-triangle test: exact decisions, then distances and weights.
//!
//! Vertices are moved to the ray's origin and sheared so that the ray is the z axis (Woop, Benthin,
//! Wald 2013), in f32: a vertex gets the same two coordinates in whichever triangle it is met.
//! Whether the origin of that plane is inside a triangle is then decided exactly. An edge function
//! `px qy − py qx` in f32 without a fused multiply-add has the right sign or is zero, as rounding is
//! monotone; in f64 both products are exact, so the sign is right even where f32 gives zero, or
//! where it overflows. So no ray passes between two triangles that share an edge.
//!
//! Distances and weights come from the edge functions in f32 where those decide and are of ordinary
//! size, and from exact positions in f64 where they do not.
//!
//! An opaque triangle includes its rim. Where any-hit shaders count, a shared edge or vertex must
//! belong to one triangle: the ray is thought to be moved by (−ε, −ε²) for an infinitesimal ε, which
//! leaves no edge function at zero (simulation of simplicity, Edelsbrunner, Mücke 1990). A closed fan
//! around a vertex is crossed once by the moved ray, so exactly one of its triangles is hit,
//! seen from either side.

use super::space::Space;
use crate::layout::Bounds;

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Intersection {
    pub t: f32,
    /// Weights of the second and third vertex.
    pub barycentrics: [f32; 2],
    /// The vertices are clockwise as seen from the ray's origin, in a left-handed space.
    pub front: bool,
}

/// What happens on a triangle's edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rim {
    /// They belong to the triangle.
    Included,
    /// A shared edge belongs to one of the triangles that share it.
    Owned,
}

/// Sums of edge functions in here neither lose digits nor overflow on the way to a distance.
pub(crate) const ORDINARY: [f32; 2] = [1.0e-30, 1.0e30];

/// A triangle that reaches so many times as far as it is hit is too large for f32: rounding of its
/// vertices' distances would show.
pub(crate) const REACH: f32 = 32.0;

/// How far off a distance in f32 may be, relative to a triangle's reach.
pub(crate) const SLACK: f32 = 1.0 / (1 << 18) as f32;

/// Intersects a ray with a triangle, whatever the ray's interval.
#[inline(always)]
pub(crate) fn intersect(space: &Space, triangle: &[[f32; 3]; 3], rim: Rim) -> Option<Intersection> {
    let [x_axis, y_axis, z_axis] = space.axes();
    let (mut flat, mut z) = ([[0f32; 2]; 3], [0f32; 3]);
    for i in 0..3 {
        let moved = |axis: usize| triangle[i][axis] - space.origin[axis];
        z[i] = moved(z_axis);
        flat[i] = [
            moved(x_axis) - space.shear[0] * z[i],
            moved(y_axis) - space.shear[1] * z[i],
        ];
    }
    let [a, b, c] = flat;
    let edge = |p: [f32; 2], q: [f32; 2]| p[0] * q[1] - p[1] * q[0];
    let [u, v, w] = [edge(c, b), edge(a, c), edge(b, a)];
    let front = u > 0.0 && v > 0.0 && w > 0.0;
    let back = u < 0.0 && v < 0.0 && w < 0.0;
    let whole = u + v + w;
    let ordinary = ORDINARY[0] < whole.abs() && whole.abs() < ORDINARY[1];
    if !((front || back) && ordinary && space.scale == 1.0) {
        return intersect_exactly(space, triangle, &flat, rim);
    }
    let inverse_whole = 1.0 / whole;
    let [v, w] = [v * inverse_whole, w * inverse_whole];
    // From the first vertex, so that errors of weights count by the triangle's size.
    let z_hit = z[0] + (v * (z[1] - z[0]) + w * (z[2] - z[0]));
    let reach = z[0].abs().max(z[1].abs()).max(z[2].abs());
    let t = z_hit * space.inverse_z;
    if !(reach <= REACH * z_hit.abs()) {
        // Surely behind the ray's start: mostly the surface that the ray starts from.
        if t + reach * space.inverse_z.abs() * SLACK <= space.t_min {
            return None;
        }
        return intersect_exactly(space, triangle, &flat, rim);
    }
    let t = t_in_slab(space, triangle, t)?;
    Some(Intersection {
        t,
        barycentrics: [v, w],
        front,
    })
}

/// Brings a distance into the triangle's own slabs, as they are widened. The exact distance is
/// inside; where it is not because the ray passes beside the rim, what no box would let pass must
/// not be a hit.
#[inline(always)]
fn t_in_slab(space: &Space, triangle: &[[f32; 3]; 3], t: f32) -> Option<f32> {
    let (near, far) = space.slab(&Bounds::of_triangle(triangle));
    let t = t
        .max((f64::from(near) * space.scale) as f32)
        .min((f64::from(far) * space.scale) as f32);
    (near <= far).then_some(t)
}

/// The same where f32 does not do: along edges and at vertices, and with numbers out of all
/// proportion. `flat`: the sheared vertices.
#[cold]
#[inline(never)]
fn intersect_exactly(
    space: &Space,
    triangle: &[[f32; 3]; 3],
    flat: &[[f32; 2]; 3],
    rim: Rim,
) -> Option<Intersection> {
    let z_axis = space.axes()[2];
    let [a, b, c] = *flat;
    let edges = [edge(c, b), edge(a, c), edge(b, a)];
    let sum: f64 = edges.iter().sum();
    if !sum.is_finite() || sum == 0.0 {
        return None;
    }
    let front = sum > 0.0;
    let inside = |value: f64, p: [f32; 2], q: [f32; 2]| {
        if value != 0.0 {
            (value > 0.0) == front
        } else {
            rim == Rim::Included || moved_edge_is_positive(p, q) == front
        }
    };
    if !(inside(edges[0], c, b) && inside(edges[1], a, c) && inside(edges[2], b, a)) {
        return None;
    }
    let inverse_z = 1.0 / f64::from(space.direction[z_axis]);
    let [u, v, w] = weights(space, triangle, front, inverse_z).unwrap_or(edges.map(f64::abs));
    let inverse_whole = 1.0 / (u + v + w);
    let z_of = |i: usize| f64::from(triangle[i][z_axis]) - f64::from(space.origin[z_axis]);
    let t = (u * z_of(0) + v * z_of(1) + w * z_of(2)) * inverse_whole * inverse_z;
    Some(Intersection {
        t: t_in_slab(space, triangle, t as f32)?,
        barycentrics: [(v * inverse_whole) as f32, (w * inverse_whole) as f32],
        front,
    })
}

/// The edge function, with the exact sign.
#[inline]
fn edge(p: [f32; 2], q: [f32; 2]) -> f64 {
    f64::from(p[0]) * f64::from(q[1]) - f64::from(p[1]) * f64::from(q[0])
}

/// The sign of the edge function, zero where the ray is, when the ray is moved aside.
#[inline]
fn moved_edge_is_positive(p: [f32; 2], q: [f32; 2]) -> bool {
    if q[1] == p[1] {
        p[0] > q[0]
    } else {
        q[1] > p[1]
    }
}

/// Weights of the three vertices, not normalised, from positions in f64; `None` where they
/// contradict the decision that was made on rounded coordinates.
#[inline(always)]
fn weights(
    space: &Space,
    triangle: &[[f32; 3]; 3],
    front: bool,
    inverse_z: f64,
) -> Option<[f64; 3]> {
    let [x_axis, y_axis, z_axis] = space.axes();
    let shear = [x_axis, y_axis].map(|axis| f64::from(space.direction[axis]) * inverse_z);
    let flat: [[f64; 2]; 3] = std::array::from_fn(|i| {
        let moved = |axis: usize| f64::from(triangle[i][axis]) - f64::from(space.origin[axis]);
        let z = moved(z_axis);
        [moved(x_axis) - shear[0] * z, moved(y_axis) - shear[1] * z]
    });
    let [a, b, c] = flat;
    let sign = if front { 1.0 } else { -1.0 };
    let edge = |p: [f64; 2], q: [f64; 2]| (sign * (p[0] * q[1] - p[1] * q[0])).max(0.0);
    let weights = [edge(c, b), edge(a, c), edge(b, a)];
    (weights.iter().sum::<f64>() > 0.0).then_some(weights)
}
