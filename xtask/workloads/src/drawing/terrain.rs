//! Ground of patches that are divided by their distance and displaced by a map of heights.

use anyhow::{Result, ensure};
use glam::{Vec3, vec3};
use half::f16;
use tuff_tests::{Bound, Gpu, Painting, Pass, Shape, vk};

use super::view::{View, nearer, projection};
use super::{RGBA, canvas, drawn, draws, turn};
use crate::scene::{REACH, height};
use crate::workload::Prepared;
use crate::world::{Scale, camera};

/// Patches along a side, and texels of the map.
const PATCHES: u32 = 64;
const SIDE: u32 = 512;

const VERTEX: &str = "
    layout(location = 0) out vec2 corner;
    void main() {
        uint patchNumber = gl_VertexIndex / 4u, of = gl_VertexIndex % 4u;
        uvec2 at = uvec2(patchNumber % PATCHES + uint(of == 1u || of == 2u), patchNumber / PATCHES + of / 2u);
        corner = vec2(at) / float(PATCHES);
    }";

/// The divisions of an edge depend on its middle: patches that share it agree.
const CONTROL: &str = "
    layout(vertices = 4) out;
    layout(location = 0) in vec2 corner[];
    layout(location = 0) out vec2 place[];
    float divisions(vec2 a, vec2 b) {
        return clamp(200.0 / distance(ground((a + b) * 0.5), eye.xyz), 1.0, 32.0);
    }
    bool isOutside() {
        const float RADIUS = 1.5;
        vec4 middle = camera * vec4(ground((corner[0] + corner[2]) * 0.5), 1.0);
        return any(greaterThan(abs(middle.xy), middle.ww + RADIUS * vec2(1.5, 2.0)));
    }
    void main() {
        place[gl_InvocationID] = corner[gl_InvocationID];
        if (gl_InvocationID == 0) {
            vec4 outer = vec4(
                divisions(corner[0], corner[3]), divisions(corner[0], corner[1]),
                divisions(corner[1], corner[2]), divisions(corner[3], corner[2]));
            if (isOutside()) outer = vec4(0.0);
            for (int i = 0; i < 4; i++) gl_TessLevelOuter[i] = outer[i];
            gl_TessLevelInner[0] = max(outer[1], outer[3]);
            gl_TessLevelInner[1] = max(outer[0], outer[2]);
        }
    }";

const EVALUATION: &str = "
    layout(quads, fractional_odd_spacing, ccw) in;
    layout(location = 0) in vec2 place[];
    layout(location = 0) out vec3 normal;
    layout(location = 1) out float level;
    void main() {
        vec2 low = mix(place[0], place[1], gl_TessCoord.x);
        vec2 at = mix(low, mix(place[3], place[2], gl_TessCoord.x), gl_TessCoord.y);
        vec3 displaced = ground(at);
        normal = textureLod(map, at, 0.0).xyz;
        level = displaced.y;
        gl_Position = camera * vec4(displaced, 1.0);
    }";

const FRAGMENT: &str = "
    layout(location = 0) in vec3 normal;
    layout(location = 1) in float level;
    layout(location = 0) out vec4 color;
    void main() {
        vec3 up = normalize(normal);
        vec3 tint = mix(vec3(0.3, 0.5, 0.2), vec3(0.6, 0.55, 0.5), clamp(level * 0.4 + 0.5, 0.0, 1.0));
        color = vec4(tint * (0.2 + 0.8 * max(dot(up, vec3(0.48, 0.8, -0.36)), 0.0)), 1.0);
    }";

/// Before all stages: the camera, and the map of normals and heights.
fn with_ground(source: &str) -> String {
    format!(
        "const uint PATCHES = {PATCHES}u;
        layout(push_constant) uniform Push {{ mat4 camera; vec4 eye; }};
        layout(set = 0, binding = 0) uniform sampler2D map;
        vec3 ground(vec2 at) {{
            vec2 across = (at * 2.0 - 1.0) * {REACH:?};
            return vec3(across.x, textureLod(map, at, 0.0).w, across.y);
        }}
        {source}"
    )
}

pub fn tessellated(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    if !draws(gpu) || gpu.features.tessellation_shader == vk::FALSE {
        return None;
    }
    let color = canvas(gpu, scale, RGBA);
    let depth = canvas(gpu, scale, vk::Format::D32_SFLOAT);
    let shape = Shape::flat(vk::Format::R16G16B16A16_SFLOAT, SIDE, SIDE);
    let map = gpu.picture(shape, vk::ImageUsageFlags::SAMPLED);
    let texels: Vec<[u16; 4]> = (0..SIDE * SIDE).map(texel).collect();
    gpu.upload(&map, 0, &texels);
    let sampler = vk::SamplerCreateInfo::default()
        .mag_filter(vk::Filter::LINEAR)
        .min_filter(vk::Filter::LINEAR)
        .address_mode_u(vk::SamplerAddressMode::CLAMP_TO_EDGE)
        .address_mode_v(vk::SamplerAddressMode::CLAMP_TO_EDGE);
    let set = gpu.set_of(&[Bound::Sampled(map.view, gpu.sampler(&sampler))]);
    let [vertex, control, evaluation] = [VERTEX, CONTROL, EVALUATION].map(with_ground);
    let mut painting = Painting::new(gpu, &vertex, FRAGMENT, RGBA);
    painting.tessellation = Some([&control, &evaluation]);
    painting.control_points = 4;
    painting.topology = vk::PrimitiveTopology::PATCH_LIST;
    painting.depth = depth.format;
    painting.depth_stencil = nearer();
    painting.layout = gpu.layout(&[set.layout]);
    let pipeline = gpu.painting(&painting);
    let pass = Pass {
        colors: &[color],
        clears: &[[0.0; 4]],
        depth: Some(depth),
        clear_depth: Some((1.0, 0)),
        ..Pass::default()
    };
    let [eye, ..] = camera(scale).map(Vec3::from);
    let mut push = projection(scale).to_cols_array().to_vec();
    push.extend(eye.extend(1.0).to_array());
    let push: [f32; 20] = push.try_into().ok()?;
    let turn = turn(gpu, &pass, |commands| {
        gpu.bind(commands, pipeline);
        gpu.bind_set(commands, painting.layout, set.handle);
        gpu.push(commands, painting.layout, &push);
        gpu.draw_vertices(commands, PATCHES * PATCHES * 4);
    });
    let view = View::of(scale);
    let work = f64::from(PATCHES * PATCHES);
    Some(drawn(gpu, turn, &[color], work, move |gpu| {
        let depths: Vec<f32> = gpu.texels(&depth, vk::ImageAspectFlags::DEPTH);
        check(&view, |x, y| {
            View::distance(depths[(y * depth.width + x) as usize])
        })
    }))
}

/// The normal and the height of the ground at a texel's centre.
fn texel(number: u32) -> [u16; 4] {
    const STEP: f32 = 0.05;
    let [x, z] = [number % SIDE, number / SIDE]
        .map(|at| ((at as f32 + 0.5) / SIDE as f32 * 2.0 - 1.0) * REACH);
    let normal = vec3(
        height(x - STEP, z) - height(x + STEP, z),
        2.0 * STEP,
        height(x, z - STEP) - height(x, z + STEP),
    );
    let texel = normal.normalize().extend(height(x, z)).to_array();
    texel.map(|it| f16::from_f32(it).to_bits())
}

/// Follows rays through some pixels: they stay above the ground and end on it, within what is lost
/// by dividing it and by the map.
fn check(view: &View, found: impl Fn(u32, u32) -> Option<f64>) -> Result<()> {
    const LOST: f64 = 0.25;
    const STEP: f64 = 0.05;
    for (x, y) in view.pixels(64) {
        let ray = view.ray(x, y);
        let above = |t: f64| {
            let at = view.eye + ray * t;
            let reach = f64::from(REACH);
            let is_there = at.x.abs() < reach && at.z.abs() < reach;
            is_there.then(|| at.y - f64::from(height(at.x as f32, at.z as f32)))
        };
        let end = found(x, y);
        let steps = (end.unwrap_or(150.0) / STEP) as u32;
        let is_free = (0..steps)
            .filter_map(|step| above(f64::from(step) * STEP))
            .all(|above| above > -LOST);
        ensure!(is_free, "pixel {x}, {y} shows what is behind the ground");
        if let Some(end) = end {
            let height = above(end - 1e-3);
            let is_on_it = height.is_some_and(|height| height.abs() < LOST);
            ensure!(is_on_it, "pixel {x}, {y} is {height:?} above the ground");
        }
    }
    Ok(())
}
