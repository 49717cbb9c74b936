//! Particles that a vertex shader moves, captured by transform feedback and drawn as points.

use anyhow::{Result, ensure};
use ash::ext;
use glam::{DVec3, Vec3, dvec3};
use rayon::prelude::*;
use tuff_tests::{Buffer, Gpu, Painting, Pass, Rng, WHITE, between, vk};

use super::view::projection;
use super::{RGBA, canvas, drawn, draws};
use crate::workload::Prepared;
use crate::world::Scale;

const COUNT: u32 = 200_000;

/// Captures of a turn.
const STEPS: usize = 4;

/// Seconds of a step.
const STEP: f32 = 0.02;

/// A place and an age, a velocity and a number: what is captured is read again.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Particle {
    place: [f32; 4],
    velocity: [f32; 4],
}

/// Particles fall, turn about a middle, and begin again when their time is over.
const MOVE: &str = "
    layout(location = 0) in vec4 place;
    layout(location = 1) in vec4 velocity;
    layout(location = 0, xfb_buffer = 0, xfb_stride = 32, xfb_offset = 0) out vec4 toPlace;
    layout(location = 1, xfb_buffer = 0, xfb_stride = 32, xfb_offset = 16) out vec4 toVelocity;
    layout(push_constant) uniform Push { float seconds; };
    void main() {
        vec3 to = vec3(0.0, 4.0, 0.0) - place.xyz;
        float far = dot(to, to) + 0.5;
        vec3 pull = to * (20.0 * inversesqrt(far) / far) + vec3(0.0, -0.5, 0.0);
        toVelocity = vec4(velocity.xyz * 0.995 + pull * seconds, velocity.w);
        toPlace = vec4(place.xyz + toVelocity.xyz * seconds, place.w - seconds);
        if (toPlace.w < 0.0) {
            toPlace = vec4(place.zxy * 0.5 + vec3(0.0, 2.0, 0.0), 2.0);
            toVelocity.xyz = -velocity.xyz;
        }
    }";

const SHOW: &str = "
    layout(location = 0) in vec4 place;
    layout(location = 1) in vec4 velocity;
    layout(location = 0) out vec3 tint;
    layout(push_constant) uniform Push { mat4 camera; };
    void main() {
        float speed = clamp(length(velocity.xyz) * 0.2, 0.0, 1.0);
        tint = mix(vec3(0.02, 0.05, 0.1), vec3(0.1, 0.05, 0.02), speed);
        gl_Position = camera * vec4(place.xyz, 1.0);
        gl_PointSize = 2.0;
    }";

const GLOW: &str = "
    layout(location = 0) in vec3 tint;
    layout(location = 0) out vec4 color;
    void main() { color = vec4(tint, 1.0); }";

fn start() -> Vec<Particle> {
    let mut random = Rng::with_seed(29);
    let mut number = |low, high| between(&mut random, low, high);
    (0..COUNT)
        .map(|index| {
            let place = [number(-8.0, 8.0), number(1.0, 8.0), number(-8.0, 8.0)];
            let velocity = [number(-2.0, 2.0), number(-1.0, 1.0), number(-2.0, 2.0)];
            // Between two steps: no rounding decides when a time is over.
            let age = ((index % 64) as f32 + 0.5) * STEP;
            Particle {
                place: Vec3::from(place).extend(age).to_array(),
                velocity: Vec3::from(velocity).extend(index as f32).to_array(),
            }
        })
        .collect()
}

fn of_particles(mut painting: Painting<'_>) -> Painting<'_> {
    let stride = size_of::<Particle>() as u32;
    painting.bindings = vec![vk::VertexInputBindingDescription::default().stride(stride)];
    painting.attributes = [0, 1]
        .map(|location| {
            vk::VertexInputAttributeDescription::default()
                .location(location)
                .format(vk::Format::R32G32B32A32_SFLOAT)
                .offset(16 * location)
        })
        .to_vec();
    painting.topology = vk::PrimitiveTopology::POINT_LIST;
    painting
}

pub fn captured(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    let features = &gpu.optional.transform_feedback;
    if !draws(gpu) || features.transform_feedback == vk::FALSE {
        return None;
    }
    let feedback = ext::transform_feedback::Device::new(&gpu.instance, &gpu.device);
    let particles = start();
    let first = gpu.buffer_with(&particles);
    let steps = [(); 2].map(|()| gpu.buffer(first.size_bytes));
    let counter = gpu.buffer(4);
    let canvas = canvas(gpu, scale, RGBA);
    // Captures draw nothing, but are commands of a pass.
    let nothing = gpu.canvas(RGBA, 4, 4);
    let mut moving = of_particles(Painting::new(gpu, MOVE, WHITE, RGBA));
    moving.fragment = None;
    moving.rasterization = moving.rasterization.rasterizer_discard_enable(true);
    let mut showing = of_particles(Painting::new(gpu, SHOW, GLOW, RGBA));
    showing.blend[0] = showing.blend[0]
        .blend_enable(true)
        .src_color_blend_factor(vk::BlendFactor::ONE)
        .dst_color_blend_factor(vk::BlendFactor::ONE);
    let [move_, show] = [&moving, &showing].map(|painting| gpu.painting(painting));
    let capture = |commands, from: &Buffer, to: &Buffer| {
        gpu.bind(commands, move_);
        gpu.push(commands, moving.layout, &STEP);
        gpu.bind_vertices(commands, from);
        let (target, size) = (to.handle, to.size_bytes);
        let fp = feedback.fp();
        // SAFETY: the command buffer is being recorded.
        unsafe {
            (fp.cmd_bind_transform_feedback_buffers_ext)(commands, 0, 1, &target, &0, &size);
            (fp.cmd_begin_transform_feedback_ext)(commands, 0, 0, &counter.handle, &0);
            gpu.device.cmd_draw(commands, COUNT, 1, 0, 0);
            (fp.cmd_end_transform_feedback_ext)(commands, 0, 1, &counter.handle, &0);
        }
    };
    let camera = projection(scale).to_cols_array();
    let last = steps[(STEPS - 1) % 2];
    let turn = gpu.record(|commands| {
        for step in 0..STEPS {
            let from = match step {
                0 => &first,
                _ => &steps[(step - 1) % 2],
            };
            let pass = Pass::black(&nothing);
            gpu.record_pass(commands, &pass, |commands| {
                capture(commands, from, &steps[step % 2]);
            });
            gpu.barrier(commands);
        }
        gpu.record_pass(commands, &Pass::black(&canvas), |commands| {
            gpu.bind(commands, show);
            gpu.push(commands, showing.layout, &camera);
            gpu.bind_vertices(commands, &last);
            let stride = size_of::<Particle>() as u32;
            // SAFETY: the command buffer is being recorded; the counter was written before.
            unsafe {
                (feedback.fp().cmd_draw_indirect_byte_count_ext)(
                    commands,
                    1,
                    0,
                    counter.handle,
                    0,
                    0,
                    stride,
                );
            }
        });
        gpu.barrier(commands);
    });
    let work = f64::from(COUNT) * (STEPS + 1) as f64;
    Some(drawn(gpu, turn, &[canvas], work, move |_| {
        check(&particles, &last.read::<Particle>())
    }))
}

/// Holds what was captured last against the same steps in `f64`, in the order of vertices.
fn check(first: &[Particle], last: &[Particle]) -> Result<()> {
    let wrong = (first.par_iter().zip(last)).position_any(|(first, last)| {
        let xyz = |it: [f32; 4]| Vec3::new(it[0], it[1], it[2]).as_dvec3();
        let (mut place, mut velocity) = (xyz(first.place), xyz(first.velocity));
        let (mut age, step) = (f64::from(first.place[3]), f64::from(STEP));
        for _ in 0..STEPS {
            let to = dvec3(0.0, 4.0, 0.0) - place;
            let far = to.length_squared() + 0.5;
            let pull = to * (20.0 / (far * far.sqrt())) + dvec3(0.0, -0.5, 0.0);
            age -= step;
            if age < 0.0 {
                place = DVec3::new(place.z, place.x, place.y) * 0.5 + dvec3(0.0, 2.0, 0.0);
                (velocity, age) = (-velocity, 2.0);
            } else {
                velocity = velocity * 0.995 + pull * step;
                place += velocity * step;
            }
        }
        let near = |a: DVec3, b: DVec3| (a - b).length() < 1e-3;
        let is_right = near(place, xyz(last.place))
            && near(velocity, xyz(last.velocity))
            && (age - f64::from(last.place[3])).abs() < 1e-4
            && first.velocity[3] == last.velocity[3];
        !is_right
    });
    ensure!(
        wrong.is_none(),
        "particle {wrong:?} is not where it is to be"
    );
    Ok(())
}
