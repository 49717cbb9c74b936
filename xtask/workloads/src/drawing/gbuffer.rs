//! The scene as the first pass of a renderer draws it: indexed meshes, instances, depth, and an
//! attachment for each property.

use glam::{Affine3A, Vec3, vec3};
use tuff_tests::{Gpu, Painting, Pass, vk};

use super::view::{View, nearer, projection};
use super::{RGBA, canvas, drawn, draws, turn};
use crate::scene::{self, Mesh};
use crate::workload::Prepared;
use crate::world::{Scale, rows};

const VERTEX: &str = "
    layout(location = 0) in vec3 corner;
    layout(location = 1) in vec3 normal;
    layout(location = 2) in vec4 row0;
    layout(location = 3) in vec4 row1;
    layout(location = 4) in vec4 row2;
    layout(location = 0) out vec3 place;
    layout(location = 1) out vec3 up;
    layout(location = 2) out vec3 tint;
    layout(push_constant) uniform Push { mat4 camera; };
    void main() {
        vec4 at = vec4(corner, 1.0);
        place = vec3(dot(row0, at), dot(row1, at), dot(row2, at));
        up = vec3(dot(row0.xyz, normal), dot(row1.xyz, normal), dot(row2.xyz, normal));
        tint = 0.5 + 0.5 * cos(vec3(0.0, 2.1, 4.2) + float(gl_InstanceIndex));
        gl_Position = camera * vec4(place, 1.0);
    }";

const FRAGMENT: &str = "
    layout(location = 0) in vec3 place;
    layout(location = 1) in vec3 up;
    layout(location = 2) in vec3 tint;
    layout(location = 0) out vec4 albedo;
    layout(location = 1) out vec4 normal;
    layout(location = 2) out vec4 position;
    void main() {
        albedo = vec4(tint, 1.0);
        normal = vec4(normalize(up), 0.0);
        position = vec4(place, 1.0);
    }";

const NORMALS: vk::Format = vk::Format::R16G16B16A16_SFLOAT;
const PLACES: vk::Format = vk::Format::R32G32B32A32_SFLOAT;

/// Normals at corners, from the triangles around them.
pub fn normals(mesh: &Mesh) -> Vec<[f32; 3]> {
    let mut normals = vec![Vec3::ZERO; mesh.corners.len()];
    for triangle in mesh.indices.chunks_exact(3) {
        let [a, b, c] = [0, 1, 2].map(|i| Vec3::from(mesh.corners[triangle[i] as usize]));
        let normal = (b - a).cross(c - a);
        for &corner in triangle {
            normals[corner as usize] += normal;
        }
    }
    let unit = |normal: Vec3| normal.normalize_or(Vec3::Y).into();
    normals.into_iter().map(unit).collect()
}

/// Writes color, normal and position of instances.
fn painting(gpu: &Gpu) -> Painting<'_> {
    let mut painting = Painting::new(gpu, VERTEX, FRAGMENT, RGBA);
    painting.colors = vec![RGBA, NORMALS, PLACES];
    painting.blend = vec![painting.blend[0]; 3];
    painting.depth = vk::Format::D32_SFLOAT;
    painting.depth_stencil = nearer();
    let binding = |binding, stride, rate| vk::VertexInputBindingDescription {
        binding,
        stride,
        input_rate: rate,
    };
    painting.bindings = vec![
        binding(0, 12, vk::VertexInputRate::VERTEX),
        binding(1, 12, vk::VertexInputRate::VERTEX),
        binding(2, 48, vk::VertexInputRate::INSTANCE),
    ];
    let attribute = |location, binding, format, offset| vk::VertexInputAttributeDescription {
        location,
        binding,
        format,
        offset,
    };
    let three = vk::Format::R32G32B32_SFLOAT;
    painting.attributes = vec![
        attribute(0, 0, three, 0),
        attribute(1, 1, three, 0),
        attribute(2, 2, PLACES, 0),
        attribute(3, 2, PLACES, 16),
        attribute(4, 2, PLACES, 32),
    ];
    painting
}

pub fn geometry(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    if !draws(gpu) {
        return None;
    }
    let meshes = [scene::hills(scale.triangles), scene::ball(4)];
    let mut places = vec![Affine3A::IDENTITY];
    places.extend(
        scene::placements(scale.instances, 1)
            .iter()
            .map(|it| it.transform),
    );
    let colors = [RGBA, NORMALS, PLACES].map(|format| canvas(gpu, scale, format));
    let depth = canvas(gpu, scale, vk::Format::D32_SFLOAT);
    let painting = painting(gpu);
    let pipeline = gpu.painting(&painting);
    let buffers = meshes.each_ref().map(|mesh| {
        let corners = gpu.buffer_with(&mesh.corners);
        let normals = gpu.buffer_with(&normals(mesh));
        (corners, normals, gpu.buffer_with(&mesh.indices))
    });
    let transforms: Vec<[f32; 12]> = places.iter().map(rows).collect();
    let transforms = gpu.buffer_with(&transforms);
    let pass = Pass {
        colors: &colors,
        clears: &[[0.0; 4]; 3],
        depth: Some(depth),
        clear_depth: Some((1.0, 0)),
        ..Pass::default()
    };
    let camera = projection(scale);
    let instances = [(0, 1), (1, places.len() as u32 - 1)];
    let turn = turn(gpu, &pass, |commands| {
        gpu.bind(commands, pipeline);
        gpu.push(commands, painting.layout, &camera.to_cols_array());
        // SAFETY: the command buffer is being recorded.
        unsafe {
            for ((corners, normals, indices), (first, count)) in buffers.iter().zip(instances) {
                let vertices = [corners.handle, normals.handle, transforms.handle];
                (gpu.device).cmd_bind_vertex_buffers(commands, 0, &vertices, &[0; 3]);
                gpu.bind_indices(commands, indices, vk::IndexType::UINT32);
                let indices = (indices.size_bytes / 4) as u32;
                (gpu.device).cmd_draw_indexed(commands, indices, count, 0, 0, first);
            }
        }
    });
    let work = meshes[0].triangle_count() + meshes[1].triangle_count() * (places.len() - 1);
    let view = View::of(scale);
    Some(drawn(gpu, turn, &colors, work as f64, move |gpu| {
        let found: Vec<[f32; 4]> = gpu.texels(&colors[2], vk::ImageAspectFlags::COLOR);
        let width = colors[2].width;
        view.check(&meshes, &places, |x, y| {
            let [px, py, pz, is_drawn] = found[(y * width + x) as usize];
            let place = vec3(px, py, pz).as_dvec3();
            (is_drawn == 1.0).then(|| (place - view.eye).length() / view.ray(x, y).length())
        })
    }))
}
