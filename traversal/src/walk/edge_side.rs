//! On which side of its edges a ray passes a triangle, decided on the numbers that were given.
//!
//! For a ray from `o` along `d`, the edge from `p` to `q` has the determinant `det(d, p − o, q −
//! o)`: the ray passes on the side that its sign says. Tests decide by bounds where they can
//! ([`Margin`](crate::layout::Margin)). This file decides the remaining cases: in f64 with an error
//! bound, then without any rounding ([`Expansion`]).
//!
//! A determinant of zero is a ray that meets the edge's line. Where a shared edge has to belong to
//! one triangle, the ray is thought to start at `o + (ε, ε², ε³)` for an infinitesimal ε
//! (simulation of simplicity, Edelsbrunner, Mücke 1990). That adds `(ε, ε², ε³) · (d × (q − p))`,
//! so the first component of the cross product that is not zero has the sign. It does not depend on
//! the third vertex, and changes with the direction of the edge: both triangles of an edge see the
//! same ray. An edge along the ray keeps its zero; its triangles are seen from their sides, and no
//! ray hits those.
#![forbid(unsafe_code)]

#[cfg(test)]
pub(super) mod tests;

use super::expansion::{Expansion, two_sum};

/// Half a unit in the last place of f64, relative.
const HALF_UNIT: f64 = f64::EPSILON / 2.0;

/// The error bound of a determinant with one exact row, relative to the sum of its products' sizes:
/// two rounded differences, four operations on each product, and two sums, and as much again for
/// the bound's own rounding.
const ERROR: f64 = 16.0 * HALF_UNIT;

/// The edges of a triangle, opposite to each vertex.
const EDGES: [[usize; 2]; 3] = [[2, 1], [0, 2], [1, 0]];

/// A ray and a triangle as seen from its start.
struct Scene<'a> {
    origin: [f32; 3],
    triangle: &'a [[f32; 3]; 3],
    direction: [f64; 3],
    /// Vertices less the origin, rounded.
    moved: [[f64; 3]; 3],
}

/// A number, and how far off it may be.
#[derive(Clone, Copy)]
struct Estimate {
    value: f64,
    error: f64,
}

impl Estimate {
    fn exactly(sum: &Expansion) -> Estimate {
        let value = sum.value();
        Estimate {
            value,
            error: ERROR * value.abs(),
        }
    }

    fn is_certain(self) -> bool {
        self.value.abs() > self.error
    }
}

impl<'a> Scene<'a> {
    #[inline(always)]
    fn new(origin: [f32; 3], direction: [f32; 3], triangle: &'a [[f32; 3]; 3]) -> Scene<'a> {
        let mut scene = Scene {
            origin,
            triangle,
            direction: direction.map(f64::from),
            moved: [[0.0; 3]; 3],
        };
        for vertex in 0..3 {
            for axis in 0..3 {
                scene.moved[vertex][axis] =
                    f64::from(triangle[vertex][axis]) - f64::from(origin[axis]);
            }
        }
        scene
    }

    /// The determinant of the direction and two vertices.
    #[inline]
    fn edge(&self, [p, q]: [usize; 2]) -> Estimate {
        let (d, p, q) = (&self.direction, &self.moved[p], &self.moved[q]);
        let (mut value, mut size) = (0.0, 0.0);
        for (i, j, k) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
            let (first, second) = (p[j] * q[k], p[k] * q[j]);
            value += d[i] * (first - second);
            size += d[i].abs() * (first.abs() + second.abs());
        }
        Estimate {
            value,
            error: ERROR * size,
        }
    }

    /// A vertex less the origin, in terms that need no rounding.
    fn terms(&self, vertex: usize) -> [[f64; 3]; 2] {
        let mut terms = [[0.0; 3]; 2];
        for axis in 0..3 {
            let (p, o) = (self.triangle[vertex][axis], self.origin[axis]);
            [terms[0][axis], terms[1][axis]] = two_sum(f64::from(p), -f64::from(o));
        }
        terms
    }

    #[cold]
    #[inline(never)]
    fn edge_exactly(&self, [p, q]: [usize; 2]) -> Estimate {
        let direction = [self.direction, [0.0; 3]];
        self.determinant(&[direction, self.terms(p), self.terms(q)])
    }

    /// The determinant of the three vertices.
    fn volume_exactly(&self) -> Estimate {
        self.determinant(&[0, 1, 2].map(|vertex| self.terms(vertex)))
    }

    /// The determinant of three rows, each a sum of two.
    fn determinant(&self, [a, b, c]: &[[[f64; 3]; 2]; 3]) -> Estimate {
        let mut sum = Expansion::new();
        let parts = |row: &[[f64; 3]; 2]| if row[1] == [0.0; 3] { 1 } else { 2 };
        for (i, j, k) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
            for a in &a[..parts(a)] {
                for b in &b[..parts(b)] {
                    for c in &c[..parts(c)] {
                        if a[i] != 0.0 {
                            sum.add_triple(b[j], c[k], a[i]);
                            sum.add_triple(-b[k], c[j], a[i]);
                        }
                    }
                }
            }
        }
        Estimate::exactly(&sum)
    }

    /// Where the ray's line meets the triangle: the distance, and the weights of the second and the
    /// third vertex. `None` if that is not in front of the ray's start. `edges`: of one sign.
    fn distance_and_weights(&self, mut edges: [Estimate; 3]) -> Option<(f64, [f64; 2])> {
        let d = &self.direction;
        let axis = (0..3).fold(0, |best, axis| {
            if d[axis].abs() > d[best].abs() {
                axis
            } else {
                best
            }
        });
        let whole: f64 = edges.iter().map(|edge| edge.value).sum();
        let (mut along, mut error) = (0.0, 0.0);
        for (edge, moved) in edges.iter().zip(&self.moved) {
            let part = edge.value * moved[axis];
            along += part;
            error += edge.error * moved[axis].abs() + ERROR * part.abs();
        }
        let uncertain: f64 = edges.iter().map(|edge| edge.error).sum();
        if error < PRECISE * along.abs() && uncertain < PRECISE * whole.abs() {
            let t = along / (whole * d[axis]);
            return (t > 0.0).then(|| (t, [1, 2].map(|i: usize| edges[i].value / whole)));
        }
        edges = EDGES.map(|edge| self.edge_exactly(edge));
        let whole: f64 = edges.iter().map(|edge| edge.value).sum();
        let t = -self.volume_exactly().value / whole;
        (t > 0.0).then(|| (t, [1, 2].map(|i: usize| edges[i].value / whole)))
    }
}

/// Relative errors that do not show in f32.
const PRECISE: f64 = 1.0 / (1u64 << 30) as f64;

/// The determinants of the edges if the ray hits the triangle, rim as said.
fn sides(scene: &Scene<'_>, triangle: &[[f32; 3]; 3], rim: Rim) -> Option<[Estimate; 3]> {
    let mut edges = EDGES.map(|edge| scene.edge(edge));
    let [mut front, mut back] = [false; 2];
    for edge in &edges {
        front |= edge.value > edge.error;
        back |= edge.value < -edge.error;
    }
    if front && back {
        return None;
    }
    for (edge, vertices) in edges.iter_mut().zip(EDGES) {
        // NaN is not certain either.
        if !edge.is_certain() {
            *edge = scene.edge_exactly(vertices);
            front |= edge.value > 0.0;
            back |= edge.value < 0.0;
        }
    }
    // All zero: the ray is in the triangle's plane, or there is none.
    if front == back {
        return None;
    }
    let owned = |(edge, [p, q]): (&Estimate, [usize; 2])| {
        edge.value != 0.0
            || moved_sign(scene, &triangle[p], &triangle[q]) == if front { 1 } else { -1 }
    };
    let hit = rim == Rim::Included || edges.iter().zip(EDGES).all(owned);
    hit.then_some(edges)
}

/// Where a ray hits a triangle, in front of its start: whether it sees the front, the distance, and
/// the weights of the second and the third vertex.
pub(crate) fn intersect_exactly(
    origin: [f32; 3],
    direction: [f32; 3],
    triangle: &[[f32; 3]; 3],
    rim: Rim,
) -> Option<(bool, f64, [f64; 2])> {
    let scene = Scene::new(origin, direction, triangle);
    let edges = sides(&scene, triangle, rim)?;
    let (t, weights) = scene.distance_and_weights(edges)?;
    Some((edges.iter().any(|edge| edge.value > 0.0), t, weights))
}

/// Whether a ray hits a triangle, wherever that is; whether it sees the front.
pub(crate) fn faces(
    origin: [f32; 3],
    direction: [f32; 3],
    triangle: &[[f32; 3]; 3],
    rim: Rim,
) -> Option<bool> {
    let edges = sides(&Scene::new(origin, direction, triangle), triangle, rim)?;
    Some(edges.iter().any(|edge| edge.value > 0.0))
}

/// The sign of an edge's determinant that is zero, once the ray's start is moved; 0 if the edge is
/// along the ray.
#[cold]
fn moved_sign(scene: &Scene<'_>, p: &[f32; 3], q: &[f32; 3]) -> i32 {
    let d = &scene.direction;
    let [x, y, z] = [0, 1, 2].map(|axis: usize| two_sum(f64::from(q[axis]), -f64::from(p[axis])));
    for (first, second, d_first, d_second) in
        [(y, z, d[1], d[2]), (z, x, d[2], d[0]), (x, y, d[0], d[1])]
    {
        let mut sum = Expansion::new();
        for i in 0..2 {
            sum.add_product(d_first, second[i]);
            sum.add_product(-d_second, first[i]);
        }
        let value = sum.value();
        if value != 0.0 {
            return if value > 0.0 { 1 } else { -1 };
        }
    }
    0
}

/// The treatment of a triangle's edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rim {
    /// They belong to the triangle.
    Included,
    /// A shared edge belongs to one of the triangles that share it.
    Owned,
}
