//! Workloads that look like programs: frames into images, as applications make them.

use tuff_tests::{Bound, Gpu, Group, Kernel, Picture, Shape, Stage, vk};

use crate::scene::Mesh;
use crate::shader;
use crate::workload::{Parts, Prepared, borrowed, compute, launch, pipeline};
use crate::world::{Scale, World, geometry};

/// Where the shaders' common declarations leave room for an image that a frame is drawn into.
const IMAGE: u32 = 6;

/// One ray a pixel at one triangle, stored to an image of 8 bits a channel.
pub fn triangle(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    let mesh = Mesh {
        corners: vec![[-6.0, -1.0, 3.0], [10.0, -1.0, 0.0], [2.0, 9.0, 4.0]],
        indices: vec![0, 1, 2],
    };
    let bottom = gpu.bottom(&[geometry(&mesh, vk::GeometryFlagsKHR::OPAQUE)]);
    let world = World::of_mesh(gpu, scale, &mesh, bottom);
    let parts = Parts {
        shaders: vec![
            (Stage::RayGeneration, shader::raygen(shader::TRIANGLE)),
            (
                Stage::Miss,
                shader::with_common(Stage::Miss, shader::TRIANGLE_MISS),
            ),
            (
                Stage::ClosestHit,
                shader::with_common(Stage::ClosestHit, shader::TRIANGLE_HIT),
            ),
        ],
        groups: vec![Group::general(0), Group::general(1), Group::hit(2)],
        recursion: 1,
    };
    let image = canvas(gpu, scale);
    let mut bindings = world.bindings();
    bindings.push((IMAGE, [Bound::StorageImage(image.view)]));
    let rays = pipeline(gpu, &parts, &bindings);
    let turn = launch(gpu, scale, &rays, 1);
    Some(drawn(gpu, scale, turn, &world, &image))
}

/// Mirroring spheres in boxes, by ray queries in a compute shader.
pub fn boxes(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    if gpu.optional.ray_query.ray_query == vk::FALSE {
        return None;
    }
    let world = World::spheres(gpu, scale);
    let words = shader::with_common(Stage::Compute, shader::BOXES);
    let turn = compute(gpu, scale, &words, &world);
    Some(Prepared::picture(turn, &world))
}

/// An image to draw a frame into.
fn canvas(gpu: &Gpu, scale: &Scale) -> Picture {
    let shape = Shape::flat(vk::Format::R8G8B8A8_UNORM, scale.width, scale.height);
    gpu.picture(shape, vk::ImageUsageFlags::STORAGE)
}

/// A turn that draws an image: a ray a pixel.
fn drawn(
    gpu: &Gpu,
    scale: &Scale,
    turn: vk::CommandBuffer,
    world: &World,
    image: &Picture,
) -> Prepared {
    Prepared {
        work: Some(scale.pixels() as f64),
        look: Some(show(gpu, scale, world, image)),
        ..Prepared::picture(turn, world)
    }
}

/// Reads an image into the world's picture.
fn show(gpu: &Gpu, scale: &Scale, world: &World, image: &Picture) -> vk::CommandBuffer {
    let set = gpu.set(&borrowed(&[
        (0, [Bound::StorageImage(image.view)]),
        (1, [Bound::Storage(world.out)]),
    ]));
    let layout = gpu.layout(&[set.layout]);
    let words = shader::show();
    let made = gpu.try_kernel(&words, c"main", layout, &vk::SpecializationInfo::default());
    let kernel = Kernel {
        pipeline: made.expect("vkCreateComputePipelines"),
        layout,
    };
    let groups = [scale.width.div_ceil(8), scale.height.div_ceil(8), 1];
    gpu.record(|commands| {
        gpu.barrier(commands);
        gpu.record_dispatch::<u32>(commands, kernel, &[set], &[], groups);
        gpu.barrier(commands);
    })
}
