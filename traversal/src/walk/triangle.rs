//! The ray-triangle test: exact decisions, then distances and weights.
//!
//! Vertices are moved to the ray's origin and sheared so that the ray is the z axis (Woop, Benthin,
//! Wald 2013), in f32. Edge functions that exceed a bound for all rounding errors ([`Margin`]) have
//! the signs of the exact determinants of the inputs; otherwise those are computed
//! ([`edge_side`](super::edge_side)). So the hit triangles depend only on the ray and the
//! triangles, no ray passes between two that share an edge, and each hit is inside the boxes around
//! its triangle. docs/watertightness.md has the whole proof.
//!
//! Distances and weights come from the edge functions in f32 where a bound of their errors is
//! small, else from f64.
//!
//! An opaque triangle includes its rim. Where any-hit shaders count, a shared edge or vertex must
//! belong to one triangle: see [`edge_side`](super::edge_side).

use super::edge_side::{self, Rim};
use super::level_ray::LevelRay;
use crate::layout::{Bounds, Margin};

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Intersection {
    pub t: f32,
    /// Weights of the second and third vertex.
    pub barycentrics: [f32; 2],
    /// The vertices are clockwise as seen from the ray's origin, in a left-handed space.
    pub front: bool,
}

/// Sums of edge functions in here neither lose digits nor overflow on the way to a distance.
pub(crate) const ORDINARY: [f32; 2] = [1.0e-30, 1.0e30];

/// 2⁻²⁴.
const UNIT: f32 = f32::EPSILON / 2.0;

/// How far off weights and distances in f32 may be, where the sheared triangle contains the ray and
/// edge functions have one sign. With F and G, the sides of the box around it across the ray, A,
/// the sum of its edge functions, D, the distance along the ray from the nearest to the farthest
/// vertex, M, the mean of the vertices' |z| by their weights, and u = 2⁻²⁴:
///
/// * Rounding moves each vertex on either axis by u (2 |X| + 4 |s z|), as
///   [`Margin`](crate::layout::Margin) says. That moves the plane under the ray by the mean of
///   those moves: u (F + 4 |s_x| M) and u (G + 4 |s_y| M), as the mean of |X| is at most F / 2. For
///   each unit a weight changes by at most G / A and F / A, and z by D times that.
/// * Products and differences of edge functions round by u P in all, and by u of themselves, where
///   P is the sum of the products' sizes: at most the product of the sums of |X| and of |Y|, which
///   are at most 2 F and 2 G. A weight changes by no more than u P / A, and z by D u P / A.
/// * Sum, reciprocal and product round weights by 4 u, and z − z₀, its product and sum by 3 u D.
/// * z itself is rounded by u M at first and by u |z| in the end.
///
/// So a weight is off by `(6 F G + 4 (|s_x| G + |s_y| F) M) u / A + 8 u`, and the distance by D
/// times that and 2 u M. Factors are larger by 1/8 for what is left out here: the terms of higher
/// order, as weights are off by less than 1/256.
///
/// A test of several triangles first asks bounds that are larger, as it has what they are made of:
/// f, g and D, the sides of the box around the triangle as seen from the origin. M is at most N,
/// the larger one of |z| and D; the vertices' |z| are at most 2 N. So F is at most f + |s_x| D + a
/// with a = 4.4 u |s_x| N for what rounds, and G at most g + |s_y| D + b with b = 4.4 u |s_y| N.
/// The bounds with f + |s_x| D, g + |s_y| D and N in their places, a and b left out, and all
/// factors larger by 1/64 ([`ROUGH`](rounding::ROUGH)) are no less than those above: where edge
/// functions exceed their bound, A is more than 768 u² (T + 2.5 W)², and so than 30 a b; where the
/// larger bound of weights is less than 1/256, a G + b F is less than A / 250. So F G is A within a
/// twentieth, a b F G less than (A / 500)², and what is left out, twice a b among the shears' a G +
/// b F, less than a 400th of that.
///
/// Underflow rounds by 2⁻¹⁵⁰ instead: s, products with z, z's own products.
/// [`LEAST`](rounding::LEAST) for each covers that. Products that edge functions are made of are
/// not changed by as little, where the sum is of [ordinary](ORDINARY) size.
pub(crate) mod rounding {
    use super::UNIT;

    pub const WIDTH: f32 = 6.75 * UNIT;
    pub const SHEAR: f32 = 4.5 * UNIT;
    pub const WEIGHTS: f32 = 9.0 * UNIT;
    pub const DISTANCE: f32 = 2.25 * UNIT;

    /// More than what underflows can be off.
    pub const LEAST: f32 = f32::MIN_POSITIVE;

    /// By what a vertex is moved for each unit along the ray, on an axis with this shear.
    #[inline(always)]
    pub fn shear(shear: f32) -> f32 {
        shear.abs() * SHEAR + LEAST
    }

    /// By what bounds are larger that take the box around the triangle, not the sheared one.
    #[cfg(target_arch = "x86_64")]
    pub const ROUGH: f32 = 1.0 + 1.0 / 64.0;

    /// Weights that may be farther off are computed in f64.
    pub const MOST: f32 = 1.0 / 256.0;
}

/// Three vertices as seen from the ray's start: sheared, and along the ray.
pub(crate) struct ShearedTriangle {
    x: [f32; 3],
    y: [f32; 3],
    pub z: [f32; 3],
}

impl ShearedTriangle {
    #[inline(always)]
    pub fn new(level_ray: &LevelRay, triangle: &[[f32; 3]; 3]) -> ShearedTriangle {
        let [x_axis, y_axis, z_axis] = level_ray.axes();
        let mut flat = ShearedTriangle {
            x: [0.0; 3],
            y: [0.0; 3],
            z: [0.0; 3],
        };
        for i in 0..3 {
            let moved = |axis: usize| triangle[i][axis] - level_ray.origin[axis];
            let z = moved(z_axis);
            flat.x[i] = moved(x_axis) - level_ray.shear[0] * z;
            flat.y[i] = moved(y_axis) - level_ray.shear[1] * z;
            flat.z[i] = z;
        }
        flat
    }

    #[inline(always)]
    pub fn edge(&self, p: usize, q: usize) -> f32 {
        self.x[p] * self.y[q] - self.y[p] * self.x[q]
    }
}

/// Intersects a ray with a triangle, whatever the ray's interval.
#[inline(always)]
pub(crate) fn intersect(
    level_ray: &LevelRay,
    triangle: &[[f32; 3]; 3],
    rim: Rim,
) -> Option<Intersection> {
    let flat = ShearedTriangle::new(level_ray, triangle);
    let edges = [flat.edge(2, 1), flat.edge(0, 2), flat.edge(1, 0)];
    let [u, v, w] = edges;
    let error = Margin::of(triangle).error(flat.z[0].abs());
    let (least, most) = (u.min(v).min(w), u.max(v).max(w));
    if least < -error && most > error {
        return None;
    }
    let whole = u + v + w;
    let ordinary = ORDINARY[0] < whole.abs() && whole.abs() < ORDINARY[1];
    let front = least > error;
    if !(ordinary && (front || most < -error)) {
        return intersect_exactly(level_ray, triangle, &flat, edges, rim);
    }
    match estimate_hit(level_ray, &flat, edges) {
        HitEstimate::At(t, barycentrics) => Some(Intersection {
            t: t_in_slab(level_ray, triangle, t),
            barycentrics,
            front,
        }),
        HitEstimate::Behind => None,
        HitEstimate::Uncertain => intersect_unrounded(level_ray, triangle, rim),
    }
}

/// Where a triangle is hit.
enum HitEstimate {
    At(f32, [f32; 2]),
    /// Surely not after the start of the interval: mostly the surface that the ray starts from.
    Behind,
    /// Rounding would show.
    Uncertain,
}

/// Where a triangle is hit whose edge functions have one sign and a sum of ordinary size.
#[inline(always)]
fn estimate_hit(level_ray: &LevelRay, flat: &ShearedTriangle, [u, v, w]: [f32; 3]) -> HitEstimate {
    let z_axis = level_ray.axes()[2];
    let ShearedTriangle { x, y, z } = flat;
    let inverse_whole = 1.0 / (u + v + w);
    let [u, v, w] = [u * inverse_whole, v * inverse_whole, w * inverse_whole];
    // From the first vertex, so that errors of weights count by the triangle's size.
    let z_hit = z[0] + (v * (z[1] - z[0]) + w * (z[2] - z[0]));
    let z_mean = u * z[0].abs() + v * z[1].abs() + w * z[2].abs();
    let [width, height] = [extent(x), extent(y)];
    let shear = level_ray.shear.map(rounding::shear);
    let sheared = height * (z_mean * shear[0] + rounding::LEAST)
        + width * (z_mean * shear[1] + rounding::LEAST);
    let moved = width * height * rounding::WIDTH + sheared;
    let weight_error = inverse_whole.abs() * moved + rounding::WEIGHTS;
    let z_error = extent(z) * weight_error + (z_mean * rounding::DISTANCE + rounding::LEAST);
    if weight_error >= rounding::MOST {
        return HitEstimate::Uncertain;
    }
    if z_error <= level_ray.tolerance * z_hit.abs() {
        return match level_ray.scale == 1.0 {
            true => HitEstimate::At(z_hit / level_ray.direction[z_axis], [v, w]),
            false => HitEstimate::Uncertain,
        };
    }
    let last = z_hit * level_ray.inverse_z + z_error * level_ray.inverse_z.abs() * ROOM;
    match level_ray.scale == 1.0 && last <= level_ray.t_min {
        true => HitEstimate::Behind,
        false => HitEstimate::Uncertain,
    }
}

/// Times the error of a distance, for what the sum of both rounds.
pub(crate) const ROOM: f32 = 2.5;

#[inline(always)]
fn extent([a, b, c]: &[f32; 3]) -> f32 {
    a.max(*b).max(*c) - a.min(*b).min(*c)
}

/// Brings a distance into the triangle's own slabs, as they are widened, so that no box around it
/// contradicts it. The exact distance is inside.
#[inline(always)]
fn t_in_slab(level_ray: &LevelRay, triangle: &[[f32; 3]; 3], t: f32) -> f32 {
    let (near, far) = level_ray.slab(&Bounds::of_triangle(triangle));
    t.max((f64::from(near) * level_ray.scale) as f32)
        .min((f64::from(far) * level_ray.scale) as f32)
}

/// The same where bounds do not decide: near edges and vertices, and with numbers out of all
/// proportion. `edges`: the edge functions in f32.
#[cold]
#[inline(never)]
fn intersect_exactly(
    level_ray: &LevelRay,
    triangle: &[[f32; 3]; 3],
    flat: &ShearedTriangle,
    edges: [f32; 3],
    rim: Rim,
) -> Option<Intersection> {
    let [u, v, w] = edges;
    let whole = u + v + w;
    let one_sign = u > 0.0 && v > 0.0 && w > 0.0 || u < 0.0 && v < 0.0 && w < 0.0;
    let ordinary = ORDINARY[0] < whole.abs() && whole.abs() < ORDINARY[1];
    if !(one_sign && ordinary) {
        return intersect_unrounded(level_ray, triangle, rim);
    }
    // The work of a test of several triangles after its bounds have decided.
    match estimate_hit(level_ray, flat, edges) {
        HitEstimate::At(t, barycentrics) => {
            let front = edge_side::faces(
                first(level_ray.origin),
                first(level_ray.direction),
                triangle,
                rim,
            )?;
            if front != (whole > 0.0) {
                return intersect_unrounded(level_ray, triangle, rim);
            }
            Some(Intersection {
                t: t_in_slab(level_ray, triangle, t),
                barycentrics,
                front,
            })
        }
        HitEstimate::Behind | HitEstimate::Uncertain => {
            intersect_unrounded(level_ray, triangle, rim)
        }
    }
}

fn first([x, y, z, _]: [f32; 4]) -> [f32; 3] {
    [x, y, z]
}

/// Computes all of it from the vertices as they are, without shearing them in f32.
#[cold]
#[inline(never)]
fn intersect_unrounded(
    level_ray: &LevelRay,
    triangle: &[[f32; 3]; 3],
    rim: Rim,
) -> Option<Intersection> {
    let (front, t, weights) = edge_side::intersect_exactly(
        first(level_ray.origin),
        first(level_ray.direction),
        triangle,
        rim,
    )?;
    Some(Intersection {
        t: t_in_slab(level_ray, triangle, t as f32),
        barycentrics: weights.map(|weight| weight as f32),
        front,
    })
}
