//! Workloads that draw: what each sets up, one turn of it, and how its picture is checked.
//!
//! Each picture is held against a reference that is computed here, exactly where the specification
//! leaves no freedom, so that a driver that draws something else gets no time.

mod clusters;
mod fill;
mod frames;
mod gbuffer;
mod lines;
mod particles;
mod sprites;
mod terrain;
mod triangles;
mod view;
mod volumes;

use anyhow::{Result, ensure};
use tuff_tests::{Bound, Buffer, Canvas, Gpu, Pass, RGBA, vk};

use crate::workload::{Bounds, Prepared, Workload};
use crate::world::Scale;

pub const ALL: [Workload; 23] = [
    row(
        "triangles 0.5",
        "triangles of half a pixel",
        "Mtri/s",
        |g, s| triangles::flat(g, s, 1),
    ),
    row("triangles 2", "triangles of 2 pixels", "Mtri/s", |g, s| {
        triangles::flat(g, s, 2)
    }),
    row("triangles 8", "triangles of 8 pixels", "Mtri/s", |g, s| {
        triangles::flat(g, s, 4)
    }),
    row(
        "triangles 32",
        "triangles of 32 pixels",
        "Mtri/s",
        |g, s| triangles::flat(g, s, 8),
    ),
    row("lines", "strips of lines of a pixel", "Mline/s", |g, s| {
        lines::strips(g, s, 1.0)
    }),
    row(
        "lines wide",
        "strips of lines of 5 pixels",
        "Mline/s",
        |g, s| lines::strips(g, s, 5.0),
    ),
    row("fill", "screens of one colour", "Mpixel/s", fill::flat),
    row(
        "fill depth",
        "screens before each other",
        "Mpixel/s",
        fill::depth,
    ),
    row(
        "fill blend",
        "screens over each other",
        "Mpixel/s",
        fill::blend,
    ),
    row(
        "fill texture",
        "screens of a bilinear texture",
        "Mpixel/s",
        fill::texture,
    ),
    row(
        "fill samples",
        "screens of four samples, resolved",
        "Mpixel/s",
        fill::samples,
    ),
    row(
        "tone map",
        "a float image to bytes by a fragment shader",
        "Mpixel/s",
        fill::tone_map,
    ),
    row(
        "g-buffer",
        "the scene into three attachments and depth",
        "Mtri/s",
        gbuffer::geometry,
    ),
    row(
        "terrain",
        "ground tessellated by distance, displaced by a map",
        "Mpatch/s",
        terrain::tessellated,
    ),
    row(
        "sprites",
        "points made squares by a geometry shader",
        "Mpoint/s",
        sprites::squares,
    ),
    row(
        "shadow volumes",
        "shadows by volumes from a geometry shader",
        "Mtri/s",
        volumes::shadows,
    ),
    row(
        "feedback",
        "particles moved by transform feedback, drawn as points",
        "Mpoint/s",
        particles::captured,
    ),
    row(
        "clusters",
        "the scene by mesh shaders, culled by a task shader",
        "Mtri/s",
        clusters::by_mesh_shaders,
    ),
    row(
        "clusters vertex",
        "the same scene by vertex shaders",
        "Mtri/s",
        clusters::by_vertex_shaders,
    ),
    row(
        "draws",
        "10,000 draws of two triangles",
        "kdraw/s",
        frames::draws,
    ),
    row(
        "interface",
        "frames of an interface: glyphs, boxes, scissors",
        "frame/s",
        frames::interface,
    ),
    row("clear", "passes that only clear", "Mpixel/s", fill::clear),
    row(
        "fill buffer",
        "the same bytes by vkCmdFillBuffer",
        "Mpixel/s",
        fill::buffer,
    ),
];

const fn row(
    name: &'static str,
    about: &'static str,
    unit: &'static str,
    prepare: fn(&Gpu, &Scale) -> Option<Prepared>,
) -> Workload {
    Workload {
        name,
        about,
        unit,
        bounds: Bounds::Drawing,
        prepare,
    }
}

/// Whether passes can be recorded as these workloads do.
fn draws(gpu: &Gpu) -> bool {
    gpu.has_graphics() && gpu.features13.dynamic_rendering == vk::TRUE
}

/// Pixels of what is drawn into: 1280×720, or less where pictures are to be small.
fn size(scale: &Scale) -> [u32; 2] {
    let width = (scale.width * 4).min(1280);
    [width, width * scale.height / scale.width]
}

/// A colour attachment of that size.
fn canvas(gpu: &Gpu, scale: &Scale, format: vk::Format) -> Canvas {
    let [width, height] = size(scale);
    gpu.canvas(format, width, height)
}

/// A turn of passes into the same attachments.
fn turn(gpu: &Gpu, pass: &Pass<'_>, record: impl Fn(vk::CommandBuffer)) -> vk::CommandBuffer {
    gpu.record(|commands| {
        gpu.record_pass(commands, pass, &record);
        gpu.barrier(commands);
    })
}

/// The picture by which drivers are compared: the sum of the attachments' contents.
fn look(gpu: &Gpu, canvases: &[Canvas]) -> (vk::CommandBuffer, Buffer) {
    let (width, height) = (canvases[0].width, canvases[0].height);
    let picture = gpu.buffer(u64::from(width) * u64::from(height) * 16);
    let sampler = gpu.sampler(&vk::SamplerCreateInfo::default());
    let sources: Vec<Bound> = canvases
        .iter()
        .map(|canvas| Bound::Sampled(canvas.view, sampler))
        .collect();
    let source = format!(
        "layout(local_size_x = 8, local_size_y = 8) in;
        layout(set = 0, binding = 0) uniform sampler2D sources[{count}];
        layout(set = 0, binding = 1) buffer Picture {{ vec4 picture[]; }};
        void main() {{
            uvec2 at = gl_GlobalInvocationID.xy;
            if (at.x >= {width}u || at.y >= {height}u) return;
            vec4 sum = vec4(0.0);
            for (int i = 0; i < {count}; i++) sum += texelFetch(sources[i], ivec2(at), 0);
            picture[at.y * {width}u + at.x] = abs(sum);
        }}",
        count = sources.len(),
    );
    let set = gpu.set(&[(0, &sources), (1, &[Bound::Storage(picture)])]);
    let kernel = gpu.kernel(&source, &[set.layout]);
    let groups = [width.div_ceil(8), height.div_ceil(8), 1];
    let commands = gpu.record(|commands| {
        gpu.record_dispatch::<u32>(commands, kernel, &[set], &[], groups);
        gpu.barrier(commands);
    });
    (commands, picture)
}

/// A turn that draws, its units of work and its check.
fn drawn(
    gpu: &Gpu,
    turn: vk::CommandBuffer,
    canvases: &[Canvas],
    work: f64,
    check: impl Fn(&Gpu) -> Result<()> + 'static,
) -> Prepared {
    let (look, picture) = look(gpu, canvases);
    Prepared {
        turn,
        work: Some(work),
        picture,
        look: Some(look),
        submissions: 1,
        check: Some(Box::new(check)),
    }
}

/// Holds every pixel of an attachment of four bytes a texel against what it is to be, within a
/// tolerance.
fn check_colors(
    gpu: &Gpu,
    canvas: &Canvas,
    tolerance: u8,
    expected: impl Fn(u32, u32) -> [u8; 4],
) -> Result<()> {
    for (index, found) in (0..).zip(gpu.colors(canvas)) {
        let (x, y) = (index % canvas.width, index / canvas.width);
        let wanted = expected(x, y);
        let fits =
            (found.iter().zip(wanted)).all(|(found, wanted)| found.abs_diff(wanted) <= tolerance);
        ensure!(fits, "pixel {x}, {y} is {found:?}, not {wanted:?}");
    }
    Ok(())
}

/// The bytes of a colour.
fn bytes(color: [f32; 4]) -> [u8; 4] {
    color.map(|part| (part.clamp(0.0, 1.0) * 255.0).round() as u8)
}

/// The source colour over the destination by its alpha.
fn over(state: vk::PipelineColorBlendAttachmentState) -> vk::PipelineColorBlendAttachmentState {
    state
        .blend_enable(true)
        .src_color_blend_factor(vk::BlendFactor::SRC_ALPHA)
        .dst_color_blend_factor(vk::BlendFactor::ONE_MINUS_SRC_ALPHA)
        .src_alpha_blend_factor(vk::BlendFactor::ONE)
        .dst_alpha_blend_factor(vk::BlendFactor::ONE_MINUS_SRC_ALPHA)
}
