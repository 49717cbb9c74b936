//! Build flags: what building costs, and what walks gain by it.

use std::hint::black_box;
use std::time::Duration;

use anyhow::Result;
use canvas::{Mark, Point};
use obvhs::BvhBuildParams;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use traversal::{BuildFlags, Walker};

use crate::Options;
use crate::report::{Chart, Report};
use crate::timing::alternate;
use crate::walks::{any_rays, bumpy};
use scenes::{Scene, closest_with};

const FLAGS: [(&str, u32, Mark); 4] = [
    ("default", 0, Mark::Default),
    (
        "PREFER_FAST_TRACE",
        BuildFlags::PREFER_FAST_TRACE,
        Mark::Ours,
    ),
    (
        "PREFER_FAST_BUILD",
        BuildFlags::PREFER_FAST_BUILD,
        Mark::Ours,
    ),
    ("LOW_MEMORY", BuildFlags::LOW_MEMORY, Mark::Ours),
];

pub fn measure(options: &Options, report: &mut Report) -> Result<()> {
    let (rounds, rays) = if options.quick {
        (3, 20_000)
    } else {
        (8, 20_000)
    };
    let (mesh, rays) = (bumpy(), any_rays(rays));
    let triangles = mesh.indices.len() as f64;
    let meshes = std::slice::from_ref(&mesh);
    let mut builds: Vec<Box<dyn FnMut() + '_>> = Vec::new();
    for (_, flags, _) in FLAGS {
        builds.push(Box::new(move || {
            black_box(scenes::build_meshes(meshes, flags));
        }));
    }
    let build_times = alternate(rounds, &mut builds);
    drop(builds);
    let scenes: Vec<Scene> = FLAGS
        .iter()
        .map(|(_, flags, _)| Scene::new(meshes, *flags))
        .collect();
    let mut walks: Vec<Box<dyn FnMut() + '_>> = Vec::new();
    for scene in &scenes {
        let (mut walker, rays) = (Walker::new(), &rays);
        walks.push(Box::new(move || {
            let hits = rays
                .iter()
                .filter_map(|ray| closest_with(&mut walker, &scene.top, ray));
            black_box(hits.count());
        }));
    }
    let walk_times = alternate(rounds, &mut walks);
    drop(walks);
    let mut points: Vec<Point> = FLAGS
        .iter()
        .zip(build_times)
        .zip(&walk_times)
        .map(|(((label, _, mark), build), walk)| Point {
            label: (*label).into(),
            x: build / triangles * 1e9,
            y: walk / rays.len() as f64 * 1e9,
            mark: *mark,
        })
        .collect();
    let mut rows = Vec::new();
    for ((label, ..), scene) in FLAGS.iter().zip(&scenes) {
        let used = traversal::compacted_size(&scene.bottom).unwrap_or(0) as f64;
        report.number("builds", label, "bytes a triangle", used / triangles);
        rows.push(vec![
            (*label).to_string(),
            format!("{:.1}", used / triangles),
        ]);
    }
    report.table("Build flags", &["bytes a triangle"], &rows);
    points.extend(others(&mesh, &rays, rounds));
    let chart = Chart {
        name: "builds",
        title: "Build flags: 81,920 triangles, incoherent rays, one thread",
        cost: "ns of building a triangle",
        error: "ns a ray",
    };
    report.frontier(&options.out, &chart, points)
}

/// obvhs' builders under its own walk of two-way nodes.
fn others(mesh: &scenes::Mesh, rays: &[traversal::Ray], rounds: usize) -> Vec<Point> {
    let triangles: Vec<obvhs::triangle::Triangle> = (0..mesh.indices.len())
        .map(|index| {
            let [v0, v1, v2] = mesh.triangle(index).map(Into::into);
            obvhs::triangle::Triangle { v0, v1, v2 }
        })
        .collect();
    let settings = [
        ("obvhs Bvh2, fast", BvhBuildParams::fast_build()),
        ("obvhs Bvh2, medium", BvhBuildParams::medium_build()),
        // The same with ever more of the tree put elsewhere.
        ("obvhs Bvh2, slow", BvhBuildParams::slow_build()),
        ("obvhs Bvh2, very slow", BvhBuildParams::very_slow_build()),
    ];
    settings
        .into_iter()
        .map(|(label, settings)| {
            let build = || {
                let mut time = Duration::ZERO;
                build_bvh2_from_tris(&triangles, settings, &mut time)
            };
            let bvh = build();
            let mut runs: Vec<Box<dyn FnMut() + '_>> = vec![
                Box::new(|| {
                    black_box(build());
                }),
                Box::new(|| {
                    let mut count = 0;
                    for ray in rays {
                        let [origin, direction] = [ray.origin, ray.direction].map(Into::into);
                        let ray = obvhs::ray::Ray::new(origin, direction, ray.t_min, ray.t_max);
                        let mut hit = obvhs::ray::RayHit::none();
                        count += usize::from(bvh.ray_traverse(ray, &mut hit, |ray, id| {
                            triangles[bvh.primitive_indices[id] as usize].intersect(ray)
                        }));
                    }
                    black_box(count);
                }),
            ];
            let times = alternate(rounds, &mut runs);
            Point {
                label: label.into(),
                x: times[0] / triangles.len() as f64 * 1e9,
                y: times[1] / rays.len() as f64 * 1e9,
                mark: Mark::Other,
            }
        })
        .collect()
}
