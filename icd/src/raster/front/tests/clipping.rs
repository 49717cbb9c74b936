//! Clipping changes coverage alone: planes are those of the whole primitive.

use super::*;
use crate::raster::primitive::{PlaneEquation, Record};

fn value(plane: &PlaneEquation, record: &Record, x: f64, y: f64) -> f64 {
    let [dx, dy] = [
        x - f64::from(record.origin[0]) - 0.5,
        y - f64::from(record.origin[1]) - 0.5,
    ];
    f64::from(plane.at) + f64::from(plane.dx) * dx + f64::from(plane.dy) * dy
}

#[test]
fn planes_of_clipped_triangles_are_those_of_whole_ones() {
    let mut random = Random::with_seed(20);
    let facts = facts(&state(), 1);
    let mut compared = 0;
    for _ in 0..500 {
        let positions: [Clip; 3] = std::array::from_fn(|_| {
            let place = [0, 1].map(|_| random.i64(0..=64 * 256) as f64);
            at(place[0], place[1], random.f64(), 0.5 + 4.0 * random.f64())
                .map(|value| f64::from(value as f32))
        });
        let whole = triangle(&facts, positions);
        // A clip distance cuts a corner off; another one leaves all.
        let distances = [[-1.0, 1.0], [1.0, 2.0], [1.5, 1.0]]
            .map(|[first, second]| [first, second, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let cut = set_up_with(
            &facts,
            positions,
            distances,
            |set_up, primitive, corners| {
                set_up.triangle(primitive, corners);
            },
        );
        let (Some(whole_record), Some(cut_record)) = (whole.records.first(), cut.records.first())
        else {
            continue;
        };
        // Only where planes start may differ.
        let differ = |a: &PlaneEquation, b: &PlaneEquation| {
            a.dx.to_bits() != b.dx.to_bits() || a.dy.to_bits() != b.dy.to_bits()
        };
        assert!(!differ(&whole_record.depth, &cut_record.depth));
        for i in 0..3 {
            let (a, b) = (&whole_record.perspective[i], &cut_record.perspective[i]);
            assert!(!differ(a, b));
            let linear = (whole.linear_of(whole_record), cut.linear_of(cut_record));
            assert!(!differ(&linear.0[i], &linear.1[i]));
        }
        compared += 1;
    }
    assert!(compared > 400);
}

#[test]
fn planes_of_triangles_that_pass_the_camera_are_right() {
    let mut random = Random::with_seed(21);
    let facts = facts(&state(), 1);
    let mut compared = 0;
    for round in 0..2000 {
        let mut positions: [Clip; 3] = std::array::from_fn(|_| {
            std::array::from_fn(|axis| match axis {
                2 => random.f64() * 0.5,
                3 => 0.6 + random.f64(),
                _ => random.f64() * 4.0 - 2.0,
            })
        });
        // Behind the camera.
        positions[round % 3][3] = -1.0 - random.f64();
        positions[round % 3][2] = -0.2;
        let positions = positions.map(|p| p.map(|value| f64::from(value as f32)));
        let chunk = triangle(&facts, positions);
        let Some(record) = chunk.records.first() else {
            continue;
        };
        for _ in 0..20 {
            let mut shares = [0, 1, 2].map(|_| random.f64());
            let sum: f64 = shares.iter().sum();
            shares = shares.map(|share| share / sum);
            let point: Clip =
                std::array::from_fn(|axis| (0..3).map(|i| shares[i] * positions[i][axis]).sum());
            let [x, y, z, w] = point;
            let visible = w > 0.2 && z > 0.01 && z < w && x.abs() < w && y.abs() < w;
            if !visible {
                continue;
            }
            let place = [x, y].map(|c| (c / w + 1.0) / 2.0 * f64::from(SIDE));
            let planes = record
                .perspective
                .map(|plane| value(&plane, record, place[0], place[1]));
            let sum: f64 = planes.iter().sum();
            // Corners move by up to half a fixed-point unit.
            let steep = record
                .perspective
                .iter()
                .map(|plane| f64::from(plane.dx.abs() + plane.dy.abs()))
                .sum::<f64>();
            let tolerance = 1e-3 + steep / 64.0;
            assert!((sum - 1.0 / w).abs() < tolerance, "1 / w: {sum} {w}");
            for i in 0..3 {
                let difference = planes[i] - shares[i] / w;
                assert!(difference.abs() < tolerance, "{difference} {tolerance}");
            }
            let depth = value(&record.depth, record, place[0], place[1]);
            assert!((depth - z / w).abs() < tolerance);
            // The pixel's sample, if it is away from the edges, is covered; other places are
            // outside of what bounds say.
            let sample = place.map(|c| c.floor() + 0.5);
            let at = |plane| value(plane, record, sample[0], sample[1]);
            let within = record.perspective.iter().all(|plane| at(plane) > 0.1);
            if within && (0.01..0.99).contains(&at(&record.depth)) && steep < 0.5 {
                let [x, y] = sample.map(|c| (c * 256.0) as i64);
                assert_eq!(coverage(&chunk, x, y), 1);
                compared += 1;
            }
        }
    }
    assert!(compared > 200, "{compared}");
}

#[test]
fn barycentric_coordinates_are_within_what_is_covered() {
    // Slivers, with corners between the places that positions snap to: coordinates are of what is
    // drawn, not of what was meant.
    let mut random = Random::with_seed(22);
    let facts = facts(&state(), 1);
    let mut compared = 0;
    for _ in 0..3000 {
        let base = [0, 1].map(|_| random.f64() * 16000.0);
        let positions: [Clip; 3] = std::array::from_fn(|_| {
            let spread = [9000.0, 60.0];
            let place: [f64; 2] =
                std::array::from_fn(|axis| base[axis] + random.f64() * spread[axis]);
            at(place[0], place[1], random.f64(), 1.0)
        });
        let chunk = triangle(&facts, positions);
        for shape in &chunk.shapes {
            let record = &chunk.records[shape.record as usize];
            let bounds = shape.bounds;
            for y in bounds.top..bounds.bottom {
                for x in bounds.left..bounds.right {
                    let (sample_x, sample_y) = (256 * i64::from(x) + 128, 256 * i64::from(y) + 128);
                    if !covers(&chunk, shape, sample_x, sample_y) {
                        continue;
                    }
                    for plane in chunk.linear_of(record) {
                        let share = value(plane, record, f64::from(x) + 0.5, f64::from(y) + 0.5);
                        assert!((-1e-3..=1.001).contains(&share), "{share}");
                        compared += 1;
                    }
                }
            }
        }
    }
    assert!(compared > 100, "{compared}");
}

#[test]
fn equal_depths_stay_equal() {
    let mut random = Random::with_seed(23);
    let facts = facts(&state(), 1);
    for _ in 0..200 {
        let depth = f64::from(random.f64() as f32);
        let positions: [Clip; 3] = std::array::from_fn(|_| {
            let place = [0, 1].map(|_| random.i64(0..=64 * 256) as f64);
            at(place[0], place[1], depth, 1.0)
        });
        for record in triangle(&facts, positions).records {
            assert_eq!(record.depth.at.to_bits(), (depth as f32).to_bits());
            assert_eq!((record.depth.dx, record.depth.dy), (0.0, 0.0));
        }
    }
}
