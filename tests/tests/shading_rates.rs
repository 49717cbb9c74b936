//! `VK_KHR_fragment_shading_rate`: which pixels share a fragment, and what it does to all of them.

use ash::khr;
use tuff_tests::*;
use vk::FragmentShadingRateCombinerOpKHR as Op;

/// Lists fragments: what each sees, and its number from one on in the pixels that it covers.
const LIST: &str = "
    layout(set = 0, binding = 0) buffer List { uint count; uvec4 fragments[]; };
    layout(location = 0) out uvec4 left;
    void main() {
        uint number = atomicAdd(count, 1u);
        uvec2 twice = uvec2(gl_FragCoord.xy * 2.0);
        uvec2 steps = uvec2(dFdx(gl_FragCoord.x), dFdy(gl_FragCoord.y));
        fragments[number] = uvec4(twice, gl_SampleMaskIn[0], steps.x << 16 | steps.y << 8 | gl_ShadingRateEXT);
        left = uvec4(number + 1u);
    }";

const NUMBERS: vk::Format = vk::Format::R32_UINT;

/// Fragments' width and height.
type Size = [u32; 2];

fn device() -> Option<Gpu> {
    rates(Gpu::new())
}

fn rates(gpu: Gpu) -> Option<Gpu> {
    gpu.drawing()?.with("fragment shading rates", |gpu| {
        gpu.optional.shading_rate.pipeline_fragment_shading_rate == vk::TRUE
            && gpu.features.fragment_stores_and_atomics == vk::TRUE
    })
}

fn has_primitive_rates(gpu: &Gpu) -> bool {
    let features = &gpu.optional.shading_rate;
    has(
        "rates of primitives",
        features.primitive_fragment_shading_rate == vk::TRUE,
    )
}

/// The rates that there are, with their sample counts.
fn supported(gpu: &Gpu) -> Vec<(Size, vk::SampleCountFlags)> {
    let instance = khr::fragment_shading_rate::Instance::new(&gpu.entry, &gpu.instance);
    let list = instance.fp().get_physical_device_fragment_shading_rates_khr;
    let mut count = 0;
    // SAFETY: the physical device is of the instance; there are as many elements as counted.
    let rates = unsafe {
        let counted = list(gpu.physical, &mut count, std::ptr::null_mut());
        assert_eq!(counted, vk::Result::SUCCESS);
        let mut rates = vec![vk::PhysicalDeviceFragmentShadingRateKHR::default(); count as usize];
        let listed = list(gpu.physical, &mut count, rates.as_mut_ptr());
        assert_eq!(listed, vk::Result::SUCCESS);
        rates
    };
    let rate = |it: &vk::PhysicalDeviceFragmentShadingRateKHR<'_>| {
        let size = it.fragment_size;
        ([size.width, size.height], it.sample_counts)
    };
    rates.iter().map(rate).collect()
}

fn extent([width, height]: Size) -> vk::Extent2D {
    vk::Extent2D { width, height }
}

/// A rate's number in shaders.
fn word([width, height]: Size) -> u32 {
    width.ilog2() << 2 | height.ilog2()
}

/// The inputs of fragments of a size that cover a scissor of whole pixels (spec, "Fragment Shading
/// Rates", and "Multisampling" for the order of the coverage mask).
fn expected(size: Size, scissor: vk::Rect2D, samples: u32) -> Vec<[u32; 4]> {
    let [width, height] = size;
    let (from, extent) = (scissor.offset, scissor.extent);
    let inside = |x: u32, y: u32| {
        (from.x as u32..from.x as u32 + extent.width).contains(&x)
            && (from.y as u32..from.y as u32 + extent.height).contains(&y)
    };
    let mut fragments = Vec::new();
    for y in (0..64).step_by(height as usize) {
        for x in (0..64).step_by(width as usize) {
            let mut mask = 0;
            for pixel in 0..width * height {
                if inside(x + pixel % width, y + pixel / width) {
                    let place = width * height - 1 - pixel;
                    mask |= ((1u32 << samples) - 1) << (place * samples);
                }
            }
            if mask != 0 {
                let steps = width << 16 | height << 8;
                fragments.push([2 * x + width, 2 * y + height, mask, steps | word(size)]);
            }
        }
    }
    fragments.sort_unstable();
    fragments
}

/// A scissor that no fragment's edges fit, in a canvas that they do not fit either.
const SCISSOR: vk::Rect2D = vk::Rect2D {
    offset: vk::Offset2D { x: 3, y: 1 },
    extent: vk::Extent2D {
        width: 34,
        height: 20,
    },
};

const CANVAS: [u32; 2] = [37, 21];

/// Draws fragments that are listed, and checks that they are of a size.
fn check(
    gpu: &Gpu,
    painting: &mut Painting<'_>,
    next: *const std::ffi::c_void,
    size: Size,
    draw: impl FnOnce(vk::CommandBuffer, vk::PipelineLayout),
) {
    let [width, height] = CANVAS;
    let buffer = gpu.buffer(16 + 16 * u64::from(width * height));
    let set = gpu.set_of(&[buffer.into()]);
    painting.layout = gpu.layout(&[set.layout]);
    let pipeline = gpu.painting_with(painting, vk::PipelineCreateFlags::empty(), next);
    let canvas = gpu.canvas_of(NUMBERS, width, height, 1, painting.samples);
    let statistics = gpu.features.pipeline_statistics_query == vk::TRUE;
    let pool = statistics.then(|| {
        let flags = vk::QueryPipelineStatisticFlags::FRAGMENT_SHADER_INVOCATIONS;
        let info = vk::QueryPoolCreateInfo::default()
            .query_type(vk::QueryType::PIPELINE_STATISTICS)
            .query_count(1)
            .pipeline_statistics(flags);
        gpu.query_pool(&info)
    });
    gpu.run(|commands| {
        if let Some(pool) = pool {
            // SAFETY: the command buffer is being recorded.
            unsafe { gpu.device.cmd_reset_query_pool(commands, pool, 0, 1) };
        }
        gpu.record_pass(commands, &Pass::black(&canvas), |commands| {
            gpu.bind(commands, pipeline);
            gpu.bind_set(commands, painting.layout, set.handle);
            // SAFETY: the command buffer is being recorded.
            unsafe {
                gpu.device.cmd_set_scissor(commands, 0, &[SCISSOR]);
                if let Some(pool) = pool {
                    let flags = vk::QueryControlFlags::empty();
                    gpu.device.cmd_begin_query(commands, pool, 0, flags);
                }
            }
            draw(commands, painting.layout);
            if let Some(pool) = pool {
                // SAFETY: the command buffer is being recorded.
                unsafe { gpu.device.cmd_end_query(commands, pool, 0) };
            }
        });
    });
    let words: Vec<u32> = buffer.read();
    let fragments = words[4..].chunks_exact(4).take(words[0] as usize);
    let fragments: Vec<[u32; 4]> = fragments.map(|it| [it[0], it[1], it[2], it[3]]).collect();
    let mut sorted = fragments.clone();
    sorted.sort_unstable();
    let expected = expected(size, SCISSOR, painting.samples);
    assert_eq!(sorted, expected, "{size:?}, {} samples", painting.samples);
    if let Some(pool) = pool {
        let [count]: [u64; 1] = gpu.query_results(pool, 0);
        if gpu.is_tuff() {
            assert_eq!(count, expected.len() as u64);
        }
    }
    if painting.samples > 1 {
        return;
    }
    let numbers: Vec<u32> = gpu.texels(&canvas, vk::ImageAspectFlags::COLOR);
    for (index, &number) in (0..).zip(&numbers) {
        let (x, y) = (index % width, index / width);
        let (from, extent) = (SCISSOR.offset, SCISSOR.extent);
        let is_drawn = (from.x as u32..from.x as u32 + extent.width).contains(&x)
            && (from.y as u32..from.y as u32 + extent.height).contains(&y);
        assert_eq!(number != 0, is_drawn, "pixel {x}, {y}");
        if let Some(fragment) = number.checked_sub(1) {
            let [center_x, center_y, ..] = fragments[fragment as usize];
            let of = [center_x / 2 / size[0], center_y / 2 / size[1]];
            assert_eq!([x / size[0], y / size[1]], of, "pixel {x}, {y}");
        }
    }
}

#[test]
fn pipelines_have_rates() {
    let Some(gpu) = device() else { return };
    let all = supported(&gpu);
    let needed = [[2, 2], [2, 1]];
    for size in needed {
        let counts = all.iter().find(|it| it.0 == size).expect("a needed rate").1;
        assert!(counts.contains(vk::SampleCountFlags::TYPE_1 | vk::SampleCountFlags::TYPE_4));
    }
    assert_eq!(all.last().expect("a rate").0, [1, 1]);
    let order = |it: &(Size, _)| std::cmp::Reverse(it.0);
    assert!(all.is_sorted_by_key(order), "{all:?}");
    for (size, counts) in all {
        for samples in [1, 2, 4, 8] {
            let count = vk::SampleCountFlags::from_raw(samples);
            let limit = gpu.limits.framebuffer_color_sample_counts;
            if !(counts & limit).contains(count) {
                continue;
            }
            let mut painting = Painting::new(&gpu, COVER, LIST, NUMBERS);
            painting.samples = samples;
            let state = vk::PipelineFragmentShadingRateStateCreateInfoKHR::default()
                .fragment_size(extent(size));
            let state = (&raw const state).cast();
            check(&gpu, &mut painting, state, size, |commands, _| {
                gpu.draw_vertices(commands, 3);
            });
            painting.dynamic = vec![vk::DynamicState::FRAGMENT_SHADING_RATE_KHR];
            check(
                &gpu,
                &mut painting,
                std::ptr::null(),
                size,
                |commands, _| {
                    gpu.set_shading_rate(commands, size, [Op::KEEP; 2]);
                    gpu.draw_vertices(commands, 3);
                },
            );
        }
    }
}

/// A combiner operation on a side.
fn combined(op: Op, a: u32, b: u32) -> u32 {
    match op {
        Op::REPLACE => b,
        Op::MIN => a.min(b),
        Op::MAX => a.max(b),
        Op::MUL => a * b,
        _ => a,
    }
}

const OPS: [Op; 5] = [Op::KEEP, Op::REPLACE, Op::MIN, Op::MAX, Op::MUL];

/// Draws with all operations on some rates of the pipeline and the primitive. `draw` draws
/// primitives of a rate.
fn check_combiners(
    gpu: &Gpu,
    painting: &mut Painting<'_>,
    draw: impl Fn(vk::CommandBuffer, vk::PipelineLayout, u32),
) {
    let limits = gpu.shading_rate_limits();
    let supported = supported(gpu);
    painting.dynamic = vec![vk::DynamicState::FRAGMENT_SHADING_RATE_KHR];
    let has_all = limits.fragment_shading_rate_non_trivial_combiner_ops == vk::TRUE;
    for op in OPS.into_iter().take(if has_all { 5 } else { 2 }) {
        for (pipeline, primitive) in [
            ([1, 1], [2, 2]),
            ([2, 1], [1, 2]),
            ([2, 2], [1, 1]),
            ([2, 2], [2, 1]),
            ([1, 1], [1, 1]),
        ] {
            let size = [0, 1].map(|axis| combined(op, pipeline[axis], primitive[axis]));
            let strict = limits.fragment_shading_rate_strict_multiply_combiner == vk::TRUE;
            if !supported.iter().any(|it| it.0 == size) || (op == Op::MUL && !strict) {
                continue;
            }
            check(gpu, painting, std::ptr::null(), size, |commands, layout| {
                gpu.set_shading_rate(commands, pipeline, [op, Op::KEEP]);
                draw(commands, layout, word(primitive));
            });
        }
    }
}

#[test]
fn vertices_choose_rates() {
    let Some(gpu) = device() else { return };
    if !has_primitive_rates(&gpu) {
        return;
    }
    let vertex = "
        layout(push_constant) uniform Push { int rate; };
        void main() {
            gl_Position = vec4(gl_VertexIndex == 1 ? 3.0 : -1.0, gl_VertexIndex == 2 ? 3.0 : -1.0, 0.5, 1.0);
            // The provoking vertex is the first one.
            gl_PrimitiveShadingRateEXT = gl_VertexIndex == 0 ? rate : 0;
        }";
    let mut painting = Painting::new(&gpu, vertex, LIST, NUMBERS);
    check_combiners(&gpu, &mut painting, |commands, layout, rate| {
        gpu.push(commands, layout, &rate);
        gpu.draw_vertices(commands, 3);
    });
}

#[test]
fn geometry_shaders_choose_rates() {
    let Some(gpu) = device() else { return };
    let has_geometry = gpu.features.geometry_shader == vk::TRUE;
    if !has_primitive_rates(&gpu) || !has("geometry shaders", has_geometry) {
        return;
    }
    let geometry = "
        layout(triangles) in;
        layout(triangle_strip, max_vertices = 3) out;
        layout(push_constant) uniform Push { int rate; };
        void main() {
            for (int i = 0; i < 3; i++) {
                gl_Position = gl_in[i].gl_Position;
                gl_PrimitiveShadingRateEXT = rate;
                EmitVertex();
            }
        }";
    let mut painting = Painting::new(&gpu, COVER, LIST, NUMBERS);
    painting.geometry = Some(geometry);
    check_combiners(&gpu, &mut painting, |commands, layout, rate| {
        gpu.push(commands, layout, &rate);
        gpu.draw_vertices(commands, 3);
    });
}

#[test]
fn mesh_shaders_choose_rates() {
    let Some(gpu) = device() else { return };
    let features = &gpu.optional.mesh_shader;
    let has_mesh = features.primitive_fragment_shading_rate_mesh_shader == vk::TRUE;
    if !has_primitive_rates(&gpu) || !has("rates of mesh shaders", has_mesh) {
        return;
    }
    let mesh = "
        layout(local_size_x = 1) in;
        layout(triangles, max_vertices = 3, max_primitives = 1) out;
        layout(push_constant) uniform Push { int rate; };
        perprimitiveEXT out gl_MeshPerPrimitiveEXT { int gl_PrimitiveShadingRateEXT; } gl_MeshPrimitivesEXT[];
        void main() {
            SetMeshOutputsEXT(3, 1);
            for (int i = 0; i < 3; i++) {
                gl_MeshVerticesEXT[i].gl_Position = vec4(i == 1 ? 3.0 : -1.0, i == 2 ? 3.0 : -1.0, 0.5, 1.0);
            }
            gl_PrimitiveTriangleIndicesEXT[0] = uvec3(0, 1, 2);
            gl_MeshPrimitivesEXT[0].gl_PrimitiveShadingRateEXT = rate;
        }";
    let mut painting = Painting::new(&gpu, "", LIST, NUMBERS);
    painting.mesh = Some((None, mesh));
    let commands_of = ash::ext::mesh_shader::Device::new(&gpu.instance, &gpu.device);
    check_combiners(&gpu, &mut painting, |commands, layout, rate| {
        gpu.push(commands, layout, &rate);
        // SAFETY: the command buffer is being recorded.
        unsafe { commands_of.cmd_draw_mesh_tasks(commands, 1, 1, 1) };
    });
}

/// Draws with fragments of a size into colours and depths, which are black and one before.
fn drawn(
    gpu: &Gpu,
    vertex: &str,
    fragment: &str,
    size: Size,
    canvas: Canvas,
) -> (Vec<[u8; 4]>, Vec<f32>) {
    let mut painting = Painting::new(gpu, vertex, fragment, RGBA);
    painting.samples = canvas.samples;
    painting.depth = vk::Format::D32_SFLOAT;
    painting.depth_stencil = painting
        .depth_stencil
        .depth_test_enable(true)
        .depth_write_enable(true)
        .depth_compare_op(vk::CompareOp::LESS);
    let state =
        vk::PipelineFragmentShadingRateStateCreateInfoKHR::default().fragment_size(extent(size));
    let flags = vk::PipelineCreateFlags::empty();
    let pipeline = gpu.painting_with(&painting, flags, (&raw const state).cast());
    let (width, height, samples) = (canvas.width, canvas.height, canvas.samples);
    let depth = gpu.canvas_of(vk::Format::D32_SFLOAT, width, height, 1, samples);
    let resolve = gpu.canvas(RGBA, width, height);
    let resolves = [resolve];
    let pass = Pass {
        depth: Some(depth),
        clear_depth: Some((1.0, 0)),
        resolves: if samples > 1 { &resolves } else { &[] },
        ..Pass::black(&canvas)
    };
    gpu.draw(&pass, |commands| {
        gpu.bind(commands, pipeline);
        gpu.draw_vertices(commands, 9);
    });
    match samples {
        1 => (
            gpu.colors(&canvas),
            gpu.texels(&depth, vk::ImageAspectFlags::DEPTH),
        ),
        _ => (gpu.colors(&resolve), Vec::new()),
    }
}

/// Coverage and depths are those of pixels, whatever the rate: three triangles through each other.
#[test]
fn coverage_and_depth_stay_those_of_samples() {
    let Some(gpu) = device() else { return };
    let vertex = "
        layout(location = 0) flat out vec4 color;
        void main() {
            const vec3 places[9] = vec3[](
                vec3(-0.9, -0.8, 0.1), vec3(0.7, -0.6, 0.9), vec3(-0.2, 0.95, 0.4),
                vec3(0.9, 0.8, 0.2), vec3(-0.8, 0.3, 0.8), vec3(0.3, -0.9, 0.5),
                vec3(-0.1, -0.3, 0.3), vec3(0.0, 0.2, 0.31), vec3(0.15, -0.1, 0.32));
            const vec4 colors[3] = vec4[](vec4(1, 0, 0, 1), vec4(0, 1, 0, 1), vec4(0, 0, 1, 1));
            gl_Position = vec4(places[gl_VertexIndex], 1.0);
            color = colors[gl_VertexIndex / 3];
        }";
    let fragment = "
        layout(location = 0) flat in vec4 color;
        layout(location = 0) out vec4 left;
        void main() { left = color; }";
    for samples in [1, 4] {
        let draw = |size| {
            let canvas = gpu.canvas_of(RGBA, 131, 75, 1, samples);
            drawn(&gpu, vertex, fragment, size, canvas)
        };
        let pixels = draw([1, 1]);
        for size in [[2, 1], [2, 2]] {
            assert!(draw(size) == pixels, "{size:?} with {samples} samples");
        }
    }
}

/// A fragment of four pixels is discarded as a whole, or leaves one depth.
#[test]
fn fragments_decide_for_all_their_pixels() {
    let Some(gpu) = device() else { return };
    let fragment = "
        layout(location = 0) out vec4 left;
        void main() {
            ivec2 at = ivec2(gl_FragCoord.xy) / 2;
            if ((at.x ^ at.y) % 2 != 0) discard;
            gl_FragDepth = (gl_FragCoord.x + gl_FragCoord.y) / 64.0;
            left = vec4(gl_FragCoord.xy, 0.0, 255.0) / 255.0;
        }";
    let canvas = gpu.canvas(RGBA, 18, 10);
    let limits = gpu.shading_rate_limits();
    let writes = limits.fragment_shading_rate_with_shader_depth_stencil_writes == vk::TRUE;
    if !has("depths of fragments of several pixels", writes) {
        return;
    }
    let (colors, depths) = drawn(&gpu, COVER, fragment, [2, 2], canvas);
    for (index, (color, depth)) in (0..).zip(colors.into_iter().zip(depths)) {
        let [x, y] = [index % 18 / 2, index / 18 / 2];
        let [center_x, center_y] = [2 * x + 1, 2 * y + 1];
        let expected = match (x ^ y) % 2 {
            0 => {
                let depth = (center_x + center_y) as f32 / 64.0;
                ([center_x as u8, center_y as u8, 0, 255], depth)
            }
            _ => ([0; 4], 1.0),
        };
        assert_eq!((color, depth), expected, "pixel {index}");
    }
}

/// The first bit of the sample mask is of the last pixel.
#[test]
fn sample_masks_choose_pixels() {
    let Some(gpu) = device() else { return };
    let fragment = "
        layout(location = 0) out vec4 left;
        void main() {
            gl_SampleMask[0] = 1;
            left = vec4(1.0);
        }";
    let limits = gpu.shading_rate_limits();
    let masks = limits.fragment_shading_rate_with_shader_sample_mask == vk::TRUE;
    if !has("sample masks of fragments of several pixels", masks) {
        return;
    }
    let canvas = gpu.canvas(RGBA, 9, 6);
    let (colors, _) = drawn(&gpu, COVER, fragment, [2, 2], canvas);
    for (index, color) in colors.into_iter().enumerate() {
        let is_last = index % 9 % 2 == 1 && index / 9 % 2 == 1;
        assert_eq!(color, [if is_last { 255 } else { 0 }; 4], "pixel {index}");
    }
}

/// A shader that runs for each sample has fragments of one pixel.
#[test]
fn sample_shading_is_of_pixels() {
    let Some(gpu) = device() else { return };
    let rates = gpu.features.sample_rate_shading == vk::TRUE;
    if !has("sampleRateShading", rates) {
        return;
    }
    let fragment = "
        layout(location = 0) out vec4 left;
        void main() { left = vec4(float(gl_ShadingRateEXT), fract(gl_FragCoord.x), float(gl_SampleID), 1.0); }";
    let canvas = gpu.canvas(RGBA, 8, 8);
    let (colors, _) = drawn(&gpu, COVER, fragment, [2, 2], canvas);
    assert_eq!(colors, [[0, 128, 0, 255]; 64]);
}

/// The rates of squares, by the second combiner operation, row by row.
const SQUARES: [Size; 6] = [[2, 2], [1, 1], [2, 1], [1, 1], [2, 1], [2, 2]];

/// An attachment of [`SQUARES`], three in a row, the size of a square, and its image.
fn squares(gpu: &Gpu) -> (Canvas, vk::Extent2D) {
    let limits = gpu.shading_rate_limits();
    let texel = limits.min_fragment_shading_rate_attachment_texel_size;
    let format = vk::Format::R8_UINT;
    let usage = vk::ImageUsageFlags::FRAGMENT_SHADING_RATE_ATTACHMENT_KHR
        | vk::ImageUsageFlags::TRANSFER_DST;
    let image = gpu.image(&flat_info(format, 3, 2).usage(usage));
    let range = vk::ImageSubresourceRange::default()
        .aspect_mask(vk::ImageAspectFlags::COLOR)
        .level_count(1)
        .layer_count(1);
    let view = vk::ImageViewCreateInfo::default()
        .image(image)
        .view_type(vk::ImageViewType::TYPE_2D)
        .format(format)
        .subresource_range(range);
    let view = gpu.view(&view);
    gpu.to_general(image, range);
    let bytes = SQUARES.map(|size| word(size) as u8);
    let buffer = gpu.buffer_with(&bytes);
    let copy = vk::BufferImageCopy::default()
        .image_subresource(
            vk::ImageSubresourceLayers::default()
                .aspect_mask(vk::ImageAspectFlags::COLOR)
                .layer_count(1),
        )
        .image_extent(vk::Extent3D {
            width: 3,
            height: 2,
            depth: 1,
        });
    gpu.run(|commands| {
        let layout = vk::ImageLayout::GENERAL;
        // SAFETY: the buffer holds all of it.
        unsafe {
            let device = &gpu.device;
            device.cmd_copy_buffer_to_image(commands, buffer.handle, image, layout, &[copy]);
        }
    });
    let canvas = Canvas {
        image,
        view,
        format,
        aspects: vk::ImageAspectFlags::COLOR,
        width: 3,
        height: 2,
        layers: 1,
        samples: 1,
    };
    (canvas, texel)
}

/// Leaves the rate in bytes.
const RATE: &str = "
    layout(location = 0) out vec4 left;
    void main() { left = vec4(gl_FragCoord.xy, gl_ShadingRateEXT, 255.0) / 255.0; }";

/// Checks colours that [`RATE`] left with the rate of the pipeline and a combiner operation.
fn check_squares(colors: &[[u8; 4]], texel: vk::Extent2D, pipeline: Size, op: Op) {
    let width = 3 * texel.width;
    for (index, color) in (0..).zip(colors) {
        let (x, y) = (index % width, index / width);
        let square = SQUARES[(y / texel.height * 3 + x / texel.width) as usize];
        let size = [0, 1].map(|axis| combined(op, pipeline[axis], square[axis]));
        let of = |at: u32, size: u32| (at / size * size + size / 2) as u8;
        let center = [of(x, size[0]), of(y, size[1])];
        // Centres of one pixel end on a half, which rounds to either side.
        let near = |axis: usize| color[axis].abs_diff(center[axis]) <= 1 || size[axis] > 1;
        let exact = |axis: usize| color[axis] == center[axis] || size[axis] == 1;
        let is_right = (0..2).all(|axis| near(axis) && exact(axis));
        let rate = u32::from(color[2]);
        assert!(
            is_right && rate == word(size),
            "{op:?} {x}, {y}: {color:?}, {size:?}"
        );
    }
}

/// With their rates combined with the pipeline's, squares have these sizes, all of which there are.
const COMBINATIONS: [(Size, Op); 5] = [
    ([2, 2], Op::KEEP),
    ([1, 1], Op::REPLACE),
    ([2, 1], Op::MIN),
    ([2, 1], Op::MAX),
    ([1, 1], Op::MUL),
];

fn has_attachment_rates(gpu: &Gpu) -> bool {
    let features = &gpu.optional.shading_rate;
    has(
        "rates of attachments",
        features.attachment_fragment_shading_rate == vk::TRUE,
    )
}

#[test]
fn attachments_have_rates() {
    let Some(gpu) = device() else { return };
    if !has_attachment_rates(&gpu) {
        return;
    }
    let (rates, texel) = squares(&gpu);
    let canvas = gpu.canvas(RGBA, 3 * texel.width, 2 * texel.height);
    for (size, op) in COMBINATIONS {
        let painting = Painting::new(&gpu, COVER, RATE, RGBA);
        let state = vk::PipelineFragmentShadingRateStateCreateInfoKHR::default()
            .fragment_size(extent(size))
            .combiner_ops([Op::KEEP, op]);
        let flags = vk::PipelineCreateFlags::RENDERING_FRAGMENT_SHADING_RATE_ATTACHMENT_KHR;
        let pipeline = gpu.painting_with(&painting, flags, (&raw const state).cast());
        let pass = Pass {
            rates: Some((rates.view, texel)),
            ..Pass::black(&canvas)
        };
        gpu.draw(&pass, |commands| {
            gpu.bind(commands, pipeline);
            gpu.draw_vertices(commands, 3);
        });
        check_squares(&gpu.colors(&canvas), texel, size, op);
    }
}

/// The same in a render pass, whose second subpass has no rates.
#[test]
fn attachments_of_render_passes_have_rates() {
    let Some(gpu) = device() else { return };
    if !has_attachment_rates(&gpu) {
        return;
    }
    let (rates, texel) = squares(&gpu);
    let general = vk::ImageLayout::GENERAL;
    let attachment = |format| {
        vk::AttachmentDescription2::default()
            .format(format)
            .samples(vk::SampleCountFlags::TYPE_1)
            .load_op(vk::AttachmentLoadOp::LOAD)
            .store_op(vk::AttachmentStoreOp::STORE)
            .initial_layout(general)
            .final_layout(general)
    };
    let attachments = [RGBA, rates.format, RGBA].map(attachment);
    let reference = |index| {
        let reference = vk::AttachmentReference2::default();
        let color = vk::ImageAspectFlags::COLOR;
        reference
            .attachment(index)
            .layout(general)
            .aspect_mask(color)
    };
    let of_rates = reference(1);
    let mut with_rates = vk::FragmentShadingRateAttachmentInfoKHR::default()
        .fragment_shading_rate_attachment(&of_rates)
        .shading_rate_attachment_texel_size(texel);
    let colors = [[reference(0)], [reference(2)]];
    let subpass = |index: usize| {
        vk::SubpassDescription2::default()
            .pipeline_bind_point(vk::PipelineBindPoint::GRAPHICS)
            .color_attachments(&colors[index])
    };
    let subpasses = [subpass(0).push_next(&mut with_rates), subpass(1)];
    let info = vk::RenderPassCreateInfo2::default()
        .attachments(&attachments)
        .subpasses(&subpasses);
    let pass = gpu.render_pass(&info);
    let canvas = gpu.canvas(RGBA, 3 * texel.width, 2 * texel.height);
    let other = gpu.canvas(RGBA, canvas.width, canvas.height);
    let framebuffer = gpu.framebuffer(pass, &[canvas, rates, other]);
    for (size, op) in COMBINATIONS {
        let state = vk::PipelineFragmentShadingRateStateCreateInfoKHR::default()
            .fragment_size(extent(size))
            .combiner_ops([Op::KEEP, op]);
        let mut painting = Painting::new(&gpu, COVER, RATE, RGBA);
        let pipelines = [0, 1].map(|subpass| {
            painting.render_pass = Some((pass, subpass));
            gpu.painting_with(
                &painting,
                vk::PipelineCreateFlags::empty(),
                (&raw const state).cast(),
            )
        });
        gpu.run(|commands| {
            let begin = vk::RenderPassBeginInfo::default()
                .render_pass(pass)
                .framebuffer(framebuffer)
                .render_area(canvas.area());
            // SAFETY: the command buffer is being recorded.
            unsafe {
                let (device, inline) = (&gpu.device, vk::SubpassContents::INLINE);
                device.cmd_begin_render_pass(commands, &begin, inline);
                gpu.look_at(commands, &canvas);
                gpu.bind(commands, pipelines[0]);
                gpu.draw_vertices(commands, 3);
                device.cmd_next_subpass(commands, inline);
                gpu.bind(commands, pipelines[1]);
                gpu.draw_vertices(commands, 3);
                device.cmd_end_render_pass(commands);
            }
        });
        check_squares(&gpu.colors(&canvas), texel, size, op);
        let alone = [0, 1].map(|axis| combined(op, size[axis], 1));
        let rates = gpu.colors(&other);
        assert!(
            rates.iter().all(|it| u32::from(it[2]) == word(alone)),
            "{op:?}"
        );
    }
}
