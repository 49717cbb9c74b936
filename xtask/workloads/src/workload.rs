//! A workload: what it prepares, what one turn of it is, and the parts that workloads share.

use anyhow::Result;
use tuff_tests::{Bound, Buffer, Group, Picture, Rays, Shape, Stage, Table};
use tuff_tests::{Gpu, vk};

use crate::shader;
use crate::world::{Scale, World};

/// The main bound of a workload's speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bounds {
    Traversal,
    Shading,
    Launching,
    Building,
    /// All of these, alternating, as in applications.
    Programs,
    Drawing,
}

/// A workload by its name.
pub struct Workload {
    pub name: &'static str,
    pub about: &'static str,
    pub unit: &'static str,
    pub bounds: Bounds,
    pub prepare: fn(&Gpu, &Scale) -> Option<Prepared>,
}

/// A workload that is ready to run, again and again.
pub struct Prepared {
    /// One turn, from submission to its end; recorded beforehand.
    pub turn: vk::CommandBuffer,
    /// How many units one turn does, unless the picture counts them.
    pub work: Option<f64>,
    /// Four floats a pixel: a colour and a count of rays.
    pub picture: Buffer,
    /// Draws the picture where the turn does not.
    pub look: Option<vk::CommandBuffer>,
    /// How often the commands are submitted in a turn, each time waited for.
    pub submissions: u32,
    /// Holds what turns left against what it has to be.
    pub check: Option<Check>,
}

/// A check of a picture, run after the turns.
pub type Check = Box<dyn Fn(&Gpu) -> Result<()>>;

/// The shaders of a pipeline, compiled, and its groups.
pub struct Parts {
    pub shaders: Vec<(Stage, Vec<u32>)>,
    pub groups: Vec<Group>,
    pub recursion: u32,
}

impl Parts {
    /// Ray generation, miss and one closest hit.
    pub fn new(raygen: Vec<u32>, miss: &str, hit: Vec<u32>) -> Parts {
        Parts {
            shaders: vec![
                (Stage::RayGeneration, raygen),
                (Stage::Miss, shader::with_common(Stage::Miss, miss)),
                (Stage::ClosestHit, hit),
            ],
            groups: vec![Group::general(0), Group::general(1), Group::hit(2)],
            recursion: 1,
        }
    }
}

/// The usual miss and closest hit.
pub fn plain(raygen: &str) -> Parts {
    let hit = shader::with_common(Stage::ClosestHit, shader::HIT);
    Parts::new(shader::raygen(raygen), shader::MISS, hit)
}

/// The words of the pipeline that [`rays`] makes of [`shader::PATH`], for measuring its creation.
pub fn path_parts() -> (Vec<(Stage, Vec<u32>)>, Vec<Group>) {
    let parts = plain(shader::PATH);
    (parts.shaders, parts.groups)
}

/// A picture of a world with so many hit groups.
fn traced(gpu: &Gpu, scale: &Scale, parts: &Parts, world: &World, hits: u32) -> Option<Prepared> {
    let rays = pipeline(gpu, parts, &world.bindings());
    let turn = launch(gpu, scale, &rays, hits);
    Some(Prepared::picture(turn, world))
}

pub fn rays(gpu: &Gpu, scale: &Scale, raygen: &str) -> Option<Prepared> {
    let world = World::landscape(gpu, scale, 1);
    traced(gpu, scale, &plain(raygen), &world, 1)
}

pub fn reflection(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    let raygen = shader::with_common(Stage::RayGeneration, shader::REFLECTION);
    let hit = shader::with_common(Stage::ClosestHit, shader::REFLECTION_HIT);
    let parts = Parts {
        recursion: 7,
        ..Parts::new(raygen, shader::REFLECTION_MISS, hit)
    };
    if gpu.pipeline_properties.max_ray_recursion_depth < parts.recursion {
        return None;
    }
    traced(gpu, scale, &parts, &World::landscape(gpu, scale, 1), 1)
}

/// The shaders of `foliage`.
pub fn foliage_parts(scale: &Scale) -> Parts {
    let mut parts = plain(shader::FOLIAGE);
    if !scale.no_any_hit {
        let any_hit = shader::with_common(Stage::AnyHit, shader::FOLIAGE_ANY_HIT);
        parts.shaders.push((Stage::AnyHit, any_hit));
        parts.groups[2].any_hit = Some(3);
    }
    parts
}

pub fn foliage(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    let world = World::foliage(gpu, scale);
    traced(gpu, scale, &foliage_parts(scale), &world, 1)
}

pub fn spheres(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    let mut parts = plain(shader::SHADOW);
    parts.shaders[2].1 = shader::with_common(Stage::ClosestHit, shader::BALL_HIT);
    let ball = shader::with_common(Stage::Intersection, shader::BALL);
    parts.shaders.push((Stage::Intersection, ball));
    parts.groups[2].intersection = Some(3);
    traced(gpu, scale, &parts, &World::spheres(gpu, scale), 1)
}

pub fn materials(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    const COUNT: u32 = 64;
    let mut parts = plain(shader::PATH);
    parts.shaders.truncate(2);
    parts.groups.truncate(2);
    for number in 0..COUNT {
        parts.groups.push(Group::hit(parts.shaders.len() as u32));
        parts
            .shaders
            .push((Stage::ClosestHit, shader::material(number)));
    }
    let world = World::landscape(gpu, scale, COUNT);
    traced(gpu, scale, &parts, &world, COUNT)
}

pub fn query(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    if gpu.optional.ray_query.ray_query == vk::FALSE {
        return None;
    }
    let world = World::landscape(gpu, scale, 1);
    let turn = compute(gpu, scale, &shader::query(), &world);
    Some(Prepared::picture(turn, &world))
}

/// A compute shader with an invocation a pixel; it finds the picture's size at binding 5.
pub fn compute(gpu: &Gpu, scale: &Scale, words: &[u32], world: &World) -> vk::CommandBuffer {
    let size = gpu.buffer_with(&[scale.width, scale.height]);
    let mut bindings = world.bindings();
    bindings.push((5, [Bound::Uniform(size)]));
    let set = gpu.set(&borrowed(&bindings));
    let kernel = gpu.kernel_of(words, &[set.layout]);
    let groups = [scale.width.div_ceil(8), scale.height.div_ceil(8), 1];
    gpu.record(|commands| {
        gpu.record_dispatch::<u32>(commands, kernel, &[set], &[], groups);
        gpu.barrier(commands);
    })
}

pub fn textures(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    let parts = plain(shader::TEXTURES);
    let world = World::least(gpu, scale);
    let mut bindings = world.bindings();
    bindings.push((5, [texture(gpu)]));
    let rays = pipeline(gpu, &parts, &bindings);
    let turn = launch(gpu, scale, &rays, 1);
    Some(Prepared::picture(turn, &world))
}

/// A list of 4,096 places in memory, in an order that is no order.
pub fn pointers(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    const COUNT: u64 = 4096;
    const PLACE_BYTES: u64 = 16;
    let places = gpu.buffer(COUNT * PLACE_BYTES);
    let address = |i: u64| places.address + i % COUNT * PLACE_BYTES;
    // An odd factor: every place is followed by another one.
    let after = |i: u64| address(i * 1_597 + 1);
    let words: Vec<u64> = (0..COUNT)
        .flat_map(|i| {
            let value = (i as f32 / COUNT as f32).to_bits();
            [after(i), u64::from(value) | (i * 7 % COUNT) << 32]
        })
        .collect();
    places.write(0, &words);
    let starts: Vec<u64> = (0..COUNT).map(|i| address(i * 31)).collect();
    let world = World::least(gpu, scale);
    let mut bindings = world.bindings();
    bindings.push((5, [Bound::Storage(gpu.buffer_with(&starts))]));
    let rays = pipeline(gpu, &plain(shader::POINTERS), &bindings);
    let turn = launch(gpu, scale, &rays, 1);
    Some(Prepared::picture(turn, &world))
}

/// A texture of 1,024² texels with all its mips, sampled with repetition and trilinearly.
fn texture(gpu: &Gpu) -> Bound {
    const SIDE: u32 = 1024;
    const LEVELS: u32 = 11;
    let shape = Shape {
        levels: LEVELS,
        ..Shape::flat(vk::Format::R8G8B8A8_UNORM, SIDE, SIDE)
    };
    let picture: Picture = gpu.picture(shape, vk::ImageUsageFlags::SAMPLED);
    for level in 0..LEVELS {
        let side = SIDE >> level;
        let texel = |i: u32| [i * 37, (i / side) * 53, (i ^ (i / side)) * 11, 255].map(|v| v as u8);
        let texels: Vec<[u8; 4]> = (0..side * side).map(texel).collect();
        gpu.upload(&picture, level, &texels);
    }
    let sampler = vk::SamplerCreateInfo::default()
        .mag_filter(vk::Filter::LINEAR)
        .min_filter(vk::Filter::LINEAR)
        .mipmap_mode(vk::SamplerMipmapMode::LINEAR)
        .max_lod(vk::LOD_CLAMP_NONE);
    Bound::Sampled(picture.view, gpu.sampler(&sampler))
}

pub fn launches(gpu: &Gpu, _scale: &Scale) -> Option<Prepared> {
    const COUNT: u32 = 2_000;
    let parts = plain(shader::PRIMARY);
    let small = Scale {
        triangles: 2_000,
        instances: 16,
        width: 8,
        height: 8,
        no_any_hit: false,
    };
    let world = World::landscape(gpu, &small, 1);
    let rays = pipeline(gpu, &parts, &world.bindings());
    let regions = gpu.regions(&rays, &Table::of(0, &[1], &[2]));
    let turn = gpu.record(|commands| {
        for _ in 0..COUNT {
            gpu.record_trace(commands, &rays, &regions, [8, 8, 1]);
            gpu.barrier(commands);
        }
    });
    let mut prepared = Prepared::picture(turn, &world);
    prepared.work = Some(f64::from(COUNT));
    Some(prepared)
}

impl Prepared {
    /// A turn that draws a picture of the world.
    pub fn picture(turn: vk::CommandBuffer, world: &World) -> Prepared {
        Prepared {
            turn,
            work: None,
            picture: world.out,
            look: None,
            submissions: 1,
            check: None,
        }
    }

    /// Runs a turn to its end.
    pub fn run(&self, gpu: &Gpu) -> Result<(), vk::Result> {
        (0..self.submissions).try_for_each(|_| gpu.submit(self.turn))
    }
}

/// Draws primary rays of a world, for workloads whose turn draws nothing.
pub fn look(gpu: &Gpu, scale: &Scale, world: &World) -> vk::CommandBuffer {
    let rays = pipeline(gpu, &plain(shader::PRIMARY), &world.bindings());
    launch(gpu, scale, &rays, 1)
}

pub fn borrowed(bindings: &[(u32, [Bound; 1])]) -> Vec<(u32, &[Bound])> {
    bindings
        .iter()
        .map(|(binding, bound)| (*binding, &bound[..]))
        .collect()
}

pub fn pipeline(gpu: &Gpu, parts: &Parts, bindings: &[(u32, [Bound; 1])]) -> Rays {
    pipeline_with(gpu, parts, bindings, vk::PipelineCreateFlags::empty())
}

/// As [`pipeline`], with flags.
pub fn pipeline_with(
    gpu: &Gpu,
    parts: &Parts,
    bindings: &[(u32, [Bound; 1])],
    flags: vk::PipelineCreateFlags,
) -> Rays {
    let set = gpu.set(&borrowed(bindings));
    gpu.rays_of_words(&parts.shaders, &parts.groups, parts.recursion, set, flags)
}

pub fn launch(gpu: &Gpu, scale: &Scale, rays: &Rays, hit_groups: u32) -> vk::CommandBuffer {
    let hits: Vec<u32> = (2..2 + hit_groups).collect();
    let regions = gpu.regions(rays, &Table::of(0, &[1], &hits));
    gpu.record(|commands| {
        gpu.record_trace(commands, rays, &regions, [scale.width, scale.height, 1]);
        gpu.barrier(commands);
    })
}
