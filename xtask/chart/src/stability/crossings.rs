//! How often a surface counts that is crossed once: what any-hit shaders see at shared edges and
//! vertices.

use anyhow::Result;
use traversal::Accuracy;

use super::Map;
use crate::Options;
use crate::report::Report;
use crate::triangles::Test;
use scenes::{Mesh, Random, Scene, candidates, icosphere, narrow, normalize, ray, wide};

const ROWS: [&str; 5] = [
    "Möller–Trumbore f32",
    "WBW f32",
    "Tuff's test, opaque",
    "walk: Tuff, opaque",
    "walk: Tuff, any hit",
];

pub fn measure(options: &Options, report: &mut Report) -> Result<()> {
    let count = if options.quick { 300 } else { 3_000 };
    let (points, indices) = icosphere(3);
    let mut map = Map::new(
        "crossings",
        "Shared edges and vertices: a surface that counts other than once",
        "where rays of a closed mesh are aimed at",
        &ROWS,
    );
    for (label, edge, vertex) in [
        ("insides", false, false),
        ("edges", true, false),
        ("vertices", false, true),
    ] {
        let mesh = |opaque| Mesh {
            vertices: points.iter().map(|p| narrow(*p)).collect(),
            indices: indices.clone(),
            opaque,
        };
        let non_opaque = mesh(false);
        let solid = Scene::new(&[mesh(true)], 0);
        let scene = Scene::new(std::slice::from_ref(&non_opaque), 0);
        let triangles: Vec<_> = (0..non_opaque.indices.len())
            .map(|i| non_opaque.triangle(i))
            .collect();
        let mut random = Random(0xABCD_EF01_2345);
        let mut wrong = [0usize; ROWS.len()];
        for _ in 0..count {
            let face =
                non_opaque.indices[(random.unit() * non_opaque.indices.len() as f64) as usize];
            let [a, b, c] = face.map(|i| wide(non_opaque.vertices[i as usize]));
            let along = random.unit();
            let weights = match (edge, vertex) {
                (true, _) => [1.0 - along, along, 0.0],
                (_, true) => [1.0, 0.0, 0.0],
                _ => [0.4, 0.25, 0.35],
            };
            let target = weights[0] * a + weights[1] * b + weights[2] * c;
            let (normal, tilt) = (normalize(target), random.direction());
            let way = normalize(normal * 0.9 + tilt * 0.5);
            let origin = narrow(target + 2.0 * way);
            let ray = ray(origin, narrow(target - wide(origin)));
            let tests = [Test::MollerTrumbore, Test::Woop, Test::Ours(Accuracy::Spec)];
            for (wrong, test) in wrong.iter_mut().zip(tests) {
                let mut front = 0;
                test.each(&ray, triangles.iter(), |_, (t, _)| {
                    front += usize::from(t > 0.0 && t < 1.2);
                });
                *wrong += usize::from(front != 1);
            }
            let hit = scenes::closest(&solid.top, &ray);
            wrong[3] += usize::from(!hit.is_some_and(|hit| hit.t < 1.2));
            let seen = candidates(&scene.top, &ray);
            let front = seen.iter().filter(|hit| hit.t < 1.2).count();
            wrong[4] += usize::from(front != 1);
        }
        let found = wrong.map(|wrong| Some((wrong, count)));
        map.column(report, label.into(), &found);
    }
    map.save(options, report)
}
