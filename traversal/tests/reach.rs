//! Closed meshes whose faces reach far: whatever the proportions, no ray leaves them unseen.
//!
//! Rays by the count of the environment's RAYS, for each mesh, length and placement.

mod scene;
#[path = "scene/ways.rs"]
mod ways;

use scene::*;
use traversal::*;
use ways::all_ways;

fn count() -> usize {
    let given = std::env::var("RAYS").ok();
    given.map_or(1500, |count| count.parse().expect("RAYS is a number"))
}

/// A convex mesh.
struct Convex {
    vertices: Vec<[f64; 3]>,
    faces: Vec<Vec<u32>>,
}

impl Convex {
    /// A box with a corner at the origin.
    fn cuboid(size: [f64; 3]) -> Convex {
        let corner = |k: u32| std::array::from_fn(|i| f64::from(k >> i & 1) * size[i]);
        Convex {
            vertices: (0..8).map(corner).collect(),
            faces: ["0231", "4576", "0154", "2673", "0462", "1375"]
                .map(|face| face.bytes().map(|b| u32::from(b - b'0')).collect())
                .to_vec(),
        }
    }

    /// A prism along z.
    fn prism(sides: u32, length: f64) -> Convex {
        let mut vertices = Vec::new();
        for z in [0.0, length] {
            for i in 0..sides {
                let angle = f64::from(i) / f64::from(sides) * std::f64::consts::TAU + 0.3;
                vertices.push([angle.cos(), angle.sin(), z]);
            }
        }
        let mut faces = vec![
            (0..sides).rev().collect::<Vec<_>>(),
            (sides..2 * sides).collect(),
        ];
        faces.extend((0..sides).map(|i| {
            let next = (i + 1) % sides;
            vec![i, next, sides + next, sides + i]
        }));
        Convex { vertices, faces }
    }

    fn mesh(&self, opaque: bool) -> Mesh {
        let mut mesh = Mesh {
            vertices: self.vertices.iter().map(|&v| narrow(v)).collect(),
            indices: Vec::new(),
            opaque,
        };
        for face in &self.faces {
            for i in 1..face.len() - 1 {
                mesh.indices.push([face[0], face[i], face[i + 1]]);
            }
        }
        mesh
    }

    /// A point inside.
    fn inside(&self, random: &mut Random) -> [f64; 3] {
        let weights: Vec<f64> = self
            .vertices
            .iter()
            .map(|_| random.next().powi(3))
            .collect();
        let sum: f64 = weights.iter().sum();
        std::array::from_fn(|i| {
            let parts = self.vertices.iter().zip(&weights);
            parts.map(|(v, w)| v[i] * w).sum::<f64>() / sum
        })
    }
}

/// Rays at edges and vertices, from inside or outside; all distances between the near and the far end of what there is.
fn rays(convex: &Convex, mesh: &Mesh, random: &mut Random, count: usize, inside: bool) -> Vec<Ray> {
    let mut rays = Vec::new();
    while rays.len() < count {
        let triangle = mesh.triangle((random.next() * mesh.indices.len() as f64) as usize);
        let [a, b, _] = triangle.map(wide);
        let weight = match rays.len() % 3 {
            0 => 0.0,
            1 => random.next(),
            _ => 10f64.powf(-6.0 * random.next()),
        };
        let beside = 10f64.powf(-9.0 + 5.0 * random.next());
        let beside = random.vector().map(|c| c * beside);
        let target: [f64; 3] = std::array::from_fn(|i| a[i] + weight * (b[i] - a[i]) + beside[i]);
        let far = convex.inside(random);
        let part = 10f64.powf(-3.5 * random.next()) * if inside { 1.0 } else { -1.0 };
        let near: [f64; 3] = std::array::from_fn(|i| target[i] + part * (far[i] - target[i]));
        let origin = narrow(near);
        let depth = depth(mesh, wide(origin));
        if if inside {
            depth < CLEAR
        } else {
            depth > -CLEAR
        } {
            continue;
        }
        let direction = narrow(sub(target, wide(origin)));
        if direction != [0.0; 3] {
            rays.push(ray(origin, direction));
        }
    }
    rays
}

/// How far inside a point is of all faces, relative to how far it is from the origin.
fn depth(mesh: &Mesh, point: [f64; 3]) -> f64 {
    let reach = point.iter().fold(0f64, |most, c| most.max(c.abs()));
    let depths = (0..mesh.indices.len()).map(|i| {
        let [a, b, c] = mesh.triangle(i).map(wide);
        let normal = cross(sub(b, a), sub(c, a));
        dot(normal, sub(a, point)) / dot(normal, normal).sqrt() / reach
    });
    depths.fold(f64::INFINITY, f64::min)
}

/// More than placing a ray by a transform can move it.
const CLEAR: f64 = 1e-6;

/// A rigid motion or a scale, applied to a ray of object space.
fn world(ray: &Ray, m: &[f32; 12]) -> Ray {
    let row = |v: [f32; 3], i: usize, w: f64| -> f32 {
        let m = &m[4 * i..4 * i + 4];
        let parts = (0..3).map(|k| f64::from(m[k]) * f64::from(v[k]));
        (parts.sum::<f64>() + f64::from(m[3]) * w) as f32
    };
    Ray {
        origin: std::array::from_fn(|i| row(ray.origin, i, 1.0)),
        direction: std::array::from_fn(|i| row(ray.direction, i, 0.0)),
        ..*ray
    }
}

const PLACEMENTS: [(&str, [f32; 12]); 4] = [
    ("identity", IDENTITY),
    (
        "rotated",
        [
            0.36, 0.48, -0.8, 0.0, -0.8, 0.6, 0.0, 0.0, 0.48, 0.64, 0.6, 0.0,
        ],
    ),
    (
        "scaled",
        [3.0, 0.0, 0.0, 0.0, 0.0, 0.125, 0.0, 0.0, 0.0, 0.0, 1.7, 0.0],
    ),
    (
        "mirrored",
        [-1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
    ),
];

/// Rays for which the answers are wrong: lost from inside, or crossings other than one from inside, none or two from outside.
fn faults(convex: &Convex, inside: bool, transform: &[f32; 12], count: usize) -> [usize; 3] {
    let (solid, glass) = (convex.mesh(true), convex.mesh(false));
    let solid_scene = Scene::placed(std::slice::from_ref(&solid), 0, *transform);
    let glass_scene = Scene::placed(std::slice::from_ref(&glass), 0, *transform);
    let mut random = Random(0x2545_F491_4F6C_DD1D);
    let [mut lost, mut crossings, mut unequal] = [0; 3];
    let mut rest = count;
    while rest > 0 {
        let some = rest.min(4096);
        rest -= some;
        let rays = rays(convex, &solid, &mut random, some, inside);
        let rays: Vec<Ray> = rays.iter().map(|ray| world(ray, transform)).collect();
        let mut ways = all_ways(&solid_scene.top, &rays).into_iter();
        let (_, first) = ways.next().expect("there is one");
        for (name, hits) in ways {
            for (i, (hit, expected)) in hits.iter().zip(&first).enumerate() {
                if hit != expected {
                    unequal += 1;
                    println!("{name}: {hit:?}, not {expected:?}: {:?}", rays[i]);
                }
            }
        }
        for (ray, hit) in rays.iter().zip(&first) {
            let found = candidates(&glass_scene.top, ray);
            let right = match inside {
                true => found.len() == 1,
                false => found.is_empty() || found.len() == 2,
            };
            if !right {
                println!("{found:?} {ray:?}");
            }
            crossings += usize::from(!right);
            // What owns no part of a ray may be touched by it.
            let some = inside || !found.is_empty();
            lost += usize::from(some && hit.is_none());
            if let (Some(hit), Some(nearest)) =
                (hit, found.iter().min_by(|a, b| a.t.total_cmp(&b.t)))
            {
                lost += usize::from(hit.t > nearest.t);
            }
        }
    }
    [lost, crossings, unequal]
}

const LENGTHS: [f64; 8] = [1.0, 10.0, 95.500_755, 300.0, 1e3, 1e4, 1e5, 1e6];

fn assert_closed(convex: impl Fn(f64) -> Convex) {
    let mut wrong = Vec::new();
    for length in LENGTHS {
        let convex = convex(length);
        for (name, transform) in PLACEMENTS {
            for inside in [true, false] {
                let faults = faults(&convex, inside, &transform, count());
                if faults != [0; 3] {
                    wrong.push(format!("{length} {name}, inside {inside}: {faults:?}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn cubes_are_closed() {
    assert_closed(|length| Convex::cuboid([length; 3]));
}

#[test]
fn long_boxes_are_closed() {
    assert_closed(|length| Convex::cuboid([1.0, 1.0, length]));
}

#[test]
fn flat_boxes_are_closed() {
    assert_closed(|length| Convex::cuboid([length, 1.0, length]));
}

#[test]
fn prisms_are_closed() {
    assert_closed(|length| Convex::prism(3, length));
    assert_closed(|length| Convex::prism(7, length));
}

/// A ray in a cube 95 wide, less than one away from what it meets.
#[test]
fn a_wall_is_met_beside_its_edge() {
    let bits = f32::from_bits;
    let size = f64::from(bits(0x42bf_0062));
    let mesh = Convex::cuboid([size; 3]).mesh(true);
    let scene = Scene::new(std::slice::from_ref(&mesh), 0);
    let ray = ray(
        [0x424c_5180, 0x3eb5_b2f4, 0x3f16_268b].map(bits),
        [0x3fb8_ff35, 0xbeb5_b306, 0xbf16_2683].map(bits),
    );
    for (way, hits) in all_ways(&scene.top, &[ray; 16]) {
        for hit in hits {
            let hit = hit.unwrap_or_else(|| panic!("{way}: nothing is met"));
            assert_eq!(
                mesh.indices[hit.primitive_index as usize],
                [0, 1, 5],
                "{way}"
            );
            assert_eq!(hit.t, 0.999_998_5, "{way}");
        }
    }
}
