//! Rays that leave a surface: what keeps them from meeting it again, and what makes them pass
//! through its neighbour.

use anyhow::Result;
use canvas::short;
use traversal::{Hit, Ray, Walker};

use super::Map;
use crate::Options;
use crate::report::Report;
use scenes::hard::FRAME;
use scenes::{DVec3, Mesh, Random, Scene, closest_with, narrow, normalize, ray, wide};

/// Where a ray starts that leaves a surface: how the point is found, and how it is moved.
struct Way {
    name: &'static str,
    start: fn(&SourceHit<'_>) -> Start,
}

struct Start {
    origin: [f32; 3],
    t_min: f32,
}

/// A hit from which a ray is to leave.
struct SourceHit<'a> {
    ray: &'a Ray,
    hit: &'a Hit,
    triangle: [[f32; 3]; 3],
    /// Towards the side that the ray came from.
    normal: [f32; 3],
}

impl SourceHit<'_> {
    /// The point along the ray.
    fn along(&self) -> [f32; 3] {
        std::array::from_fn(|i| self.ray.origin[i] + self.hit.t * self.ray.direction[i])
    }

    /// The point by the weights of the vertices.
    fn by_weights(&self) -> [f32; 3] {
        let [v, w] = self.hit.barycentrics;
        let [a, b, c] = self.triangle;
        std::array::from_fn(|i| a[i] + (v * (b[i] - a[i]) + w * (c[i] - a[i])))
    }

    fn moved(&self, from: [f32; 3], by: f32) -> [f32; 3] {
        std::array::from_fn(|i| from[i] + by * self.normal[i])
    }
}

/// Wächter and Binder, "A Fast and Robust Method for Avoiding Self-Intersection" (2019): by units
/// in the last place, and by a constant near 0.
fn by_last_places(from: [f32; 3], normal: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| {
        if from[i].abs() < 1.0 / 32.0 {
            return from[i] + normal[i] / 65_536.0;
        }
        let steps = (256.0 * normal[i]) as i32;
        let steps = if from[i] < 0.0 { -steps } else { steps };
        f32::from_bits((from[i].to_bits() as i32).wrapping_add(steps) as u32)
    })
}

const WAYS: [Way; 6] = [
    Way {
        name: "along the ray",
        start: |seen| Start {
            origin: seen.along(),
            t_min: 0.0,
        },
    },
    Way {
        name: "t_min = 0.001",
        start: |seen| Start {
            origin: seen.along(),
            t_min: 1e-3,
        },
    },
    Way {
        name: "0.001 along the normal",
        start: |seen| Start {
            origin: seen.moved(seen.along(), 1e-3),
            t_min: 0.0,
        },
    },
    Way {
        name: "last places, along the ray",
        start: |seen| Start {
            origin: by_last_places(seen.along(), seen.normal),
            t_min: 0.0,
        },
    },
    Way {
        name: "by weights",
        start: |seen| Start {
            origin: seen.by_weights(),
            t_min: 0.0,
        },
    },
    Way {
        name: "last places, by weights",
        start: |seen| Start {
            origin: by_last_places(seen.by_weights(), seen.normal),
            t_min: 0.0,
        },
    },
];

/// A floor and a lid: squares of 8 × 8, tilted, `gap` apart and much wider than that.
fn gap(distance: f64, gap: f64) -> Mesh {
    let half = (30.0 * gap).max(1.0);
    let mut mesh = Mesh {
        opaque: true,
        ..Mesh::default()
    };
    for height in [0.0, gap] {
        let first = mesh.vertices.len() as u32;
        for j in 0..=8i32 {
            for i in 0..=8i32 {
                let along = |k: i32| half * (f64::from(k) / 4.0 - 1.0);
                let at = FRAME * DVec3::new(along(i), along(j), height);
                mesh.vertices.push(narrow(distance + at));
            }
        }
        for j in 0..8 {
            for i in 0..8 {
                let a = first + j * 9 + i;
                mesh.indices
                    .extend([[a, a + 1, a + 9], [a + 1, a + 10, a + 9]]);
            }
        }
    }
    mesh
}

pub fn measure(options: &Options, report: &mut Report) -> Result<()> {
    let count = if options.quick { 500 } else { 5_000 };
    let names: Vec<&str> = WAYS.iter().map(|way| way.name).collect();
    let mut own = Map::new(
        "starts",
        "Leaving a surface: rays that meet the triangle they start from",
        "distance from the origin of space",
        &names,
    );
    let mut through = Map::new(
        "leaks",
        "Leaving a surface: rays that pass a lid at a ten-thousandth of that distance",
        "distance from the origin of space",
        &names,
    );
    let mut walker = Walker::new();
    for power in 0..=7 {
        let distance = 10f64.powi(power);
        let lid = 1e-4 * distance;
        let mesh = gap(distance, lid);
        let scene = Scene::new(std::slice::from_ref(&mesh), 0);
        let mut random = Random(0x2468_ACE0_1357);
        let (mut again, mut leaked) = ([0usize; WAYS.len()], [0usize; WAYS.len()]);
        let mut all = 0;
        for _ in 0..count {
            // From inside the gap at the floor, and back at the lid.
            let index = (random.unit() * 128.0) as usize;
            let triangle = mesh.triangle(index);
            let [a, b, c] = triangle.map(wide);
            let target = 0.3 * a + 0.3 * b + 0.4 * c;
            let normal = normalize((b - a).cross(c - a));
            let tilt = random.direction();
            let way = normalize(normal + 0.5 * tilt);
            let from = narrow(target + 0.5 * lid * way);
            let coming = ray(from, narrow(-way));
            let Some(hit) = closest_with(&mut walker, &scene.top, &coming) else {
                continue;
            };
            if hit.primitive_index as usize >= 128 {
                continue;
            }
            let triangle = mesh.triangle(hit.primitive_index as usize);
            let normal = scenes::hard::unit_normal(&triangle);
            let toward = if normal.dot(way) < 0.0 { -1.0 } else { 1.0 };
            let seen = SourceHit {
                ray: &coming,
                hit: &hit,
                triangle,
                normal: narrow(normal * toward),
            };
            all += 1;
            for (number, way_out) in WAYS.iter().enumerate() {
                let start = (way_out.start)(&seen);
                let leaving = Ray {
                    t_min: start.t_min,
                    ..ray(start.origin, narrow(way))
                };
                match closest_with(&mut walker, &scene.top, &leaving) {
                    Some(next) if next.primitive_index < 128 => again[number] += 1,
                    Some(_) => {}
                    None => leaked[number] += 1,
                }
            }
        }
        own.column(
            report,
            short(distance),
            &again.map(|wrong| Some((wrong, all))),
        );
        through.column(
            report,
            short(distance),
            &leaked.map(|wrong| Some((wrong, all))),
        );
    }
    own.save(options, report)?;
    through.save(options, report)
}
