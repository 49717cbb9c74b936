//! Hits of rays by brute force in double precision.

use super::*;

/// Möller and Trumbore in double precision: t, the weights of the second and third corner, and
/// whether the ray sees the front (counter-clockwise corners in a left-handed sense, as Vulkan
/// defines facing for a ray).
pub fn intersect(ray: &Ray, corners: [[f32; 3]; 3]) -> Option<(f64, f64, f64, bool)> {
    let [a, b, c] = corners.map(|corner| Vec3::from(corner).as_dvec3());
    let (o, d) = ray.wide();
    let (e1, e2) = (b - a, c - a);
    let p = d.cross(e2);
    let determinant = e1.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let s = o - a;
    let u = s.dot(p) / determinant;
    let q = s.cross(e1);
    let v = d.dot(q) / determinant;
    let t = e2.dot(q) / determinant;
    Some((t, u, v, determinant > 0.0))
}

/// A triangle's number, t, the weights of its second and third corner, and whether it faces.
type Nearest = (usize, f64, f64, f64, bool);

/// The nearest triangle by brute force, and whether the answer is too close to call in single
/// precision: near an edge, or near a second hit.
fn nearest(ray: &Ray, triangles: &[[[f32; 3]; 3]]) -> (Option<Nearest>, bool) {
    let mut best: Option<Nearest> = None;
    let mut doubtful = false;
    for (i, corners) in triangles.iter().enumerate() {
        let Some((t, u, v, front)) = intersect(ray, *corners) else {
            continue;
        };
        let inside = u.min(v).min(1.0 - u - v);
        let near_range = (t - f64::from(ray.t_min)).abs() < 1e-4;
        if inside.abs() < 1e-4 && t > -1e-3 || inside > -1e-4 && near_range {
            doubtful = true;
        }
        if inside >= 0.0 && t > f64::from(ray.t_min) && t < f64::from(ray.t_max) {
            if best.is_some_and(|best| (best.1 - t).abs() < 1e-4 * t.abs().max(1.0)) {
                doubtful = true;
            }
            if best.is_none_or(|best| t < best.1) {
                best = Some((i, t, u, v, front));
            }
        }
    }
    (best, doubtful)
}

pub fn check_against_brute_force(hits: &[Hit], rays: &[Ray], triangles: &[[[f32; 3]; 3]]) {
    let mut decided = 0;
    for (i, (hit, ray)) in hits.iter().zip(rays).enumerate() {
        let (expected, doubtful) = nearest(ray, triangles);
        if doubtful {
            continue;
        }
        decided += 1;
        match expected {
            None => assert_eq!(hit.primitive, MISSED, "ray {i} {ray:?}"),
            Some((primitive, t, u, v, front)) => {
                assert_eq!(hit.primitive, primitive as u32, "ray {i} {ray:?} t {t}");
                let close = |a: f32, b: f64, scale: f64| (f64::from(a) - b).abs() < 2e-4 * scale;
                assert!(
                    close(hit.t, t, t.abs().max(1.0)),
                    "ray {i}: {} is not {t}",
                    hit.t
                );
                assert!(
                    close(hit.weights[0], u, 1.0),
                    "ray {i}: {:?} {u}",
                    hit.weights
                );
                assert!(
                    close(hit.weights[1], v, 1.0),
                    "ray {i}: {:?} {v}",
                    hit.weights
                );
                assert_eq!(hit.kind, if front { FRONT } else { BACK }, "ray {i}");
            }
        }
    }
    assert!(
        decided * 10 > rays.len() * 8,
        "only {decided} rays could be decided"
    );
}

pub fn random_triangles(random: &mut Rng, count: usize, size: f32) -> Vec<[[f32; 3]; 3]> {
    (0..count)
        .map(|_| {
            let centre: [f32; 3] = std::array::from_fn(|_| between(random, -10.0, 10.0));
            std::array::from_fn(|_| centre.map(|c| c + between(random, -size, size)))
        })
        .collect()
}

pub fn random_rays(random: &mut Rng, count: usize) -> Vec<Ray> {
    (0..count)
        .map(|_| {
            let origin = std::array::from_fn(|_| between(random, -14.0, 14.0));
            let mut direction = [0.0; 3];
            while direction.iter().map(|d| d * d).sum::<f32>() < 0.01 {
                direction = std::array::from_fn(|_| between(random, -1.0, 1.0));
            }
            Ray::new(origin, direction)
        })
        .collect()
}
