//! Random draws: shaders with changed instructions, random counts, indices, viewports and states.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::OnceLock;

use ash::vk;
use fastrand::Rng;
use tuff_tests::{Painting, Stage};

use super::modules::mutate;
use crate::case::{Case, wild};
use crate::guard::{Attachment, MARGIN};
use crate::world::{BYTES, World, compiled};

/// Vertex shaders to start from.
const VERTEX: [&str; 2] = [
    r"
    layout(location = 0) in vec4 place;
    layout(location = 1) in uvec2 more;
    layout(location = 0) out vec4 shade;
    layout(location = 1) flat out uvec2 kept;
    layout(location = 2) noperspective centroid out vec2 at;
    out gl_PerVertex { vec4 gl_Position; float gl_PointSize; float gl_ClipDistance[2]; };
    void main() {
        gl_Position = place + vec4(gl_VertexIndex & 3, gl_VertexIndex >> 2 & 3, 0, 0) * 0.5;
        gl_PointSize = float(more.x & 63u);
        gl_ClipDistance[0] = place.w; gl_ClipDistance[1] = 1.0 - place.x;
        shade = u[gl_InstanceIndex & 63] + place;
        kept = more;
        at = place.yx;
    }",
    r"
    layout(location = 0) out vec4 shade;
    layout(location = 1) flat out uvec2 kept;
    layout(location = 2) noperspective centroid out vec2 at;
    void main() {
        int i = gl_VertexIndex;
        uint w = b[i & 4095];
        gl_Position = vec4(i % 3 == 1 ? 3.0 : -1.0, i % 3 == 2 ? 3.0 : -1.0, 0.1 * float(gl_InstanceIndex), uintBitsToFloat(w | 0x3f800000u));
        for (uint k = 0u; k < (w & 7u); k++) gl_Position.x += texelFetch(t, ivec2(k), 0).x;
        shade = vec4(i, w, 0, 1);
        kept = uvec2(w, gl_BaseInstance + gl_DrawID);
        at = vec2(i);
        gl_PrimitiveShadingRateEXT = int(w & 31u);
        b[256 + (i & 255)] = w;
    }",
];

/// Geometry shaders to start from.
const GEOMETRY: [&str; 2] = [
    r"
    layout(triangles, invocations = 2) in;
    layout(triangle_strip, max_vertices = 9) out;
    layout(location = 0) in vec4 shades[];
    layout(location = 1) flat in uvec2 keeps[];
    layout(location = 2) in vec2 ats[];
    layout(location = 0) out vec4 shade;
    layout(location = 1) flat out uvec2 kept;
    layout(location = 2) noperspective centroid out vec2 at;
    void main() {
        uint n = keeps[0].x & 15u;
        for (uint i = 0u; i < n; i++) {
            gl_Position = gl_in[i % 3u].gl_Position + vec4(gl_InvocationID) * 0.1;
            gl_Layer = int(keeps[1].y & 1u);
            gl_ViewportIndex = int(keeps[2].y & 15u) / 15;
            gl_PrimitiveShadingRateEXT = int(keeps[1].x);
            gl_PrimitiveID = gl_PrimitiveIDIn + int(i);
            shade = shades[keeps[i % 3u].x & 3u] + u[i & 63u];
            kept = keeps[2];
            at = ats[1];
            EmitVertex();
            if (i % 4u == 3u) EndPrimitive();
        }
        b[uint(gl_PrimitiveIDIn) & 255u] = n;
    }",
    r"
    layout(lines_adjacency) in;
    layout(line_strip, max_vertices = 4) out;
    layout(location = 0) in vec4 shades[];
    layout(location = 0) out vec4 shade;
    layout(location = 1) flat out uvec2 kept;
    void main() {
        for (int i = 0; i < gl_in.length(); i++) {
            gl_Position = gl_in[3 - i].gl_Position;
            gl_PointSize = gl_in[i].gl_PointSize;
            shade = shades[i];
            kept = uvec2(gl_PrimitiveIDIn, b[i]);
            EmitVertex();
        }
    }",
];

/// The payload between the shaders below.
const PAYLOAD: &str = "struct Payload { uint count; uvec2 kept; vec4 shade[20]; };
    taskPayloadSharedEXT Payload payload;";

/// Task shaders to start from.
const TASK: [&str; 2] = [
    r"
    layout(local_size_x = 20) in;
    shared uint most;
    void main() {
        uint i = gl_LocalInvocationIndex;
        if (i == 0u) { most = 0u; payload.count = b[gl_DrawID & 255] & 15u; }
        barrier();
        atomicMax(most, b[256u + i] & 3u);
        payload.shade[(i + gl_WorkGroupID.x) % 20u] = u[i & 63u];
        payload.kept = gl_NumWorkGroups.xy;
        barrier();
        EmitMeshTasksEXT(most, gl_WorkGroupID.y & 3u, 1u);
    }",
    r"
    void main() {
        payload.count = b[gl_WorkGroupID.x & 255u];
        EmitMeshTasksEXT(payload.count & 7u, 1u, 2u);
    }",
];

/// Mesh shaders to start from.
const MESH: [&str; 2] = [
    r"
    layout(local_size_x = 24) in;
    layout(triangles, max_vertices = 24, max_primitives = 40) out;
    layout(location = 0) out vec4 shade[];
    layout(location = 1) flat out uvec2 kept[];
    layout(location = 2) noperspective centroid out vec2 at[];
    shared vec4 places[24];
    void main() {
        uint i = gl_LocalInvocationIndex;
        places[i] = vec4(i % 3u == 1u ? 3.0 : -1.0, i % 3u == 2u ? 3.0 : -1.0, 0.1, 1.0);
        barrier();
        SetMeshOutputsEXT(20u + payload.count % 8u, b[i] & 63u);
        gl_MeshVerticesEXT[i].gl_Position = places[23u - i] + u[b[i] & 63u] * 0.01;
        shade[i] = payload.shade[b[i] % 32u];
        kept[i] = payload.kept + i;
        at[i] = vec2(i, payload.count);
        for (uint p = i; p < 40u; p += 24u) {
            gl_PrimitiveTriangleIndicesEXT[p] = uvec3(p, b[p] & 31u, p + 2u) % 25u;
            gl_MeshPrimitivesEXT[p].gl_CullPrimitiveEXT = (b[p] & 7u) == 0u;
            gl_MeshPrimitivesEXT[p].gl_Layer = int(p & 1u);
            gl_MeshPrimitivesEXT[p].gl_ViewportIndex = int(p & 15u) / 15;
            gl_MeshPrimitivesEXT[p].gl_PrimitiveShadingRateEXT = int(b[p]);
            gl_MeshPrimitivesEXT[p].gl_PrimitiveID = int(p);
        }
    }",
    r"
    layout(lines, max_vertices = 6, max_primitives = 6) out;
    layout(location = 0) out vec4 shade[];
    layout(location = 1) flat out uvec2 kept[];
    void main() {
        SetMeshOutputsEXT(6u, 6u);
        for (uint i = 0u; i < 6u; i++) {
            uint w = b[(gl_WorkGroupID.x + i) & 255u];
            gl_MeshVerticesEXT[i].gl_Position = uintBitsToFloat(uvec4(w, w << 3, w << 5, 0x3f800000u));
            gl_MeshVerticesEXT[i].gl_ClipDistance[0] = uintBitsToFloat(w);
            shade[i] = payload.shade[w & 31u];
            kept[i] = payload.kept;
            gl_PrimitiveLineIndicesEXT[i] = uvec2(i, w & 7u);
        }
    }",
];

/// Control shaders to start from.
const CONTROL: [&str; 2] = [
    r"
    layout(vertices = 3) out;
    layout(location = 0) in vec4 shades[];
    layout(location = 1) in uvec2 keeps[];
    layout(location = 0) out vec4 shade[];
    layout(location = 1) out uvec2 kept[];
    layout(location = 3) patch out vec4 all[4];
    void main() {
        gl_out[gl_InvocationID].gl_Position = gl_in[gl_InvocationID].gl_Position;
        shade[gl_InvocationID] = shades[keeps[0].x & 31u];
        kept[gl_InvocationID] = keeps[gl_InvocationID];
        barrier();
        all[keeps[1].x & 3u] = shade[(gl_InvocationID + 1) % 3] + u[keeps[1].y & 63u];
        barrier();
        gl_TessLevelOuter = float[](shades[0].x, all[0].y, all[1].z, shades[2].w);
        gl_TessLevelInner = float[](all[keeps[2].x & 3u].x * 8.0, 4.0);
        b[uint(gl_PrimitiveID) & 255u] = uint(gl_PatchVerticesIn);
    }",
    r"
    layout(vertices = 20) out;
    layout(location = 1) in uvec2 keeps[];
    layout(location = 1) out uvec2 kept[];
    void main() {
        kept[gl_InvocationID] = keeps[gl_InvocationID & 3];
        barrier();
        uvec2 other = kept[keeps[0].x % 20u];
        gl_out[gl_InvocationID].gl_Position = uintBitsToFloat(other.xyxy);
        gl_TessLevelOuter[other.x & 3u] = float(other.y & 15u);
        gl_TessLevelInner[other.y & 1u] = uintBitsToFloat(other.x);
    }",
];

/// Evaluation shaders to start from.
const EVALUATION: [&str; 3] = [
    r"
    layout(quads, fractional_even_spacing) in;
    layout(location = 0) in vec4 shades[];
    layout(location = 1) in uvec2 keeps[];
    layout(location = 3) patch in vec4 all[4];
    layout(location = 0) out vec4 shade;
    layout(location = 1) flat out uvec2 kept;
    void main() {
        uint n = keeps[0].x & 31u;
        gl_Position = mix(gl_in[0].gl_Position, gl_in[1].gl_Position, gl_TessCoord.x) + gl_TessCoord.yyyy;
        gl_PointSize = gl_TessLevelInner[n & 1u];
        shade = shades[n] + all[n & 3u] + u[n];
        kept = keeps[n];
    }",
    r"
    layout(triangles, fractional_odd_spacing, cw) in;
    layout(location = 1) in uvec2 keeps[];
    layout(location = 1) flat out uvec2 kept;
    void main() {
        kept = keeps[gl_PatchVerticesIn - 1];
        gl_Position = gl_in[0].gl_Position * gl_TessCoord.x + gl_in[1].gl_Position * gl_TessCoord.y
            + gl_in[2].gl_Position * gl_TessCoord.z;
        b[uint(gl_PrimitiveID) & 255u] += kept.x;
    }",
    r"
    layout(isolines, point_mode) in;
    layout(location = 0) in vec4 shades[];
    layout(location = 0) out vec4 shade;
    void main() {
        shade = shades[1] * gl_TessLevelOuter[0];
        gl_Position = vec4(gl_TessCoord.xy * 2.0 - 1.0, 0.5, 1.0);
        gl_PointSize = shade.x;
    }",
];

/// Fragment shaders to start from.
const FRAGMENT: [&str; 3] = [
    r"
    layout(location = 0) in vec4 shade;
    layout(location = 1) flat in uvec2 kept;
    layout(location = 2) noperspective centroid in vec2 at;
    layout(location = 0) out vec4 first;
    layout(location = 1) out vec4 second;
    void main() {
        vec2 d = dFdx(at) + fwidth(shade.xy);
        first = texture(t, at) + vec4(d, 0, 1);
        second = interpolateAtOffset(shade, vec2(0.25)) * u[(kept.x + gl_ShadingRateEXT) & 63u];
        if (kept.y % 5u == 1u) discard;
        imageStore(p, ivec2(gl_FragCoord.xy), first);
        atomicAdd(b[kept.x & 255u], gl_SampleMaskIn[0]);
    }",
    r"
    #extension GL_EXT_demote_to_helper_invocation : require
    layout(location = 0) in vec4 shade;
    layout(location = 1) flat in uvec2 kept;
    layout(location = 0) out vec4 first;
    layout(location = 1) out vec4 second;
    void main() {
        if (shade.x > 0.4) demote;
        uint n = kept.x & 15u;
        vec4 sum = shade;
        for (uint i = 0u; i < n; i++) { sum += u[(b[i] + i) & 63u]; if (sum.x > 1e6) break; }
        first = gl_FrontFacing ? sum : -sum;
        second = vec4(gl_PointCoord, helperInvocationEXT() ? 1.0 : 0.0, gl_SampleID);
        gl_FragDepth = shade.z;
        gl_SampleMask[0] = int(kept.y);
    }",
    r"
    layout(early_fragment_tests) in;
    layout(location = 0) in vec4 shade;
    layout(location = 0) out vec4 first;
    layout(location = 1) out vec4 second;
    void main() {
        rayQueryEXT q;
        rayQueryInitializeEXT(q, world, 0u, 0xff, vec3(gl_FragCoord.xy * 0.01, 0), 0.0, vec3(0, 0, 1), 50.0);
        while (rayQueryProceedEXT(q)) rayQueryConfirmIntersectionEXT(q);
        first = vec4(rayQueryGetIntersectionTEXT(q, true));
        second = dFdy(first) + shade;
        b[uint(gl_FragCoord.x) + uint(gl_FragCoord.y) * 64u & 4095u] = floatBitsToUint(first.x);
    }",
];

fn shaders() -> &'static [Vec<Vec<u32>>; 7] {
    static SHADERS: OnceLock<[Vec<Vec<u32>>; 7]> = OnceLock::new();
    const PARAMETERS: &str = "#extension GL_ARB_shader_draw_parameters : enable\n";
    SHADERS.get_or_init(|| {
        let head = |source: &str| {
            let source = source.replace("gl_BaseInstance", "gl_BaseInstanceARB");
            format!(
                "{PARAMETERS}{}",
                source.replace("gl_DrawID", "gl_DrawIDARB")
            )
        };
        let all = |stage, sources: &[&str]| {
            let compile = |source: &&str| compiled(stage, &head(source));
            sources.iter().map(compile).collect()
        };
        // These have the parameters of draws in any case.
        let of_meshes = |stage, sources: &[&str]| {
            let compile = |source: &&str| compiled(stage, &format!("{PAYLOAD}{source}"));
            sources.iter().map(compile).collect()
        };
        [
            all(Stage::Vertex, &VERTEX),
            all(Stage::TessellationControl, &CONTROL),
            all(Stage::TessellationEvaluation, &EVALUATION),
            all(Stage::Geometry, &GEOMETRY),
            all(Stage::Fragment, &FRAGMENT),
            of_meshes(Stage::Task, &TASK),
            of_meshes(Stage::Mesh, &MESH),
        ]
    })
}

const COLORS: [vk::Format; 6] = [
    vk::Format::R8G8B8A8_UNORM,
    vk::Format::B8G8R8A8_SRGB,
    vk::Format::R16G16B16A16_SFLOAT,
    vk::Format::R32_UINT,
    vk::Format::A2B10G10R10_UNORM_PACK32,
    vk::Format::R8_UNORM,
];

const DEPTHS: [vk::Format; 5] = [
    vk::Format::UNDEFINED,
    vk::Format::D32_SFLOAT,
    vk::Format::D16_UNORM,
    vk::Format::D24_UNORM_S8_UINT,
    vk::Format::D32_SFLOAT_S8_UINT,
];

fn one_of<T: Copy>(rng: &mut Rng, all: &[T]) -> T {
    all[rng.usize(0..all.len())]
}

/// Mostly a plain number, else one such as breaks things.
fn number(rng: &mut Rng) -> f32 {
    const SPECIAL: [f32; 9] = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        f32::MIN_POSITIVE,
        -0.0,
        1e-40,
        32768.0,
        -32769.0,
    ];
    match rng.u32(0..3) {
        0 => one_of(rng, &SPECIAL),
        1 => f32::from_bits(rng.u32(..)),
        _ => rng.f32() * 80.0 - 20.0,
    }
}

/// Mostly within a count, else a wild number.
fn near(rng: &mut Rng, most: u32) -> u32 {
    match rng.u32(0..12) {
        0 => wild(rng) as u32,
        1 => most.wrapping_add(rng.u32(0..4)),
        _ => rng.u32(0..=most),
    }
}

/// A count that is mostly small: one that is not costs all the time that a draw is given.
fn counted(rng: &mut Rng) -> u32 {
    match rng.u32(0..5000) {
        0 => wild(rng) as u32,
        _ => rng.u32(0..64),
    }
}

/// The attachments of a pass, all with one number of samples.
struct PassAttachments {
    colors: Vec<Attachment>,
    depth: Option<Attachment>,
    /// Fragment shading rates: whatever its memory holds.
    rates: Option<Attachment>,
    extent: [u32; 2],
    layers: u32,
    samples: u32,
}

impl PassAttachments {
    fn new(world: &World, rng: &mut Rng) -> PassAttachments {
        let extent = [rng.u32(1..90), rng.u32(1..90)];
        let samples = one_of(rng, &[1, 1, 1, 2, 4, 8]);
        let layers = one_of(rng, &[1, 1, 2]);
        let of = |format| Attachment::new(&world.gpu, format, extent, layers, samples);
        let count = rng.usize(1..3);
        let colors = (0..count).map(|_| of(one_of(rng, &COLORS))).collect();
        let format = one_of(rng, &DEPTHS);
        let rates = (rng.u32(0..3) == 0).then(|| {
            let extent = [rng.u32(1..7), rng.u32(1..7)];
            let layers = rng.u32(1..3);
            Attachment::new(&world.gpu, vk::Format::R8_UINT, extent, layers, 1)
        });
        PassAttachments {
            colors,
            depth: (format != vk::Format::UNDEFINED).then(|| of(format)),
            rates,
            extent,
            layers,
            samples,
        }
    }

    fn check(&self) {
        self.colors
            .iter()
            .chain(&self.depth)
            .chain(&self.rates)
            .for_each(Attachment::check);
    }
}

fn blend(rng: &mut Rng) -> vk::PipelineColorBlendAttachmentState {
    let mut factor = || vk::BlendFactor::from_raw(rng.i32(0..19));
    let [a, b, c, d] = [factor(), factor(), factor(), factor()];
    vk::PipelineColorBlendAttachmentState::default()
        .blend_enable(rng.bool())
        .src_color_blend_factor(a)
        .dst_color_blend_factor(b)
        .src_alpha_blend_factor(c)
        .dst_alpha_blend_factor(d)
        .color_blend_op(vk::BlendOp::from_raw(rng.i32(0..5)))
        .alpha_blend_op(vk::BlendOp::from_raw(rng.i32(0..5)))
        .color_write_mask(vk::ColorComponentFlags::from_raw(rng.u32(0..16)))
}

/// A pipeline for a target; its states are valid or nearly so.
fn painting<'a>(world: &World, rng: &mut Rng, target: &PassAttachments) -> Painting<'a> {
    let format = target.depth.as_ref().map(|it| it.format);
    let format = format.unwrap_or(vk::Format::UNDEFINED);
    let has_stencil = [DEPTHS[3], DEPTHS[4]].contains(&format);
    let stencil = vk::StencilOpState {
        fail_op: vk::StencilOp::from_raw(rng.i32(0..8)),
        pass_op: vk::StencilOp::from_raw(rng.i32(0..8)),
        depth_fail_op: vk::StencilOp::from_raw(rng.i32(0..8)),
        compare_op: vk::CompareOp::from_raw(rng.i32(0..8)),
        compare_mask: rng.u32(..),
        write_mask: rng.u32(..),
        reference: rng.u32(..),
    };
    let rasterization = vk::PipelineRasterizationStateCreateInfo::default()
        .depth_clamp_enable(rng.bool())
        .polygon_mode(vk::PolygonMode::from_raw(rng.i32(0..3)))
        .cull_mode(vk::CullModeFlags::from_raw(rng.u32(0..8) / 5))
        .depth_bias_enable(rng.bool())
        .depth_bias_constant_factor(number(rng))
        .depth_bias_slope_factor(number(rng))
        .depth_bias_clamp(number(rng))
        .line_width(number(rng));
    let attributes = [
        (
            0,
            one_of(
                rng,
                &[vk::Format::R32G32B32A32_SFLOAT, vk::Format::R8G8B8A8_SNORM],
            ),
        ),
        (
            1,
            one_of(rng, &[vk::Format::R32G32_UINT, vk::Format::R16G16_UINT]),
        ),
    ];
    let attribute = |(location, format)| {
        vk::VertexInputAttributeDescription::default()
            .location(location)
            .format(format)
            .offset(location * 4)
    };
    Painting {
        bindings: vec![vk::VertexInputBindingDescription::default().stride(rng.u32(0..40))],
        attributes: attributes.map(attribute).to_vec(),
        topology: vk::PrimitiveTopology::from_raw(rng.i32(0..10)),
        control_points: one_of(rng, &[1, 2, 3, 4, 16, 31, 32]),
        lower_left: rng.bool(),
        restart: rng.bool(),
        rasterization,
        samples: target.samples,
        depth_stencil: vk::PipelineDepthStencilStateCreateInfo::default()
            .depth_test_enable(rng.bool())
            .depth_write_enable(rng.bool())
            .depth_compare_op(vk::CompareOp::from_raw(rng.i32(0..8)))
            .depth_bounds_test_enable(rng.u32(0..4) == 0)
            .min_depth_bounds(number(rng))
            .max_depth_bounds(number(rng))
            .stencil_test_enable(rng.bool())
            .front(stencil)
            .back(stencil),
        blend: target.colors.iter().map(|_| blend(rng)).collect(),
        colors: target.colors.iter().map(|it| it.format).collect(),
        depth: format,
        stencil: if has_stencil {
            format
        } else {
            vk::Format::UNDEFINED
        },
        layout: world.layout,
        dynamic: match rng.u32(0..3) {
            0 => vec![vk::DynamicState::FRAGMENT_SHADING_RATE_KHR],
            _ => Vec::new(),
        },
        ..Painting::new(&world.gpu, "", "", target.colors[0].format)
    }
}

pub fn run(world: &World, case: &Case) {
    let mut rng = case.common();
    let target = PassAttachments::new(world, &mut rng);
    let mut painting = painting(world, &mut rng, &target);
    let mut words = shaders()
        .each_ref()
        .map(|all| all[rng.usize(0..all.len())].clone());
    // Half of the cases have shaders as they were written: what they draw goes further.
    let changes = rng.usize(0..6) / 3 * rng.usize(1..5);
    for mut rng in case.steps().take(changes) {
        let which = rng.usize(0..words.len());
        mutate(&mut rng, &mut words[which]);
    }
    let stages = [
        Stage::Vertex,
        Stage::TessellationControl,
        Stage::TessellationEvaluation,
        Stage::Geometry,
        Stage::Fragment,
        Stage::Task,
        Stage::Mesh,
    ];
    let mut stages: Vec<_> = stages.into_iter().zip(words).collect();
    let mut meshes = stages.split_off(5);
    if rng.bool() {
        stages.remove(3);
    }
    // Rarely one of the two without the other, and patches without either.
    match rng.u32(0..16) {
        0 => drop(stages.remove(1 + rng.usize(0..2))),
        1..=8 => drop(stages.drain(1..3)),
        _ => painting.topology = vk::PrimitiveTopology::PATCH_LIST,
    }
    if rng.u32(0..32) == 0 {
        painting.topology = vk::PrimitiveTopology::PATCH_LIST;
    }
    // Workgroups in the place of vertices, with a task shader or without.
    if rng.u32(0..4) == 0 {
        meshes.extend(stages.pop());
        stages = meshes;
        if rng.u32(0..3) == 0 {
            stages.remove(0);
        }
    }
    let none = vk::PipelineCreateFlags::empty();
    let made = (world.gpu).try_painting(&painting, &stages, none, std::ptr::null());
    if let Ok(pipeline) = made {
        // The memory of vertices, indices and counts.
        let words: Vec<u32> = (0..BYTES / 4)
            .map(|_| match rng.u32(0..4) {
                0 => wild(&mut rng) as u32,
                1 => number(&mut rng).to_bits(),
                2 => (rng.f32() * 2.0 - 1.0).to_bits(),
                _ => rng.u32(0..64),
            })
            .collect();
        world.guarded[0].buffer.write(MARGIN as usize, &words);
        // The memory of draw parameters: few of them are too long to end.
        let words: Vec<u32> = (0..256).map(|_| counted(&mut rng)).collect();
        world.guarded[1].buffer.write(MARGIN as usize, &words);
        let done = catch_unwind(AssertUnwindSafe(|| {
            world.run(|commands| record(world, case, &mut rng, &target, pipeline, commands));
        }));
        target.check();
        if let Err(panic) = done {
            std::panic::resume_unwind(panic);
        }
    }
}

/// A pass with a draw a step.
fn record(
    world: &World,
    case: &Case,
    rng: &mut Rng,
    target: &PassAttachments,
    pipeline: vk::Pipeline,
    commands: vk::CommandBuffer,
) {
    let device = &world.gpu.device;
    let attachment = |of: &Attachment| {
        vk::RenderingAttachmentInfo::default()
            .image_view(of.view)
            .image_layout(vk::ImageLayout::GENERAL)
            .load_op(vk::AttachmentLoadOp::CLEAR)
            .store_op(vk::AttachmentStoreOp::STORE)
    };
    let colors: Vec<_> = target.colors.iter().map(attachment).collect();
    let depth = target.depth.as_ref().map(attachment);
    let [width, height] = target.extent;
    let area = vk::Rect2D {
        offset: vk::Offset2D {
            x: (rng.u32(0..6) / 5 * near(rng, width)) as i32,
            y: (rng.u32(0..6) / 5 * near(rng, height)) as i32,
        },
        extent: vk::Extent2D {
            width: if rng.u32(0..5) == 0 {
                near(rng, width)
            } else {
                width
            },
            height: if rng.u32(0..5) == 0 {
                near(rng, height)
            } else {
                height
            },
        },
    };
    let mut info = vk::RenderingInfo::default()
        .render_area(area)
        .layer_count(if rng.u32(0..9) == 0 {
            near(rng, target.layers)
        } else {
            target.layers
        })
        .view_mask(rng.u32(0..12) / 10 * near(rng, 3))
        .color_attachments(&colors);
    if let Some(depth) = &depth {
        info = info.depth_attachment(depth).stencil_attachment(depth);
    }
    let side = 1 << rng.u32(3..6);
    let mut rates = vk::RenderingFragmentShadingRateAttachmentInfoKHR::default()
        .image_layout(vk::ImageLayout::GENERAL)
        .shading_rate_attachment_texel_size(vk::Extent2D {
            width: side,
            height: side,
        });
    if let Some(attachment) = &target.rates {
        rates = rates.image_view(attachment.view);
        info = info.push_next(&mut rates);
    }
    // SAFETY: all handles live until the commands have run; the numbers the driver has to bear.
    unsafe {
        device.cmd_begin_rendering(commands, &info);
        let point = vk::PipelineBindPoint::GRAPHICS;
        device.cmd_bind_pipeline(commands, point, pipeline);
        let sets = [world.set.handle];
        device.cmd_bind_descriptor_sets(commands, point, world.layout, 0, &sets, &[]);
        for mut rng in case.steps() {
            step(world, &mut rng, target, commands);
        }
        device.cmd_end_rendering(commands);
    }
}

/// Other dynamic state, then a draw.
///
/// # Safety
/// The commands are being recorded, in a pass over the target.
unsafe fn step(
    world: &World,
    rng: &mut Rng,
    target: &PassAttachments,
    commands: vk::CommandBuffer,
) {
    let device = &world.gpu.device;
    let buffer = world.guarded[0].buffer.handle;
    let [width, height] = target.extent;
    let plain = rng.u32(0..3) != 0;
    let mut of = |most: u32| if plain { most as f32 } else { number(rng) };
    let viewport = vk::Viewport {
        x: of(0),
        y: of(0),
        width: of(width),
        height: of(height),
        min_depth: of(0),
        max_depth: of(1),
    };
    let mut of = |most: u32| {
        if rng.u32(0..4) == 0 {
            near(rng, most)
        } else {
            most
        }
    };
    let scissor = vk::Rect2D {
        offset: vk::Offset2D {
            x: of(0) as i32,
            y: of(0) as i32,
        },
        extent: vk::Extent2D {
            width: of(width),
            height: of(height),
        },
    };
    let offset = MARGIN + u64::from(near(rng, BYTES as u32) & !3);
    let clear = vk::ClearAttachment {
        aspect_mask: vk::ImageAspectFlags::from_raw(rng.u32(1..8)),
        color_attachment: rng.u32(0..3),
        ..Default::default()
    };
    let rect = vk::ClearRect {
        rect: scissor,
        base_array_layer: near(rng, 1),
        layer_count: near(rng, target.layers),
    };
    let mut op = || vk::FragmentShadingRateCombinerOpKHR::from_raw(rng.i32(0..6));
    let combiners = [op(), op()];
    let size = [near(rng, 4), near(rng, 4)];
    (world.gpu).set_shading_rate(commands, size, combiners);
    // SAFETY: the caller guarantees that the commands are being recorded, in a pass over the
    // target.
    unsafe {
        device.cmd_set_viewport(commands, 0, &[viewport]);
        device.cmd_set_scissor(commands, 0, &[scissor]);
        device.cmd_bind_vertex_buffers(commands, 0, &[buffer], &[offset]);
        let kind = one_of(rng, &[vk::IndexType::UINT16, vk::IndexType::UINT32]);
        device.cmd_bind_index_buffer(commands, buffer, offset, kind);
        if !draw(world, rng, commands) {
            device.cmd_clear_attachments(commands, &[clear], &[rect]);
        }
    }
}

/// Draws by one of the commands; false in one of twelve cases, without a command.
///
/// # Safety
/// The commands are being recorded, in a pass.
unsafe fn draw(world: &World, rng: &mut Rng, commands: vk::CommandBuffer) -> bool {
    let device = &world.gpu.device;
    let draws = world.guarded[1].buffer.handle;
    let meshes = ash::ext::mesh_shader::Device::new(&world.gpu.instance, device);
    // SAFETY: the caller guarantees that the commands are being recorded, in a pass.
    unsafe {
        let commands_at = MARGIN + u64::from(rng.u32(0..800) & !3);
        let stride = 4 * rng.u32(4..9);
        match rng.u32(0..12) {
            0 | 1 => {
                let (first, instance) = (near(rng, 60), near(rng, 60));
                device.cmd_draw(commands, counted(rng), rng.u32(0..4), first, instance);
            }
            2..=4 => {
                let (first, add) = (near(rng, 60), wild(rng) as i32 * rng.i32(0..2));
                let (count, instances) = (counted(rng), rng.u32(0..4));
                device.cmd_draw_indexed(commands, count, instances, first, add, near(rng, 60));
            }
            5 => device.cmd_draw_indirect(commands, draws, commands_at, rng.u32(0..4), stride),
            6 => {
                let at = MARGIN + u64::from(rng.u32(0..800) & !3);
                let most = rng.u32(0..5);
                device.cmd_draw_indexed_indirect_count(
                    commands,
                    draws,
                    commands_at,
                    draws,
                    at,
                    most,
                    stride,
                );
            }
            7..=9 => {
                let [x, y] = [counted(rng), rng.u32(0..4)];
                meshes.cmd_draw_mesh_tasks(commands, x, y, rng.u32(0..3));
            }
            10 => {
                let count = rng.u32(0..4);
                meshes.cmd_draw_mesh_tasks_indirect(commands, draws, commands_at, count, stride);
            }
            _ => return false,
        }
    }
    true
}
