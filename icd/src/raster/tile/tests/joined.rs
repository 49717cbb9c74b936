//! Triangles whose pixels share quads, blended over each other.

use std::ops::Range;

use ash::vk;

use super::rectangle::halves;
use super::support::{
    Canvas, Random, chunk_of, draw, edges, halve_and_double, program, run, targets,
};
use crate::object::graphics_state::GraphicsState;
use crate::raster::Work;
use crate::raster::primitive::{Bounds, Edge, PlaneEquation};
use crate::raster::tile::pack::{Found, OWN, Origin, Packs};
use crate::raster::tile::samples::{MAX_SAMPLES, standard};

const COLOR: vk::ImageAspectFlags = vk::ImageAspectFlags::COLOR;
const SIZE: [u32; 2] = [90, 75];

/// Its colour in pixel (x, y) is `id + x, 2 id, y, 1`.
struct Drawn {
    corners: [[i32; 2]; 3],
    id: i32,
    depth: f32,
}

impl Drawn {
    /// Columns, or rows, of the image with pixels that may be covered.
    fn pixels(&self, axis: usize) -> Range<u32> {
        let places = self.corners.map(|corner| corner[axis].div_euclid(256));
        let (least, most) = (places.into_iter().min(), places.into_iter().max());
        let end = most.unwrap_or(0) + 1;
        least.unwrap_or(0).max(0) as u32..(end.max(0) as u32).min(SIZE[axis])
    }
}

/// A net of small triangles that share edges, each once; in any order.
fn net(random: &mut Random, triangles: &mut Vec<[[i32; 2]; 3]>) {
    let first = triangles.len();
    let side = [700, 1000, 1800, 4000][random.usize(0..4)];
    let [columns, rows] = SIZE.map(|size| size as i32 * 256 / side + 2);
    let corners: Vec<[i32; 2]> = (0..rows * columns)
        .map(|it| [it % columns, it / columns])
        .map(|at| at.map(|it| (it - 1) * side + random.i32(0..side / 2)))
        .collect();
    for row in 1..rows {
        for column in 1..columns {
            let at = |x: i32, y: i32| corners[((row - y) * columns + column - x) as usize];
            let (a, b, c, d) = (at(1, 1), at(0, 1), at(1, 0), at(0, 0));
            match random.bool() {
                true => triangles.extend([[a, b, c], [b, c, d]]),
                false => triangles.extend([[a, b, d], [a, c, d]]),
            }
        }
    }
    if random.bool() {
        random.shuffle(&mut triangles[first..]);
    }
}

fn covers(edges: &[Edge; 4], x: i64, y: i64) -> bool {
    let is_inside = |edge: &Edge| i64::from(edge.a) * x + i64::from(edge.b) * y + edge.c >= 0;
    edges[..3].iter().all(is_inside)
}

/// Colours are added to half of what is there: the order of triangles shows, and numbers are exact.
fn check(random: &mut Random, samples: u32, is_tested: bool) {
    let [width, height] = SIZE;
    let mut triangles = Vec::new();
    for _ in 0..3 {
        net(random, &mut triangles);
        for _ in 0..4 {
            let middle = SIZE.map(|it| random.i32(0..it as i32 * 256));
            triangles.push([(); 3].map(|()| middle.map(|it| it + random.i32(-3000..3000))));
        }
        for _ in 0..30 {
            let least = SIZE.map(|it| random.i32(-2000..it as i32 * 256));
            let greatest = least.map(|it| it + random.i32(1..4000));
            triangles.extend(halves(least, greatest, random.bool()));
        }
    }
    let area =
        |[p, q, r]: &[[i32; 2]; 3]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    triangles.retain(|corners| area(corners) != 0);
    let all: Vec<Drawn> = (0..)
        .zip(triangles)
        .map(|(number, corners)| Drawn {
            corners,
            id: number % 512,
            depth: random.i32(1..16) as f32 / 16.0,
        })
        .collect();
    let canvas = Canvas::new(vk::Format::R32G32B32A32_SFLOAT, width, height, 1, samples);
    let depth = Canvas::new(vk::Format::D32_SFLOAT, width, height, 1, samples);
    let targets = targets(Some(&canvas), Some(&depth));
    let mut state = GraphicsState::default();
    state.multisample.samples = samples;
    state.depth_stencil.depth_test = is_tested;
    state.depth_stencil.depth_write = is_tested;
    state.depth_stencil.depth_compare = vk::CompareOp::GREATER_OR_EQUAL;
    let blend = &mut state.blend.attachments[0];
    blend.enable = true;
    blend.src_color = vk::BlendFactor::ONE;
    blend.src_alpha = vk::BlendFactor::ONE;
    blend.dst_color = vk::BlendFactor::CONSTANT_COLOR;
    blend.dst_alpha = vk::BlendFactor::CONSTANT_ALPHA;
    state.blend.constants = [0.5; 4];
    let work = [Work::Draw(draw(
        state,
        Some(halve_and_double("linear.center")),
    ))];
    let plane = |at, dx, dy| PlaneEquation { at, dx, dy };
    let chunks: Vec<_> = all
        .chunks(100)
        .map(|some| {
            let shapes = some.iter().map(|it| {
                let id = it.id as f32;
                let first = [id, 2.0 * id, 0.0, 1.0];
                let second = [id + 1.0, 2.0 * id, 0.0, 1.0];
                let third = [id, 2.0 * id, 1.0, 1.0];
                let words = [first, second, third].map(|it| it.map(f32::to_bits));
                let linear = [plane(0.0, 1.0, 0.0), plane(0.0, 0.0, 1.0)];
                let depth = plane(it.depth, 0.0, 0.0);
                (it.corners, depth, linear, [0, 0], words)
            });
            let mut chunk = chunk_of(0, &targets, shapes);
            for (shape, it) in chunk.shapes.iter_mut().zip(some) {
                let [columns, rows] = [0, 1].map(|axis| it.pixels(axis));
                shape.bounds = Bounds {
                    left: columns.start as i32,
                    top: rows.start as i32,
                    right: columns.end as i32,
                    bottom: rows.end as i32,
                };
            }
            chunk
        })
        .collect();
    run(2, &targets, &work, &chunks);
    let (mut passed, mut invocations) = (0, 0);
    let mut wanted = vec![[([0.0f32; 4], 0.0f32); MAX_SAMPLES]; (width * height) as usize];
    for drawn in &all {
        let edges = edges(drawn.corners);
        let [columns, rows] = [0, 1].map(|axis| drawn.pixels(axis));
        let pixels = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
        for (x, y) in pixels {
            let mut is_shaded = false;
            let stored = &mut wanted[(y * width + x) as usize];
            for (stored, location) in stored.iter_mut().zip(standard(samples)) {
                let [px, py] = [(x, location[0]), (y, location[1])]
                    .map(|(pixel, inside)| i64::from(pixel) * 256 + i64::from(inside) * 16);
                if !covers(&edges, px, py) || is_tested && drawn.depth < stored.1 {
                    continue;
                }
                let id = drawn.id as f32;
                let color = [id + x as f32, 2.0 * id, y as f32, 1.0];
                for (old, new) in stored.0.iter_mut().zip(color) {
                    *old = new + *old * 0.5;
                }
                stored.1 = drawn.depth;
                is_shaded = true;
                passed += 1;
            }
            invocations += u64::from(is_shaded);
        }
    }
    for (place, stored) in (0..).zip(&wanted) {
        let (x, y) = (place % width, place / width);
        for (sample, (color, _)) in (0..samples).zip(stored) {
            let found = canvas.texel(COLOR, [x, y, 0, sample]).map(f32::from_bits);
            assert_eq!(found, *color, "{x} {y} {sample}");
        }
    }
    let Work::Draw(draw) = &work[0] else {
        unreachable!()
    };
    let counters = &draw.counters[0];
    let count = |it: &std::sync::atomic::AtomicU64| it.load(std::sync::atomic::Ordering::Relaxed);
    assert_eq!(count(&counters.samples), passed);
    assert_eq!(count(&counters.fragment_invocations), invocations);
}

#[test]
fn small_blended_triangles_keep_their_order() {
    let mut random = Random::with_seed(77);
    for _ in 0..3 {
        for samples in [1, 4] {
            for is_tested in [false, true] {
                check(&mut random, samples, is_tested);
            }
        }
    }
}

/// Adds lanes of the block at (8, 4), of a primitive; tells how many packs there are.
fn add(packs: &mut Packs, record: u32, lanes: u16) -> usize {
    let mut masks = [0; MAX_SAMPLES];
    masks[0] = lanes;
    let area = Bounds {
        left: 0,
        top: 0,
        right: 64,
        bottom: 64,
    };
    let found = Found {
        origin: Origin { chunk: 0, record },
        place: [8, 4],
        layer: 0,
        area: &area,
        sample: 0,
        lanes,
        masks: &masks,
        coverage: &masks,
    };
    packs.add(&found, Some(OWN));
    packs.packs.len()
}

#[test]
fn fragments_that_do_not_overlap_share_a_subgroup() {
    let mut packs = Packs::default();
    assert_eq!(add(&mut packs, 0, 0x7fff), 1);
    assert_eq!(add(&mut packs, 1, 0x8000), 1);
    assert_eq!(packs.packs[0].masks[0], 0xffff);
    assert_eq!(packs.joined.len(), 1);
    assert_eq!(packs.joined[0].lanes, 0x8000);
    // A fragment above another one goes into a later pack, and so does one above that.
    assert_eq!(add(&mut packs, 2, 0x8000), 2);
    assert_eq!(add(&mut packs, 3, 0x4000), 2);
    assert_eq!(add(&mut packs, 4, 0xffff), 3);
    packs.clear();
    // Quads of their own, which lie in one pack.
    assert_eq!(add(&mut packs, 0, 0x0001), 1);
    assert_eq!(add(&mut packs, 1, 0x0006), 1);
    assert_eq!(add(&mut packs, 2, 0x0010), 1);
    assert_eq!(packs.packs[0].masks[0], 0x0017);
    assert_eq!(packs.joined.len(), 1);
    // Not all of these pixels are free.
    assert_eq!(add(&mut packs, 3, 0xffe8), 2);
}

#[test]
fn programs_tell_whether_lanes_look_at_others() {
    let looks = |work: &str| {
        let text = format!(
            "module fragment
            inputs varying.0.0.linear.center
            output_rows 1
            outputs location.0.0.0
            fragment colors.1
            func f0 {{
                v0: f32 = input[0]
                v1: i32 = const 0
                v2: descriptor = descriptor[set 0, first 0, count 1] v1
                {work}
                end(v0)
            }}"
        );
        program(&text).looks_at_lanes()
    };
    let sample = |mode: &str, operands: &str| {
        let results = "v3: f32, v4: f32, v5: f32, v6: f32";
        format!("{results} = image.sample[2d, f32, {mode}, format 0] v2, v2, v0, v0{operands}")
    };
    for text in [
        "v3: f32 = derivative_x v0",
        "v3: f32 = derivative_y v0",
        "v3: i32 = lane_index",
        "v3: i1 = subgroup.elect",
        &sample("implicit", ""),
        &sample("bias", ", v0"),
    ] {
        assert!(looks(text), "{text}");
    }
    for text in [
        "v3: f32 = fmul v0, v0",
        &sample("lod", ", v0"),
        &sample("grad", ", v0, v0, v0, v0"),
    ] {
        assert!(!looks(text), "{text}");
    }
}
