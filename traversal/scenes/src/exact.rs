//! Where a ray meets triangles, by whole numbers: nothing is rounded but the answer.

use num_bigint::BigInt;
use num_traits::{Signed, ToPrimitive, Zero};
use traversal::Ray;

use crate::{Mesh, wide};

/// Where a ray meets a triangle, edges and vertices included.
#[derive(Clone, Copy, Debug)]
pub struct Crossing {
    pub t: f64,
    /// Weights of the second and the third vertex.
    pub weights: [f64; 2],
}

type Whole = [BigInt; 3];

/// A number in units of 2⁻¹⁴⁹.
fn whole(value: f32) -> BigInt {
    let bits = value.to_bits();
    let (exponent, fraction) = (bits >> 23 & 0xFF, bits & 0x7F_FFFF);
    let size = match exponent {
        0 => BigInt::from(fraction),
        _ => BigInt::from(fraction | 0x80_0000) << (exponent - 1),
    };
    if value < 0.0 { -size } else { size }
}

fn product(a: &Whole, b: &Whole) -> BigInt {
    &a[0] * &b[0] + &a[1] * &b[1] + &a[2] * &b[2]
}

fn normal(a: &Whole, b: &Whole) -> Whole {
    [
        &a[1] * &b[2] - &a[2] * &b[1],
        &a[2] * &b[0] - &a[0] * &b[2],
        &a[0] * &b[1] - &a[1] * &b[0],
    ]
}

/// A quotient of numbers that may be beyond the range of f64.
fn quotient(above: &BigInt, below: &BigInt) -> f64 {
    let parts = |value: &BigInt| {
        let excess = value.bits().saturating_sub(64);
        let head = (value >> excess).to_f64().unwrap_or(0.0);
        (head, excess as i32)
    };
    let ((a, a_power), (b, b_power)) = (parts(above), parts(below));
    // In two steps: either power may be out of range by itself.
    let power = a_power - b_power;
    a / b * 2f64.powi(power / 2) * 2f64.powi(power - power / 2)
}

/// Where a ray's line meets a triangle.
pub fn intersect(ray: &Ray, triangle: &[[f32; 3]; 3]) -> Option<Crossing> {
    let origin = ray.origin.map(whole);
    let direction = ray.direction.map(whole);
    let [a, b, c] = triangle.map(|vertex| {
        let vertex = vertex.map(whole);
        std::array::from_fn(|i| &vertex[i] - &origin[i])
    });
    let edges = [(&c, &b), (&a, &c), (&b, &a)].map(|(p, q)| product(&direction, &normal(p, q)));
    let whole: BigInt = edges.iter().sum();
    let [u, v, w] = &edges;
    let mixed = edges.iter().any(Signed::is_positive) && edges.iter().any(Signed::is_negative);
    if mixed || whole.is_zero() {
        return None;
    }
    let axis = (0..3).max_by(|&i, &j| {
        let size = |axis: usize| ray.direction[axis].abs();
        size(i).total_cmp(&size(j))
    })?;
    let along = u * &a[axis] + v * &b[axis] + w * &c[axis];
    Some(Crossing {
        t: quotient(&along, &(&whole * &direction[axis])),
        weights: [quotient(v, &whole), quotient(w, &whole)],
    })
}

/// Which of -1, 0 and 1 an edge's determinant has for a sign, once the origin is moved by (ε, ε²,
/// ε³).
fn moved_sign(edge: &BigInt, direction: &Whole, from: &Whole, to: &Whole) -> i32 {
    let sign = |value: &BigInt| i32::from(value.is_positive()) - i32::from(value.is_negative());
    let step: Whole = std::array::from_fn(|i| &to[i] - &from[i]);
    let slopes = normal(direction, &step);
    let signs = std::iter::once(edge).chain(&slopes).map(sign);
    signs.into_iter().find(|&sign| sign != 0).unwrap_or(0)
}

/// Whether a ray crosses a triangle after its origin; at edges and vertices, as the ray does whose
/// origin is moved by an infinitesimal (ε, ε², ε³).
pub fn crosses(ray: &Ray, triangle: &[[f32; 3]; 3]) -> bool {
    if intersect(ray, triangle).is_none_or(|found| found.t <= 0.0) {
        return false;
    }
    let direction = ray.direction.map(whole);
    let origin = ray.origin.map(whole);
    let [a, b, c] = triangle.map(|vertex| {
        let vertex = vertex.map(whole);
        std::array::from_fn::<BigInt, 3, _>(|i| &vertex[i] - &origin[i])
    });
    let signs = [(&c, &b), (&a, &c), (&b, &a)]
        .map(|(p, q)| moved_sign(&product(&direction, &normal(p, q)), &direction, p, q));
    signs[0] != 0 && signs.iter().all(|&sign| sign == signs[0])
}

/// How many triangles a ray [`crosses`].
pub fn crossings(mesh: &Mesh, ray: &Ray) -> usize {
    (0..mesh.indices.len())
        .map(|index| mesh.triangle(index))
        .filter(|triangle| !is_beside(ray, triangle) && crosses(ray, triangle))
        .count()
}

/// Whether a triangle is so far beside a ray that f64 is sure of it.
fn is_beside(ray: &Ray, triangle: &[[f32; 3]; 3]) -> bool {
    let (origin, direction) = (wide(ray.origin), wide(ray.direction));
    let [a, b, c] = triangle.map(|vertex| wide(vertex) - origin);
    let [mut above, mut below] = [false; 2];
    for (p, q) in [(c, b), (a, c), (b, a)] {
        let margin = 1e-12 * direction.length() * p.length() * q.length();
        let edge = direction.dot(p.cross(q));
        above |= edge > margin;
        below |= edge < -margin;
    }
    above && below
}

/// The first triangle that a ray meets in its interval at a distance that f32 can say, and where;
/// the first of equals.
pub fn nearest(mesh: &Mesh, ray: &Ray) -> Option<(usize, Crossing)> {
    let mut best: Option<(usize, Crossing)> = None;
    for index in 0..mesh.indices.len() {
        let triangle = mesh.triangle(index);
        if is_beside(ray, &triangle) {
            continue;
        }
        if let Some(found) = intersect(ray, &triangle)
            && found.t > f64::from(ray.t_min)
            && found.t < f64::from(ray.t_max)
            && (found.t as f32).is_finite()
            && best.is_none_or(|(_, best)| found.t < best.t)
        {
            best = Some((index, found));
        }
    }
    best
}
