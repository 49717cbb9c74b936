//! Whole walks through a structure: cost, and holes.

use std::hint::black_box;
use std::time::Duration;

use anyhow::Result;
use canvas::{Mark, Point};
use obvhs::BvhBuildParams;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use traversal::{Accuracy, Options as WalkOptions, Ray, Specialisation, Tier, Walker};

use crate::Options;
use crate::report::{Chart, Report};
use crate::timing::alternate;
use crate::triangles::{Test, sphere};
use scenes::{Mesh, Random, Scene, closest_with, narrow, normalize, ray};

/// A structure over a mesh, and how it is walked.
pub enum Engine {
    Ours(Box<Scene>, Box<Walker>),
    Bvh2(Bvh2, Vec<obvhs::triangle::Triangle>),
    CwBvh(CwBvh, Vec<obvhs::triangle::Triangle>),
    /// obvhs' structures with a watertight test of triangles in f32.
    Bvh2Woop(Bvh2, Mesh),
    CwBvhWoop(CwBvh, Mesh),
}

fn others(mesh: &Mesh) -> Vec<obvhs::triangle::Triangle> {
    (0..mesh.indices.len())
        .map(|index| {
            let [v0, v1, v2] = mesh.triangle(index).map(Into::into);
            obvhs::triangle::Triangle { v0, v1, v2 }
        })
        .collect()
}

fn bvh2(mesh: &Mesh) -> Bvh2 {
    let mut time = Duration::ZERO;
    build_bvh2_from_tris(&others(mesh), BvhBuildParams::medium_build(), &mut time)
}

fn cwbvh(mesh: &Mesh) -> CwBvh {
    let mut time = Duration::ZERO;
    build_cwbvh_from_tris(&others(mesh), BvhBuildParams::medium_build(), &mut time)
}

impl Engine {
    pub fn ours(mesh: &Mesh, options: WalkOptions) -> Engine {
        let walker = Walker::with(options).expect("the tier is there");
        let scene = Scene::new(std::slice::from_ref(mesh), 0);
        Engine::Ours(Box::new(scene), walker)
    }

    pub fn accurate(mesh: &Mesh, accuracy: Accuracy) -> Engine {
        let options = WalkOptions {
            accuracy,
            ..WalkOptions::default()
        };
        Engine::ours(mesh, options)
    }

    pub fn bvh2(mesh: &Mesh) -> Engine {
        Engine::Bvh2(bvh2(mesh), others(mesh))
    }

    pub fn cwbvh(mesh: &Mesh) -> Engine {
        Engine::CwBvh(cwbvh(mesh), others(mesh))
    }

    /// The distance of the closest hit.
    pub fn closest(&mut self, ray: &Ray) -> Option<f32> {
        let mut hit = obvhs::ray::RayHit::none();
        let other = || obvhs_ray(ray);
        let woop = |mesh: &Mesh, index: u32, far: f32| {
            let triangle = mesh.triangle(index as usize);
            let found = Test::Woop.nearest(ray, std::iter::once(&triangle));
            match found {
                Some((_, (t, _))) if t <= far => t,
                _ => f32::INFINITY,
            }
        };
        let found = match self {
            Engine::Ours(scene, walker) => {
                return closest_with(walker, &scene.top, ray).map(|hit| hit.t);
            }
            Engine::Bvh2(bvh, triangles) => bvh.ray_traverse(other(), &mut hit, |ray, id| {
                triangles[bvh.primitive_indices[id] as usize].intersect(ray)
            }),
            Engine::CwBvh(bvh, triangles) => bvh.ray_traverse(other(), &mut hit, |ray, id| {
                triangles[bvh.primitive_indices[id] as usize].intersect(ray)
            }),
            Engine::Bvh2Woop(bvh, mesh) => bvh.ray_traverse(other(), &mut hit, |ray, id| {
                woop(mesh, bvh.primitive_indices[id], ray.tmax)
            }),
            Engine::CwBvhWoop(bvh, mesh) => bvh.ray_traverse(other(), &mut hit, |ray, id| {
                woop(mesh, bvh.primitive_indices[id], ray.tmax)
            }),
        };
        (found && hit.t > ray.t_min && hit.t < ray.t_max).then_some(hit.t)
    }
}

fn obvhs_ray(ray: &Ray) -> obvhs::ray::Ray {
    let [origin, direction] = [ray.origin, ray.direction].map(Into::into);
    obvhs::ray::Ray::new(origin, direction, ray.t_min, ray.t_max)
}

/// The methods under comparison.
#[derive(Clone, Copy)]
pub struct Contestant {
    pub name: &'static str,
    mark: Mark,
    make: fn(&Mesh) -> Option<Engine>,
}

impl Contestant {
    /// The engine over a mesh; `None` where the machine lacks its instruction set.
    pub fn over(&self, mesh: &Mesh) -> Option<Engine> {
        (self.make)(mesh)
    }
}

fn of_tier(mesh: &Mesh, tier: Tier) -> Option<Engine> {
    let options = WalkOptions {
        tier,
        ..WalkOptions::default()
    };
    tier.is_available().then(|| Engine::ours(mesh, options))
}

pub const CONTESTANTS: &[Contestant] = &[
    Contestant {
        name: "Tuff",
        mark: Mark::Default,
        make: |mesh| Some(Engine::accurate(mesh, Accuracy::Spec)),
    },
    Contestant {
        name: "Tuff exact",
        mark: Mark::Ours,
        make: |mesh| Some(Engine::accurate(mesh, Accuracy::Exact)),
    },
    Contestant {
        name: "Tuff, without its opaque path",
        mark: Mark::Ours,
        make: |mesh| {
            let options = WalkOptions {
                without: [Specialisation::Opaque].into_iter().collect(),
                ..WalkOptions::default()
            };
            Some(Engine::ours(mesh, options))
        },
    },
    Contestant {
        name: "Tuff, AVX2",
        mark: Mark::Ours,
        make: |mesh| of_tier(mesh, Tier::Avx2),
    },
    Contestant {
        name: "Tuff, portable",
        mark: Mark::Ours,
        make: |mesh| of_tier(mesh, Tier::Portable),
    },
    Contestant {
        name: "obvhs Bvh2",
        mark: Mark::Other,
        make: |mesh| Some(Engine::bvh2(mesh)),
    },
    Contestant {
        name: "obvhs CwBvh",
        mark: Mark::Other,
        make: |mesh| Some(Engine::cwbvh(mesh)),
    },
    Contestant {
        name: "obvhs Bvh2, WBW f32",
        mark: Mark::Other,
        make: |mesh| Some(Engine::Bvh2Woop(bvh2(mesh), mesh.clone())),
    },
    Contestant {
        name: "obvhs CwBvh, WBW f32",
        mark: Mark::Other,
        make: |mesh| Some(Engine::CwBvhWoop(cwbvh(mesh), mesh.clone())),
    },
];

/// A bumpy sphere of 81,920 triangles.
pub fn bumpy() -> Mesh {
    Mesh::icosphere(6, true, |p| {
        let [x, y, z] = p.to_array();
        let size = 1.0 + 0.05 * libm::sin(9.0 * x) * libm::cos(8.0 * y + 1.0) * libm::sin(7.0 * z);
        p * size
    })
}

/// Rays from anywhere around to anywhere inside: incoherent.
pub fn any_rays(count: usize) -> Vec<Ray> {
    let mut random = Random(0xDEAD_BEEF_CAFE);
    (0..count)
        .map(|_| {
            let origin = 2.5 * random.direction();
            let target = 0.8 * random.vector();
            ray(narrow(origin), narrow(normalize(target - origin)))
        })
        .collect()
}

/// How many of a million rays at edges and vertices of a closed sphere get no hit on its front.
fn misses(contestant: &Contestant, count: usize) -> f64 {
    let (mut missed, mut all) = (0usize, 0usize);
    for (scale, translation) in [(1.0, 0.0), (1e6, 0.0), (1.0, 1e4), (1e6, 1e7)] {
        let (mesh, rays) = sphere(5, scale, translation, count);
        let Some(mut engine) = contestant.over(&mesh) else {
            continue;
        };
        for ray in &rays {
            missed += usize::from(!engine.closest(ray).is_some_and(|t| t < 1.2));
            all += 1;
        }
    }
    missed as f64 / all as f64 * 1e6
}

pub fn measure(options: &Options, report: &mut Report) -> Result<()> {
    let (rounds, rays, aimed) = if options.quick {
        (5, 20_000, 5_000)
    } else {
        (10, 20_000, 50_000)
    };
    let (mesh, rays) = (bumpy(), any_rays(rays));
    let mut engines: Vec<(&Contestant, Engine)> = CONTESTANTS
        .iter()
        .filter_map(|contestant| Some((contestant, contestant.over(&mesh)?)))
        .collect();
    let mut runs: Vec<Box<dyn FnMut() + '_>> = Vec::new();
    for (_, engine) in &mut engines {
        let rays = &rays;
        runs.push(Box::new(move || {
            let sum: f32 = rays.iter().filter_map(|ray| engine.closest(ray)).sum();
            black_box(sum);
        }));
    }
    let times = alternate(rounds, &mut runs);
    drop(runs);
    let points = engines
        .iter()
        .zip(times)
        .map(|((contestant, _), time)| Point {
            label: contestant.name.into(),
            x: time / rays.len() as f64 * 1e9,
            y: misses(contestant, aimed),
            mark: contestant.mark,
        })
        .collect();
    let chart = Chart {
        name: "walks",
        title: "Walks, one ray at a time: rays that slip through a closed mesh",
        cost: "ns a ray (incoherent, 81,920 triangles)",
        error: "misses of a million rays at edges and vertices",
    };
    report.frontier(&options.out, &chart, points)
}
