//! Tests of the front end: against slow references with whole numbers of 128 bits, and with
//! nonsense.

mod bins;
mod bresenham;
mod clipping;
mod coverage;
mod cutting;
mod lines;
mod projecting;
mod tessellation;
mod topology;
mod vertices;

use ash::vk;

use super::clip::MAX_CLIP_DISTANCES;
use super::facts::{DepthFormat, Facts};
use super::screen::{Clip, ScreenVertex, project};
use super::set_up::{Corners, Primitive, SetUp};
use crate::object::graphics_state::GraphicsState;
use crate::raster::primitive::{Chunk, Shape};
pub use fastrand::Rng as Random;

/// Pixels of a side of the tests' screen.
pub const SIDE: u32 = 64;

/// A viewport of [`SIDE`] by [`SIDE`] pixels, depths from 0 to 1.
pub fn state() -> GraphicsState {
    let mut state = GraphicsState::default();
    state.viewports.viewports.push(vk::Viewport {
        x: 0.0,
        y: 0.0,
        width: SIDE as f32,
        height: SIDE as f32,
        min_depth: 0.0,
        max_depth: 1.0,
    });
    state.viewports.scissors.push(area());
    state
}

pub fn area() -> vk::Rect2D {
    vk::Rect2D {
        offset: vk::Offset2D { x: 0, y: 0 },
        extent: vk::Extent2D {
            width: SIDE,
            height: SIDE,
        },
    }
}

pub fn facts(state: &GraphicsState, samples: u32) -> Facts {
    Facts::new(state, &area(), samples, 1, DepthFormat::Float)
}

/// Clip coordinates of a place on the tests' screen in fixed-point units, with that w.
pub fn at(x: f64, y: f64, z: f64, w: f64) -> Clip {
    let unit = |place: f64| place / 256.0 / f64::from(SIDE) * 2.0 - 1.0;
    [unit(x) * w, unit(y) * w, z * w, w]
}

/// Draws primitives by `draw`, with vertices of those positions and clip distances.
pub fn set_up_with(
    facts: &Facts,
    positions: [Clip; 3],
    distances: [[f64; MAX_CLIP_DISTANCES]; 3],
    draw: impl FnOnce(&mut SetUp<'_>, &Primitive, &Corners<'_>),
) -> Chunk {
    let mut chunk = Chunk::default();
    let screen = facts.views[0].screen;
    let vertices: [ScreenVertex; 3] = std::array::from_fn(|i| {
        let mut vertex = project(&screen, &facts.volume, &positions[i]);
        for (bit, distance) in (super::screen::code::CLIP..).zip(distances[i]) {
            vertex.code |= u32::from(!(distance >= 0.0)) << bit;
        }
        vertex
    });
    let corners = Corners {
        screen: vertices.each_ref(),
        positions,
        distances,
        point_sizes: [1.0; 3],
    };
    let mut set_up = SetUp {
        facts,
        chunk: &mut chunk,
        stippled: 0.0,
        clipped: 0,
    };
    draw(&mut set_up, &Primitive::default(), &corners);
    chunk
}

/// Draws a triangle.
pub fn triangle(facts: &Facts, positions: [Clip; 3]) -> Chunk {
    set_up_with(
        facts,
        positions,
        Default::default(),
        |set_up, primitive, corners| set_up.triangle(primitive, corners),
    )
}

/// Whether a shape of edges covers a sample, in fixed-point units.
pub fn covers(chunk: &Chunk, shape: &Shape, x: i64, y: i64) -> bool {
    let bounds = shape.bounds;
    let (pixel_x, pixel_y) = ((x >> 8) as i32, (y >> 8) as i32);
    let (edges, count) = shape.edges(chunk);
    assert_ne!(count, 0, "not a shape of edges");
    (bounds.left..bounds.right).contains(&pixel_x)
        && (bounds.top..bounds.bottom).contains(&pixel_y)
        && edges[..count].iter().all(|edge| {
            i128::from(edge.a) * i128::from(x)
                + i128::from(edge.b) * i128::from(y)
                + i128::from(edge.c)
                >= 0
        })
}

/// How many shapes of a chunk cover a sample.
pub fn coverage(chunk: &Chunk, x: i64, y: i64) -> usize {
    chunk
        .shapes
        .iter()
        .filter(|shape| covers(chunk, shape, x, y))
        .count()
}

/// The standard places of samples in a pixel, in fixed-point units.
pub fn sample_places(samples: u32) -> &'static [[i64; 2]] {
    match samples {
        1 => &[[128, 128]],
        _ => &[[96, 32], [224, 96], [32, 160], [160, 224]],
    }
}
