//! Instances: how crooked a transform may be.

use anyhow::Result;
use canvas::short;
use traversal::Accuracy;

use super::Map;
use crate::Options;
use crate::report::Report;
use crate::triangles::Test;
use scenes::hard::{TOLERANCE, fault};
use scenes::{
    DMat3, DVec3, Mesh, Random, Scene, apply, closest_with, narrow, normalize, ray, wide,
};
use traversal::{Options as WalkOptions, Ray, Walker};

const ROWS: [&str; 4] = [
    "inverse f32, Möller–Trumbore",
    "inverse f32, WBW",
    "walk: Tuff",
    "walk: Tuff exact",
];

/// A kind of transform, by its condition number.
struct TransformKind {
    name: &'static str,
    title: &'static str,
    scale: fn(f64) -> [f64; 3],
    /// x moves by so many y.
    shear: fn(f64) -> f64,
}

const KINDS: [TransformKind; 3] = [
    TransformKind {
        name: "stretched",
        title: "Instances stretched along one axis and turned",
        scale: |condition| [1.0, 1.0, condition],
        shear: |_| 0.0,
    },
    TransformKind {
        name: "mirrored",
        title: "Instances mirrored, squeezed along one axis and turned",
        scale: |condition| [-1.0, 1.0, 1.0 / condition],
        shear: |_| 0.0,
    },
    TransformKind {
        name: "sheared",
        title: "Instances sheared and turned",
        scale: |_| [1.0; 3],
        shear: |condition| condition.sqrt(),
    },
];

/// Two turns about axes, in between stretched or sheared; moved a little.
fn transform(kind: &TransformKind, condition: f64) -> [f32; 12] {
    // By rows; so a product is written from right to left.
    const FIRST: DMat3 =
        DMat3::from_cols_array_2d(&[[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]);
    const SECOND: DMat3 =
        DMat3::from_cols_array_2d(&[[1.0, 0.0, 0.0], [0.0, 0.28, -0.96], [0.0, 0.96, 0.28]]);
    let (scale, shear) = ((kind.scale)(condition), (kind.shear)(condition));
    let middle = DMat3::from_cols_array_2d(&[
        [scale[0], shear, 0.0],
        [0.0, scale[1], 0.0],
        [0.0, 0.0, scale[2]],
    ]);
    let m = SECOND * middle * FIRST;
    std::array::from_fn(|i| match i % 4 {
        3 => 0.5 + (i / 4) as f32,
        column => m.col(i / 4)[column] as f32,
    })
}

fn rows_of(m: &[f32; 12]) -> [DVec3; 3] {
    [0, 4, 8].map(|first| wide([m[first], m[first + 1], m[first + 2]]))
}

fn inverse(m: &[f32; 12]) -> [DVec3; 3] {
    let [a, b, c] = rows_of(m);
    let columns = [b.cross(c), c.cross(a), a.cross(b)];
    let determinant = a.dot(columns[0]);
    [0, 1, 2].map(|i| DVec3::from(columns.map(|column| column[i])) / determinant)
}

/// The way of a simple tracer: the ray through the rounded inverse, in f32.
fn into_object(m: &[f32; 12], ray: &Ray) -> Ray {
    let inverse = inverse(m).map(narrow);
    let turn = |v: [f32; 3]| -> [f32; 3] {
        std::array::from_fn(|i| inverse[i][0] * v[0] + inverse[i][1] * v[1] + inverse[i][2] * v[2])
    };
    let from = std::array::from_fn(|i| ray.origin[i] - m[4 * i + 3]);
    Ray {
        origin: turn(from),
        direction: turn(ray.direction),
        ..*ray
    }
}

pub fn measure(options: &Options, report: &mut Report) -> Result<()> {
    let count = if options.quick { 200 } else { 2_000 };
    let mesh = Mesh::icosphere(3, true, |p| p);
    let triangles: Vec<_> = (0..mesh.indices.len()).map(|i| mesh.triangle(i)).collect();
    for kind in &KINDS {
        let mut map = Map::new(kind.name, kind.title, "condition number", &ROWS);
        for power in 0..=7 {
            let condition = 10f64.powi(power);
            let placed = transform(kind, condition);
            let scene = Scene::placed(std::slice::from_ref(&mesh), 0, placed);
            let mut walkers = [Accuracy::Spec, Accuracy::Exact].map(|accuracy| {
                let options = WalkOptions {
                    accuracy,
                    ..WalkOptions::default()
                };
                Walker::with(options).expect("the best tier is available")
            });
            let mut random = Random(0x5555_1234_9876);
            let mut wrong = [0usize; ROWS.len()];
            for _ in 0..count {
                let (aimed, t) = aim(&mesh, &placed, &mut random);
                // Within what rounding of a transformed origin may move it.
                let answers = [
                    Test::MollerTrumbore.nearest(&into_object(&placed, &aimed), triangles.iter()),
                    Test::Woop.nearest(&into_object(&placed, &aimed), triangles.iter()),
                ];
                let distances = answers.map(|found| found.map(|(_, (t, _))| t));
                let [spec, exact] = &mut walkers;
                let walked = [spec, exact]
                    .map(|walker| closest_with(walker, &scene.top, &aimed).map(|hit| hit.t));
                for (wrong, found) in wrong.iter_mut().zip(distances.into_iter().chain(walked)) {
                    *wrong += usize::from(fault(found, Some(t)).is_some());
                }
            }
            map.column(
                report,
                short(condition),
                &wrong.map(|wrong| Some((wrong, count))),
            );
        }
        map.save(options, report)?;
    }
    Ok(())
}

/// A ray at a point of the mesh as it is placed, from two units of the object's space outside along
/// a way near the normal; and where it meets the mesh, by f64.
fn aim(mesh: &Mesh, placed: &[f32; 12], random: &mut Random) -> (Ray, f64) {
    loop {
        let index = (random.unit() * mesh.indices.len() as f64) as usize;
        let corners = mesh.triangle(index).map(wide);
        let (u, v) = (0.1 + 0.4 * random.unit(), 0.1 + 0.4 * random.unit());
        let target = corners[0] * (1.0 - u - v) + corners[1] * u + corners[2] * v;
        let (normal, tilt) = (normalize(target), random.direction());
        let from = target + 2.0 * (0.9 * normal + 0.4 * tilt);
        let origin = narrow(apply(placed, from, 1.0));
        let aimed = ray(origin, narrow(apply(placed, target, 1.0) - wide(origin)));
        // The truth: the triangles where they are in the world.
        let mut best: Option<f64> = None;
        for number in 0..mesh.indices.len() {
            let [a, b, c] = mesh.triangle(number).map(|p| apply(placed, wide(p), 1.0));
            if let Some(t) = intersect(&aimed, a, b, c)
                && best.is_none_or(|best| t < best)
            {
                best = Some(t);
            }
        }
        if let Some(t) = best
            && (t - 1.0).abs() < 0.5 + TOLERANCE
        {
            return (aimed, t);
        }
    }
}

fn intersect(ray: &Ray, a: DVec3, b: DVec3, c: DVec3) -> Option<f64> {
    let (origin, direction) = (wide(ray.origin), wide(ray.direction));
    let (first, second) = (b - a, c - a);
    let p = direction.cross(second);
    let determinant = first.dot(p);
    let s = origin - a;
    let q = s.cross(first);
    let (u, v) = (s.dot(p) / determinant, direction.dot(q) / determinant);
    let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
    inside.then(|| second.dot(q) / determinant)
}
