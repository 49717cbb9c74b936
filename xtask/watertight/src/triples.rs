//! Two triangles with a common edge, and a ray that meets the edge as nearly as numbers can say.

use traversal::Ray;

use scenes::closed::Faults;
use scenes::exact;
use scenes::ways::walkers;
use scenes::*;

pub const KINDS: [&str; 6] = [
    "through an edge",
    "through a vertex",
    "whole numbers",
    "both nearly in the ray's plane",
    "of all sizes",
    "needles",
];

/// Distances that f32 can say without getting near its ends.
const DISTANCES: std::ops::Range<f64> = 1e-30..1e30;

struct Case {
    quad: [[f32; 3]; 4],
    ray: Ray,
}

fn size(random: &mut Random, low: f64, high: f64) -> f64 {
    10f64.powf(low + (high - low) * random.unit())
}

fn case(kind: usize, random: &mut Random) -> Case {
    if kind == 2 {
        let mut small = |range: f64| [0; 3].map(|_| (random.signed() * range).round() as f32);
        return Case {
            quad: [small(4.0), small(4.0), small(4.0), small(4.0)],
            ray: ray(small(4.0), small(3.0)),
        };
    }
    let scale = if kind == 4 {
        size(random, -12.0, 12.0)
    } else {
        1.0
    };
    let mut point = |spread: f64| {
        let scale = if kind == 4 {
            scale * size(random, -6.0, 6.0)
        } else {
            1.0
        };
        random.vector() * scale * spread
    };
    let [p, q, mut c, mut d] = [point(1.0), point(1.0), point(1.0), point(1.0)];
    let reach = size(random, -3.0, 2.0);
    let away = random.vector();
    let [p, q] = match kind {
        // A thousandth to a millionth as wide as long.
        5 => {
            let thin = size(random, -6.0, -3.0);
            let beside = random.vector();
            c = p + thin * beside;
            d = q - thin * away;
            [p, q]
        }
        _ => [p, q],
    };
    let [p, q] = [p, q].map(narrow);
    let weight = match kind {
        1 => 0.0,
        5 => size(random, -6.0, 0.0),
        _ => random.unit(),
    };
    let [start, end] = [p, q].map(wide);
    let aim = start + weight * (end - start);
    let far = if kind == 4 { scale } else { 1.0 };
    let origin = narrow(aim + reach * far * away);
    let mut direction = narrow(aim - wide(origin));
    if random.unit() < 0.25 {
        direction[(random.unit() * 3.0) as usize] = 0.0;
    }
    if kind == 3 {
        // In the plane of the ray and the edge, except for rounding.
        let way = end - start;
        for vertex in [&mut c, &mut d] {
            let [along, across] = [random.signed(), random.signed()];
            *vertex = aim + along * way + across * wide(direction);
        }
    }
    Case {
        quad: [p, q, narrow(c), narrow(d)],
        ray: ray(origin, direction),
    }
}

/// Candidates and hits of so many pairs, against whole numbers.
pub fn faults(kind: usize, seed: u64, count: usize) -> Faults {
    let mut random = Random(seed);
    let mut walkers: Vec<_> = walkers();
    let mut faults = Faults::default();
    while faults.rays < count as u64 {
        let Case { quad, ray } = case(kind, &mut random);
        if ray.direction == [0.0; 3] {
            continue;
        }
        let non_opaque = Mesh {
            vertices: quad.to_vec(),
            indices: vec![[0, 1, 2], [1, 0, 3]],
            opaque: false,
        };
        let one = |index: usize| Mesh {
            indices: vec![non_opaque.indices[index]],
            ..non_opaque.clone()
        };
        let pair = [one(0), one(1)];
        let met = [0, 1].map(|i| exact::intersect(&ray, &non_opaque.triangle(i)));
        let ordinary = |t: f64| t <= 0.0 || DISTANCES.contains(&t);
        if !met.iter().flatten().all(|crossing| ordinary(crossing.t)) {
            continue;
        }
        faults.rays += 1;
        faults.checked += 1;
        let crossed: Vec<u32> = (0..2)
            .filter(|&i| exact::crossings(&pair[i as usize], &ray) != 0)
            .collect();
        let truth = met.iter().flatten().map(|crossing| crossing.t);
        let truth = truth.filter(|&t| t > 0.0).min_by(f64::total_cmp);
        let solid = Mesh {
            opaque: true,
            ..non_opaque.clone()
        };
        let [solid, non_opaque] = [solid, non_opaque].map(|mesh| Scene::new(&[mesh], 0));
        for (name, walker) in &mut walkers {
            let hit = closest_with(walker, &solid.top, &ray);
            let wrong = match (hit, truth) {
                (None, None) => false,
                (Some(hit), Some(truth)) => {
                    (f64::from(hit.t) - truth).abs() > 65.0 * f64::from(f32::EPSILON) * truth
                }
                _ => true,
            };
            let found = candidates_with(walker, &non_opaque.top, &ray);
            let mut found: Vec<u32> = found.iter().map(|hit| hit.primitive_index).collect();
            found.sort_unstable();
            let miscounted = found != crossed;
            if wrong || miscounted {
                println!("{name}: {hit:?} {found:?}, not {truth:?} {crossed:?}: {quad:?} {ray:?}");
            }
            faults.lost += u64::from(truth.is_some() && hit.is_none());
            faults.wrong += u64::from(wrong);
            faults.miscounted += u64::from(miscounted);
        }
    }
    faults
}
