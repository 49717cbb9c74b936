//! Workloads that look like programs: frames into images, as applications make them.

use tuff_tests::heaps::{HEAP_WITH_CONSTANT_OFFSET, Heaps, mapping};
use tuff_tests::newer::{ConstantOffset, DescriptorMappingSourceDataEXT};
use tuff_tests::{Bound, Buffer, Gpu, Group, Picture, Rays, Record, Set, Shape, Stage, Table, vk};

use crate::mips::{self, Texture};
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
    let parts = Parts::new(
        shader::raygen(shader::TRIANGLE),
        shader::TRIANGLE_MISS,
        shader::with_common(Stage::ClosestHit, shader::TRIANGLE_HIT),
    );
    let image = canvas(gpu, scale);
    let mut bindings = world.bindings();
    bindings.push((IMAGE, [Bound::StorageImage(image.view)]));
    let rays = pipeline(gpu, &parts, &bindings);
    let turn = launch(gpu, scale, &rays, 1);
    Some(drawn(gpu, scale, turn, &world, &image))
}

/// Small boxes on a large one, by ray queries in a compute shader that tests the boxes itself.
pub fn boxes(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    queried(gpu, scale, shader::BOXES, World::boxes)
}

/// Mirroring spheres in boxes, by ray queries in a compute shader.
pub fn mirrors(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    queried(gpu, scale, shader::MIRRORS, World::spheres)
}

/// A picture of a world by ray queries in a compute shader.
fn queried(
    gpu: &Gpu,
    scale: &Scale,
    source: &str,
    world: fn(&Gpu, &Scale) -> World,
) -> Option<Prepared> {
    if gpu.optional.ray_query.ray_query == vk::FALSE {
        return None;
    }
    let world = world(gpu, scale);
    let words = shader::with_common(Stage::Compute, source);
    let turn = compute(gpu, scale, &words, &world);
    Some(Prepared::picture(turn, &world))
}

/// Closest hits that read their records and call one of three shaders.
pub fn callable(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    const PATTERNS: u32 = 3;
    let mut parts = Parts::new(
        shader::raygen(shader::CALLABLE),
        shader::CALLABLE_MISS,
        shader::with_common(Stage::ClosestHit, shader::CALLABLE_HIT),
    );
    for number in 0..PATTERNS {
        let index = parts.shaders.len() as u32;
        parts
            .shaders
            .push((Stage::Callable, shader::pattern(number)));
        parts.groups.push(Group::general(index));
    }
    let world = World::landscape(gpu, &few(scale), PATTERNS);
    let image = canvas(gpu, scale);
    let mut bindings = world.bindings();
    bindings.push((IMAGE, [Bound::StorageImage(image.view)]));
    let rays = pipeline(gpu, &parts, &bindings);
    let tint = |number: u32| {
        let weight = |part: u32| 0.5 + 0.25 * ((number + part) % 3) as f32;
        let tint = [0, 1, 2].map(|part| weight(part).to_bits());
        [tint[0], tint[1], tint[2], 0, number]
    };
    let table = Table {
        raygen: Record::of(0),
        miss: vec![Record::with(1, &tint(1))],
        hit: (0..PATTERNS).map(|n| Record::with(2, &tint(n))).collect(),
        callable: (0..PATTERNS).map(|n| Record::of(3 + n)).collect(),
    };
    let regions = gpu.regions(&rays, &table);
    let turn = gpu.record(|commands| {
        gpu.record_trace(commands, &rays, &regions, [scale.width, scale.height, 1]);
        gpu.barrier(commands);
    });
    Some(drawn(gpu, scale, turn, &world, &image))
}

/// Closest hits that sample a texture at levels of their own.
pub fn textured(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    let parts = Parts::new(
        shader::raygen(shader::TEXTURED),
        shader::MISS,
        shader::with_common(Stage::ClosestHit, shader::TEXTURED_HIT),
    );
    let texture = Texture::filled(gpu, vk::Format::R8G8B8A8_SRGB, 1024, 1);
    gpu.run(|commands| texture.record_mips(gpu, commands));
    let world = World::landscape(gpu, &few(scale), 1);
    let image = canvas(gpu, scale);
    let mut bindings = world.bindings();
    bindings.push((5, [texture.bound(gpu)]));
    bindings.push((IMAGE, [Bound::StorageImage(image.view)]));
    let rays = pipeline(gpu, &parts, &bindings);
    let turn = launch(gpu, scale, &rays, 1);
    Some(drawn(gpu, scale, turn, &world, &image))
}

/// Textures that closest hits pick from.
const TEXTURES: u32 = 64;

/// Closest hits that pick one of many textures by their material.
struct Bindless {
    parts: Parts,
    textures: Vec<Texture>,
    materials: Buffer,
    world: World,
    image: Picture,
}

impl Bindless {
    /// `None` where the device lacks what the shader needs.
    fn new(gpu: &Gpu, scale: &Scale) -> Option<Bindless> {
        if gpu
            .features12
            .shader_sampled_image_array_non_uniform_indexing
            == vk::FALSE
        {
            return None;
        }
        let texture = |number| {
            let texture = Texture::filled(gpu, vk::Format::R8G8B8A8_UNORM, 256, number);
            gpu.run(|commands| texture.record_mips(gpu, commands));
            texture
        };
        let material = |number: u32| {
            let part = |k: u32| (0.4 + 0.05 * ((number * 7 + k * 5) % 12) as f32).to_bits();
            let scale = (0.1 + 0.02 * (number % 9) as f32).to_bits();
            let gloss = (0.01 * (number % 20) as f32).to_bits();
            let texture = number * 5 % TEXTURES;
            [part(0), part(1), part(2), 0, texture, scale, gloss, 0]
        };
        let materials: Vec<[u32; 8]> = (0..97).map(material).collect();
        Some(Bindless {
            parts: Parts::new(
                shader::raygen(shader::TEXTURED),
                shader::MISS,
                shader::bindless_hit(TEXTURES),
            ),
            textures: (0..TEXTURES).map(texture).collect(),
            world: World::landscape(gpu, &few(scale), 1),
            image: canvas(gpu, scale),
            materials: gpu.buffer_with(&materials),
        })
    }
}

/// The textures in a descriptor set.
pub fn bindless(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    let it = Bindless::new(gpu, scale)?;
    let textures: Vec<Bound> = it.textures.iter().map(|it| it.bound(gpu)).collect();
    let materials = [Bound::Storage(it.materials)];
    let target = [Bound::StorageImage(it.image.view)];
    let bindings = it.world.bindings();
    let mut all = borrowed(&bindings);
    all.extend([(5, &textures[..]), (IMAGE, &target), (7, &materials)]);
    let set = gpu.set(&all);
    let rays = rays_of(gpu, &it.parts, set);
    let turn = launch(gpu, scale, &rays, 1);
    Some(drawn(gpu, scale, turn, &it.world, &it.image))
}

/// The same picture with the descriptors in heaps.
pub fn bindless_heaps(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    use vk::DescriptorType as Ty;
    /// The first texture's place; bindings before it have the places of their numbers.
    const FIRST: u64 = 8;
    if gpu.optional.heaps.descriptor_heap == vk::FALSE {
        return None;
    }
    let it = Bindless::new(gpu, scale)?;
    let heaps = Heaps::new(gpu, FIRST + u64::from(TEXTURES));
    heaps.put_structure(0, &it.world.top);
    let storage = [
        (1, &it.world.out),
        (2, &it.world.corners),
        (3, &it.world.indices),
    ];
    for (place, buffer) in storage.into_iter().chain([(7, &it.materials)]) {
        heaps.put_buffer(place, Ty::STORAGE_BUFFER, buffer);
    }
    heaps.put_buffer(4, Ty::UNIFORM_BUFFER, &it.world.camera);
    heaps.put_picture(IMAGE.into(), Ty::STORAGE_IMAGE, &it.image);
    heaps.put_sampler(0, &mips::trilinear());
    for (place, texture) in (FIRST..).zip(&it.textures) {
        heaps.put_picture(place, Ty::SAMPLED_IMAGE, &texture.picture);
    }
    let textures = ConstantOffset {
        heap_offset: heaps.at(FIRST),
        heap_array_stride: heaps.stride as u32,
        p_embedded_sampler: std::ptr::null(),
        sampler_heap_offset: heaps.at(0),
        sampler_heap_array_stride: 0,
    };
    let textures = DescriptorMappingSourceDataEXT {
        constant_offset: textures,
    };
    let plain = [0, 1, 2, 3, 4, IMAGE, 7].map(|binding| heaps.constant(binding, binding.into()));
    let mut mappings = plain.to_vec();
    mappings.push(mapping(5, HEAP_WITH_CONSTANT_OFFSET, textures));
    let parts = &it.parts;
    let rays = heaps.rays(&parts.shaders, &parts.groups, parts.recursion, &mappings);
    let regions = gpu.regions(&rays, &plain_table());
    let turn = gpu.record(|commands| {
        heaps.record_trace(commands, &rays, &regions, [scale.width, scale.height, 1]);
        gpu.barrier(commands);
    });
    Some(drawn(gpu, scale, turn, &it.world, &it.image))
}

/// A frame as hybrid renderers make it: what was drawn is copied in, rays add light to it, a
/// compute shader maps it to colours, and those are copied out.
pub fn hybrid(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    let parts = Parts::new(
        shader::raygen(shader::HYBRID),
        shader::MISS,
        shader::with_common(Stage::ClosestHit, shader::HIT),
    );
    let world = World::landscape(gpu, scale, 1);
    let shape = Shape::flat(vk::Format::R16G16B16A16_SFLOAT, scale.width, scale.height);
    let light = gpu.picture(shape, vk::ImageUsageFlags::STORAGE);
    let image = canvas(gpu, scale);
    // 0.25 in halves.
    let before = gpu.buffer_with(&vec![0x3400_u16; scale.pixels() as usize * 4]);
    let after = gpu.buffer(scale.pixels() * 4);
    let mut bindings = world.bindings();
    bindings.push((IMAGE, [Bound::StorageImage(light.view)]));
    let rays = pipeline(gpu, &parts, &bindings);
    let regions = gpu.regions(&rays, &plain_table());
    let set = gpu.set(&borrowed(&[
        (0, [Bound::StorageImage(light.view)]),
        (1, [Bound::StorageImage(image.view)]),
    ]));
    let tone = gpu.kernel_of(&shader::tone(), &[set.layout]);
    let whole = whole(scale);
    let general = vk::ImageLayout::GENERAL;
    let turn = gpu.record(|commands| {
        // SAFETY: buffers and images are as large as the copies.
        unsafe {
            gpu.device.cmd_copy_buffer_to_image(
                commands,
                before.handle,
                light.handle,
                general,
                &[whole],
            );
        }
        gpu.barrier(commands);
        gpu.record_trace(commands, &rays, &regions, [scale.width, scale.height, 1]);
        gpu.barrier(commands);
        let groups = [scale.width.div_ceil(16), scale.height.div_ceil(4), 1];
        gpu.record_dispatch::<u32>(commands, tone, &[set], &[], groups);
        gpu.barrier(commands);
        // SAFETY: buffers and images are as large as the copies.
        unsafe {
            gpu.device.cmd_copy_image_to_buffer(
                commands,
                image.handle,
                general,
                after.handle,
                &[whole],
            );
        }
        gpu.barrier(commands);
    });
    Some(drawn(gpu, scale, turn, &world, &image))
}

/// Glass and mirrors by ray queries; rays that wait lie in arrays of the invocation's own.
pub fn stack(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    let landscape = |gpu: &Gpu, scale: &Scale| World::landscape(gpu, scale, 1);
    queried(gpu, scale, shader::STACK, landscape)
}

/// Small frames in sequence, each submitted separately and copied to its place of presentation.
pub fn frames(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    const COUNT: u32 = 100;
    let small = Scale {
        width: (scale.width / 4).max(1),
        height: (scale.height / 4).max(1),
        ..few(scale)
    };
    let parts = Parts::new(
        shader::raygen(shader::TEXTURED),
        shader::MISS,
        shader::with_common(Stage::ClosestHit, shader::HIT),
    );
    let world = World::landscape(gpu, &small, 1);
    let image = canvas(gpu, &small);
    let shown = canvas(gpu, &small);
    let mut bindings = world.bindings();
    bindings.push((IMAGE, [Bound::StorageImage(image.view)]));
    let rays = pipeline(gpu, &parts, &bindings);
    let regions = gpu.regions(&rays, &plain_table());
    let layers = whole(&small).image_subresource;
    let copy = vk::ImageCopy::default()
        .src_subresource(layers)
        .dst_subresource(layers)
        .extent(whole(&small).image_extent);
    let general = vk::ImageLayout::GENERAL;
    let turn = gpu.record(|commands| {
        gpu.record_trace(commands, &rays, &regions, [small.width, small.height, 1]);
        gpu.barrier(commands);
        // SAFETY: the images are of one size.
        unsafe {
            gpu.device.cmd_copy_image(
                commands,
                image.handle,
                general,
                shown.handle,
                general,
                &[copy],
            );
        }
        gpu.barrier(commands);
    });
    Some(Prepared {
        work: Some(f64::from(COUNT)),
        submissions: COUNT,
        check: None,
        ..drawn(gpu, &small, turn, &world, &shown)
    })
}

/// Mip chains of textures, a blit a level.
pub fn mip_chains(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    const COUNT: u32 = 4;
    let textures: Vec<Texture> = (0..COUNT)
        .map(|number| Texture::filled(gpu, vk::Format::R8G8B8A8_SRGB, 1024, number))
        .collect();
    let turn = gpu.record(|commands| {
        for texture in &textures {
            texture.record_mips(gpu, commands);
        }
    });
    let world = World::landscape(gpu, &few(scale), 1);
    let parts = crate::workload::plain(shader::TEXTURES);
    let mut bindings = world.bindings();
    bindings.push((5, [textures[0].bound(gpu)]));
    let rays = pipeline(gpu, &parts, &bindings);
    Some(Prepared {
        work: Some(f64::from(COUNT * mips::texels_made(1024))),
        look: Some(launch(gpu, scale, &rays, 1)),
        ..Prepared::picture(turn, &world)
    })
}

/// A scene as small as those of first programs.
fn few(scale: &Scale) -> Scale {
    Scale {
        triangles: 2_000,
        instances: 16,
        ..*scale
    }
}

fn plain_table() -> Table {
    Table::of(0, &[1], &[2])
}

fn rays_of(gpu: &Gpu, parts: &Parts, set: Set) -> Rays {
    let flags = vk::PipelineCreateFlags::empty();
    gpu.rays_of_words(&parts.shaders, &parts.groups, parts.recursion, set, flags)
}

/// All of a picture, as a copy between it and a buffer.
fn whole(scale: &Scale) -> vk::BufferImageCopy {
    vk::BufferImageCopy::default()
        .image_subresource(mips::layers(0))
        .image_extent(vk::Extent3D {
            width: scale.width,
            height: scale.height,
            depth: 1,
        })
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
    let kernel = gpu.kernel_of(&shader::show(), &[set.layout]);
    let groups = [scale.width.div_ceil(8), scale.height.div_ceil(8), 1];
    gpu.record(|commands| {
        gpu.barrier(commands);
        gpu.record_dispatch::<u32>(commands, kernel, &[set], &[], groups);
        gpu.barrier(commands);
    })
}
