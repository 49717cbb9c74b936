//! Random sequences of draws and clears, held against a rasterizer that asks every sample of every
//! pixel.
//!
//! Everything is chosen so that the specification leaves no freedom: positions lie on the grid of
//! sub-pixels, a primitive has one depth and one colour, alphas are 0 or 1 and blend factors follow
//! from them. So every sample of every attachment, and every count of samples, must be equal.

mod chance;
mod reference;

use chance::{Able, pick, random_area, random_color, random_depth, random_draw};
use reference::{Area, DrawState, Fragment, Frame, GRID, Primitive};
use tuff_tests::*;

const DEPTH: vk::Format = vk::Format::D32_SFLOAT_S8_UINT;
const WIDTH: u32 = 48;
const HEIGHT: u32 = 40;
/// How many vertices a draw's buffer has.
const VERTICES: u32 = 24;
const INSTANCES: u32 = 4;

/// An instance moves its vertices, and replaces their colour if the fourth component of the shift
/// is 1.
const VERTEX: &str = "
    layout(location = 0) in vec4 position;
    layout(location = 1) in vec4 color;
    layout(location = 2) in vec4 shift;
    layout(location = 3) in vec4 other;
    layout(push_constant) uniform Push { int bits; float depth; int mask; float size; };
    layout(location = 0) flat out vec4 shade;
    void main() {
        gl_Position = vec4(position.xy + shift.xy, position.z, 1.0);
        gl_PointSize = size;
        shade = shift.w == 1.0 ? other : color;
    }";

/// A geometry shader that passes primitives on, without its input.
const PASS_ON: &str = "
    layout(location = 0) flat in vec4 shades[];
    layout(location = 0) flat out vec4 shade;
    void main() {
        for (int i = 0; i < gl_in.length(); i++) {
            gl_Position = gl_in[i].gl_Position;
            gl_PointSize = gl_in[i].gl_PointSize;
            shade = shades[i];
            EmitVertex();
        }
    }";

/// The common part of fragment shaders; the body of `main` follows.
const FRAGMENT: &str = "
    layout(location = 0) flat in vec4 shade;
    layout(location = 0) out vec4 first;
    layout(location = 1) out vec4 second;
    layout(push_constant) uniform Push { int bits; float depth; int mask; float size; };
    void main() {
        first = shade;
        second = shade.bgra;
        ";

fn fragment_source(fragment: Fragment) -> String {
    let rest = match fragment {
        Fragment::Plain => "",
        Fragment::Discard(_) => {
            "ivec2 at = ivec2(gl_FragCoord.xy); if (((at.x ^ at.y) & bits) == bits) discard;"
        }
        Fragment::Depth(_) => "gl_FragDepth = depth;",
        Fragment::Mask(_) => "gl_SampleMask[0] = mask;",
    };
    format!("{FRAGMENT}{rest} }}")
}

/// Writes the samples of a picture side by side.
const SPREAD: &str = "
    layout(local_size_x = 8, local_size_y = 8) in;
    layout(binding = 0) uniform sampler2DMS samples;
    layout(binding = 1, rgba8) uniform writeonly image2D spread;
    void main() {
        ivec2 at = ivec2(gl_GlobalInvocationID.xy);
        if (any(greaterThanEqual(at, imageSize(spread)))) return;
        imageStore(spread, at, texelFetch(samples, at / ivec2(4, 1), at.x % 4));
    }";

/// One draw: what is bound, and which vertices it takes.
struct Draw {
    state: DrawState,
    topology: vk::PrimitiveTopology,
    point_size: f32,
    /// Places in the framebuffer in parts of a pixel, with depth and colour.
    vertices: Vec<([i64; 2], f32, [u8; 4])>,
    /// Shifts in parts of a pixel, and colours in the place of the vertices'.
    instances: Vec<([i64; 2], Option<[u8; 4]>)>,
    first_instance: u32,
    instance_count: u32,
    /// Of a draw without indices.
    first_vertex: u32,
    vertex_count: u32,
    /// Some(_): indices, none of them restarts.
    indices: Option<Vec<Option<u32>>>,
    vertex_offset: i32,
    is_short: bool,
    /// There is a geometry shader that passes primitives on.
    passes_on: bool,
}

enum Step {
    Draw(Box<Draw>),
    /// A rectangle of one colour attachment, or of depth and stencil.
    ClearColor(usize, Area, [u8; 4]),
    ClearDepth(Area, f32, u8),
}

fn whole() -> Area {
    Area {
        low: [0, 0],
        high: [i64::from(WIDTH), i64::from(HEIGHT)],
    }
}

impl Draw {
    /// The vertices in the order of the draw, with none where a restart ends a strip or a fan.
    fn sequence(&self) -> Vec<Option<u32>> {
        match &self.indices {
            Some(indices) => {
                let moved = |index: &Option<u32>| index.map(|it| it + self.vertex_offset as u32);
                indices.iter().map(moved).collect()
            }
            None => (self.first_vertex..self.first_vertex + self.vertex_count)
                .map(Some)
                .collect(),
        }
    }

    /// The primitives in order, of all instances ("Primitive Topologies"): the first vertex gives
    /// the colour.
    fn primitives(&self) -> Vec<Primitive> {
        let sequence = self.sequence();
        let mut shapes: Vec<Vec<u32>> = Vec::new();
        for run in sequence.split(Option::is_none) {
            let run: Vec<u32> = run.iter().copied().flatten().collect();
            match self.topology {
                vk::PrimitiveTopology::POINT_LIST => shapes.extend(run.iter().map(|&it| vec![it])),
                vk::PrimitiveTopology::TRIANGLE_LIST => {
                    shapes.extend(run.chunks_exact(3).map(<[u32]>::to_vec));
                }
                vk::PrimitiveTopology::TRIANGLE_STRIP => {
                    shapes.extend((0..run.len().saturating_sub(2)).map(|i| {
                        let odd = i % 2;
                        vec![run[i], run[i + 1 + odd], run[i + 2 - odd]]
                    }));
                }
                _ => shapes.extend(
                    (0..run.len().saturating_sub(2)).map(|i| vec![run[i + 1], run[i + 2], run[0]]),
                ),
            }
        }
        let mut primitives = Vec::new();
        for instance in 0..self.instance_count {
            let (shift, color) = self.instances[(self.first_instance + instance) as usize];
            for shape in &shapes {
                let corner = |index: u32| {
                    let at = self.vertices[index as usize].0;
                    [at[0] + shift[0], at[1] + shift[1]]
                };
                let (_, depth, own) = self.vertices[shape[0] as usize];
                primitives.push(Primitive {
                    shape: match shape[..] {
                        [a, b, c] => reference::Shape::Triangle([a, b, c].map(corner)),
                        _ => {
                            reference::Shape::Point(corner(shape[0]), self.point_size as i64 * GRID)
                        }
                    },
                    depth,
                    color: color.unwrap_or(own),
                });
            }
        }
        primitives
    }

    /// A length in parts of a pixel as one in clip space, exact in `f32`.
    fn clip(&self, length: i64, axis: usize) -> f32 {
        let size = self.state.viewport.high[axis] - self.state.viewport.low[axis];
        (2 * length) as f32 / (size * GRID) as f32
    }

    fn pipeline(&self, gpu: &Gpu, samples: u32) -> vk::Pipeline {
        let source = fragment_source(self.state.fragment);
        let kinds = match self.topology {
            vk::PrimitiveTopology::POINT_LIST => {
                "layout(points) in; layout(points, max_vertices = 1) out;"
            }
            _ => "layout(triangles) in; layout(triangle_strip, max_vertices = 3) out;",
        };
        let geometry = format!("{kinds}{PASS_ON}");
        let mut painting = Painting::new(gpu, VERTEX, &source, RGBA).with_corners();
        painting.geometry = self.passes_on.then_some(&*geometry);
        painting.bindings.push(
            vk::VertexInputBindingDescription::default()
                .binding(1)
                .stride(size_of::<Corner>() as u32)
                .input_rate(vk::VertexInputRate::INSTANCE),
        );
        for location in 2..4 {
            painting.attributes.push(
                vk::VertexInputAttributeDescription::default()
                    .location(location)
                    .binding(1)
                    .format(vk::Format::R32G32B32A32_SFLOAT)
                    .offset(16 * (location - 2)),
            );
        }
        let state = &self.state;
        painting.topology = self.topology;
        painting.restart = self.topology == vk::PrimitiveTopology::TRIANGLE_STRIP
            || self.topology == vk::PrimitiveTopology::TRIANGLE_FAN;
        painting.samples = samples;
        painting.rasterization = painting
            .rasterization
            .cull_mode(state.cull)
            .front_face(state.front);
        painting.depth_stencil = painting
            .depth_stencil
            .depth_test_enable(state.depth_test)
            .depth_write_enable(state.depth_write)
            .depth_compare_op(state.depth_compare)
            .stencil_test_enable(state.stencil_test)
            .front(state.stencil[0])
            .back(state.stencil[1]);
        painting.blend = state.blends.clone();
        painting.logic = state.logic;
        painting.colors = vec![RGBA; state.blends.len()];
        painting.depth = DEPTH;
        painting.stencil = DEPTH;
        let [width, height] = state.rate.map(|side| side as u32);
        let rate = vk::PipelineFragmentShadingRateStateCreateInfoKHR::default()
            .fragment_size(vk::Extent2D { width, height });
        let next = match state.rate {
            [1, 1] => std::ptr::null(),
            _ => (&raw const rate).cast(),
        };
        gpu.painting_with(&painting, vk::PipelineCreateFlags::empty(), next)
    }

    fn record(&self, gpu: &Gpu, commands: vk::CommandBuffer, pipeline: vk::Pipeline) {
        let middle = |axis: usize| {
            let viewport = &self.state.viewport;
            (viewport.low[axis] + viewport.high[axis]) * GRID / 2
        };
        let shade = |color: [u8; 4]| color.map(|it| f32::from(it) / 255.0);
        let corners: Vec<Corner> = self
            .vertices
            .iter()
            .map(|&(at, depth, color)| Corner {
                position: [
                    self.clip(at[0] - middle(0), 0),
                    self.clip(at[1] - middle(1), 1),
                    depth,
                    1.0,
                ],
                color: shade(color),
            })
            .collect();
        let instances: Vec<Corner> = self
            .instances
            .iter()
            .map(|&(shift, color)| Corner {
                position: [
                    self.clip(shift[0], 0),
                    self.clip(shift[1], 1),
                    0.0,
                    f32::from(color.is_some()),
                ],
                color: shade(color.unwrap_or_default()),
            })
            .collect();
        let (corners, instances) = (gpu.buffer_with(&corners), gpu.buffer_with(&instances));
        let viewport = &self.state.viewport;
        let extent = |axis: usize| (viewport.high[axis] - viewport.low[axis]) as f32;
        let viewport = vk::Viewport {
            x: viewport.low[0] as f32,
            y: viewport.low[1] as f32,
            width: extent(0),
            height: extent(1),
            min_depth: 0.0,
            max_depth: 1.0,
        };
        let (bits, depth, mask) = match self.state.fragment {
            Fragment::Plain => (0, 0.0, 0),
            Fragment::Discard(bits) => (bits as u32, 0.0, 0),
            Fragment::Depth(depth) => (0, depth, 0),
            Fragment::Mask(mask) => (0, 0.0, mask),
        };
        let push = [bits, depth.to_bits(), mask, self.point_size.to_bits()];
        let device = &gpu.device;
        gpu.bind(commands, pipeline);
        // SAFETY: the command buffer is being recorded; the buffers live as long as the device.
        unsafe {
            device.cmd_set_viewport(commands, 0, &[viewport]);
            device.cmd_set_scissor(commands, 0, &[rectangle(self.state.scissor)]);
            let stages = vk::ShaderStageFlags::ALL;
            let bytes = bytemuck::bytes_of(&push);
            device.cmd_push_constants(commands, gpu.layout(&[]), stages, 0, bytes);
            let buffers = [corners.handle, instances.handle];
            device.cmd_bind_vertex_buffers(commands, 0, &buffers, &[0, 0]);
            let (count, first) = (self.instance_count, self.first_instance);
            let Some(indices) = &self.indices else {
                let (vertices, from) = (self.vertex_count, self.first_vertex);
                device.cmd_draw(commands, vertices, count, from, first);
                return;
            };
            let long: Vec<u32> = indices.iter().map(|it| it.unwrap_or(u32::MAX)).collect();
            let short: Vec<u16> = long.iter().map(|&it| it as u16).collect();
            let (buffer, kind) = match self.is_short {
                true => (gpu.buffer_with(&short), vk::IndexType::UINT16),
                false => (gpu.buffer_with(&long), vk::IndexType::UINT32),
            };
            device.cmd_bind_index_buffer(commands, buffer.handle, 0, kind);
            let length = indices.len() as u32;
            device.cmd_draw_indexed(commands, length, count, 0, self.vertex_offset, first);
        }
    }
}

fn rectangle(area: Area) -> vk::Rect2D {
    vk::Rect2D {
        offset: vk::Offset2D {
            x: area.low[0] as i32,
            y: area.low[1] as i32,
        },
        extent: vk::Extent2D {
            width: (area.high[0] - area.low[0]) as u32,
            height: (area.high[1] - area.low[1]) as u32,
        },
    }
}

/// Clears a rectangle of the attachments, on the device and in the reference.
fn record_clear(gpu: &Gpu, commands: vk::CommandBuffer, step: &Step) {
    let (area, clear) = match *step {
        Step::ClearColor(attachment, area, color) => {
            let color = vk::ClearColorValue {
                float32: color.map(|it| f32::from(it) / 255.0),
            };
            let clear = vk::ClearAttachment::default()
                .aspect_mask(vk::ImageAspectFlags::COLOR)
                .color_attachment(attachment as u32)
                .clear_value(vk::ClearValue { color });
            (area, clear)
        }
        Step::ClearDepth(area, depth, stencil) => {
            let depth_stencil = vk::ClearDepthStencilValue {
                depth,
                stencil: u32::from(stencil),
            };
            let clear = vk::ClearAttachment::default()
                .aspect_mask(vk::ImageAspectFlags::DEPTH | vk::ImageAspectFlags::STENCIL)
                .clear_value(vk::ClearValue { depth_stencil });
            (area, clear)
        }
        Step::Draw(_) => unreachable!("a draw is no clear"),
    };
    let rect = vk::ClearRect {
        rect: rectangle(area),
        base_array_layer: 0,
        layer_count: 1,
    };
    // SAFETY: the command buffer is being recorded.
    unsafe {
        gpu.device
            .cmd_clear_attachments(commands, &[clear], &[rect])
    };
}

/// Runs one sequence on the device and in the reference, and compares.
fn run(gpu: &Gpu, able: Able, seed: u32) {
    let random = &mut Rng::with_seed(seed.into());
    let samples = pick(random, &[1, 1, 4]);
    let attachments = 1 + random.usize(..2);
    let colors: Vec<Canvas> = (0..attachments)
        .map(|_| gpu.canvas_of(RGBA, WIDTH, HEIGHT, 1, samples))
        .collect();
    let depth = gpu.canvas_of(DEPTH, WIDTH, HEIGHT, 1, samples);
    let mut frame = Frame::new(WIDTH, HEIGHT, samples as usize, attachments);
    for pass in 0..2 {
        let steps: Vec<Step> = (0..1 + random.u32(..4))
            .map(|_| match random.u32(..8) {
                0 => Step::ClearColor(
                    random.usize(..attachments),
                    random_area(random),
                    random_color(random),
                ),
                1 => Step::ClearDepth(random_area(random), random_depth(random), random.u8(..)),
                _ => Step::Draw(Box::new(random_draw(random, able, samples, attachments))),
            })
            .collect();
        let clears: Vec<[u8; 4]> = (0..attachments).map(|_| random_color(random)).collect();
        let clear_depth = (random_depth(random), random.u8(..));
        let is_cleared = pass == 0;

        let floats: Vec<[f32; 4]> = clears
            .iter()
            .map(|it| it.map(|byte| f32::from(byte) / 255.0))
            .collect();
        let recorded = Pass {
            colors: &colors,
            clears: if is_cleared { &floats } else { &[] },
            depth: Some(depth),
            stencil: Some(depth),
            clear_depth: is_cleared.then_some((clear_depth.0, u32::from(clear_depth.1))),
            ..Pass::default()
        };
        let pipelines: Vec<Option<vk::Pipeline>> = steps
            .iter()
            .map(|step| match step {
                Step::Draw(draw) => Some(draw.pipeline(gpu, samples)),
                _ => None,
            })
            .collect();
        let queries = vk::QueryPoolCreateInfo::default()
            .query_type(vk::QueryType::OCCLUSION)
            .query_count(steps.len() as u32);
        let queries = gpu.query_pool(&queries);
        let precise = match gpu.features.occlusion_query_precise == vk::TRUE {
            true => vk::QueryControlFlags::PRECISE,
            false => vk::QueryControlFlags::empty(),
        };
        gpu.run(|commands| {
            // SAFETY: the command buffer is being recorded.
            unsafe {
                let count = steps.len() as u32;
                gpu.device.cmd_reset_query_pool(commands, queries, 0, count);
            }
            gpu.record_pass(commands, &recorded, |commands| {
                for (index, (step, pipeline)) in steps.iter().zip(&pipelines).enumerate() {
                    let (Step::Draw(draw), Some(pipeline)) = (step, *pipeline) else {
                        record_clear(gpu, commands, step);
                        continue;
                    };
                    // SAFETY: the command buffer is being recorded.
                    unsafe {
                        let device = &gpu.device;
                        device.cmd_begin_query(commands, queries, index as u32, precise);
                        draw.record(gpu, commands, pipeline);
                        device.cmd_end_query(commands, queries, index as u32);
                    }
                }
            });
        });

        if is_cleared {
            frame.in_area(whole(), |frame, index| {
                for (attachment, color) in clears.iter().enumerate() {
                    frame.colors[attachment][index] = *color;
                }
                (frame.depth[index], frame.stencil[index]) = clear_depth;
            });
        }
        for (index, step) in steps.iter().enumerate() {
            let draw = match step {
                Step::ClearColor(attachment, area, color) => {
                    frame.in_area(*area, |it, index| it.colors[*attachment][index] = *color);
                    continue;
                }
                Step::ClearDepth(area, depth, stencil) => {
                    frame.in_area(*area, |it, index| {
                        (it.depth[index], it.stencil[index]) = (*depth, *stencil);
                    });
                    continue;
                }
                Step::Draw(draw) => draw,
            };
            let primitives = draw.primitives();
            let draw_one = |primitive| frame.draw(&draw.state, primitive);
            let expected: u64 = primitives.iter().map(draw_one).sum();
            let mut count = [0u64];
            // SAFETY: the query has ended.
            unsafe {
                let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
                gpu.device
                    .get_query_pool_results(queries, index as u32, &mut count, flags)
                    .expect("the count of samples");
            }
            let is_equal = match precise.is_empty() {
                true => (count[0] > 0) == (expected > 0),
                false => count[0] == expected,
            };
            assert!(
                is_equal,
                "sequence {seed}, pass {pass}, step {index}: {} samples passed, not {expected}\n{:?}\n{:?}",
                count[0], draw.state, draw.topology
            );
        }
        compare(
            gpu,
            &colors,
            &depth,
            &frame,
            &format!("sequence {seed}, pass {pass}"),
        );
    }
}

/// Every sample of colour; depth and stencil where there is one sample.
fn compare(gpu: &Gpu, colors: &[Canvas], depth: &Canvas, frame: &Frame, what: &str) {
    for (attachment, canvas) in colors.iter().enumerate() {
        let found = match frame.samples {
            1 => gpu.colors(canvas),
            _ => spread(gpu, canvas),
        };
        same(
            &found,
            &frame.colors[attachment],
            frame,
            &format!("{what}, colour {attachment}"),
        );
    }
    if frame.samples == 1 {
        let depths: Vec<f32> = gpu.texels(depth, vk::ImageAspectFlags::DEPTH);
        same(&depths, &frame.depth, frame, &format!("{what}, depth"));
        let stencils: Vec<u8> = gpu.texels(depth, vk::ImageAspectFlags::STENCIL);
        same(
            &stencils,
            &frame.stencil,
            frame,
            &format!("{what}, stencil"),
        );
    }
}

#[track_caller]
fn same<T: PartialEq + std::fmt::Debug>(found: &[T], expected: &[T], frame: &Frame, what: &str) {
    assert_eq!(found.len(), expected.len());
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        let (pixel, sample) = (index / frame.samples, index % frame.samples);
        let (x, y) = (pixel as i64 % frame.width, pixel as i64 / frame.width);
        assert_eq!(found, expected, "{what}, pixel ({x}, {y}), sample {sample}");
    }
}

/// The samples of a picture, pixel by pixel.
fn spread(gpu: &Gpu, canvas: &Canvas) -> Vec<[u8; 4]> {
    let usage = vk::ImageUsageFlags::STORAGE | vk::ImageUsageFlags::TRANSFER_SRC;
    let wide = gpu.picture(
        tuff_tests::Shape::flat(RGBA, 4 * canvas.width, canvas.height),
        usage,
    );
    let sampler = gpu.sampler(&vk::SamplerCreateInfo::default());
    let set = gpu.set_of(&[
        Bound::Sampled(canvas.view, sampler),
        Bound::StorageImage(wide.view),
    ]);
    let groups = [canvas.width.div_ceil(2), canvas.height.div_ceil(8), 1];
    let kernel = gpu.kernel(SPREAD, &[set.layout]);
    gpu.dispatch(kernel, &[set], &[0u32], groups);
    gpu.download(&wide, 0, 4).read()
}

/// How many sequences one device draws: what they make is freed with it.
const TOGETHER: u32 = 20;

/// Draws sequences `0..count`.
fn sequences(count: u32, clips: bool) {
    for start in (0..count).step_by(TOGETHER as usize) {
        let Some(gpu) = Gpu::new().with("a graphics queue with dynamic rendering", |gpu| {
            gpu.has_graphics()
                && gpu.features13.dynamic_rendering == vk::TRUE
                && gpu.limits.standard_sample_locations == vk::TRUE
                && gpu.limits.sub_pixel_precision_bits == 8
        }) else {
            return;
        };
        if clips && !gpu.is_tuff() {
            return;
        }
        let able = Able {
            logic: gpu.features.logic_op == vk::TRUE,
            independent_blend: gpu.features.independent_blend == vk::TRUE,
            large_points: gpu.features.large_points == vk::TRUE,
            geometry: gpu.features.geometry_shader == vk::TRUE
                && gpu.features.shader_tessellation_and_geometry_point_size == vk::TRUE,
            rates: has_rates(&gpu),
            clips_exactly: clips,
        };
        (start..count.min(start + TOGETHER)).for_each(|seed| run(&gpu, able, seed));
    }
}

/// Whether fragments of several pixels are there and may leave what draws here leave.
fn has_rates(gpu: &Gpu) -> bool {
    let limits = gpu.shading_rate_limits();
    gpu.optional.shading_rate.pipeline_fragment_shading_rate == vk::TRUE
        && limits.fragment_shading_rate_with_shader_depth_stencil_writes == vk::TRUE
        && limits.fragment_shading_rate_with_shader_sample_mask == vk::TRUE
}

#[test]
fn random_sequences_of_draws_are_exact() {
    sequences(effort::rounds(100), false);
}

/// The vertices that clipping adds need not lie on the grid of sub-pixels, so drivers may move
/// edges there. This one does not.
#[test]
fn clipping_moves_no_edge() {
    sequences(effort::rounds(100), true);
}
