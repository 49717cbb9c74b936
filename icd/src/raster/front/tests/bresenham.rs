//! Bresenham lines against the diamond rule, evaluated with ends moved by real ε's.

use std::collections::BTreeSet;

use ash::vk;

use super::*;
use crate::raster::primitive::Coverage;

/// Units of a fixed-point unit: ε is 2⁻²⁰ of them, its square 2⁻⁴⁰.
const SCALE: i128 = 1 << 40;

/// Whether the open diamond around a centre meets the segment; `None` if the segment lies beside
/// it.
fn crosses(from: [i128; 2], to: [i128; 2], center: [i128; 2]) -> bool {
    // |x| + |y| < half: four half-planes. The part of the segment inside is where all distances are positive.
    let half = 128 * SCALE;
    let (mut low, mut high) = ((0i128, 1i128), (1i128, 1i128));
    // Fractions with positive denominators.
    let less = |a: (i128, i128), b: (i128, i128)| {
        // Products have up to 2 × 60 bits.
        a.0 * b.1 < b.0 * a.1
    };
    for [sx, sy] in [[1, 1], [1, -1], [-1, 1], [-1, -1]] {
        let distance = |p: [i128; 2]| half - (sx * (p[0] - center[0]) + sy * (p[1] - center[1]));
        let (a, b) = (distance(from), distance(to));
        match (a > 0, b > 0) {
            (true, true) => {}
            (false, false) => return false,
            (true, false) => {
                let t = (a, a - b);
                if less(t, high) {
                    high = t;
                }
            }
            (false, true) => {
                let t = (-a, b - a);
                if less(low, t) {
                    low = t;
                }
            }
        }
    }
    less(low, high)
}

fn inside(p: [i128; 2], center: [i128; 2]) -> bool {
    (p[0] - center[0]).abs() + (p[1] - center[1]).abs() < 128 * SCALE
}

fn reference(from: [i64; 2], to: [i64; 2]) -> BTreeSet<(i16, i16)> {
    let epsilon = SCALE >> 20;
    let moved = |p: [i64; 2]| {
        [
            i128::from(p[0]) * SCALE - epsilon,
            i128::from(p[1]) * SCALE - ((epsilon * epsilon) >> 40),
        ]
    };
    let (from, to) = (moved(from), moved(to));
    let mut pixels = BTreeSet::new();
    for y in 0..SIDE as i16 {
        for x in 0..SIDE as i16 {
            let center = [x, y].map(|c| (i128::from(c) * 256 + 128) * SCALE);
            if crosses(from, to, center) && !inside(to, center) {
                pixels.insert((x, y));
            }
        }
    }
    pixels
}

fn drawn(facts: &Facts, from: [i64; 2], to: [i64; 2]) -> Vec<(i16, i16)> {
    let place = |p: [i64; 2]| at(p[0] as f64, p[1] as f64, 0.5, 1.0);
    let positions = [place(from), place(to), place(to)];
    let chunk = set_up_with(
        facts,
        positions,
        Default::default(),
        |set_up, primitive, corners| set_up.line(primitive, corners, [0, 1], true, 0.0),
    );
    let mut pixels = Vec::new();
    for shape in &chunk.shapes {
        let Coverage::Pixels { first, count, .. } = shape.coverage else {
            panic!("a list of pixels");
        };
        let listed = &chunk.pixels[first as usize..(first + count) as usize];
        pixels.extend(listed.iter().map(|[x, y]| (*x, *y)));
    }
    pixels
}

fn bresenham_state() -> GraphicsState {
    let mut state = state();
    state.rasterization.line_mode = vk::LineRasterizationModeEXT::BRESENHAM;
    state
}

#[test]
fn pixels_are_those_whose_diamonds_are_left() {
    let facts = facts(&bresenham_state(), 1);
    let mut random = Random::with_seed(30);
    for round in 0..3000 {
        // On centres, corners, diamonds' edges, and anywhere.
        let step = [128, 64, 32, 1][round % 4];
        let reach = if round % 3 == 0 { 6 * 256 } else { 24 * 256 };
        let mut place = || {
            let start = 20 * 256;
            [0, 1].map(|_| start + random.i64(0..=reach / step) * step)
        };
        let (from, mut to) = (place(), place());
        match round % 5 {
            0 => to[1] = from[1],
            1 => to[0] = from[0],
            2 => to[1] = from[1] + (to[0] - from[0]).clamp(-20 * 256, 19 * 256),
            _ => {}
        }
        to[1] = to[1].clamp(0, 60 * 256);
        let pixels = drawn(&facts, from, to);
        let set: BTreeSet<_> = pixels.iter().copied().collect();
        assert_eq!(set.len(), pixels.len(), "{from:?} {to:?}: twice");
        assert_eq!(set, reference(from, to), "{from:?} {to:?}");
    }
}

#[test]
fn strips_draw_their_corners_once() {
    // Of a closed strip of lines in one direction, each pixel where two lines meet belongs to one
    // of them.
    let facts = facts(&bresenham_state(), 1);
    let mut random = Random::with_seed(31);
    for _ in 0..300 {
        let mut place = [256 * 4 + 128, 256 * 30 + 128];
        let mut all = Vec::new();
        for _ in 0..5 {
            let next = [
                place[0] + random.i64(300..=2500),
                place[1] + random.i64(-290..=290),
            ];
            all.extend(drawn(&facts, place, next));
            place = next;
        }
        let set: BTreeSet<_> = all.iter().copied().collect();
        assert_eq!(set.len(), all.len());
        // One in each column.
        let columns: BTreeSet<_> = all.iter().map(|pixel| pixel.0).collect();
        assert_eq!(columns.len(), all.len());
    }
}

#[test]
fn patterns_leave_pixels_out() {
    let mut state = bresenham_state();
    state.rasterization.line_stipple = true;
    state.rasterization.line_stipple_factor = 2;
    state.rasterization.line_stipple_pattern = 0b1011;
    let facts = facts(&state, 1);
    let (from, to) = ([128, 2688], [40 * 256 + 128, 2688]);
    let pixels = drawn(&facts, from, to);
    let expected: Vec<(i16, i16)> = (0..40)
        .filter(|x| 0b1011u16 >> (x / 2 % 16) & 1 != 0)
        .map(|x| (x, 10))
        .collect();
    assert_eq!(pixels, expected);
    // Backwards, the pattern starts at the other end.
    let pixels: BTreeSet<_> = drawn(&facts, to, from).into_iter().collect();
    let expected: BTreeSet<(i16, i16)> = (0..40)
        .filter(|x| 0b1011u16 >> (x / 2 % 16) & 1 != 0)
        .map(|x| (40 - x, 10))
        .collect();
    assert_eq!(pixels, expected);
}
