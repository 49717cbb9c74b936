//! The order of primitives, whatever the number of threads.

use std::sync::Arc;

use ash::vk;

use super::support::{
    Canvas, Random, Triangle, chunk, draw, halve_and_double, pass_on, run, run_within, targets,
};
use crate::object::graphics_state::GraphicsState;
use crate::raster::Work;
use crate::wave::{Budget, Limits, Stopped};

const COLOR: vk::ImageAspectFlags = vk::ImageAspectFlags::COLOR;

fn triangles(count: usize, random: &mut Random) -> Vec<Triangle> {
    (0..count)
        .map(|index| {
            let size = 1 << (8 + index % 7);
            let middle = [random.i64(0..150 * 256), random.i64(0..100 * 256)];
            let corners = [(); 3].map(|()| middle.map(|it| (it + random.i64(-size..size)) as i32));
            Triangle {
                corners,
                depth: random.f32(),
                color: [index as u32 & 0xff, index as u32 >> 8, 7, 1],
                front: true,
            }
        })
        .collect()
}

#[test]
fn the_last_primitive_wins_at_each_sample() {
    for samples in [1, 4] {
        let mut random = Random::with_seed(41);
        let all = triangles(500, &mut random);
        let canvas = Canvas::new(vk::Format::R8G8B8A8_UINT, 150, 100, 1, samples);
        let targets = targets(Some(&canvas), None);
        let mut state = GraphicsState::default();
        state.multisample.samples = samples;
        let work = [Work::Draw(draw(state, Some(pass_on("flat"))))];
        let chunks: Vec<_> = all.chunks(64).map(|it| chunk(0, &targets, it)).collect();
        run(4, &targets, &work, &chunks);
        let locations = crate::raster::tile::samples::standard(samples);
        for place in 0..150 * 100 * samples {
            let (x, y, sample) = (place % 150, place / 150 % 100, place / 15000);
            let [sx, sy] = locations[sample as usize].map(|it| i64::from(it) * 16);
            let (px, py) = (i64::from(x) * 256 + sx, i64::from(y) * 256 + sy);
            let covers = |triangle: &&Triangle| {
                let edges = super::support::edges(triangle.corners);
                edges[..3]
                    .iter()
                    .all(|edge| i64::from(edge.a) * px + i64::from(edge.b) * py + edge.c >= 0)
            };
            let wanted = all.iter().rfind(covers).map_or([0; 4], |it| it.color);
            assert_eq!(
                canvas.texel(COLOR, [x, y, 0, sample]),
                wanted,
                "{x} {y} {sample}"
            );
        }
    }
}

#[test]
fn threads_change_nothing() {
    let pictures: Vec<Vec<u8>> = [1, 2, 5]
        .into_iter()
        .map(|threads| {
            let mut random = Random::with_seed(1009);
            let all = triangles(800, &mut random);
            let canvas = Canvas::new(vk::Format::R8G8B8A8_UNORM, 200, 130, 1, 4);
            let depth = Canvas::new(vk::Format::D16_UNORM, 200, 130, 1, 4);
            let targets = targets(Some(&canvas), Some(&depth));
            let mut state = GraphicsState::default();
            state.multisample.samples = 4;
            state.depth_stencil.depth_test = true;
            state.depth_stencil.depth_write = true;
            state.depth_stencil.depth_compare = vk::CompareOp::GREATER_OR_EQUAL;
            let blend = &mut state.blend.attachments[0];
            blend.enable = true;
            blend.src_color = vk::BlendFactor::CONSTANT_COLOR;
            blend.dst_color = vk::BlendFactor::ONE_MINUS_CONSTANT_COLOR;
            state.blend.constants = [0.3, 0.6, 0.4, 0.5];
            let all: Vec<Triangle> = all
                .into_iter()
                .map(|it| Triangle {
                    color: [(); 4].map(|()| random.f32().to_bits()),
                    ..it
                })
                .collect();
            let work = [Work::Draw(draw(state, Some(pass_on("smooth.centroid"))))];
            let chunks: Vec<_> = all.chunks(100).map(|it| chunk(0, &targets, it)).collect();
            run(threads, &targets, &work, &chunks);
            [canvas.bytes(), depth.bytes()].concat()
        })
        .collect();
    assert!(pictures[0].iter().any(|&byte| byte != 0));
    assert!(pictures[1..].iter().all(|picture| *picture == pictures[0]));
}

#[test]
fn fragments_are_within_the_budget_of_memory() {
    const BYTES: usize = 64 << 20;
    let canvas = Canvas::new(vk::Format::R32G32B32A32_SFLOAT, 64, 64, 1, 1);
    let targets = targets(Some(&canvas), None);
    let program = halve_and_double("flat");
    let work = [Work::Draw(draw(GraphicsState::default(), Some(program)))];
    let color = [1.5f32, -2.0, 0.25, 7.0].map(f32::to_bits);
    let chunks = [chunk(0, &targets, &[Triangle::everywhere(0.0, color)])];
    for (bytes, result) in [(0, Err(Stopped::OutOfMemory)), (BYTES, Ok(()))] {
        let limits = Limits {
            memory: Arc::new(Budget::new(bytes)),
            ..Limits::default()
        };
        assert_eq!(run_within(&limits, 2, &targets, &work, &chunks), result);
        assert!(limits.memory.take(bytes), "not all was given back");
    }
    assert_eq!(canvas.texel(COLOR, [63, 63, 0, 0]), color);
}
