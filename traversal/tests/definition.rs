//! The definition of a hit if rays only touch a triangle's rim, its plane or its start.

use scenes::exact;
use scenes::ways::all_ways;
use scenes::*;
use traversal::*;

fn soup(triangles: &[[[f32; 3]; 3]], opaque: bool) -> Mesh {
    Mesh {
        vertices: triangles.iter().flatten().copied().collect(),
        indices: (0..triangles.len() as u32)
            .map(|i| [3 * i, 3 * i + 1, 3 * i + 2])
            .collect(),
        opaque,
    }
}

/// No way of walking finds anything, and there are no candidates.
fn assert_missed(triangle: &[[f32; 3]; 3], rays: &[Ray]) {
    for opaque in [true, false] {
        let scene = Scene::new(&[soup(&[*triangle], opaque)], 0);
        if opaque {
            for (way, hits) in all_ways(&scene.top, rays) {
                for (ray, hit) in rays.iter().zip(hits) {
                    assert_eq!(hit, None, "{way} {triangle:?} {ray:?}");
                }
            }
        } else {
            for ray in rays {
                let found = candidates(&scene.top, ray);
                assert!(found.is_empty(), "{found:?} {triangle:?} {ray:?}");
            }
        }
    }
}

#[test]
fn three_vertices_on_a_line_are_never_hit() {
    let mut random = Random(0xD1B5_4A32_D192_ED03);
    for i in 0..60 {
        // Exactly on a line: whole numbers of steps.
        let mut whole = |range: f64| [0; 3].map(|_| (random.signed() * range).round() as f32);
        let (start, step) = (whole(8.0), whole(3.0));
        let mut at = |range: f64| -> [f32; 3] {
            let factor = (random.signed() * range).round() as f32;
            std::array::from_fn(|k| start[k] + factor * step[k])
        };
        let triangle = match i % 4 {
            0 => [start; 3],
            1 => [start, start, at(5.0)],
            _ => [at(5.0), at(5.0), at(9.0)],
        };
        let rays: Vec<Ray> = (0..32)
            .map(|k| {
                let mut point = |range: f64| [0; 3].map(|_| (random.signed() * range).round());
                let vertex = triangle[k % 3];
                let origin = point(16.0).map(|c| c as f32);
                ray(origin, std::array::from_fn(|i| vertex[i] - origin[i]))
            })
            .filter(|ray| ray.direction != [0.0; 3])
            .collect();
        assert_missed(&triangle, &rays);
    }
}

#[test]
fn a_ray_in_a_triangles_plane_misses_it() {
    let mut random = Random(0x94D0_49BB_1331_11EB);
    for _ in 0..60 {
        let mut whole = |range: f64| [0; 3].map(|_| (random.signed() * range).round() as f32);
        let (start, u, v) = (whole(8.0), whole(3.0), whole(3.0));
        let mut at = || -> [f32; 3] {
            let [a, b] = [0; 2].map(|_| (random.signed() * 6.0).round() as f32);
            std::array::from_fn(|k| start[k] + a * u[k] + b * v[k])
        };
        let triangle = [at(), at(), at()];
        let rays: Vec<Ray> = (0..64)
            .map(|_| {
                let (origin, target) = (at(), at());
                ray(origin, std::array::from_fn(|i| target[i] - origin[i]))
            })
            .filter(|ray| ray.direction != [0.0; 3])
            .collect();
        assert_missed(&triangle, &rays);
    }
}

/// A ray that starts on a triangle does not meet it, and whether one that starts beside it does is
/// decided exactly.
#[test]
fn a_ray_does_not_meet_the_triangle_that_it_starts_on() {
    let mut random = Random(0x2545_F491_4F6C_DD1D);
    let [mut on, mut before, mut behind] = [0; 3];
    for i in 0..1500 {
        let scale = 10f64.powf(-6.0 + 9.0 * random.unit());
        let triangle = [0; 3].map(|_| narrow(random.vector() * scale));
        let triangle = match i % 3 {
            // Whole numbers, so that what is between them is exactly on the triangle.
            0 => triangle.map(|v| v.map(|c| (f64::from(c) / scale * 64.0).round() as f32)),
            _ => triangle,
        };
        let [a, b, c] = triangle.map(wide);
        let eighths = [0; 2].map(|_| (random.unit() * 4.0).floor() / 8.0);
        let origin = narrow(std::array::from_fn(|k| {
            a[k] + eighths[0] * (b[k] - a[k]) + eighths[1] * (c[k] - a[k])
        }));
        let ray = ray(origin, narrow(random.direction()));
        let truth = exact::intersect(&ray, &triangle);
        let scene = Scene::new(&[soup(&[triangle], true)], 0);
        let expected = truth.is_some_and(|crossing| crossing.t > 0.0);
        for (way, hits) in all_ways(&scene.top, &[ray]) {
            assert_eq!(hits[0].is_some(), expected, "{way} {triangle:?} {ray:?}");
            if let (Some(hit), Some(crossing)) = (hits[0], truth) {
                let off = (f64::from(hit.t) / crossing.t - 1.0).abs();
                assert!(
                    off < 1e-6,
                    "{way} {hit:?} {crossing:?} {triangle:?} {ray:?}"
                );
            }
        }
        let glass = Scene::new(&[soup(&[triangle], false)], 0);
        assert!(candidates(&glass.top, &ray).len() <= usize::from(expected));
        match truth {
            Some(crossing) if crossing.t == 0.0 => on += 1,
            Some(crossing) if crossing.t > 0.0 => before += 1,
            _ => behind += 1,
        }
    }
    assert!(
        on > 100 && before > 100 && behind > 100,
        "{on} {before} {behind}"
    );
}

/// A closed fan of needles a million times as long as wide: each ray through it crosses one, at its
/// edges, too.
#[test]
fn needles_are_crossed_once() {
    let mut random = Random(0x853C_49E6_748F_EA9B);
    let blades = 64;
    let width = 1e-6;
    let mut mesh = Mesh {
        opaque: false,
        ..Mesh::default()
    };
    // Strips along x, between curves that are shared.
    for i in 0..=blades {
        let y = f64::from(i) * width;
        let z = [0; 2].map(|_| random.signed() * width);
        mesh.vertices.push(narrow([-1.0, y, z[0]]));
        mesh.vertices.push(narrow([1.0, y + 0.3 * width, z[1]]));
    }
    for i in 0..blades {
        let first = 2 * i;
        mesh.indices.push([first, first + 1, first + 3]);
        mesh.indices.push([first, first + 3, first + 2]);
    }
    let glass = Scene::new(std::slice::from_ref(&mesh), 0);
    mesh.opaque = true;
    let solid = Scene::new(std::slice::from_ref(&mesh), 0);
    let inner = |random: &mut Random| {
        let index = 8 + (random.unit() * f64::from(2 * blades - 16)) as usize;
        let [a, b, c] = mesh.triangle(index).map(wide);
        let x = random.signed() * 0.9;
        let along = |a: DVec3, b: DVec3| -> DVec3 {
            let part = (x - a[0]) / (b[0] - a[0]);
            a + part * (b - a)
        };
        if a[0] != b[0] {
            along(a, b)
        } else {
            along(a, c)
        }
    };
    let rays: Vec<Ray> = (0..4000)
        .map(|_| {
            let target = inner(&mut random);
            let tilt = random.vector();
            let from = DVec3::new(tilt.x, 0.3 * tilt.y, 1.0);
            let far = 10f64.powf(-2.0 * random.unit());
            let origin = narrow(target + far * from);
            ray(origin, narrow(target - wide(origin)))
        })
        .collect();
    for (way, hits) in all_ways(&solid.top, &rays) {
        for (ray, hit) in rays.iter().zip(hits) {
            assert!(hit.is_some(), "{way} {ray:?}");
        }
    }
    for ray in &rays {
        let found = candidates(&glass.top, ray);
        let crossed = (0..mesh.indices.len())
            .filter(|&i| exact::intersect(ray, &mesh.triangle(i)).is_some())
            .count();
        assert!(
            found.len() <= crossed && !found.is_empty(),
            "{found:?} {ray:?}"
        );
        assert_eq!(
            found.len() % 2,
            1,
            "a ray goes from above to below: {found:?} {ray:?}"
        );
    }
}
