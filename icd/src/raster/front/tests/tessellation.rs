//! The tessellator, in whole numbers: the pieces cover the domain once, shared edges agree, and
//! the count of primitives is foretold.

use std::collections::HashMap;

use spirv_jit::program::{Domain, Spacing};

use super::super::tessellate::{Subdivision, Tessellation};
use super::Random;

const SPACINGS: [Spacing; 3] = [
    Spacing::Equal,
    Spacing::FractionalEven,
    Spacing::FractionalOdd,
];

/// Parts of a coordinate in whole numbers. Those inside of triangles are thirds, rounded.
const PARTS: f64 = (3 << 22) as f64;

/// Coordinates u and v as whole numbers.
fn whole(coordinate: [f32; 3]) -> [i64; 2] {
    [coordinate[0], coordinate[1]].map(|it| (f64::from(it) * PARTS).round() as i64)
}

fn triangles(made: &Tessellation) -> impl Iterator<Item = [u16; 3]> + '_ {
    made.vertices.as_chunks::<3>().0.iter().copied()
}

fn level(random: &mut Random) -> f32 {
    match random.u32(..8) {
        0 => random.f32(),
        1 => [f32::NAN, f32::INFINITY, 1e30, 64.0][random.usize(..4)],
        2 => random.u32(1..66) as f32,
        3 => 1.0 + random.f32() * 1e-6,
        _ => random.f32() * 66.0,
    }
}

/// Levels that discard nothing.
fn levels(random: &mut Random) -> ([f32; 4], [f32; 2]) {
    let mut outer = [0; 4].map(|_| level(random));
    for level in &mut outer {
        if level.is_nan() || *level <= 0.0 {
            *level = 1.0;
        }
    }
    (outer, [0; 2].map(|_| level(random)))
}

/// Twice the area of a triangle.
fn area([a, b, c]: [[i64; 2]; 3]) -> i64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Each edge inside the domain has two triangles, which go along it in opposite directions; those
/// on its border have one. No triangle is turned about, and all of them together have the area of
/// the domain: so they cover it once.
#[test]
fn triangles_cover_the_domain_once() {
    let mut random = Random::with_seed(1);
    for round in 0..400 {
        let spacing = SPACINGS[round % 3];
        let domain = [Domain::Triangles, Domain::Quads][round % 2];
        let (outer, inner) = levels(&mut random);
        let subdivision = Subdivision::new(domain, spacing, outer, inner).unwrap();
        let made = subdivision.tessellate(false, false);
        let what = format!("{domain:?} {spacing:?} {outer:?} {inner:?}");
        assert_eq!(made.corners, 3);
        let count = triangles(&made).count() as u32;
        assert_eq!(count, subdivision.primitives(false), "{what}");
        let points = subdivision.tessellate(true, false);
        let count = points.vertices.len() as u32;
        assert_eq!(count, subdivision.primitives(true), "{what}");
        let mut edges: HashMap<[u16; 2], i32> = HashMap::new();
        let mut sum = 0;
        for triangle in triangles(&made) {
            let corners = triangle.map(|vertex| whole(made.coordinates[usize::from(vertex)]));
            let area = area(corners);
            // Thirds are rounded: a sliver may be turned about by that much.
            assert!(area >= -(1 << 24), "{what}: {triangle:?}");
            sum += area;
            for corner in 0..3 {
                let (from, to) = (triangle[corner], triangle[(corner + 1) % 3]);
                assert_ne!(from, to, "{what}");
                *edges.entry([from.min(to), from.max(to)]).or_default() +=
                    if from < to { 1 } else { -1 };
            }
        }
        let side = PARTS as i64;
        let whole_area = match domain {
            Domain::Quads => 2 * side * side,
            _ => side * side,
        };
        assert_eq!(sum, whole_area, "{what}");
        // The border: once around.
        let border: u32 = edges.values().map(|count| count.unsigned_abs()).sum();
        // Inner levels of 1 may put other vertices there.
        if inner.iter().all(|level| *level > 1.0) {
            let around = subdivision_border(&made, domain);
            assert_eq!(border as usize, around, "{what}");
        }
    }
}

/// Vertices on the border of the domain that are its first ones: the way around.
fn subdivision_border(made: &Tessellation, domain: Domain) -> usize {
    let on_border = |coordinate: &&[f32; 3]| match domain {
        Domain::Quads => coordinate[..2].iter().any(|it| *it == 0.0 || *it == 1.0),
        _ => coordinate.contains(&0.0),
    };
    made.coordinates.iter().take_while(on_border).count()
}

/// The places of the vertices on a side of the domain.
fn on_side(made: &Tessellation, domain: Domain, side: usize) -> Vec<u32> {
    let mut places: Vec<u32> = (made.coordinates.iter())
        .filter_map(|&[u, v, w]| match (domain, side) {
            (Domain::Triangles, 0) => (u == 0.0).then_some((v, w)),
            (Domain::Triangles, 1) => (v == 0.0).then_some((w, u)),
            (Domain::Triangles, _) => (w == 0.0).then_some((u, v)),
            (_, 0) => (u == 0.0).then_some((v, 1.0 - v)),
            (_, 1) => (v == 0.0).then_some((u, 1.0 - u)),
            (_, 2) => (u == 1.0).then_some((v, 1.0 - v)),
            (_, _) => (v == 1.0).then_some((u, 1.0 - u)),
        })
        .map(|(from, to)| {
            // 1 − u is exact, so that a neighbour may go along the side the other way.
            assert_eq!(from.to_bits(), (1.0 - to).to_bits());
            assert_eq!(to.to_bits(), (1.0 - from).to_bits());
            from.to_bits()
        })
        .collect();
    places.sort_unstable();
    places.dedup();
    places
}

/// Sides with one level have the same vertices, bit for bit, whatever the domain, the side, the
/// direction and the other levels.
#[test]
fn shared_edges_agree() {
    let mut random = Random::with_seed(2);
    for round in 0..100 {
        let spacing = SPACINGS[round % 3];
        let shared = level(&mut random).abs().max(0.5);
        let mut expected = None;
        for (domain, sides) in [(Domain::Triangles, 3), (Domain::Quads, 4)] {
            for side in 0..sides {
                let (mut outer, mut inner) = levels(&mut random);
                outer[side] = shared;
                // Inner levels of 1 may put vertices on the sides.
                inner = inner.map(|level| level.max(1.5));
                let made = Subdivision::new(domain, spacing, outer, inner).unwrap();
                let made = made.tessellate(false, false);
                let places = on_side(&made, domain, side);
                let mirrored: Vec<u32> = (places.iter().rev())
                    .map(|it| (1.0 - f32::from_bits(*it)).to_bits())
                    .collect();
                assert_eq!(places, mirrored);
                let expected = expected.get_or_insert_with(|| places.clone());
                assert_eq!(*expected, places, "{domain:?} {spacing:?} {side} {shared}");
            }
        }
    }
}

/// The specification's rules of clamping and rounding, by the vertices of isolines.
#[test]
fn levels_are_clamped_and_rounded() {
    let segments = |spacing, level| {
        let outer = [1.0, level, 0.0, 0.0];
        let made = Subdivision::new(Domain::Isolines, spacing, outer, [0.0; 2]).unwrap();
        assert_eq!(made.primitives(false) + 1, made.primitives(true));
        made.primitives(false)
    };
    for (level, equal, even, odd) in [
        (1e-30, 1, 2, 1),
        (1.0, 1, 2, 1),
        (1.5, 2, 2, 3),
        (2.0, 2, 2, 3),
        (2.0001, 3, 4, 3),
        (3.0, 3, 4, 3),
        (3.5, 4, 4, 5),
        (62.5, 63, 64, 63),
        (64.0, 64, 64, 63),
        (1e9, 64, 64, 63),
        (f32::INFINITY, 64, 64, 63),
    ] {
        assert_eq!(segments(Spacing::Equal, level), equal, "{level}");
        assert_eq!(segments(Spacing::FractionalEven, level), even, "{level}");
        assert_eq!(segments(Spacing::FractionalOdd, level), odd, "{level}");
    }
    // Lines have equal distances with any spacing, and none has v = 1.
    let outer = [4.5, 1.0, 0.0, 0.0];
    for spacing in SPACINGS {
        let made = Subdivision::new(Domain::Isolines, spacing, outer, [0.0; 2]).unwrap();
        let made = made.tessellate(false, false);
        let mut lines: Vec<f32> = made.coordinates.iter().map(|it| it[1]).collect();
        lines.dedup();
        let near = |(line, k): (&f32, u8)| (line - f32::from(k) / 5.0).abs() < 1e-6;
        assert_eq!(lines.len(), 5);
        assert!(lines.iter().zip(0..).all(near));
    }
}

/// The places of a fractional level, in f64, as the Direct3D 11 reference tessellator has them
/// (`PlacePointIn1D`).
fn reference_places(is_odd: bool, level: f64) -> Vec<f64> {
    let half = level / 2.0 + if is_odd { 0.5 } else { 0.0 };
    let (floor, ceil) = (half.floor(), half.ceil());
    let points = ceil as u32;
    let without_high_bit = |it: u32| it & !(1 << it.ilog2());
    let split = match floor as u32 {
        1 if is_odd => 0,
        it if is_odd => without_high_bit(it - 1) * 2 + 1,
        it => without_high_bit(it) * 2 + 1,
    };
    let odd = f64::from(u8::from(is_odd));
    let place = |point: u32| {
        let on_floor = point - u32::from(ceil != floor && point > split);
        let [on_floor, on_ceil] = [(on_floor, floor), (point, ceil)]
            .map(|(point, half)| f64::from(point) / (2.0 * half - odd));
        on_floor + (on_ceil - on_floor) * (half - floor)
    };
    let segments = 2 * points - u32::from(is_odd);
    let mirrored = |point| match 2 * point <= segments {
        true => place(point),
        false => 1.0 - place(segments - point),
    };
    (0..=segments).map(mirrored).collect()
}

/// Edges of fractional levels have the vertices of Direct3D's tessellator: all segments but two
/// have one length, and two that are as long as each other are shorter.
#[test]
fn fractional_levels_have_the_places_of_direct3d() {
    let mut random = Random::with_seed(3);
    let whole = (1..=64).map(|level| level as f32);
    let levels: Vec<f32> = whole.chain((0..500).map(|_| level(&mut random))).collect();
    for (spacing, least, most) in [
        (Spacing::FractionalOdd, 1.0, 63.0),
        (Spacing::FractionalEven, 2.0, 64.0),
    ] {
        for &level in &levels {
            let made =
                Subdivision::new(Domain::Isolines, spacing, [1.0, level, 0.0, 0.0], [0.0; 2]);
            let Some(made) = made else { continue };
            let made = made.tessellate(false, false);
            let places: Vec<f64> = made.coordinates.iter().map(|it| it[0].into()).collect();
            let clamped = f64::from(level.clamp(least, most));
            let expected = reference_places(spacing == Spacing::FractionalOdd, clamped);
            assert_eq!(places.len(), expected.len(), "{spacing:?} {level}");
            for (place, expected) in places.iter().zip(&expected) {
                assert!(
                    (place - expected).abs() < 3e-7,
                    "{spacing:?} {level}: {places:?}"
                );
            }
            let mut lengths: Vec<f64> = expected.windows(2).map(|it| it[1] - it[0]).collect();
            lengths.sort_by(f64::total_cmp);
            let equal = lengths.get(2..).unwrap_or_default();
            assert!(
                equal.iter().all(|it| it - equal[0] < 1e-9),
                "{spacing:?} {level}"
            );
        }
    }
    // A level of 2 lies in the middle between one and three segments.
    assert_eq!(
        reference_places(true, 2.0),
        [0.0, 1.0 / 6.0, 5.0 / 6.0, 1.0]
    );
}

/// A patch with a relevant outer level that is not greater than zero is discarded.
#[test]
fn patches_are_discarded() {
    for (domain, relevant) in [
        (Domain::Isolines, 2),
        (Domain::Triangles, 3),
        (Domain::Quads, 4),
    ] {
        for index in 0..4 {
            for level in [0.0, -0.0, -3.0, f32::NAN, f32::NEG_INFINITY] {
                let mut outer = [2.0; 4];
                outer[index] = level;
                let made = Subdivision::new(domain, Spacing::Equal, outer, [f32::NAN; 2]);
                assert_eq!(
                    made.is_none(),
                    index < relevant,
                    "{domain:?} {index} {level}"
                );
            }
        }
    }
}

/// The least and the greatest patches are as large as the specification says.
#[test]
fn counts_are_as_written() {
    let count = |domain, outer, inner| {
        let made = Subdivision::new(domain, Spacing::Equal, [outer; 4], [inner; 2]).unwrap();
        (made.primitives(false), made.primitives(true))
    };
    assert_eq!(count(Domain::Triangles, 1.0, 1.0), (1, 3));
    assert_eq!(count(Domain::Quads, 1.0, f32::NAN), (2, 4));
    // An inner level of 1 counts as a little more than 1.
    assert_eq!(count(Domain::Triangles, 2.0, 1.0), (6, 7));
    assert_eq!(count(Domain::Quads, 2.0, 0.0), (8, 9));
    assert_eq!(count(Domain::Quads, 1e9, 1e9), (8192, 65 * 65));
    assert_eq!(count(Domain::Triangles, 64.0, 64.0), (6144, 3169));
}

/// Direct3D divides an undivided quad along the diagonal from (1, 0) to (0, 1).
#[test]
fn whole_quads_have_the_diagonal_of_direct3d() {
    let quad = Subdivision::new(Domain::Quads, Spacing::Equal, [1.0; 4], [1.0; 2]);
    let made = quad.expect("no level is zero").tessellate(false, false);
    let corners = |it: [u16; 3]| it.map(|it| made.coordinates[it as usize]);
    let corners: Vec<_> = triangles(&made).map(corners).collect();
    let [low, right, up, high] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    assert_eq!(corners, [[low, right, up], [right, high, up]]);
}
