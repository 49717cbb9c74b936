//! No ray passes through a closed mesh, and each surface is crossed once.
//!
//! Rays are aimed at edges and vertices of a sphere of triangles, well inside its outline: whatever
//! rounding does to such a ray, it goes through the front of the sphere and through the back.

use scenes::*;
use traversal::*;

struct Sphere {
    vertices: Vec<DVec3>,
    faces: Vec<[u32; 3]>,
    edges: Vec<[u32; 2]>,
}

impl Sphere {
    fn new(levels: u32) -> Sphere {
        let (vertices, faces) = icosphere(levels);
        let edges = faces
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
            .filter(|[a, b]| a < b)
            .collect();
        Sphere {
            vertices,
            faces,
            edges,
        }
    }

    fn mesh(&self, scale: f64, offset: DVec3, opaque: bool) -> Mesh {
        Mesh {
            vertices: self
                .vertices
                .iter()
                .map(|v| narrow(v * scale + offset))
                .collect(),
            indices: self.faces.clone(),
            opaque,
        }
    }
}

/// Directions along which a sphere is looked at, and what is aimed at.
fn aims<'a>(
    sphere: &'a Sphere,
    mesh: &'a Mesh,
    random: &'a mut Random,
    count: usize,
) -> impl Iterator<Item = (&'static str, DVec3, DVec3)> + 'a {
    (0..count).flat_map(move |_| {
        let edge = sphere.edges[(random.unit() * sphere.edges.len() as f64) as usize];
        let weight = random.unit();
        let [a, b] = edge.map(|i| wide(mesh.vertices[i as usize]));
        let on_edge = a + weight * (b - a);
        let edge_normal = normalize(std::array::from_fn(|i| {
            sphere.vertices[edge[0] as usize][i] + sphere.vertices[edge[1] as usize][i]
        }));
        let vertex = (random.unit() * mesh.vertices.len() as f64) as usize;
        let tilt = random.direction();
        [
            ("edge", on_edge, edge_normal),
            (
                "vertex",
                wide(mesh.vertices[vertex]),
                sphere.vertices[vertex],
            ),
        ]
        .map(|(what, target, normal)| {
            // At most 42 degrees off the normal at the target.
            let from = normalize(normal * 0.9 + tilt * 0.6);
            (what, target, from)
        })
    })
}

/// Counts rays that miss the front of the sphere, or have other than one crossing of it.
fn holes(
    sphere: &Sphere,
    scale: f64,
    offset: DVec3,
    transform: [f32; 12],
    rays: usize,
) -> [u32; 3] {
    let solid = sphere.mesh(scale, offset, true);
    let non_opaque = sphere.mesh(scale, offset, false);
    let solid_scene = Scene::placed(std::slice::from_ref(&solid), 0, transform);
    let non_opaque_scene = Scene::placed(std::slice::from_ref(&non_opaque), 0, transform);
    let mut random = Random(88_172_645_463_325_252);
    let mut walker = Walker::new();
    let [mut missed, mut crossings, mut unequal] = [0; 3];
    for (_, target, from) in aims(sphere, &solid, &mut random, rays) {
        // Two radii away from the target, in the mesh's space, then out of it.
        let origin = target + 2.0 * scale * from;
        let origin = narrow(apply(&transform, origin, 1.0));
        let direction = narrow(apply(&transform, target, 1.0) - wide(origin));
        if direction == [0.0; 3] {
            continue;
        }
        let ray = ray(origin, direction);
        let hit = closest_with(&mut walker, &solid_scene.top, &ray);
        let on_front = |t: f32| t < 1.2;
        missed += u32::from(!hit.is_some_and(|hit| on_front(hit.t)));
        let all = candidates(&non_opaque_scene.top, &ray);
        let front = all.iter().filter(|hit| on_front(hit.t)).count();
        crossings += u32::from(front != 1 || all.len() != 2);
        if let Some(hit) = hit {
            unequal += u32::from(
                !all.iter()
                    .any(|non_opaque| (non_opaque.t - hit.t).abs() <= 1e-5 * hit.t),
            );
        }
    }
    [missed, crossings, unequal]
}

#[test]
fn closed_at_every_scale_and_translation() {
    let sphere = Sphere::new(4);
    for (scale, translation) in [
        (1.0, 0.0),
        (1e-3, 0.0),
        (1e3, 0.0),
        (1e6, 0.0),
        (1.0, 1e4),
        (1e3, 1e4),
        (1e3, 1e7),
        (1e6, 1e7),
        (1e-30, 0.0),
        (1e-19, 0.0),
        (1e15, 0.0),
        (1e30, 0.0),
    ] {
        let offset = translation * DVec3::new(1.0, 1.3, 0.7);
        let found = holes(&sphere, scale, offset, IDENTITY, 20_000);
        assert_eq!(
            found, [0; 3],
            "scale {scale:e}, translation {translation:e}"
        );
    }
}

/// Rotation by an angle around an axis.
fn rotation(axis: [f64; 3], angle: f64) -> [[f64; 3]; 3] {
    let [x, y, z] = normalize(axis).to_array();
    let (s, c) = angle.sin_cos();
    let k = 1.0 - c;
    [
        [c + x * x * k, x * y * k - z * s, x * z * k + y * s],
        [y * x * k + z * s, c + y * y * k, y * z * k - x * s],
        [z * x * k - y * s, z * y * k + x * s, c + z * z * k],
    ]
}

/// Rotation · scale, then translation.
fn placement(axis: [f64; 3], angle: f64, scale: [f64; 3], translation: [f64; 3]) -> [f32; 12] {
    let r = rotation(axis, angle);
    std::array::from_fn(|i| match i % 4 {
        3 => translation[i / 4] as f32,
        column => (r[i / 4][column] * scale[column]) as f32,
    })
}

#[test]
fn closed_through_instances() {
    let sphere = Sphere::new(4);
    for (angle, scale, translation) in [
        (0.0, [1.0; 3], [10.0, -20.0, 30.0]),
        (1.0, [1.0; 3], [0.0; 3]),
        (2.0, [0.1, 3.0, 1.0], [5.0, 5.0, 5.0]),
        (0.5, [-1.0, 1.0, 1.0], [1.0, 2.0, 3.0]),
        (0.5, [-2.0, -0.5, -1.0], [1e3, 2e3, -3e3]),
        (2.5, [1e-3; 3], [1.0, 0.0, 0.0]),
        (2.5, [1e4, 1e3, 1e4], [0.0, 1e5, 0.0]),
    ] {
        let transform = placement([1.0, 2.0, -0.5], angle, scale, translation);
        let found = holes(&sphere, 1.0, DVec3::ZERO, transform, 20_000);
        assert_eq!(found, [0; 3], "{angle} {scale:?} {translation:?}");
    }
}

/// A flat fan around the origin in the plane z = 0.
fn fan(blades: u32, opaque: bool, reversed: bool) -> Mesh {
    let mut vertices = vec![[0.0f32; 3]];
    for i in 0..blades {
        let angle = f64::from(i) / f64::from(blades) * std::f64::consts::TAU;
        vertices.push([angle.cos() as f32, angle.sin() as f32, 0.0]);
    }
    let indices = (0..blades)
        .map(|i| {
            let (p, q) = (1 + i, 1 + (i + 1) % blades);
            if reversed { [0, q, p] } else { [0, p, q] }
        })
        .collect();
    Mesh {
        vertices,
        indices,
        opaque,
    }
}

#[test]
fn one_blade_of_a_fan_owns_its_apex_and_edges() {
    for blades in [3, 4, 5, 8, 16, 100] {
        for reversed in [false, true] {
            let mesh = fan(blades, false, reversed);
            let scene = Scene::new(std::slice::from_ref(&mesh), 0);
            for z in [1.0f32, -1.0] {
                // Straight down on the apex, and aslant.
                for from in [[0.0, 0.0], [0.5, 0.25], [-3.0, 1.0]] {
                    let apex = ray([from[0], from[1], z], [-from[0], -from[1], -z]);
                    assert_eq!(candidates(&scene.top, &apex).len(), 1, "{blades} {apex:?}");
                }
                // Straight down on points of each edge from the apex: vertices times powers of two
                // are exactly on it.
                for vertex in &mesh.vertices[1..] {
                    for weight in [0.5, 0.25] {
                        let (x, y) = (vertex[0] * weight, vertex[1] * weight);
                        let found = candidates(&scene.top, &ray([x, y, z], [0.0, 0.0, -z]));
                        assert_eq!(found.len(), 1, "{blades} {x} {y} {found:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn an_opaque_triangle_includes_its_rim() {
    let mesh = Mesh {
        vertices: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        indices: vec![[0, 1, 2]],
        opaque: true,
    };
    let scene = Scene::new(std::slice::from_ref(&mesh), 0);
    for [x, y] in [
        [0.0, 0.0],
        [1.0, 0.0],
        [0.0, 1.0],
        [0.5, 0.5],
        [0.25, 0.75],
        [0.0, 0.5],
        [0.5, 0.0],
        [0.0, 1e-30],
    ] {
        for z in [1.0, -1.0] {
            let down = ray([x, y, z], [0.0, 0.0, -z]);
            let hit = closest(&scene.top, &down).unwrap_or_else(|| panic!("{x} {y} {z}"));
            assert_eq!(hit.t, 1.0);
            let slanted = ray([x + 1.0, y - 2.0, 2.0 * z], [-1.0, 2.0, -2.0 * z]);
            assert!(closest(&scene.top, &slanted).is_some(), "{x} {y} {z}");
        }
    }
    for [x, y] in [[-1e-6, 0.5], [0.5, -1e-6], [0.5, 0.50001]] {
        let down = ray([x, y, 1.0], [0.0, 0.0, -1.0]);
        assert!(closest(&scene.top, &down).is_none(), "{x} {y}");
    }
}
