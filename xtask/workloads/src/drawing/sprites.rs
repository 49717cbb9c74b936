//! Soft points: squares that a geometry shader makes, blended over each other.

use tuff_tests::{Gpu, Painting, Pass, vk};

use super::triangles::{Corner, of_corners};
use super::{RGBA, canvas, check_colors, drawn, draws, over, size, turn};
use crate::workload::Prepared;
use crate::world::Scale;

/// Pixels from a point to the next.
const CELL: u32 = 8;

/// Pixels of a square's side.
const SIDE: u32 = 7;

/// Draws of a turn.
const REPEATS: u32 = 4;

const VERTEX: &str = "
    layout(location = 0) in vec2 place;
    layout(location = 1) in vec4 color;
    layout(location = 0) out vec4 shade;
    layout(push_constant) uniform Push { vec2 size; };
    void main() {
        gl_Position = vec4(place * 2.0 / size - 1.0, 0.5, 1.0);
        shade = color;
    }";

/// Squares of seven pixels.
const GEOMETRY: &str = "
    layout(points) in;
    layout(triangle_strip, max_vertices = 4) out;
    layout(location = 0) in vec4 shade[];
    layout(location = 0) out vec4 tint;
    layout(location = 1) out vec2 at;
    layout(push_constant) uniform Push { vec2 size; };
    void main() {
        for (int corner = 0; corner < 4; corner++) {
            at = vec2(corner & 1, corner >> 1) * 2.0 - 1.0;
            tint = shade[0];
            gl_Position = gl_in[0].gl_Position + vec4(at * 7.0 / size, 0.0, 0.0);
            EmitVertex();
        }
        EndPrimitive();
    }";

/// They fade from their middle on.
const FRAGMENT: &str = "
    layout(location = 0) in vec4 tint;
    layout(location = 1) in vec2 at;
    layout(location = 0) out vec4 color;
    void main() { color = vec4(tint.rgb, max(1.0 - dot(at, at), 0.0)); }";

fn color(column: u32, row: u32) -> [u8; 4] {
    let word = (row * 1024 + column).wrapping_mul(0x9E37_79B1);
    [word >> 8, word >> 16, word >> 24, 255].map(|part| part as u8)
}

pub fn squares(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    if !draws(gpu) || gpu.features.geometry_shader == vk::FALSE {
        return None;
    }
    let [width, height] = size(scale);
    let (columns, rows) = (width / CELL, height / CELL);
    let points: Vec<Corner> = (0..columns * rows)
        .map(|number| (number % columns, number / columns))
        .map(|(column, row)| Corner {
            place: [column, row].map(|at| (at * CELL) as f32 + SIDE as f32 / 2.0),
            color: color(column, row),
        })
        .collect();
    let vertices = gpu.buffer_with(&points);
    let canvas = canvas(gpu, scale, RGBA);
    let mut painting = of_corners(Painting::new(gpu, VERTEX, FRAGMENT, RGBA));
    painting.topology = vk::PrimitiveTopology::POINT_LIST;
    painting.geometry = Some(GEOMETRY);
    painting.blend[0] = over(painting.blend[0]);
    let pipeline = gpu.painting(&painting);
    let pass = Pass {
        colors: &[canvas],
        clears: &[[0.0; 4]],
        ..Pass::default()
    };
    let count = points.len() as u32;
    let turn = turn(gpu, &pass, |commands| {
        gpu.bind(commands, pipeline);
        gpu.push(commands, painting.layout, &[width as f32, height as f32]);
        gpu.bind_vertices(commands, &vertices);
        for _ in 0..REPEATS {
            gpu.draw_vertices(commands, count);
        }
    });
    let expected = move |x: u32, y: u32| {
        let (column, row) = (x / CELL, y / CELL);
        let [across, down] = [x % CELL, y % CELL];
        if across >= SIDE || down >= SIDE || column >= columns || row >= rows {
            return [0; 4];
        }
        let from_middle = |at: u32| (f64::from(at) + 0.5) * 2.0 / f64::from(SIDE) - 1.0;
        let alpha = 1.0 - from_middle(across).powi(2) - from_middle(down).powi(2);
        let shown = 1.0 - (1.0 - alpha.max(0.0)).powi(REPEATS as i32);
        let [red, green, blue, _] = color(column, row).map(|part| f64::from(part) * shown);
        [red, green, blue, 255.0 * shown].map(|part| part.round() as u8)
    };
    let work = f64::from(count * REPEATS);
    Some(drawn(gpu, turn, &[canvas], work, move |gpu| {
        check_colors(gpu, &canvas, 3, expected)
    }))
}
