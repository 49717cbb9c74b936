//! Closed meshes whose faces reach far, rays at their edges and vertices, and what is right about
//! those: a ray from inside leaves through the surface, whatever the proportions.

use crate::exact;
use crate::ways::{all_ways, walkers};
use crate::*;
use traversal::*;

/// A closed mesh by how far it reaches.
pub struct Family {
    pub name: &'static str,
    make: fn(f64) -> Mesh,
    /// Whether a ray from inside crosses it once and one from outside twice at most. What has
    /// slanted faces of four corners is not convex any more when those are rounded.
    convex: bool,
}

pub const FAMILIES: &[Family] = &[
    Family {
        name: "cube",
        make: |length| cuboid([length; 3]),
        convex: true,
    },
    Family {
        name: "long box",
        make: |length| cuboid([1.0, 1.0, length]),
        convex: true,
    },
    Family {
        name: "flat box",
        make: |length| cuboid([length, 1.0, length]),
        convex: true,
    },
    Family {
        name: "prism of 3 sides",
        make: |length| prism(&circle(3, 1.0), length),
        convex: false,
    },
    Family {
        name: "prism of 7 sides",
        make: |length| prism(&circle(7, 1.0), length),
        convex: false,
    },
    Family {
        name: "wedge",
        make: |length| prism(&[[0.0, 0.0], [length, 0.0], [length, 1.0]], 1.0),
        convex: true,
    },
    Family {
        name: "tetrahedron, long",
        make: |length| tetrahedron([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.3, 0.2, length]]),
        convex: true,
    },
    Family {
        name: "tetrahedron, flat",
        make: |length| tetrahedron([[length, 0.0, 0.0], [0.0, length, 0.0], [0.3, 0.2, 1.0]]),
        convex: true,
    },
    Family {
        name: "fans of slivers",
        make: |length| spindle(48, 1.0, length),
        convex: false,
    },
    Family {
        name: "flat fans",
        make: |length| spindle(48, length, 1.0),
        convex: false,
    },
    Family {
        name: "L-shaped room",
        make: |length| {
            let end = length + 1.0;
            let corners = [
                [1.0, 1.0],
                [1.0, end],
                [0.0, end],
                [0.0, 0.0],
                [end, 0.0],
                [end, 1.0],
            ];
            prism(&corners, 1.0)
        },
        convex: false,
    },
    Family {
        name: "sky box and sphere",
        make: |length| {
            let (vertices, faces) = icosphere(1);
            let middle = length + 1.0;
            let mut mesh = cuboid([2.0 * middle; 3]);
            let first = mesh.vertices.len() as u32;
            let place = |v: DVec3| narrow(v.map(|c| 0.5 * c + middle));
            mesh.vertices.extend(vertices.into_iter().map(place));
            let faces = faces.into_iter().map(|face| face.map(|i| first + i));
            mesh.indices.extend(faces);
            mesh
        },
        convex: false,
    },
    Family {
        name: "terrain of strips",
        make: |length| terrain(24, length),
        convex: false,
    },
    Family {
        name: "terrain of needles",
        make: |length| terrain(24, length.recip()),
        convex: false,
    },
];

pub const LENGTHS: [f64; 8] = [1.0, 10.0, 95.500_755, 300.0, 1e3, 1e4, 1e5, 1e6];

fn mesh(vertices: &[[f64; 3]], faces: &[Vec<u32>]) -> Mesh {
    let mut mesh = Mesh {
        vertices: vertices.iter().map(|&v| narrow(v)).collect(),
        indices: Vec::new(),
        opaque: true,
    };
    for face in faces {
        for i in 1..face.len() - 1 {
            mesh.indices.push([face[0], face[i], face[i + 1]]);
        }
    }
    mesh
}

/// A box with a corner at the origin.
pub fn cuboid(size: [f64; 3]) -> Mesh {
    let corner = |k: u32| std::array::from_fn(|i| f64::from(k >> i & 1) * size[i]);
    let vertices: Vec<[f64; 3]> = (0..8).map(corner).collect();
    let faces = ["0231", "4576", "0154", "2673", "0462", "1375"]
        .map(|face| face.bytes().map(|b| u32::from(b - b'0')).collect());
    mesh(&vertices, &faces)
}

fn circle(sides: u32, radius: f64) -> Vec<[f64; 2]> {
    let angle = |i: u32| f64::from(i) / f64::from(sides) * std::f64::consts::TAU + 0.3;
    (0..sides)
        .map(|i| [radius * angle(i).cos(), radius * angle(i).sin()])
        .collect()
}

/// A prism along z over a polygon all of which is seen from its first corner.
fn prism(corners: &[[f64; 2]], length: f64) -> Mesh {
    let sides = corners.len() as u32;
    let at = |z: f64| corners.iter().map(move |&[x, y]| [x, y, z]);
    let vertices: Vec<_> = at(0.0).chain(at(length)).collect();
    let mut faces = vec![(0..sides).collect::<Vec<_>>(), (sides..2 * sides).collect()];
    faces.extend((0..sides).map(|i| {
        let next = (i + 1) % sides;
        vec![i, next, sides + next, sides + i]
    }));
    mesh(&vertices, &faces)
}

/// A tetrahedron with a corner at the origin.
fn tetrahedron([a, b, c]: [[f64; 3]; 3]) -> Mesh {
    let faces = [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]];
    mesh(&[[0.0; 3], a, b, c], &faces.map(Vec::from))
}

/// A circle, and a fan of triangles to a point at either side.
fn spindle(sides: u32, radius: f64, length: f64) -> Mesh {
    let rim = circle(sides, radius);
    let mut vertices: Vec<_> = rim.into_iter().map(|[x, y]| [x, y, 0.0]).collect();
    vertices.extend([[0.0, 0.0, length], [0.0, 0.0, -length]]);
    let ends = [sides, sides + 1];
    let fan = |i: u32| ends.map(|end| vec![i, (i + 1) % sides, end]);
    let faces: Vec<_> = (0..sides).flat_map(fan).collect();
    mesh(&vertices, &faces)
}

/// Ground of strips side by side, and a flat bottom below.
fn terrain(strips: u32, length: f64) -> Mesh {
    let mut random = Random(0x2545_F491_4F6C_DD1D);
    let points = strips + 1;
    let mut vertices = Vec::new();
    for is_top in [true, false] {
        for y in [0.0, length] {
            let mut x = 0.0;
            for _ in 0..points {
                let height = if is_top { random.next() } else { -2.0 };
                vertices.push([x, y, height]);
                x += 0.75;
            }
        }
    }
    let at = |below: u32, far: u32, i: u32| (2 * below + far) * points + i;
    let mut faces = Vec::new();
    for i in 0..strips {
        for below in [0, 1] {
            let [a, b] = [at(below, 0, i), at(below, 0, i + 1)];
            let [c, d] = [at(below, 1, i), at(below, 1, i + 1)];
            faces.extend([vec![a, b, d], vec![a, d, c]]);
        }
        for far in [0, 1] {
            let [a, b] = [at(0, far, i), at(0, far, i + 1)];
            let [c, d] = [at(1, far, i), at(1, far, i + 1)];
            faces.extend([vec![a, b, d], vec![a, d, c]]);
        }
    }
    for i in [0, strips] {
        faces.push(vec![at(0, 0, i), at(0, 1, i), at(1, 1, i), at(1, 0, i)]);
    }
    mesh(&vertices, &faces)
}

/// A mean of all vertices.
fn mean(mesh: &Mesh, random: &mut Random) -> DVec3 {
    let mut point = DVec3::ZERO;
    let mut sum = 0.0;
    for &vertex in &mesh.vertices {
        let weight = random.next().powi(3);
        sum += weight;
        point += weight * wide(vertex);
    }
    point / sum
}

/// No more than how far a point is from a triangle: how far from its plane, or outside of an edge.
fn least_distance(point: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let normal = (b - a).cross(c - a);
    let along = |way: DVec3, from: DVec3| way.dot(point - from) / way.length();
    [(a, b), (b, c), (c, a)]
        .into_iter()
        .map(|(p, q)| along((q - p).cross(normal), p))
        .fold(along(normal, a).abs(), f64::max)
}

/// Whether a point is inside a closed mesh, if that is certain: by the crossings of rays in f64,
/// none of which comes near an edge, and if the point is further from the surface than by this part
/// of how far it is from the origin of space.
fn is_inside(mesh: &Mesh, point: DVec3, clear: f64) -> Option<bool> {
    let reach = point.abs().max_element();
    let is_clear =
        |index: usize| least_distance(point, mesh.triangle(index).map(wide)) > clear * reach;
    if !(0..mesh.indices.len()).all(is_clear) {
        return None;
    }
    const WAYS: [[f64; 3]; 3] = [
        [0.531, 0.622, 0.575],
        [-0.288, 0.713, -0.639],
        [0.913, -0.237, 0.331],
    ];
    WAYS.map(DVec3::from).into_iter().find_map(|way| {
        let mut inside = false;
        for index in 0..mesh.indices.len() {
            let [a, b, c] = mesh.triangle(index).map(|vertex| wide(vertex) - point);
            let [mut above, mut below, mut unsure] = [false; 3];
            for (p, q) in [(c, b), (a, c), (b, a)] {
                let margin = 1e-14 * p.length() * q.length();
                let edge = way.dot(p.cross(q));
                above |= edge > margin;
                below |= edge < -margin;
                unsure |= edge.abs() <= margin;
            }
            if above && below {
                continue;
            }
            // The plane's distance has the sign of the volume over that of the edges.
            let volume = a.dot(b.cross(c));
            let size = [a, b, c].map(DVec3::length).iter().product::<f64>();
            if unsure || volume.abs() <= 1e-14 * size {
                return None;
            }
            // Edges of one sign belong to a normal along or against the way.
            let normal = (b - a).cross(c - a);
            inside ^= (normal.dot(a) > 0.0) == (normal.dot(way) > 0.0);
        }
        Some(inside)
    })
}

/// Rays at edges and vertices, from inside or outside; all distances between the near and the far
/// end of what there is. Fewer where places to start from are hardly found.
fn rays(mesh: &Mesh, random: &mut Random, count: usize, inside: bool, clear: f64) -> Vec<Ray> {
    let mut rays = Vec::new();
    for _ in 0..64 * count {
        if rays.len() == count {
            break;
        }
        let triangle = mesh.triangle((random.next() * mesh.indices.len() as f64) as usize);
        let first = (random.next() * 3.0) as usize;
        let [a, b] = [triangle[first % 3], triangle[(first + 1) % 3]].map(wide);
        let weight = match rays.len() % 3 {
            0 => 0.0,
            1 => random.next(),
            _ => 10f64.powf(-6.0 * random.next()),
        };
        let beside = 10f64.powf(-9.0 + 5.0 * random.next());
        let beside = random.vector() * beside;
        let target = a + weight * (b - a) + beside;
        let far = mean(mesh, random);
        let part = 10f64.powf(-3.5 * random.next()) * if inside { 1.0 } else { -1.0 };
        let near = target + part * (far - target);
        let origin = narrow(near);
        if is_inside(mesh, wide(origin), clear) != Some(inside) {
            continue;
        }
        let direction = narrow(target - wide(origin));
        if direction != [0.0; 3] {
            rays.push(ray(origin, direction));
        }
    }
    rays
}

/// A ray of object space, placed.
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

/// How a mesh is placed.
pub struct Placement {
    pub name: &'static str,
    pub transform: [f32; 12],
    /// More than placing and back can move a ray's origin, relative to how far it is from that of
    /// space.
    clear: f64,
}

pub const PLACEMENTS: [Placement; 4] = [
    Placement {
        name: "identity",
        transform: IDENTITY,
        clear: 1e-12,
    },
    Placement {
        name: "rotated",
        transform: [
            0.36, 0.48, -0.8, 0.0, -0.8, 0.6, 0.0, 0.0, 0.48, 0.64, 0.6, 0.0,
        ],
        clear: 1e-6,
    },
    Placement {
        name: "scaled",
        transform: [3.0, 0.0, 0.0, 0.0, 0.0, 0.125, 0.0, 0.0, 0.0, 0.0, 1.7, 0.0],
        clear: 1e-6,
    },
    Placement {
        name: "mirrored",
        transform: [-1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        clear: 1e-12,
    },
];

/// What went wrong with some rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    pub rays: u64,
    /// Rays that cross the mesh, or what is nearest of it, unseen.
    pub lost: u64,
    /// Rays whose candidates are not as many as crossings.
    pub miscounted: u64,
    /// Hits and candidates that another tier or way of walking does not find, or not to the bit.
    pub unequal: u64,
    /// Rays whose hits or crossings whole numbers see differently.
    pub wrong: u64,
    /// Rays that whole numbers were asked about.
    pub checked: u64,
}

impl Faults {
    pub fn none(&self) -> bool {
        [self.lost, self.miscounted, self.unequal, self.wrong] == [0; 4]
    }
}

impl std::ops::AddAssign for Faults {
    fn add_assign(&mut self, other: Faults) {
        self.rays += other.rays;
        self.lost += other.lost;
        self.miscounted += other.miscounted;
        self.unequal += other.unequal;
        self.wrong += other.wrong;
        self.checked += other.checked;
    }
}

/// Every how many rays whole numbers are asked, where the mesh is not moved.
const SAMPLE: usize = 61;

/// Sends rays from inside or outside at a family's mesh of this length, placed; in every way.
pub fn faults(
    family: &Family,
    length: f64,
    placement: &Placement,
    inside: bool,
    seed: u64,
    count: usize,
) -> Faults {
    let solid = (family.make)(length);
    let glass = Mesh {
        opaque: false,
        ..solid.clone()
    };
    let [solid_scene, glass_scene] = [&solid, &glass]
        .map(|mesh| Scene::placed(std::slice::from_ref(mesh), 0, placement.transform));
    let mut walkers: Vec<_> = walkers()
        .into_iter()
        .filter(|(name, _)| !name.ends_with("plain"))
        .collect();
    let mut random = Random(seed);
    let mut faults = Faults::default();
    let mut rest = count;
    while rest > 0 {
        let some = rest.min(4096);
        rest -= some;
        let given = rays(&solid, &mut random, some, inside, placement.clear);
        faults.rays += given.len() as u64;
        let rays: Vec<Ray> = given
            .iter()
            .map(|ray| world(ray, &placement.transform))
            .collect();
        let mut ways = all_ways(&solid_scene.top, &rays).into_iter();
        let (_, first) = ways.next().expect("there is one");
        for (name, hits) in ways {
            for (i, (hit, expected)) in hits.iter().zip(&first).enumerate() {
                if hit != expected {
                    faults.unequal += 1;
                    println!("{name}: {hit:?}, not {expected:?}: {:?}", rays[i]);
                }
            }
        }
        for (i, (ray, hit)) in rays.iter().zip(&first).enumerate() {
            let mut found = walkers
                .iter_mut()
                .map(|(_, walker)| candidates_with(walker, &glass_scene.top, ray));
            let first = found.next().expect("there is one");
            faults.unequal += found.filter(|found| *found != first).count() as u64;
            let found = first;
            let right = match (inside, family.convex) {
                (true, true) => found.len() == 1,
                (false, true) => found.is_empty() || found.len() == 2,
                (inside, false) => found.len() % 2 == usize::from(inside),
            };
            // What owns no part of a ray may be touched by it.
            let some = inside || !found.is_empty();
            let nearest = found.iter().map(|hit| hit.t).min_by(f32::total_cmp);
            let lost = match (hit, nearest) {
                (None, _) => some,
                (Some(hit), Some(nearest)) => hit.t > nearest,
                (Some(_), None) => false,
            };
            let is_asked = placement.transform == IDENTITY && i % SAMPLE == 0;
            let wrong = is_asked && !agrees(&solid, ray, hit.as_ref(), found.len());
            if !right || lost || wrong {
                println!(
                    "{} {length} {}: {hit:?} {found:?} {ray:?}",
                    family.name, placement.name
                );
            }
            faults.miscounted += u64::from(!right);
            faults.lost += u64::from(lost);
            faults.checked += u64::from(is_asked);
            faults.wrong += u64::from(wrong);
        }
    }
    faults
}

/// Whether whole numbers see as many crossings, and the nearest hit where it was found.
fn agrees(mesh: &Mesh, ray: &Ray, hit: Option<&Hit>, crossings: usize) -> bool {
    if exact::crossings(mesh, ray) != crossings {
        return false;
    }
    match (exact::nearest(mesh, ray), hit) {
        (None, None) => true,
        (Some((_, truth)), Some(hit)) => {
            (f64::from(hit.t) - truth.t).abs() <= 130.0 * f64::from(f32::EPSILON) / 2.0 * truth.t
        }
        _ => false,
    }
}
