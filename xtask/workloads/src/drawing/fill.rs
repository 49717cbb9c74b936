//! Bands over the whole screen, and passes that only clear.

use anyhow::{Result, ensure};
use tuff_tests::{Bound, Canvas, Gpu, Painting, Pass, Shape, vk};

use super::view::nearer;
use super::{RGBA, bytes, canvas, check_colors, drawn, draws, look, over, size, turn};
use crate::workload::Prepared;
use crate::world::Scale;

/// Rows of a band. Bands are less high than tiles of renderers are, or one that finds a tile
/// covered whole may drop what lies below.
const BAND: u32 = 60;

/// Bands over all of the viewport, an instance a layer; later layers are nearer. Their sides slant,
/// outside of the viewport: what is measured are triangles, not rectangles.
const COVER: &str = "
    layout(location = 0) out vec2 at;
    layout(push_constant) uniform Push { float height; };
    void main() {
        int corner = gl_VertexIndex % 6;
        vec2 of = vec2(corner == 1 || corner > 3, corner == 2 || corner == 3 || corner == 5);
        at = vec2(of.x * 2.0 + of.y * 0.25 - 0.5, (float(gl_VertexIndex / 6) + of.y) * height);
        gl_Position = vec4(at * 2.0 - 1.0, 0.75 - float(gl_InstanceIndex) / 256.0, 1.0);
    }";

const FLAT: &str = "
    layout(location = 0) out vec4 color;
    void main() { color = vec4(1.0, 0.6, 0.2, 0.4); }";

const TEXTURE: &str = "
    layout(set = 0, binding = 0) uniform sampler2D image;
    layout(location = 0) in vec2 at;
    layout(location = 0) out vec4 color;
    void main() { color = texture(image, at); }";

const TONE_MAP: &str = "
    layout(set = 0, binding = 0) uniform sampler2D image;
    layout(location = 0) out vec4 color;
    void main() {
        vec3 light = texelFetch(image, ivec2(gl_FragCoord.xy), 0).rgb;
        vec3 film = light * (2.51 * light + 0.03) / (light * (2.43 * light + 0.59) + 0.14);
        color = vec4(pow(clamp(film, 0.0, 1.0), vec3(1.0 / 2.2)), 1.0);
    }";

/// The colour of the flat shader.
const COLOR: [f32; 4] = [1.0, 0.6, 0.2, 0.4];

/// Layers drawn over each other by what a pass has; the pixels of all of them are its work.
fn layers(
    gpu: &Gpu,
    painting: &Painting<'_>,
    pass: &Pass<'_>,
    set: Option<vk::DescriptorSet>,
    layers: u32,
) -> vk::CommandBuffer {
    let pipeline = gpu.painting(painting);
    turn(gpu, pass, |commands| {
        gpu.bind(commands, pipeline);
        if let Some(set) = set {
            gpu.bind_set(commands, painting.layout, set);
        }
        let height = pass.colors[0].height;
        gpu.push(commands, painting.layout, &(BAND as f32 / height as f32));
        let corners = height.div_ceil(BAND) * 6;
        // SAFETY: the command buffer is being recorded.
        unsafe { gpu.device.cmd_draw(commands, corners, layers, 0, 0) };
    })
}

fn pixels(canvas: &Canvas, layers: u32) -> f64 {
    f64::from(canvas.width) * f64::from(canvas.height) * f64::from(layers)
}

fn clearing(canvas: &Canvas) -> Pass<'_> {
    Pass {
        colors: std::slice::from_ref(canvas),
        clears: &[[0.0; 4]],
        ..Pass::default()
    }
}

pub fn flat(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    const LAYERS: u32 = 64;
    if !draws(gpu) {
        return None;
    }
    let canvas = canvas(gpu, scale, RGBA);
    let painting = Painting::new(gpu, COVER, FLAT, RGBA);
    let turn = layers(gpu, &painting, &clearing(&canvas), None, LAYERS);
    let work = pixels(&canvas, LAYERS);
    Some(drawn(gpu, turn, &[canvas], work, move |gpu| {
        check_colors(gpu, &canvas, 0, |_, _| bytes(COLOR))
    }))
}

pub fn depth(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    const LAYERS: u32 = 64;
    if !draws(gpu) {
        return None;
    }
    let color = canvas(gpu, scale, RGBA);
    let depth = canvas(gpu, scale, vk::Format::D32_SFLOAT);
    let mut painting = Painting::new(gpu, COVER, FLAT, RGBA);
    painting.depth = vk::Format::D32_SFLOAT;
    painting.depth_stencil = nearer();
    let pass = Pass {
        depth: Some(depth),
        clear_depth: Some((1.0, 0)),
        ..clearing(&color)
    };
    let turn = layers(gpu, &painting, &pass, None, LAYERS);
    let work = pixels(&color, LAYERS);
    Some(drawn(gpu, turn, &[color], work, move |gpu| {
        check_colors(gpu, &color, 0, |_, _| bytes(COLOR))?;
        let nearest = 0.75 - (LAYERS - 1) as f32 / 256.0;
        let depths: Vec<f32> = gpu.texels(&depth, vk::ImageAspectFlags::DEPTH);
        let wrong = depths.iter().find(|it| (*it - nearest).abs() > 1e-6);
        ensure!(wrong.is_none(), "a depth is {wrong:?}, not {nearest}");
        Ok(())
    }))
}

pub fn blend(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    const LAYERS: u32 = 24;
    if !draws(gpu) {
        return None;
    }
    let canvas = canvas(gpu, scale, RGBA);
    let mut painting = Painting::new(gpu, COVER, FLAT, RGBA);
    painting.blend[0] = over(painting.blend[0]);
    let turn = layers(gpu, &painting, &clearing(&canvas), None, LAYERS);
    // Each layer leaves six tenths of what is below: what remains of the rounding is less than 2.
    let left = (1.0 - COLOR[3]).powi(LAYERS as i32);
    let expected = bytes([COLOR[0], COLOR[1], COLOR[2], 1.0].map(|part| part * (1.0 - left)));
    let work = pixels(&canvas, LAYERS);
    Some(drawn(gpu, turn, &[canvas], work, move |gpu| {
        check_colors(gpu, &canvas, 2, |_, _| expected)
    }))
}

pub fn texture(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    const LAYERS: u32 = 12;
    const SIDE: u32 = 256;
    if !draws(gpu) {
        return None;
    }
    let canvas = canvas(gpu, scale, RGBA);
    let image = gpu.picture(Shape::flat(RGBA, SIDE, SIDE), vk::ImageUsageFlags::SAMPLED);
    // Ramps: what lies between two texels is as simple as they are.
    let texel = |at: u32| [at % SIDE, at / SIDE, 255 - at % SIDE, 255].map(|part| part as u8);
    let texels: Vec<[u8; 4]> = (0..SIDE * SIDE).map(texel).collect();
    gpu.upload(&image, 0, &texels);
    let sampler = vk::SamplerCreateInfo::default()
        .mag_filter(vk::Filter::LINEAR)
        .min_filter(vk::Filter::LINEAR)
        .address_mode_u(vk::SamplerAddressMode::CLAMP_TO_EDGE)
        .address_mode_v(vk::SamplerAddressMode::CLAMP_TO_EDGE);
    let set = gpu.set_of(&[Bound::Sampled(image.view, gpu.sampler(&sampler))]);
    let mut painting = Painting::new(gpu, COVER, TEXTURE, RGBA);
    painting.layout = gpu.layout(&[set.layout]);
    let pass = clearing(&canvas);
    let turn = layers(gpu, &painting, &pass, Some(set.handle), LAYERS);
    let expected = move |x: u32, y: u32| {
        let ramp = |at: u32, of: u32| {
            let texels = (f64::from(at) + 0.5) / f64::from(of) * f64::from(SIDE) - 0.5;
            texels.clamp(0.0, 255.0).round() as u8
        };
        let (red, green) = (ramp(x, canvas.width), ramp(y, canvas.height));
        [red, green, 255 - red, 255]
    };
    let work = pixels(&canvas, LAYERS);
    Some(drawn(gpu, turn, &[canvas], work, move |gpu| {
        check_colors(gpu, &canvas, 1, expected)
    }))
}

pub fn samples(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    const LAYERS: u32 = 12;
    const SAMPLES: u32 = 4;
    if !draws(gpu) {
        return None;
    }
    let [width, height] = size(scale);
    let canvas = gpu.canvas_of(RGBA, width, height, 1, SAMPLES);
    let resolved = gpu.canvas(RGBA, width, height);
    let mut painting = Painting::new(gpu, COVER, FLAT, RGBA);
    painting.samples = SAMPLES;
    let pass = Pass {
        resolves: &[resolved],
        ..clearing(&canvas)
    };
    let turn = layers(gpu, &painting, &pass, None, LAYERS);
    let work = pixels(&canvas, LAYERS);
    Some(drawn(gpu, turn, &[resolved], work, move |gpu| {
        check_colors(gpu, &resolved, 0, |_, _| bytes(COLOR))
    }))
}

pub fn tone_map(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    const LAYERS: u32 = 6;
    if !draws(gpu) {
        return None;
    }
    let [width, height] = size(scale);
    let canvas = canvas(gpu, scale, RGBA);
    let format = vk::Format::R32G32B32A32_SFLOAT;
    let shape = Shape::flat(format, width, height);
    let image = gpu.picture(shape, vk::ImageUsageFlags::SAMPLED);
    let light = move |x: u32, y: u32| {
        let across = x as f32 / width as f32;
        let down = y as f32 / height as f32;
        [8.0 * across * across, down, across * down, 1.0]
    };
    let texels: Vec<[f32; 4]> = (0..width * height)
        .map(|at| light(at % width, at / width))
        .collect();
    gpu.upload(&image, 0, &texels);
    let sampler = gpu.sampler(&vk::SamplerCreateInfo::default());
    let set = gpu.set_of(&[Bound::Sampled(image.view, sampler)]);
    let mut painting = Painting::new(gpu, COVER, TONE_MAP, RGBA);
    painting.layout = gpu.layout(&[set.layout]);
    let pass = clearing(&canvas);
    let turn = layers(gpu, &painting, &pass, Some(set.handle), LAYERS);
    let film = |light: f32| {
        let light = f64::from(light);
        let film = light * (2.51 * light + 0.03) / (light * (2.43 * light + 0.59) + 0.14);
        (libm::pow(film.clamp(0.0, 1.0), 1.0 / 2.2) * 255.0).round() as u8
    };
    let expected = move |x: u32, y: u32| {
        let [red, green, blue, _] = light(x, y);
        [film(red), film(green), film(blue), 255]
    };
    let work = pixels(&canvas, LAYERS);
    Some(drawn(gpu, turn, &[canvas], work, move |gpu| {
        check_colors(gpu, &canvas, 1, expected)
    }))
}

/// How often attachments are cleared in a turn.
const CLEARS: u32 = 20;

pub fn clear(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    if !draws(gpu) {
        return None;
    }
    let color = canvas(gpu, scale, RGBA);
    let depth = canvas(gpu, scale, vk::Format::D32_SFLOAT);
    let pass = Pass {
        clears: &[COLOR],
        depth: Some(depth),
        clear_depth: Some((0.5, 0)),
        ..clearing(&color)
    };
    let turn = gpu.record(|commands| {
        for _ in 0..CLEARS {
            gpu.record_pass(commands, &pass, |_| {});
            gpu.barrier(commands);
        }
    });
    let work = pixels(&color, CLEARS);
    Some(drawn(gpu, turn, &[color], work, move |gpu| {
        check_colors(gpu, &color, 0, |_, _| bytes(COLOR))?;
        let depths: Vec<f32> = gpu.texels(&depth, vk::ImageAspectFlags::DEPTH);
        ensure!(depths.iter().all(|&it| it == 0.5), "depth is not cleared");
        Ok(())
    }))
}

/// As many bytes as [`clear`] writes, by the command that only writes bytes.
pub fn buffer(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    if !draws(gpu) {
        return None;
    }
    let canvas = canvas(gpu, scale, RGBA);
    let bytes = u64::from(canvas.width) * u64::from(canvas.height) * 4;
    let word = u32::from_le_bytes(bytes_of_color());
    let buffers = [gpu.buffer(bytes), gpu.buffer(bytes)];
    let turn = gpu.record(|commands| {
        for _ in 0..CLEARS {
            for buffer in &buffers {
                // SAFETY: the command buffer is being recorded.
                unsafe {
                    (gpu.device).cmd_fill_buffer(commands, buffer.handle, 0, bytes, word);
                }
            }
            gpu.barrier(commands);
        }
    });
    gpu.draw(&clearing(&canvas), |_| {});
    let (look, picture) = look(gpu, &[canvas]);
    let check = move |_: &Gpu| -> Result<()> {
        let words: Vec<u32> = buffers[1].read();
        ensure!(
            words.iter().all(|&it| it == word),
            "the buffer is not filled"
        );
        Ok(())
    };
    Some(Prepared {
        turn,
        work: Some(pixels(&canvas, CLEARS)),
        picture,
        look: Some(look),
        submissions: 1,
        check: Some(Box::new(check)),
    })
}

fn bytes_of_color() -> [u8; 4] {
    bytes(COLOR)
}
