//! Tests of a ray against a triangle: cost, holes between triangles, and errors of distances and
//! weights.

use std::hint::black_box;

use anyhow::Result;
use canvas::{Mark, Point};
use traversal::{Accuracy, Ray, TriangleTest};

use crate::Options;
use crate::report::{Chart, Report};
use crate::timing::alternate;
use scenes::exact;
use scenes::{DVec3, Mesh, Random, narrow, normalize, ray, wide};

/// Where a ray meets a triangle: distance, and the weights of the second and the third vertex.
pub type TriangleHit = (f32, [f32; 2]);
type Triangle = [[f32; 3]; 3];

/// A way to test triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Test {
    MollerTrumbore,
    Woop,
    Ours(Accuracy),
    MollerTrumboreWide,
    Whole,
}

impl Test {
    pub const ALL: [Test; 6] = [
        Test::MollerTrumbore,
        Test::Woop,
        Test::Ours(Accuracy::Spec),
        Test::Ours(Accuracy::Exact),
        Test::MollerTrumboreWide,
        Test::Whole,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Test::MollerTrumbore => "Möller–Trumbore f32",
            Test::Woop => "Woop–Benthin–Wald f32",
            Test::Ours(Accuracy::Spec) => "Tuff (WBW, f64 where needed)",
            Test::Ours(Accuracy::Exact) => "Tuff exact",
            Test::MollerTrumboreWide => "Möller–Trumbore f64",
            Test::Whole => "whole numbers",
        }
    }

    pub fn mark(self) -> Mark {
        match self {
            Test::Ours(Accuracy::Spec) => Mark::Default,
            Test::Ours(_) => Mark::Ours,
            _ => Mark::Other,
        }
    }

    /// Tests one ray against triangles; hands each meeting to `met`.
    pub fn each<'a>(
        self,
        ray: &Ray,
        triangles: impl Iterator<Item = &'a Triangle>,
        mut met: impl FnMut(usize, TriangleHit),
    ) {
        let triangles = triangles.enumerate();
        match self {
            Test::MollerTrumbore => {
                for (index, triangle) in triangles {
                    if let Some(found) = moller_trumbore(ray, triangle) {
                        met(index, found);
                    }
                }
            }
            Test::Woop => {
                let sheared = Sheared::new(ray);
                for (index, triangle) in triangles {
                    if let Some(found) = sheared.intersect_triangle(triangle) {
                        met(index, found);
                    }
                }
            }
            Test::Ours(accuracy) => {
                let test = TriangleTest::new(ray, accuracy);
                for (index, triangle) in triangles {
                    if let Some(found) = test.intersect_triangle(triangle) {
                        met(index, found);
                    }
                }
            }
            Test::MollerTrumboreWide => {
                for (index, triangle) in triangles {
                    if let Some(found) = moller_trumbore_wide(ray, triangle) {
                        met(index, found);
                    }
                }
            }
            Test::Whole => {
                for (index, triangle) in triangles {
                    if let Some(found) = exact::intersect(ray, triangle) {
                        let weights = found.weights.map(|weight| weight as f32);
                        met(index, (found.t as f32, weights));
                    }
                }
            }
        }
    }

    /// The nearest meeting inside the ray's interval.
    pub fn nearest<'a>(
        self,
        ray: &Ray,
        triangles: impl Iterator<Item = &'a Triangle>,
    ) -> Option<(usize, TriangleHit)> {
        let mut best: Option<(usize, TriangleHit)> = None;
        self.each(ray, triangles, |index, found| {
            let inside = ray.t_min < found.0 && found.0 < ray.t_max;
            if inside && best.is_none_or(|(_, best)| found.0 < best.0) {
                best = Some((index, found));
            }
        });
        best
    }
}

/// Möller and Trumbore (1997).
fn moller_trumbore(ray: &Ray, triangle: &Triangle) -> Option<TriangleHit> {
    let minus = |a: [f32; 3], b: [f32; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let times = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let across = |a: [f32; 3], b: [f32; 3]| {
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    };
    let [a, b, c] = *triangle;
    let (first, second) = (minus(b, a), minus(c, a));
    let p = across(ray.direction, second);
    let determinant = times(first, p);
    if determinant == 0.0 {
        return None;
    }
    let inverse = 1.0 / determinant;
    let s = minus(ray.origin, a);
    let u = times(s, p) * inverse;
    if !(0.0..=1.0).contains(&u) {
        return None;
    }
    let q = across(s, first);
    let v = times(ray.direction, q) * inverse;
    if v < 0.0 || u + v > 1.0 {
        return None;
    }
    Some((times(second, q) * inverse, [u, v]))
}

/// The same in f64.
fn moller_trumbore_wide(ray: &Ray, triangle: &Triangle) -> Option<TriangleHit> {
    let [a, b, c] = triangle.map(wide);
    let (origin, direction) = (wide(ray.origin), wide(ray.direction));
    let (first, second) = (b - a, c - a);
    let p = direction.cross(second);
    let determinant = first.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let s = origin - a;
    let u = s.dot(p) / determinant;
    if !(0.0..=1.0).contains(&u) {
        return None;
    }
    let q = s.cross(first);
    let v = direction.dot(q) / determinant;
    if v < 0.0 || u + v > 1.0 {
        return None;
    }
    Some(((second.dot(q) / determinant) as f32, [u as f32, v as f32]))
}

/// Woop, Benthin and Wald (2013), in f32 throughout.
struct Sheared {
    origin: [f32; 3],
    axes: [usize; 3],
    shear: [f32; 3],
}

impl Sheared {
    fn new(ray: &Ray) -> Sheared {
        let size = ray.direction.map(f32::abs);
        let z = if size[0] > size[1] && size[0] > size[2] {
            0
        } else if size[1] > size[2] {
            1
        } else {
            2
        };
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if ray.direction[z] < 0.0 {
            (x, y) = (y, x);
        }
        let d = ray.direction;
        Sheared {
            origin: ray.origin,
            axes: [x, y, z],
            shear: [d[x] / d[z], d[y] / d[z], 1.0 / d[z]],
        }
    }

    fn intersect_triangle(&self, triangle: &Triangle) -> Option<TriangleHit> {
        let [x, y, z] = self.axes;
        let moved = triangle.map(|vertex| {
            let at = |axis: usize| vertex[axis] - self.origin[axis];
            [
                at(x) - self.shear[0] * at(z),
                at(y) - self.shear[1] * at(z),
                self.shear[2] * at(z),
            ]
        });
        let [a, b, c] = moved;
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let whole = u + v + w;
        if whole == 0.0 {
            return None;
        }
        let inverse = 1.0 / whole;
        let t = (u * a[2] + v * b[2] + w * c[2]) * inverse;
        Some((t, [v * inverse, w * inverse]))
    }
}

/// Scales and translations of the sphere that rays are aimed at.
const PLACES: [(f64, f64); 4] = [(1.0, 0.0), (1e6, 0.0), (1.0, 1e4), (1e6, 1e7)];

/// A sphere of 1,280 triangles and rays at its edges and vertices, from two radii away.
pub fn sphere(levels: u32, scale: f64, translation: f64, count: usize) -> (Mesh, Vec<Ray>) {
    let offset = translation * DVec3::new(1.0, 1.3, 0.7);
    let mesh = Mesh::icosphere(levels, true, |p| p * scale + offset);
    let mut random = Random(88_172_645_463_325_252);
    let mut rays = Vec::with_capacity(count);
    for number in 0..count {
        let face = mesh.indices[(random.unit() * mesh.indices.len() as f64) as usize];
        let [a, b, _] = face.map(|i| wide(mesh.vertices[i as usize]));
        let weight = if number % 2 == 0 { random.unit() } else { 0.0 };
        let target = a + weight * (b - a);
        let (normal, tilt) = (normalize(target - offset), random.direction());
        let way = normalize(normal * 0.9 + tilt * 0.6);
        let origin = narrow(target + 2.0 * scale * way);
        rays.push(ray(origin, narrow(target - wide(origin))));
    }
    (mesh, rays)
}

/// How many of a million rays at a closed sphere miss its front.
fn misses(test: Test, count: usize) -> f64 {
    let (mut missed, mut all) = (0usize, 0usize);
    for (scale, translation) in PLACES {
        let (mesh, rays) = sphere(3, scale, translation, count);
        let triangles: Vec<Triangle> = (0..mesh.indices.len()).map(|i| mesh.triangle(i)).collect();
        for ray in &rays {
            let found = test.nearest(ray, triangles.iter());
            missed += usize::from(!found.is_some_and(|(_, (t, _))| t < 1.2));
            all += 1;
        }
    }
    missed as f64 / all as f64 * 1e6
}

/// Errors of hits inside triangles: the greatest of the distance in ULP, and of weights in 2⁻²⁴.
fn errors(test: Test, count: usize) -> (f64, f64) {
    let (mut in_t, mut in_weights) = (0f64, 0f64);
    for (scale, translation) in PLACES {
        let (mesh, rays) = sphere(3, scale, translation, 3 * count);
        let mut random = Random(0x1234_5678_9ABC_DEF1);
        for aimed in rays {
            let index = (random.unit() * mesh.indices.len() as f64) as usize;
            let triangle = mesh.triangle(index);
            let corners = triangle.map(wide);
            let inner = 0.2 * corners[0] + 0.3 * corners[1] + 0.5 * corners[2];
            let length = 0.3 + random.unit();
            let way = (inner - wide(aimed.origin)) * length / scale;
            let ray = ray(aimed.origin, narrow(way));
            let Some(truth) = exact::intersect(&ray, &triangle) else {
                continue;
            };
            let outer = 1.0 - truth.weights[0] - truth.weights[1];
            let normal = normalize((corners[1] - corners[0]).cross(corners[2] - corners[0]));
            let slope = normal.dot(normalize(wide(ray.direction))).abs();
            if truth.weights[0].min(truth.weights[1]).min(outer) < 0.01 || slope < 0.5 {
                continue;
            }
            test.each(&ray, std::iter::once(&triangle), |_, (t, weights)| {
                let unit = f64::from((truth.t as f32).next_up()) - f64::from(truth.t as f32);
                in_t = in_t.max((f64::from(t) - truth.t).abs() / unit);
                for (found, expected) in weights.into_iter().zip(truth.weights) {
                    let error = (f64::from(found) - expected).abs() * f64::from(1u32 << 24);
                    in_weights = in_weights.max(error);
                }
            });
        }
    }
    (in_t, in_weights)
}

/// Nanoseconds a test: rays against the triangles around where they hit, as leaves have them.
fn costs(rounds: usize) -> Vec<f64> {
    const NEAR: usize = 16;
    let (mesh, rays) = sphere(3, 1.0, 0.0, 512);
    let all: Vec<Triangle> = (0..mesh.indices.len()).map(|i| mesh.triangle(i)).collect();
    let leaves: Vec<Vec<Triangle>> = rays
        .iter()
        .map(|ray| {
            let hit = Test::Ours(Accuracy::Spec).nearest(ray, all.iter());
            let first = hit.map_or(0, |(index, _)| index).saturating_sub(NEAR / 2);
            all[first.min(all.len() - NEAR)..][..NEAR].to_vec()
        })
        .collect();
    let mut contestants: Vec<Box<dyn FnMut() + '_>> = Vec::new();
    for test in Test::ALL {
        let (rays, leaves) = (&rays, &leaves);
        // Whole numbers take their time.
        let share = if test == Test::Whole { 16 } else { 1 };
        contestants.push(Box::new(move || {
            let mut sum = 0.0;
            for (ray, leaf) in rays.iter().zip(leaves).take(rays.len() / share) {
                test.each(black_box(ray), leaf.iter(), |_, (t, _)| sum += t);
            }
            black_box(sum);
        }));
    }
    let times = alternate(rounds, &mut contestants);
    let tests = (512 * NEAR) as f64;
    let per_test = |(time, test): (f64, Test)| {
        let share = if test == Test::Whole { 16.0 } else { 1.0 };
        time / tests * share * 1e9
    };
    times.into_iter().zip(Test::ALL).map(per_test).collect()
}

pub fn measure(options: &Options, report: &mut Report) -> Result<()> {
    let (rounds, rays) = if options.quick {
        (10, 500)
    } else {
        (60, 5_000)
    };
    let costs = costs(rounds);
    let [mut holes, mut distances, mut weights] = [(); 3].map(|()| Vec::new());
    for (test, cost) in Test::ALL.into_iter().zip(costs) {
        let point = |y: f64| Point {
            label: test.name().into(),
            x: cost,
            y,
            mark: test.mark(),
        };
        // Every ray is aimed at the surface: whole numbers are right by construction, and slow.
        let missed = if test == Test::Whole {
            0.0
        } else {
            misses(test, rays)
        };
        let (in_t, in_weights) = errors(test, rays);
        holes.push(point(missed));
        distances.push(point(in_t));
        weights.push(point(in_weights));
    }
    const COST: &str = "ns a test";
    let chart = Chart {
        name: "triangle-misses",
        title: "Triangle tests: rays that slip through a closed mesh",
        cost: COST,
        error: "misses of a million rays at edges and vertices",
    };
    report.frontier(&options.out, &chart, holes)?;
    let chart = Chart {
        name: "triangle-distances",
        title: "Triangle tests: distances of hits inside triangles",
        cost: COST,
        error: "greatest error of t, ULP",
    };
    report.frontier(&options.out, &chart, distances)?;
    let chart = Chart {
        name: "triangle-weights",
        title: "Triangle tests: barycentrics of hits inside triangles",
        cost: COST,
        error: "greatest error of weights, 2⁻²⁴",
    };
    report.frontier(&options.out, &chart, weights)
}
