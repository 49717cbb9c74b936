//! Many draws: objects of two triangles, and frames of an interface.

use tuff_tests::{Bound, Gpu, Painting, Pass, Rng, Shape, vk};

use super::{RGBA, canvas, check_colors, drawn, draws as can_draw, over, size, turn};
use crate::workload::Prepared;
use crate::world::Scale;

const OBJECT: &str = "
    layout(location = 0) in vec2 place;
    layout(location = 0) out vec4 shade;
    layout(push_constant) uniform Push { vec4 tint; vec2 offset; vec2 size; };
    void main() {
        gl_Position = vec4((place + offset) * 2.0 / size - 1.0, 0.5, 1.0);
        shade = tint;
    }";

const SHADE: &str = "
    layout(location = 0) in vec4 shade;
    layout(location = 0) out vec4 color;
    void main() { color = shade; }";

/// The push constants of each object.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Push {
    tint: [f32; 4],
    offset: [f32; 2],
    size: [f32; 2],
}

fn tint(number: u32) -> [u8; 4] {
    let word = number.wrapping_mul(0x9E37_79B1);
    [word >> 8, word >> 16, word >> 24, 255].map(|part| part as u8)
}

/// 10,000 indexed draws of a square, each with push constants of its own.
pub fn draws(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    const DRAWS: u32 = 10_000;
    const SIDE: u32 = 8;
    if !can_draw(gpu) {
        return None;
    }
    let [width, height] = size(scale);
    let canvas = canvas(gpu, scale, RGBA);
    let mut painting = Painting::new(gpu, OBJECT, SHADE, RGBA);
    painting.bindings = vec![vk::VertexInputBindingDescription::default().stride(8)];
    let format = vk::Format::R32G32_SFLOAT;
    painting.attributes = vec![vk::VertexInputAttributeDescription::default().format(format)];
    let pipeline = gpu.painting(&painting);
    let side = SIDE as f32;
    let vertices = gpu.buffer_with(&[[0.0, 0.0], [side, 0.0], [0.0, side], [side, side]]);
    let indices = gpu.buffer_with(&[0u16, 1, 2, 2, 1, 3]);
    let columns = width / SIDE;
    let places = columns * (height / SIDE);
    let pass = Pass {
        colors: &[canvas],
        clears: &[[0.0; 4]],
        ..Pass::default()
    };
    let turn = turn(gpu, &pass, |commands| {
        gpu.bind(commands, pipeline);
        gpu.bind_vertices(commands, &vertices);
        gpu.bind_indices(commands, &indices, vk::IndexType::UINT16);
        for number in 0..DRAWS {
            let place = number % places;
            let push = Push {
                tint: tint(number).map(|part| f32::from(part) / 255.0),
                offset: [place % columns, place / columns].map(|at| (at * SIDE) as f32),
                size: [width as f32, height as f32],
            };
            gpu.push(commands, painting.layout, &push);
            // SAFETY: the command buffer is being recorded.
            unsafe { gpu.device.cmd_draw_indexed(commands, 6, 1, 0, 0, 0) };
        }
    });
    // The last square at each place.
    let expected = move |x: u32, y: u32| {
        let (column, row) = (x / SIDE, y / SIDE);
        let place = row * columns + column;
        let is_inside = column < columns && place < places;
        match (DRAWS - 1).checked_sub(place) {
            Some(later) if is_inside => tint(place + later / places * places),
            _ => [0; 4],
        }
    };
    Some(drawn(gpu, turn, &[canvas], f64::from(DRAWS), move |gpu| {
        check_colors(gpu, &canvas, 0, expected)
    }))
}

/// A corner of an interface's box: pixels, a place in the atlas, a colour.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Corner {
    place: [f32; 2],
    at: [f32; 2],
    color: [u8; 4],
}

const BOX: &str = "
    layout(location = 0) in vec2 place;
    layout(location = 1) in vec2 inAt;
    layout(location = 2) in vec4 color;
    layout(location = 0) out vec4 shade;
    layout(location = 1) out vec2 at;
    layout(push_constant) uniform Push { vec2 size; };
    void main() {
        gl_Position = vec4(place * 2.0 / size - 1.0, 0.0, 1.0);
        shade = color;
        at = inAt;
    }";

const GLYPH: &str = "
    layout(set = 0, binding = 0) uniform sampler2D atlas;
    layout(location = 0) in vec4 shade;
    layout(location = 1) in vec2 at;
    layout(location = 0) out vec4 color;
    void main() { color = shade * texture(atlas, at); }";

/// Texels of the atlas's side. Its first 16 by 16 texels are white, for boxes without a glyph.
const ATLAS: u32 = 256;
const GLYPH_WIDTH: u32 = 8;
const GLYPH_HEIGHT: u32 = 14;

/// A box of an interface and the texel that its first pixel has.
#[derive(Clone, Copy)]
struct Item {
    left: u32,
    top: u32,
    width: u32,
    height: u32,
    texel: Option<[u32; 2]>,
    color: [u8; 4],
}

/// Items that share a scissor.
struct Window {
    scissor: vk::Rect2D,
    items: Vec<Item>,
}

fn texel(x: u32, y: u32) -> [u8; 4] {
    let glyph = (x.wrapping_mul(0x9E37) ^ y.wrapping_mul(0x79B1)) >> 3;
    let alpha = match x < 16 && y < 16 {
        true => 255,
        false => glyph as u8,
    };
    [255, 255, 255, alpha]
}

/// Windows in a grid: a box behind, a title, and lines of text that are cut off.
fn windows(width: u32, height: u32) -> Vec<Window> {
    let mut random = Rng::with_seed(5);
    let (columns, rows) = (16, 12);
    let (across, down) = (width / columns, height / rows);
    let mut windows = Vec::new();
    for cell in 0..columns * rows {
        let (left, top) = (cell % columns * across, cell / columns * down);
        let scissor = vk::Rect2D {
            offset: vk::Offset2D {
                x: left as i32 + 1,
                y: top as i32 + 1,
            },
            extent: vk::Extent2D {
                width: across.saturating_sub(3),
                height: down.saturating_sub(3),
            },
        };
        let plain = |left, top, width, height, color| Item {
            left,
            top,
            width,
            height,
            texel: None,
            color,
        };
        let mut items = vec![
            plain(left, top, across, down, [40, 44, 52, 230]),
            plain(left, top, across, 12, [70, 90, 140, 255]),
        ];
        for letter in 0..24 {
            let place = [16 + random.u32(..220), 16 + random.u32(..220)];
            items.push(Item {
                left: left + 3 + letter % 9 * 9,
                top: top + 2 + letter / 9 * 16,
                width: GLYPH_WIDTH,
                height: GLYPH_HEIGHT,
                texel: Some(place),
                color: [230, 220, 200, 255],
            });
        }
        windows.push(Window { scissor, items });
    }
    windows
}

/// The picture of those, in f64.
fn reference(width: u32, height: u32, windows: &[Window]) -> Vec<[u8; 4]> {
    let mut picture = vec![[0.0f64; 4]; (width * height) as usize];
    for window in windows {
        let clip = window.scissor;
        let (first_x, first_y) = (clip.offset.x as u32, clip.offset.y as u32);
        for item in &window.items {
            for y in
                item.top.max(first_y)..(item.top + item.height).min(first_y + clip.extent.height)
            {
                for x in item.left.max(first_x)
                    ..(item.left + item.width).min(first_x + clip.extent.width)
                {
                    let sampled = match item.texel {
                        Some([u, v]) => texel(u + x - item.left, v + y - item.top),
                        None => [255; 4],
                    };
                    let part =
                        |i: usize| f64::from(item.color[i]) * f64::from(sampled[i]) / 65025.0;
                    let alpha = part(3);
                    let below = &mut picture[(y * width + x) as usize];
                    for (i, below) in below.iter_mut().enumerate() {
                        let source = if i == 3 { alpha } else { part(i) * alpha };
                        *below = source + *below * (1.0 - alpha);
                    }
                }
            }
        }
    }
    let bytes = |pixel: [f64; 4]| pixel.map(|part| (part * 255.0).round() as u8);
    picture.into_iter().map(bytes).collect()
}

/// The corners and indices of all items' boxes.
fn boxes(windows: &[Window]) -> (Vec<Corner>, Vec<u16>) {
    let (mut corners, mut indices) = (Vec::new(), Vec::new());
    for item in windows.iter().flat_map(|window| &window.items) {
        let first = corners.len() as u16;
        for (right, bottom) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let place = [
                item.left + right * item.width,
                item.top + bottom * item.height,
            ];
            let at = match item.texel {
                Some([u, v]) => [u + right * item.width, v + bottom * item.height],
                None => [8, 8],
            };
            corners.push(Corner {
                place: place.map(|it| it as f32),
                at: at.map(|it| it as f32 / ATLAS as f32),
                color: item.color,
            });
        }
        indices.extend([0, 1, 2, 2, 1, 3].map(|corner| first + corner));
    }
    (corners, indices)
}

/// Ten frames as immediate-mode interfaces draw them: one vertex buffer, 192 windows with a scissor
/// and a draw each.
pub fn interface(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    const FRAMES: u32 = 10;
    if !can_draw(gpu) {
        return None;
    }
    let [width, height] = size(scale);
    let canvas = canvas(gpu, scale, RGBA);
    let atlas = gpu.picture(
        Shape::flat(RGBA, ATLAS, ATLAS),
        vk::ImageUsageFlags::SAMPLED,
    );
    let texels: Vec<[u8; 4]> = (0..ATLAS * ATLAS)
        .map(|at| texel(at % ATLAS, at / ATLAS))
        .collect();
    gpu.upload(&atlas, 0, &texels);
    let sampler = vk::SamplerCreateInfo::default()
        .mag_filter(vk::Filter::LINEAR)
        .min_filter(vk::Filter::LINEAR);
    let set = gpu.set_of(&[Bound::Sampled(atlas.view, gpu.sampler(&sampler))]);
    let windows = windows(width, height);
    let (corners, indices) = boxes(&windows);
    let (vertices, indices) = (gpu.buffer_with(&corners), gpu.buffer_with(&indices));
    let mut painting = Painting::new(gpu, BOX, GLYPH, RGBA);
    painting.layout = gpu.layout(&[set.layout]);
    painting.blend[0] = over(painting.blend[0]);
    let stride = size_of::<Corner>() as u32;
    painting.bindings = vec![vk::VertexInputBindingDescription::default().stride(stride)];
    let two = vk::Format::R32G32_SFLOAT;
    painting.attributes = [(two, 0), (two, 8), (RGBA, 16)]
        .iter()
        .zip(0..)
        .map(
            |(&(format, offset), location)| vk::VertexInputAttributeDescription {
                location,
                binding: 0,
                format,
                offset,
            },
        )
        .collect();
    let pipeline = gpu.painting(&painting);
    let pass = Pass {
        colors: &[canvas],
        clears: &[[0.0; 4]],
        ..Pass::default()
    };
    let frame = |commands| {
        gpu.bind(commands, pipeline);
        gpu.push(commands, painting.layout, &[width as f32, height as f32]);
        gpu.bind_vertices(commands, &vertices);
        gpu.bind_indices(commands, &indices, vk::IndexType::UINT16);
        let mut first = 0;
        for window in &windows {
            gpu.bind_set(commands, painting.layout, set.handle);
            let count = window.items.len() as u32 * 6;
            // SAFETY: the command buffer is being recorded.
            unsafe {
                (gpu.device).cmd_set_scissor(commands, 0, &[window.scissor]);
                (gpu.device).cmd_draw_indexed(commands, count, 1, first, 0, 0);
            }
            first += count;
        }
    };
    let turn = gpu.record(|commands| {
        for _ in 0..FRAMES {
            gpu.record_pass(commands, &pass, frame);
            gpu.barrier(commands);
        }
    });
    let expected = reference(width, height, &windows);
    Some(drawn(gpu, turn, &[canvas], f64::from(FRAMES), move |gpu| {
        check_colors(gpu, &canvas, 2, |x, y| expected[(y * width + x) as usize])
    }))
}
