//! Coverage of triangles: every sample of a surface once, and the values of the vertices.

use ash::vk;

use super::*;
use crate::raster::primitive::Coverage;

/// Twice the area, in 128 bits.
fn area_of(a: [i64; 2], b: [i64; 2], c: [i64; 2]) -> i128 {
    let wide = |value: i64| i128::from(value);
    (wide(b[0]) - wide(a[0])) * (wide(c[1]) - wide(a[1]))
        - (wide(c[0]) - wide(a[0])) * (wide(b[1]) - wide(a[1]))
}

/// Each sample of the screen, by its fixed-point place.
fn samples(count: u32) -> impl Iterator<Item = [i64; 2]> {
    let pixels = 0..i64::from(SIDE);
    pixels.clone().flat_map(move |y| {
        pixels.clone().flat_map(move |x| {
            sample_places(count)
                .iter()
                .map(move |place| [256 * x + place[0], 256 * y + place[1]])
        })
    })
}

#[test]
fn a_triangle_covers_what_is_inside_and_nothing_outside() {
    let mut random = Random::with_seed(1);
    for round in 0..400 {
        let count = if round % 2 == 0 { 1 } else { 4 };
        let facts = facts(&state(), count);
        // Sometimes on a coarse grid, so that samples lie on edges, and sometimes small, or far
        // outside.
        let (grid, low, high) = match round % 4 {
            0 => (32, 0, 512),
            1 => (1, 0, 64 * 256),
            2 => (1, 4000, 4700),
            _ => (1, -2_000_000, 2_000_000),
        };
        let p: [[i64; 2]; 3] =
            std::array::from_fn(|_| std::array::from_fn(|_| random.i64(low..=high) * grid));
        let chunk = triangle(&facts, p.map(|[x, y]| at(x as f64, y as f64, 0.5, 1.0)));
        let whole = area_of(p[0], p[1], p[2]);
        for sample in samples(count) {
            let sides = [
                area_of(p[0], p[1], sample),
                area_of(p[1], p[2], sample),
                area_of(p[2], p[0], sample),
            ]
            .map(|side| side * whole.signum());
            let is_inside = whole != 0 && sides.iter().all(|side| *side > 0);
            let is_outside = whole == 0 || sides.iter().any(|side| *side < 0);
            let covered = coverage(&chunk, sample[0], sample[1]);
            if is_inside {
                assert_eq!(covered, 1, "{p:?} {sample:?}");
            }
            if is_outside {
                assert_eq!(covered, 0, "{p:?} {sample:?}");
            }
        }
    }
}

/// With one sample a pixel, a triangle by one or two centres is a shape exactly if it covers one of
/// them.
#[test]
fn small_triangles_are_shapes_if_they_cover_a_center() {
    let mut random = Random::with_seed(31);
    let facts = facts(&state(), 1);
    let [mut shapes, mut dropped] = [0, 0];
    for round in 0..20_000 {
        // On a coarse grid edges and corners meet centres.
        let grid = if round % 2 == 0 { 64 } else { 1 };
        let corner = [0, 1].map(|_| random.i64(0..i64::from(SIDE) - 2) * 256);
        let p: [[i64; 2]; 3] =
            std::array::from_fn(|_| corner.map(|from| from + random.i64(0..=400 / grid) * grid));
        let chunk = triangle(&facts, p.map(|[x, y]| at(x as f64, y as f64, 0.5, 1.0)));
        let centers =
            (0..4).map(|k| [corner[0] + 128 + k % 2 * 256, corner[1] + 128 + k / 2 * 256]);
        let whole = area_of(p[0], p[1], p[2]);
        let is_inside = |center: [i64; 2]| {
            (0..3).all(|k| area_of(p[k], p[(k + 1) % 3], center) * whole.signum() > 0)
        };
        if whole != 0 && centers.clone().any(is_inside) {
            assert_eq!(chunk.shapes.len(), 1, "{p:?}");
        }
        let few = |shape: &Shape| {
            let bounds = shape.bounds;
            (bounds.right - bounds.left) * (bounds.bottom - bounds.top) <= 2
        };
        for shape in chunk.shapes.iter().filter(|shape| few(shape)) {
            let mut covered = centers.clone();
            assert!(
                covered.any(|it| coverage(&chunk, it[0], it[1]) == 1),
                "{p:?} {shape:?}"
            );
            shapes += 1;
        }
        dropped += usize::from(whole != 0 && chunk.shapes.is_empty());
    }
    assert!(shapes > 1000 && dropped > 1000, "{shapes} {dropped}");
}

/// Draws a net of triangles over the screen, whose corners `place` gives for each node, and counts
/// how often each sample is covered.
fn covered_by_net(
    nodes: i64,
    samples_count: u32,
    facts: &Facts,
    place: &dyn Fn(i64, i64) -> Clip,
    flip: &mut dyn FnMut() -> bool,
) -> Vec<usize> {
    let mut counts = vec![0; samples(samples_count).count()];
    for y in 0..nodes {
        for x in 0..nodes {
            let corner = |dx: i64, dy: i64| place(x + dx, y + dy);
            let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
            let triangles = if flip() {
                [[a, b, c], [d, c, b]]
            } else {
                [[a, b, d], [c, a, d]]
            };
            for positions in triangles {
                let chunk = triangle(facts, positions);
                for (count, sample) in counts.iter_mut().zip(samples(samples_count)) {
                    *count += coverage(&chunk, sample[0], sample[1]);
                }
            }
        }
    }
    counts
}

#[test]
fn shared_edges_are_covered_once() {
    let mut random = Random::with_seed(2);
    for round in 0..6 {
        let count = if round % 2 == 0 { 1 } else { 4 };
        let facts = facts(&state(), count);
        // Nodes jittered by less than half a cell; those at the border reach past the screen.
        let nodes = 6;
        let cell = f64::from(SIDE) * 256.0 / (nodes - 2) as f64;
        let steps = if round < 3 { 8 } else { 1000 };
        let places: Vec<[f64; 2]> = (0..(nodes + 1) * (nodes + 1))
            .map(|index| {
                let mut jitter = || random.i64(-steps..=steps) as f64 / steps as f64 * cell * 0.25;
                let (x, y) = (index % (nodes + 1), index / (nodes + 1));
                [
                    (x - 1) as f64 * cell + jitter(),
                    (y - 1) as f64 * cell + jitter(),
                ]
            })
            .collect();
        let place = |x: i64, y: i64| {
            let [x, y] = places[(y * (nodes + 1) + x) as usize];
            at(x, y, 0.5, 1.0)
        };
        let mut flips = Random::with_seed(round + 10);
        let counts = covered_by_net(nodes, count, &facts, &place, &mut || flips.u64(..2) == 0);
        assert!(counts.iter().all(|count| *count == 1), "round {round}");
    }
}

#[test]
fn clipped_surfaces_are_covered_once() {
    // A plane that passes the camera: nodes are behind it, in front of the near plane, and beyond
    // the far one. It fills the screen's lower half and more; clipped at depth or not, no sample
    // that it covers is covered twice, and none inside is missed.
    let mut random = Random::with_seed(3);
    for clips in [true, false] {
        let mut state = state();
        state.rasterization.depth_clip = clips;
        let facts = facts(&state, 1);
        let nodes = 8i64;
        let heights: Vec<[f64; 2]> = (0..(nodes + 1) * (nodes + 1))
            .map(|_| [random.f64() - 0.5, random.f64() - 0.5])
            .collect();
        let place = |x: i64, y: i64| {
            let [dx, dz] = heights[(y * (nodes + 1) + x) as usize];
            // World: x from −40 to 40, the ground at −1, z (away) from −20 to 60.
            let world = [(x - 4) as f64 * 10.0 + dx, -1.0, (y - 2) as f64 * 10.0 + dz];
            // w is the distance; depth 0 at 0.5, 1 at 50.
            let (near, far) = (0.5, 50.0);
            let w = world[2];
            let z = far / (far - near) * (w - near);
            let [x, y] = [world[0], -world[1]];
            [x, y, z, w].map(|value| f64::from(value as f32))
        };
        let mut flips = Random::with_seed(7);
        let counts = covered_by_net(nodes, 1, &facts, &place, &mut || flips.u64(..2) == 0);
        // Row y sees the ground at w = 1 / (y as NDC).
        for (sample, count) in samples(1).zip(counts) {
            let ndc = (sample[1] as f64 / 256.0) / f64::from(SIDE) * 2.0 - 1.0;
            let ndc_x = (sample[0] as f64 / 256.0) / f64::from(SIDE) * 2.0 - 1.0;
            let w = 1.0 / ndc;
            let reach = if clips { 49.0 } else { 54.0 };
            let seen = ndc > 0.0 && w < reach && w > 1.0 && (ndc_x * w).abs() < 35.0;
            assert!(count <= 1, "{sample:?}: {count}");
            if seen {
                assert_eq!(count, 1, "{sample:?}");
            }
            if ndc < 0.0 {
                assert_eq!(count, 0, "{sample:?}");
            }
        }
    }
}

#[test]
fn huge_coordinates_cover_as_exact_ones_do() {
    // A corner far beyond the guard band: the two sides that meet there are nearly parallel on the
    // screen. What lies more than a pixel from them is decided.
    let mut random = Random::with_seed(4);
    let facts = facts(&state(), 1);
    for _ in 0..300 {
        let near = [0, 1].map(|_| [0, 1].map(|_| random.f64() * 64.0));
        let angle = random.f64() * std::f64::consts::TAU;
        let far = [angle.cos(), angle.sin()].map(|c| c * 1e9 * (1.0 + random.f64()));
        let p = [near[0], near[1], far];
        let chunk = triangle(
            &facts,
            p.map(|[x, y]| at(x * 256.0, y * 256.0, 0.5, 1.0).map(|v| f64::from(v as f32))),
        );
        let side = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| {
            let length = ((b[0] - a[0]).powi(2) + (b[1] - a[1]).powi(2)).sqrt();
            ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])) / length
        };
        let whole = side(p[0], p[1], p[2]).signum();
        for sample in samples(1) {
            let here = sample.map(|v| v as f64 / 256.0);
            let least = [
                side(p[0], p[1], here),
                side(p[1], p[2], here),
                side(p[2], p[0], here),
            ]
            .into_iter()
            .map(|side| side * whole)
            .fold(f64::INFINITY, f64::min);
            let covered = coverage(&chunk, sample[0], sample[1]);
            assert!(covered <= 1, "{p:?} {sample:?}");
            if least > 1.0 {
                assert_eq!(covered, 1, "{p:?} {sample:?}");
            } else if least < -1.0 {
                assert_eq!(covered, 0, "{p:?} {sample:?}");
            }
        }
    }
}

#[test]
fn faces_are_culled_by_their_winding() {
    // Clockwise on a screen whose y is down.
    let clockwise = [
        at(1000.0, 1000.0, 0.5, 1.0),
        at(9000.0, 1000.0, 0.5, 1.0),
        at(1000.0, 9000.0, 0.5, 1.0),
    ];
    let [a, b, c] = clockwise;
    for (positions, face) in [
        (clockwise, vk::FrontFace::CLOCKWISE),
        ([a, c, b], vk::FrontFace::COUNTER_CLOCKWISE),
    ] {
        let drawn = |cull: vk::CullModeFlags, face: vk::FrontFace| {
            let mut state = state();
            state.rasterization.cull_mode = cull;
            state.rasterization.front_face = face;
            triangle(&facts(&state, 1), positions).records
        };
        let other = if face == vk::FrontFace::CLOCKWISE {
            vk::FrontFace::COUNTER_CLOCKWISE
        } else {
            vk::FrontFace::CLOCKWISE
        };
        assert!(drawn(vk::CullModeFlags::NONE, face)[0].front);
        assert!(!drawn(vk::CullModeFlags::NONE, other)[0].front);
        assert!(drawn(vk::CullModeFlags::FRONT, face).is_empty());
        assert!(!drawn(vk::CullModeFlags::BACK, face).is_empty());
        assert!(drawn(vk::CullModeFlags::BACK, other).is_empty());
        assert!(drawn(vk::CullModeFlags::FRONT_AND_BACK, face).is_empty());
    }
}

#[test]
fn garbage_stays_within_the_scissor() {
    let mut random = Random::with_seed(5);
    let special = [
        0.0,
        -0.0,
        1.0,
        f64::from(f32::MAX),
        f64::from(f32::MIN_POSITIVE),
        1e-45,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NAN,
    ];
    for round in 0..20_000 {
        let mut state = state();
        state.rasterization.depth_clip = round % 3 != 0;
        state.rasterization.polygon_mode = [
            vk::PolygonMode::FILL,
            vk::PolygonMode::LINE,
            vk::PolygonMode::POINT,
        ][round % 5 % 3];
        state.rasterization.line_width = 3.0;
        if round % 7 == 0 {
            state.rasterization.line_mode = vk::LineRasterizationModeEXT::BRESENHAM;
        }
        state.rasterization.line_stipple = round % 11 == 0;
        state.rasterization.line_stipple_pattern = 0xA5F0;
        if round % 13 == 0 {
            let viewport = &mut state.viewports.viewports[0];
            viewport.x = f32::from_bits(random.u64(..) as u32);
            viewport.width = f32::from_bits(random.u64(..) as u32);
            viewport.max_depth = f32::from_bits(random.u64(..) as u32);
        }
        let facts = facts(&state, if round % 2 == 0 { 1 } else { 4 });
        let mut value = || match random.u64(..8) {
            0 => special[random.u64(..special.len() as u64) as usize],
            1..4 => f64::from(f32::from_bits(random.u64(..) as u32)),
            _ => f64::from((random.f64() * 4.0 - 2.0) as f32),
        };
        let positions = std::array::from_fn(|_| std::array::from_fn(|_| value()));
        let distances = std::array::from_fn(|_| {
            let distance = value();
            [distance, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        });
        let chunk = set_up_with(
            &facts,
            positions,
            distances,
            |set_up, primitive, corners| match round % 4 {
                0 => set_up.line(primitive, corners, [0, 1], true, 0.0),
                1 => set_up.point(
                    primitive,
                    corners.screen[0],
                    corners.point_sizes[0],
                    0,
                    (true, 0.0),
                ),
                _ => set_up.triangle(primitive, corners),
            },
        );
        for shape in &chunk.shapes {
            let bounds = shape.bounds;
            assert!(bounds.left >= 0 && bounds.top >= 0, "{bounds:?}");
            assert!(bounds.right <= SIDE as i32 && bounds.bottom <= SIDE as i32);
            assert!(bounds.left < bounds.right && bounds.top < bounds.bottom);
            assert!((shape.record as usize) < chunk.records.len());
            if let Coverage::Pixels { first, count, .. } = shape.coverage {
                for [x, y] in &chunk.pixels[first as usize..(first + count) as usize] {
                    assert!((bounds.left..bounds.right).contains(&i32::from(*x)));
                    assert!((bounds.top..bounds.bottom).contains(&i32::from(*y)));
                }
            }
        }
    }
}
