//! Solid things: a torus knot, boxes, boulders, tiles.

use glam::Vec3;

use super::mesh::Part;
use super::noise::fractal;

const TAU: f32 = std::f32::consts::TAU;

/// A (2, 3) torus knot whose tube is itself fluted; about 1.4 units in radius.
pub fn torus_knot(columns: u32, rows: u32) -> Part {
    let curve = |s: f32| {
        let (sin2, cos2) = libm::sincosf(2.0 * TAU * s);
        let (sin3, cos3) = libm::sincosf(3.0 * TAU * s);
        let r = 1.0 + 0.42 * cos3;
        Vec3::new(r * cos2, r * sin2, 0.46 * sin3)
    };
    let surface = |s: f32, t: f32| {
        let step = 1e-3;
        let centre = curve(s);
        let tangent = (curve(s + step) - curve(s - step)).normalize();
        let away = Vec3::new(centre.x, centre.y, 0.0).normalize();
        let across = (away - tangent * tangent.dot(away)).normalize();
        let other = tangent.cross(across);
        let (sine, cosine) = libm::sincosf(TAU * t);
        let flute = libm::cosf(TAU * (6.0 * t + 18.0 * s));
        centre + (across * cosine + other * sine) * (0.27 + 0.014 * flute)
    };
    let mut part = Part::default();
    part.grid(columns, rows, |s, t| {
        let step = 5e-4;
        let ds = surface(s + step, t) - surface(s - step, t);
        let dt = surface(s, t + step * 4.0) - surface(s, t - step * 4.0);
        (surface(s, t), ds.cross(dt).normalize(), (s * 24.0, t * 2.0))
    });
    part
}

/// A box with bevelled edges, from its centre.
pub fn block(half: Vec3, bevel: f32) -> Part {
    let mut part = Part::default();
    let inner = half - Vec3::splat(bevel);
    let axes = [Vec3::X, Vec3::Y, Vec3::Z];
    for axis in 0..3 {
        for sign in [-1.0f32, 1.0] {
            let n = axes[axis] * sign;
            let u = axes[(axis + 1) % 3];
            let v = n.cross(u);
            let (hu, hv) = (inner.dot(u.abs()), inner.dot(v.abs()));
            let centre = n * half.dot(n.abs());
            let mut corners = [0; 4];
            for (corner, (s, t)) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
                .into_iter()
                .enumerate()
            {
                let position = centre + u * (hu * s) + v * (hv * t);
                corners[corner] = part.vertex(position, n, (s * hu * 0.5, t * hv * 0.5));
            }
            part.quad(corners[0], corners[1], corners[2], corners[3]);
        }
    }
    // The twelve bevels join the faces' edges, the eight corners join the bevels.
    for axis in 0..3 {
        let (a, b, c) = (axes[axis], axes[(axis + 1) % 3], axes[(axis + 2) % 3]);
        for (sb, sc) in [(-1.0f32, -1.0f32), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            let normal = (b * sb + c * sc).normalize();
            let on_b = b * (sb * half.dot(b)) + c * (sc * inner.dot(c));
            let on_c = b * (sb * inner.dot(b)) + c * (sc * half.dot(c));
            let reach = inner.dot(a);
            let corner = |part: &mut Part, p: Vec3| part.vertex(p, normal, (0.1, 0.1));
            let p0 = corner(&mut part, on_b - a * reach);
            let p1 = corner(&mut part, on_b + a * reach);
            let p2 = corner(&mut part, on_c + a * reach);
            let p3 = corner(&mut part, on_c - a * reach);
            part.quad(p0, p1, p2, p3);
        }
    }
    for corner in 0..8u32 {
        let sign = |bit: u32| if corner >> bit & 1 == 0 { -1.0f32 } else { 1.0 };
        let s = Vec3::new(sign(0), sign(1), sign(2));
        let normal = s.normalize();
        let [a, b, c] = [0, 1, 2].map(|axis| {
            let mut p = s * inner;
            p[axis] = s[axis] * half[axis];
            part.vertex(p, normal, (0.1, 0.1))
        });
        part.triangle(a, b, c);
    }
    part
}

/// A boulder: a cube's grid blown up to a sphere and dented by noise; about 1 unit in radius.
pub fn boulder(quads: u32, seed: u32) -> Part {
    let offset = seed as f32 * 7.31;
    let surface = |direction: Vec3| {
        let d = direction.normalize();
        let broad = fractal(d.x * 1.3 + offset, d.y * 1.3 + d.z * 0.9, 3, 0, seed);
        let rough = fractal(d.y * 2.7 + offset, d.z * 2.7 - d.x * 1.9, 5, 0, seed + 9);
        let flat = Vec3::new(1.0, 0.72, 0.88);
        d * flat * (1.0 + 0.38 * broad + 0.12 * rough)
    };
    let mut part = Part::default();
    let axes = [Vec3::X, Vec3::Y, Vec3::Z];
    for axis in 0..3 {
        for sign in [-1.0f32, 1.0] {
            let n = axes[axis] * sign;
            let u = axes[(axis + 1) % 3];
            let v = n.cross(u);
            part.grid(quads, quads, |s, t| {
                let at = |s: f32, t: f32| surface(n + u * (2.0 * s - 1.0) + v * (2.0 * t - 1.0));
                let step = 0.004;
                let ds = at(s + step, t) - at(s - step, t);
                let dt = at(s, t + step) - at(s, t - step);
                (at(s, t), ds.cross(dt).normalize(), (s * 1.5, t * 1.5))
            });
        }
    }
    part
}
