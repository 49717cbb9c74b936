//! Shadows of balls by volumes that a geometry shader makes of triangles and their neighbours.

use std::collections::HashMap;

use anyhow::{Result, ensure};
use glam::{DVec3, Vec3, Vec4, dvec3, vec3};
use tuff_tests::{Buffer, Canvas, Gpu, Painting, Pass, Rng, between, vk};

use super::view::{View, nearer, projection};
use super::{RGBA, canvas, drawn, draws, turn};
use crate::scene::{self, Mesh, REACH};
use crate::workload::Prepared;
use crate::world::Scale;

const BALLS: usize = 128;
const LIGHT: Vec3 = vec3(5.0, 14.0, -3.0);
const AMBIENT: f32 = 0.2;

/// Balls by their middle and radius. The ground comes as an instance without one, whose corners
/// are in the world.
const VERTEX: &str = "
    layout(location = 0) in vec3 corner;
    layout(location = 1) in vec3 up;
    layout(location = 2) in vec4 ball;
    layout(location = 0) out vec3 place;
    layout(location = 1) out vec3 normal;
    layout(location = 2) out vec3 tint;
    layout(push_constant) uniform Push { mat4 camera; };
    invariant gl_Position;
    void main() {
        place = ball.xyz + ball.w * corner;
        normal = up;
        tint = 0.5 + 0.5 * cos(vec3(0.0, 2.1, 4.2) + ball.x);
        gl_Position = camera * vec4(place, 1.0);
    }";

const FRAGMENT: &str = "
    layout(location = 0) in vec3 place;
    layout(location = 1) in vec3 normal;
    layout(location = 2) in vec3 tint;
    layout(location = 0) out vec4 color;
    void main() { color = vec4(tint * share(normalize(normal), LIGHT - place), 1.0); }";

/// The volumes' vertices: the geometry shader wants places alone.
const PLACES: &str = "
    layout(location = 0) in vec3 corner;
    layout(location = 2) in vec4 ball;
    layout(location = 0) out vec3 place;
    void main() { place = ball.xyz + ball.w * corner; }";

/// A cap below each lit triangle, another one far away, and a side at each edge to a triangle that
/// is not lit.
const GEOMETRY: &str = "
    layout(triangles_adjacency) in;
    layout(triangle_strip, max_vertices = 18) out;
    layout(location = 0) in vec3 place[];
    layout(push_constant) uniform Push { mat4 camera; };
    void put(vec3 at, float away) {
        gl_Position = camera * vec4(at + normalize(at - LIGHT) * away, 1.0);
        EmitVertex();
    }
    const float NEAR = 0.02, FAR = 60.0;
    bool isLit(vec3 a, vec3 b, vec3 c) { return dot(cross(b - a, c - a), LIGHT - a) > 0.0; }
    void main() {
        if (!isLit(place[0], place[2], place[4])) return;
        for (int i = 0; i < 6; i += 2) {
            vec3 a = place[i], b = place[(i + 2) % 6];
            if (isLit(a, place[i + 1], b)) continue;
            put(a, NEAR); put(a, FAR); put(b, NEAR); put(b, FAR);
            EndPrimitive();
        }
        put(place[0], NEAR); put(place[2], NEAR); put(place[4], NEAR);
        EndPrimitive();
        put(place[0], FAR); put(place[4], FAR); put(place[2], FAR);
        EndPrimitive();
    }";

/// The indices of a closed mesh's triangles with the opposite corner of each neighbour.
fn adjacent(mesh: &Mesh) -> Vec<u32> {
    // Edges in their triangle's order, with the third corner.
    let edges = |triangle: &[u32]| {
        let [a, b, c] = [triangle[0], triangle[1], triangle[2]];
        [((a, b), c), ((b, c), a), ((c, a), b)]
    };
    let all = || mesh.indices.chunks_exact(3).flat_map(edges);
    let opposite: HashMap<(u32, u32), u32> = all().collect();
    all()
        .flat_map(|((a, b), _)| [a, opposite[&(b, a)]])
        .collect()
}

/// A ball: its middle and its radius.
fn balls() -> Vec<Vec4> {
    let mut random = Rng::with_seed(23);
    let mut number = |low, high| between(&mut random, low, high);
    (0..BALLS)
        .map(|_| {
            Vec4::new(
                number(-12.0, 12.0),
                number(1.0, 5.0),
                number(-8.0, 14.0),
                number(0.2, 0.6),
            )
        })
        .collect()
}

/// A mesh on the device: corners and normals, instances, indices.
struct Drawable {
    vertices: [Buffer; 3],
    indices: Buffer,
    count: u32,
    instances: u32,
}

impl Drawable {
    fn record(&self, gpu: &Gpu, commands: vk::CommandBuffer) {
        let handles = self.vertices.map(|buffer| buffer.handle);
        gpu.bind_indices(commands, &self.indices, vk::IndexType::UINT32);
        // SAFETY: the command buffer is being recorded.
        unsafe {
            (gpu.device).cmd_bind_vertex_buffers(commands, 0, &handles, &[0; 3]);
            (gpu.device).cmd_draw_indexed(commands, self.count, self.instances, 0, 0, 0);
        }
    }
}

/// Where corners, normals and balls are.
fn with_meshes(mut painting: Painting<'_>, depth: vk::Format) -> Painting<'_> {
    let three = vk::Format::R32G32B32_SFLOAT;
    let inputs = [
        (three, 12, vk::VertexInputRate::VERTEX),
        (three, 12, vk::VertexInputRate::VERTEX),
        (
            vk::Format::R32G32B32A32_SFLOAT,
            16,
            vk::VertexInputRate::INSTANCE,
        ),
    ];
    for (number, (format, stride, rate)) in (0..).zip(inputs) {
        painting.bindings.push(vk::VertexInputBindingDescription {
            binding: number,
            stride,
            input_rate: rate,
        });
        painting
            .attributes
            .push(vk::VertexInputAttributeDescription {
                location: number,
                binding: number,
                format,
                offset: 0,
            });
    }
    painting.depth = depth;
    painting.stencil = depth;
    painting
}

/// The square below the balls.
fn ground(gpu: &Gpu) -> Drawable {
    let square = [
        (-REACH, -REACH),
        (REACH, -REACH),
        (-REACH, REACH),
        (REACH, REACH),
    ];
    Drawable {
        vertices: [
            gpu.buffer_with(&square.map(|(x, z)| [x, 0.0, z])),
            gpu.buffer_with(&[[0.0f32, 1.0, 0.0]; 4]),
            gpu.buffer_with(&[[0.0f32, 0.0, 0.0, 1.0]]),
        ],
        indices: gpu.buffer_with(&[0u32, 1, 2, 2, 1, 3]),
        count: 6,
        instances: 1,
    }
}

/// Counts the beginnings and ends of shadow volumes before the scene in the stencil.
fn volumes<'t>(gpu: &Gpu, dark: &'t str, geometry: &'t str, depth: vk::Format) -> Painting<'t> {
    let mut volumes = with_meshes(Painting::new(gpu, PLACES, dark, RGBA), depth);
    volumes.attributes.retain(|it| it.location != 1);
    volumes.fragment = None;
    volumes.geometry = Some(geometry);
    volumes.topology = vk::PrimitiveTopology::TRIANGLE_LIST_WITH_ADJACENCY;
    volumes.blend[0].color_write_mask = vk::ColorComponentFlags::empty();
    let counts = |op| {
        vk::StencilOpState::default()
            .compare_op(vk::CompareOp::ALWAYS)
            .depth_fail_op(op)
            .compare_mask(0xFF)
            .write_mask(0xFF)
    };
    volumes.depth_stencil = vk::PipelineDepthStencilStateCreateInfo::default()
        .depth_test_enable(true)
        .depth_compare_op(vk::CompareOp::LESS_OR_EQUAL)
        .stencil_test_enable(true)
        .front(counts(vk::StencilOp::DECREMENT_AND_WRAP))
        .back(counts(vk::StencilOp::INCREMENT_AND_WRAP));
    volumes
}

/// Adds light where the stencil is zero.
fn lit_painting<'t>(gpu: &Gpu, lit: &'t str, depth: vk::Format) -> Painting<'t> {
    let mut painting = with_meshes(Painting::new(gpu, VERTEX, lit, RGBA), depth);
    painting.blend[0] = painting.blend[0]
        .blend_enable(true)
        .src_color_blend_factor(vk::BlendFactor::ONE)
        .dst_color_blend_factor(vk::BlendFactor::ONE);
    let unshadowed = vk::StencilOpState::default()
        .compare_op(vk::CompareOp::EQUAL)
        .compare_mask(0xFF);
    painting.depth_stencil = vk::PipelineDepthStencilStateCreateInfo::default()
        .depth_test_enable(true)
        .depth_compare_op(vk::CompareOp::EQUAL)
        .stencil_test_enable(true)
        .front(unshadowed)
        .back(unshadowed);
    painting
}

/// The scene dark, then the volumes into the stencil where the scene is before them, then light
/// where as many begin as end.
pub fn shadows(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    if !draws(gpu) || gpu.features.geometry_shader == vk::FALSE {
        return None;
    }
    let color = canvas(gpu, scale, RGBA);
    let depth = canvas(gpu, scale, vk::Format::D32_SFLOAT_S8_UINT);
    let [x, y, z] = LIGHT.to_array();
    let light = format!("const vec3 LIGHT = vec3({x:?}, {y:?}, {z:?});");
    let shaded = |share: &str| {
        format!("{light} float share(vec3 normal, vec3 towards) {{ return {share}; }} {FRAGMENT}")
    };
    let dark = shaded(&format!("{AMBIENT:?}"));
    let lit = shaded("max(dot(normal, normalize(towards)), 0.0)");
    let geometry = format!("{light}{GEOMETRY}");
    let mut first = with_meshes(Painting::new(gpu, VERTEX, &dark, RGBA), depth.format);
    first.depth_stencil = nearer();

    let volumes = volumes(gpu, &dark, &geometry, depth.format);
    let last = lit_painting(gpu, &lit, depth.format);
    let pipelines = [&first, &volumes, &last].map(|painting| gpu.painting(painting));

    let mesh = scene::ball(3).welded();
    let balls = balls();
    let corners = gpu.buffer_with(&mesh.corners);
    // Corners of a ball are its normals.
    let vertices = [
        corners,
        corners,
        gpu.buffer_with(&balls.iter().map(Vec4::to_array).collect::<Vec<_>>()),
    ];
    let of_balls = |indices: &[u32]| Drawable {
        vertices,
        indices: gpu.buffer_with(indices),
        count: indices.len() as u32,
        instances: BALLS as u32,
    };
    let solid = of_balls(&mesh.indices);
    let casting = of_balls(&adjacent(&mesh));
    let ground = ground(gpu);
    let pass = Pass {
        colors: &[color],
        clears: &[[0.0; 4]],
        depth: Some(depth),
        stencil: Some(depth),
        clear_depth: Some((1.0, 0)),
        ..Pass::default()
    };
    let camera = projection(scale).to_cols_array();
    let turn = turn(gpu, &pass, |commands| {
        for (pipeline, drawables) in
            pipelines
                .iter()
                .zip([&[&ground, &solid][..], &[&casting], &[&ground, &solid]])
        {
            gpu.bind(commands, *pipeline);
            gpu.push(commands, first.layout, &camera);
            for drawable in drawables {
                drawable.record(gpu, commands);
            }
        }
    });
    let view = View::of(scale);
    let work = (mesh.triangle_count() * BALLS) as f64;
    Some(drawn(gpu, turn, &[color], work, move |gpu| {
        check(gpu, &view, &color, &balls)
    }))
}

/// Holds some pixels against rays to balls that are round.
fn check(gpu: &Gpu, view: &View, color: &Canvas, balls: &[Vec4]) -> Result<()> {
    const PIXELS: usize = 200;
    let colors = gpu.colors(color);
    let light = LIGHT.as_dvec3();
    let wanted = |x: u32, y: u32| {
        let ray = view.ray(x, y);
        let reach = f64::from(REACH);
        let ground = Some(-view.eye.y / ray.y).filter(|t| {
            let at = view.eye + ray * *t;
            *t > 0.0 && at.x.abs() < reach && at.z.abs() < reach
        });
        let of_ball = |ball: &Vec4| {
            let t = intersect(*ball, view.eye, ray)?;
            let normal = view.eye + ray * t - ball.truncate().as_dvec3();
            Some((t, normal.normalize(), f64::from(ball.x)))
        };
        let ground = ground.map(|t| (t, DVec3::Y, 0.0));
        let surfaces = balls.iter().filter_map(of_ball).chain(ground);
        let Some((t, normal, phase)) = surfaces.min_by(|a, b| a.0.total_cmp(&b.0)) else {
            return [0; 3];
        };
        let at = view.eye + ray * t;
        let towards = light - at;
        let start = at + towards.normalize() * 1e-2;
        let is_dark = (balls.iter())
            .any(|ball| intersect(*ball, start, light - start).is_some_and(|t| t < 1.0));
        let share = match is_dark {
            true => 0.0,
            false => normal.dot(towards.normalize()).max(0.0),
        };
        let tint = dvec3(0.0, 2.1, 4.2)
            .to_array()
            .map(|it| 0.5 + 0.5 * libm::cos(it + phase));
        tint.map(|tint| (tint * (f64::from(AMBIENT) + share)).min(1.0) * 255.0)
            .map(|it| it as u8)
    };
    let fits = |&(x, y): &(u32, u32)| {
        let found = colors[(y * color.width + x) as usize];
        let wanted = wanted(x, y);
        (found.iter().zip(wanted)).all(|(found, wanted)| found.abs_diff(wanted) <= 10)
    };
    let right_ones = view.pixels(PIXELS).filter(fits).count();
    // Balls of flat triangles are smaller than round ones.
    ensure!(
        right_ones + PIXELS / 20 >= PIXELS,
        "{right_ones} of {PIXELS} pixels are as light as they are to be"
    );
    Ok(())
}

/// How far along a ray it first meets a ball.
fn intersect(ball: Vec4, origin: DVec3, ray: DVec3) -> Option<f64> {
    let from = origin - ball.truncate().as_dvec3();
    let half = from.dot(ray) / ray.length_squared();
    let rest = (from.length_squared() - f64::from(ball.w).powi(2)) / ray.length_squared();
    let root = (half * half - rest).sqrt();
    let t = -half - root;
    (t > 0.0).then_some(t)
}
