//! Meshes whose faces reach far, rays at their edges and vertices, and what is right about those: a
//! ray from inside of a closed one leaves through the surface, whatever the proportions, and each
//! meets what whole numbers say.

mod meshes;

use crate::exact;
use crate::surface::{Containment, Met, Surface};
use crate::ways::{all_ways, walkers};
use crate::*;
pub use meshes::cuboid;
use meshes::{circle, lantern, prism, spindle, star, terrain, tetrahedron, torus};
use traversal::*;

/// A mesh by how far it reaches.
pub struct Family {
    pub name: &'static str,
    make: fn(f64) -> Mesh,
    shape: Shape,
}

/// Statements about crossings that hold for any ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shape {
    /// A ray from inside crosses it once and one from outside twice at most. What has slanted faces
    /// of four corners is not convex any more when those are rounded.
    Convex,
    /// An odd number from inside, an even one from outside.
    Closed,
    /// Nothing. Only whole numbers know what rays meet, so it is placed as these can follow.
    Open,
}

pub const FAMILIES: &[Family] = &[
    Family {
        name: "cube",
        make: |length| cuboid([length; 3]),
        shape: Shape::Convex,
    },
    Family {
        name: "long box",
        make: |length| cuboid([1.0, 1.0, length]),
        shape: Shape::Convex,
    },
    Family {
        name: "flat box",
        make: |length| cuboid([length, 1.0, length]),
        shape: Shape::Convex,
    },
    Family {
        name: "prism of 3 sides",
        make: |length| prism(&circle(3, 1.0), length),
        shape: Shape::Closed,
    },
    Family {
        name: "prism of 7 sides",
        make: |length| prism(&circle(7, 1.0), length),
        shape: Shape::Closed,
    },
    Family {
        name: "wedge",
        make: |length| prism(&[[0.0, 0.0], [length, 0.0], [length, 1.0]], 1.0),
        shape: Shape::Convex,
    },
    Family {
        name: "long tetrahedron",
        make: |length| tetrahedron([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.3, 0.2, length]]),
        shape: Shape::Convex,
    },
    Family {
        name: "flat tetrahedron",
        make: |length| tetrahedron([[length, 0.0, 0.0], [0.0, length, 0.0], [0.3, 0.2, 1.0]]),
        shape: Shape::Convex,
    },
    Family {
        name: "fans of slivers",
        make: |length| spindle(48, 1.0, length),
        shape: Shape::Closed,
    },
    Family {
        name: "flat fans",
        make: |length| spindle(48, length, 1.0),
        shape: Shape::Closed,
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
        shape: Shape::Closed,
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
        shape: Shape::Closed,
    },
    Family {
        name: "terrain of strips",
        make: |length| terrain(24, length),
        shape: Shape::Closed,
    },
    Family {
        name: "terrain of needles",
        make: |length| terrain(24, length.recip()),
        shape: Shape::Closed,
    },
    Family {
        name: "spiky star",
        make: star,
        shape: Shape::Closed,
    },
    Family {
        name: "thin torus",
        make: |length| torus([24, 6], [length + 1.0, 1.0]),
        shape: Shape::Closed,
    },
    Family {
        name: "lantern of slivers",
        make: |length| lantern(10, 8, length.recip()),
        shape: Shape::Closed,
    },
    Family {
        name: "double fan of hundreds",
        make: |length| spindle(200, length, 1.0),
        shape: Shape::Closed,
    },
    Family {
        name: "open fan of hundreds",
        make: |length| {
            let mut mesh = spindle(300, length, 1.0);
            // One side of the two, and a slit in it.
            mesh.indices.retain(|face| face.contains(&300));
            mesh.indices.pop();
            mesh
        },
        shape: Shape::Open,
    },
    Family {
        name: "open strips",
        make: |length| {
            let mut mesh = terrain(24, length);
            mesh.indices.truncate(mesh.indices.len() / 2);
            mesh
        },
        shape: Shape::Open,
    },
];

pub const LENGTHS: [f64; 8] = [1.0, 10.0, 95.500_755, 300.0, 1e3, 1e4, 1e5, 1e6];

/// A mean of all vertices.
fn mean(mesh: &Mesh, random: &mut Random) -> DVec3 {
    let mut point = DVec3::ZERO;
    let mut sum = 0.0;
    for &vertex in &mesh.vertices {
        let weight = random.unit().powi(3);
        sum += weight;
        point += weight * wide(vertex);
    }
    point / sum
}

/// Rays at edges and vertices, from inside or outside (towards all vertices or away from them,
/// where it is open); all distances between the near and the far end of what there is. Fewer where
/// places to start from are hardly found.
fn rays(
    mesh: &Mesh,
    surface: &mut Surface<'_>,
    random: &mut Random,
    count: usize,
    start: Start,
) -> Vec<Ray> {
    let Start {
        inside,
        closed,
        clear,
    } = start;
    let meant = match inside {
        true => Containment::Inside,
        false => Containment::Outside,
    };
    let mut rays = Vec::new();
    for _ in 0..64 * count {
        if rays.len() == count {
            break;
        }
        let triangle = mesh.triangle((random.unit() * mesh.indices.len() as f64) as usize);
        let first = (random.unit() * 3.0) as usize;
        let [a, b] = [triangle[first % 3], triangle[(first + 1) % 3]].map(wide);
        let weight = match rays.len() % 3 {
            0 => 0.0,
            1 => random.unit(),
            _ => libm::pow(10.0, -6.0 * random.unit()),
        };
        let beside = libm::pow(10.0, -9.0 + 5.0 * random.unit());
        let beside = random.vector() * beside;
        let target = a + weight * (b - a) + beside;
        let far = mean(mesh, random);
        let part = libm::pow(10.0, -6.0 * random.unit()) * if inside { 1.0 } else { -1.0 };
        let near = target + part * (far - target);
        let origin = narrow(near);
        let fits = match closed {
            true => surface.place(wide(origin), clear) == meant,
            false => surface.is_clear(wide(origin), clear),
        };
        if !fits {
            continue;
        }
        let direction = narrow(target - wide(origin));
        if direction != [0.0; 3] {
            rays.push(ray(origin, direction));
        }
    }
    rays
}

/// Where rays start from.
#[derive(Clone, Copy)]
struct Start {
    inside: bool,
    /// Whether there is an inside.
    closed: bool,
    /// How far from the surface, relative to how far from the origin of space.
    clear: f64,
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

impl Placement {
    /// Whether placing a ray and back rounds nothing, so that it is known to the bit in object
    /// space.
    pub fn is_exact(&self) -> bool {
        self.clear == EXACT
    }
}

/// How far from a surface f64 is certain of a side.
const EXACT: f64 = 1e-12;

pub const PLACEMENTS: [Placement; 4] = [
    Placement {
        name: "identity",
        transform: IDENTITY,
        clear: EXACT,
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
        clear: EXACT,
    },
];

/// Errors of some rays.
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
    /// Rays for which that was asked: all where placing rounds nothing.
    pub checked: u64,
    /// Triangles of those rays about which f64 was not certain.
    pub whole: u64,
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
        self.whole += other.whole;
    }
}

/// Every how many rays whole numbers are asked about all triangles, too.
const SAMPLE: usize = 1021;

/// Sends rays from inside or outside at a family's mesh of this length, placed, in every way of
/// walking. Returns none if the right hits are unknown.
pub fn faults(
    family: &Family,
    length: f64,
    placement: &Placement,
    inside: bool,
    seed: u64,
    count: usize,
) -> Faults {
    let solid = (family.make)(length);
    let non_opaque = Mesh {
        opaque: false,
        ..solid.clone()
    };
    if family.shape == Shape::Open && !placement.is_exact() {
        return Faults::default();
    }
    let mut surface = Surface::new(&solid);
    let start = Start {
        inside,
        closed: family.shape != Shape::Open,
        clear: placement.clear,
    };
    let [solid_scene, non_opaque_scene] = [&solid, &non_opaque]
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
        let given = rays(&solid, &mut surface, &mut random, some, start);
        faults.rays += given.len() as u64;
        let rays: Vec<Ray> = given
            .iter()
            .map(|ray| world(ray, &placement.transform))
            .collect();
        let mut ways = all_ways(&solid_scene.top, &rays).into_iter();
        let (_, first) = ways.next().expect("there is one");
        faults.unequal += unequal(ways, &first, &rays);
        for (i, (ray, hit)) in rays.iter().zip(&first).enumerate() {
            let mut found = walkers
                .iter_mut()
                .map(|(_, walker)| candidates_with(walker, &non_opaque_scene.top, ray));
            let first = found.next().expect("there is one");
            faults.unequal += found.filter(|found| *found != first).count() as u64;
            let found = first;
            let met = placement.is_exact().then(|| surface.intersect(&given[i]));
            let right = is_right_count(family.shape, inside, found.len())
                && met.is_none_or(|met| met.crossings == found.len());
            // A mesh that owns no part of a ray may still touch it.
            let some = start.closed && inside
                || !found.is_empty()
                || met.is_some_and(|met| met.nearest.is_some());
            let nearest = found.iter().map(|hit| hit.t).min_by(f32::total_cmp);
            let lost = hit.map_or(some, |hit| nearest.is_some_and(|nearest| hit.t > nearest));
            let wrong = met.is_some_and(|met| {
                !agrees(&met, hit.as_ref())
                    || i % SAMPLE == 0 && !is_exactly(&met, &solid, &given[i])
            });
            if !right || lost || wrong {
                println!(
                    "{} {length} {}: {hit:?} {found:?} {ray:?}",
                    family.name, placement.name
                );
            }
            faults.miscounted += u64::from(!right);
            faults.lost += u64::from(lost);
            faults.checked += u64::from(met.is_some());
            faults.whole += met.map_or(0, |met| u64::from(met.asked));
            faults.wrong += u64::from(wrong);
        }
    }
    faults
}

/// Prints and counts hits of other ways that differ from the first one's.
fn unequal(
    ways: impl Iterator<Item = (String, Vec<Option<Hit>>)>,
    first: &[Option<Hit>],
    rays: &[Ray],
) -> u64 {
    let mut unequal = 0;
    for (name, hits) in ways {
        for (i, (hit, expected)) in hits.iter().zip(first).enumerate() {
            if hit != expected {
                unequal += 1;
                println!("{name}: {hit:?}, not {expected:?}: {:?}", rays[i]);
            }
        }
    }
    unequal
}

/// Whether a ray from inside or outside may cross a shape so many times.
fn is_right_count(shape: Shape, inside: bool, crossings: usize) -> bool {
    match (shape, inside) {
        (Shape::Convex, true) => crossings == 1,
        (Shape::Convex, false) => crossings == 0 || crossings == 2,
        (Shape::Closed, inside) => crossings % 2 == usize::from(inside),
        (Shape::Open, _) => true,
    }
}

/// Whether a hit is where the nearest is.
fn agrees(met: &Met, hit: Option<&Hit>) -> bool {
    match (met.nearest, hit) {
        (None, None) => true,
        (Some(truth), Some(hit)) => {
            (f64::from(hit.t) - truth).abs() <= 130.0 * f64::from(f32::EPSILON) / 2.0 * truth
        }
        _ => false,
    }
}

/// How many of so many rays whole numbers see otherwise than f64 where that is certain.
pub fn misjudged(family: &Family, length: f64, inside: bool, seed: u64, count: usize) -> usize {
    let mesh = (family.make)(length);
    let mut surface = Surface::new(&mesh);
    let start = Start {
        inside,
        closed: family.shape != Shape::Open,
        clear: EXACT,
    };
    let rays = rays(&mesh, &mut surface, &mut Random(seed), count, start);
    rays.iter()
        .filter(|ray| !is_exactly(&surface.intersect(ray), &mesh, ray))
        .count()
}

/// Whether whole numbers say the same without any help by f64.
pub fn is_exactly(met: &Met, mesh: &Mesh, ray: &Ray) -> bool {
    let triangles = || (0..mesh.indices.len()).map(|index| mesh.triangle(index));
    let found = triangles().filter_map(|triangle| exact::intersect(ray, &triangle));
    let ahead = found.map(|found| found.t).filter(|&t| t > 0.0);
    let nearest = ahead.filter(|&t| (t as f32).is_finite());
    let nearest = nearest.min_by(f64::total_cmp);
    let is_near = match (nearest, met.nearest) {
        (None, None) => true,
        (Some(truth), Some(t)) => (t - truth).abs() <= 1e-8 * truth,
        _ => false,
    };
    is_near
        && triangles()
            .filter(|triangle| exact::crosses(ray, triangle))
            .count()
            == met.crossings
}
