//! The scene as the first pass of a renderer draws it: indexed meshes, instances, depth, and an
//! attachment for each property.

use anyhow::{Result, ensure};
use glam::{Affine3A, DVec3, Mat4, Vec3, vec3};
use rayon::prelude::*;
use tuff_tests::{Gpu, Painting, Pass, Rng, vk};

use super::{RGBA, canvas, drawn, draws, size, turn};
use crate::scene::{self, Mesh};
use crate::workload::Prepared;
use crate::world::{Scale, camera, rows};

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
fn normals(mesh: &Mesh) -> Vec<[f32; 3]> {
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

/// From the world to clip space.
fn projection(scale: &Scale) -> Mat4 {
    let [eye, right, up, ahead] = camera(scale).map(Vec3::from);
    let (near, far) = (0.1, 200.0);
    let depth = far / (far - near);
    // Rows: x and y of the picture (down is positive), depth, distance.
    let right = right / right.length_squared();
    let down = -up / up.length_squared();
    let row = |axis: Vec3, offset: f32| axis.extend(offset - axis.dot(eye));
    let distance = row(ahead, 0.0);
    let depth = distance * depth - glam::Vec4::W * (near * depth);
    Mat4::from_cols(row(right, 0.0), row(down, 0.0), depth, distance).transpose()
}

pub fn geometry(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    if !draws(gpu) {
        return None;
    }
    let [width, height] = size(scale);
    let meshes = [scene::hills(scale.triangles), scene::ball(4)];
    let mut places = vec![Affine3A::IDENTITY];
    places.extend(
        scene::placements(scale.instances, 1)
            .iter()
            .map(|it| it.transform),
    );
    let colors = [RGBA, NORMALS, PLACES].map(|format| canvas(gpu, scale, format));
    let depth = canvas(gpu, scale, vk::Format::D32_SFLOAT);
    let mut painting = Painting::new(gpu, VERTEX, FRAGMENT, RGBA);
    painting.colors = vec![RGBA, NORMALS, PLACES];
    painting.blend = vec![painting.blend[0]; 3];
    painting.depth = vk::Format::D32_SFLOAT;
    painting.depth_stencil = vk::PipelineDepthStencilStateCreateInfo::default()
        .depth_test_enable(true)
        .depth_write_enable(true)
        .depth_compare_op(vk::CompareOp::LESS);
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
    let scale = *scale;
    Some(drawn(gpu, turn, &colors, work as f64, move |gpu| {
        let found: Vec<[f32; 4]> = gpu.texels(&colors[2], vk::ImageAspectFlags::COLOR);
        check(&scale, [width, height], &meshes, &places, &found)
    }))
}

/// Holds places of some pixels against rays through their centres, which are cast at all triangles.
fn check(
    scale: &Scale,
    [width, height]: [u32; 2],
    meshes: &[Mesh; 2],
    places: &[Affine3A],
    found: &[[f32; 4]],
) -> Result<()> {
    const PIXELS: usize = 24;
    let mut random = Rng::with_seed(17);
    let [eye, right, up, ahead] = camera(scale).map(|it| Vec3::from(it).as_dvec3());
    let mut right_ones = 0;
    for _ in 0..PIXELS {
        let (x, y) = (random.u32(..width), random.u32(..height));
        let across = (f64::from(x) + 0.5) / f64::from(width) * 2.0 - 1.0;
        let down = (f64::from(y) + 0.5) / f64::from(height) * 2.0 - 1.0;
        let direction = ahead + right * across - up * down;
        let nearest = (0..places.len())
            .into_par_iter()
            .filter_map(|at| nearest(&meshes[usize::from(at > 0)], &places[at], eye, direction))
            .reduce_with(f64::min);
        let [px, py, pz, is_drawn] = found[(y * width + x) as usize];
        let fits = match nearest {
            None => is_drawn == 0.0,
            Some(t) => {
                let apart = (vec3(px, py, pz).as_dvec3() - (eye + direction * t)).length();
                is_drawn == 1.0 && apart < 1e-3 * t.max(1.0)
            }
        };
        right_ones += usize::from(fits);
    }
    // Vertices are snapped to a grid: at a silhouette a ray may see what is behind.
    ensure!(
        right_ones + 2 >= PIXELS,
        "{right_ones} of {PIXELS} pixels show what is there"
    );
    Ok(())
}

/// How far along a ray the first triangle of a mesh is.
fn nearest(mesh: &Mesh, place: &Affine3A, origin: DVec3, direction: DVec3) -> Option<f64> {
    let corners: Vec<DVec3> = mesh
        .corners
        .iter()
        .map(|&corner| place.transform_point3(corner.into()).as_dvec3())
        .collect();
    let hit = |triangle: &[u32]| {
        let [a, b, c] = [0, 1, 2].map(|i| corners[triangle[i] as usize]);
        let (ab, ac) = (b - a, c - a);
        let normal = direction.cross(ac);
        let volume = ab.dot(normal);
        let from = origin - a;
        let u = from.dot(normal) / volume;
        let across = from.cross(ab);
        let v = direction.dot(across) / volume;
        let t = ac.dot(across) / volume;
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.1).then_some(t)
    };
    mesh.indices
        .chunks_exact(3)
        .filter_map(hit)
        .reduce(f64::min)
}
