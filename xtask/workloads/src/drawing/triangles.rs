//! Many small triangles from a vertex buffer, each of one colour.

use tuff_tests::{Gpu, Painting, Pass, vk};

use super::{RGBA, canvas, check_colors, drawn, draws, size, turn};
use crate::workload::Prepared;
use crate::world::Scale;

/// A corner: pixels and a colour.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Corner {
    pub place: [f32; 2],
    pub color: [u8; 4],
}

pub const VERTEX: &str = "
    layout(location = 0) in vec2 place;
    layout(location = 1) in vec4 color;
    layout(location = 0) flat out vec4 shade;
    layout(push_constant) uniform Push { vec2 size; };
    void main() {
        gl_Position = vec4(place * 2.0 / size - 1.0, 0.5, 1.0);
        shade = color;
    }";

pub const FRAGMENT: &str = "
    layout(location = 0) flat in vec4 shade;
    layout(location = 0) out vec4 color;
    void main() { color = shade; }";

/// A painting of corners.
pub fn of_corners(mut painting: Painting<'_>) -> Painting<'_> {
    let stride = size_of::<Corner>() as u32;
    painting.bindings = vec![vk::VertexInputBindingDescription::default().stride(stride)];
    painting.attributes = vec![
        vk::VertexInputAttributeDescription::default().format(vk::Format::R32G32_SFLOAT),
        vk::VertexInputAttributeDescription::default()
            .location(1)
            .format(RGBA)
            .offset(8),
    ];
    painting
}

/// How far from a pixel's corner triangles start: no centre is near an edge.
const START: f32 = 0.25;

fn color(column: u32, row: u32) -> [u8; 4] {
    let word = (row * 4096 + column).wrapping_mul(0x9E37_79B1);
    [word >> 8, word >> 16, word >> 24, 255].map(|part| part as u8)
}

/// A right triangle with legs of `side` pixels in each square of so many; drawn as often as makes a
/// long turn.
pub fn flat(gpu: &Gpu, scale: &Scale, side: u32) -> Option<Prepared> {
    if !draws(gpu) {
        return None;
    }
    let [width, height] = size(scale);
    let (columns, rows) = (width / side, height / side);
    let repeats = side;
    let mut corners = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let color = color(column, row);
            let [x, y] = [column, row].map(|at| (at * side) as f32 + START);
            let legs = side as f32;
            for place in [[x, y], [x + legs, y], [x, y + legs]] {
                corners.push(Corner { place, color });
            }
        }
    }
    let vertices = gpu.buffer_with(&corners);
    let canvas = canvas(gpu, scale, RGBA);
    let painting = of_corners(Painting::new(gpu, VERTEX, FRAGMENT, RGBA));
    let pipeline = gpu.painting(&painting);
    let pass = Pass {
        colors: &[canvas],
        clears: &[[0.0; 4]],
        ..Pass::default()
    };
    let count = corners.len() as u32;
    let turn = turn(gpu, &pass, |commands| {
        gpu.bind(commands, pipeline);
        gpu.push(commands, painting.layout, &[width as f32, height as f32]);
        gpu.bind_vertices(commands, &vertices);
        for _ in 0..repeats {
            gpu.draw_vertices(commands, count);
        }
    });
    let expected = move |x: u32, y: u32| {
        let (column, row) = (x / side, y / side);
        let inside = (x % side + y % side) as f32 + 1.0 - 2.0 * START < side as f32;
        match inside && column < columns && row < rows {
            true => color(column, row),
            false => [0; 4],
        }
    };
    let work = f64::from(count / 3 * repeats);
    Some(drawn(gpu, turn, &[canvas], work, move |gpu| {
        check_colors(gpu, &canvas, 0, expected)
    }))
}
