//! The workloads: what each prepares, and what one turn of it is.

use anyhow::{Context, Result};
use tuff_tests::{Bound, Buffer, Group, Picture, Rays, Shape, Stage, Table};
use tuff_tests::{Gpu, vk};

use crate::drawing;
use crate::micromaps;
use crate::network;
use crate::programs;
use crate::shader;
use crate::world::{Scale, World};

/// The main bound of a workload's speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bounds {
    Traversal,
    Shading,
    Launching,
    Building,
    /// All of these by turns, as in applications.
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

const TRACING: &[Workload] = &[
    row("primary", "one ray a pixel", Bounds::Traversal, |g, s| {
        rays(g, s, shader::PRIMARY)
    }),
    row(
        "shadow",
        "a ray a pixel, four shadow rays from its hit",
        Bounds::Traversal,
        |g, s| rays(g, s, shader::SHADOW),
    ),
    row(
        "occlusion",
        "eight short rays from each hit",
        Bounds::Traversal,
        |g, s| rays(g, s, shader::OCCLUSION),
    ),
    row(
        "path",
        "diffuse paths of eight bounces",
        Bounds::Traversal,
        |g, s| rays(g, s, shader::PATH),
    ),
    row(
        "reflection",
        "closest-hit shaders that trace, six deep",
        Bounds::Traversal,
        reflection,
    ),
    row(
        "foliage",
        "leaves cut out by an any-hit shader",
        Bounds::Traversal,
        foliage,
    ),
    row(
        "foliage micromaps",
        "the same leaves, their outline in opacity micromaps",
        Bounds::Traversal,
        micromaps::ext,
    ),
    row(
        "foliage khr micromaps",
        "the same with micromaps that are acceleration structures",
        Bounds::Traversal,
        micromaps::khr,
    ),
    row(
        "spheres",
        "spheres by an intersection shader",
        Bounds::Traversal,
        spheres,
    ),
    row(
        "materials",
        "paths over 64 closest-hit shaders",
        Bounds::Shading,
        materials,
    ),
    Workload {
        name: "network",
        about: "three layers of 64 for each hit, by cooperative vectors",
        unit: "Mhit/s",
        bounds: Bounds::Shading,
        prepare: network::vectors,
    },
    Workload {
        name: "network plain",
        about: "the same in loops over a buffer",
        unit: "Mhit/s",
        bounds: Bounds::Shading,
        prepare: network::plain,
    },
    row(
        "query",
        "the paths by ray queries in a compute shader",
        Bounds::Traversal,
        query,
    ),
    Workload {
        name: "arithmetic",
        about: "noise of 16 octaves, no rays",
        unit: "Mpixel/s",
        bounds: Bounds::Shading,
        prepare: |g, s| rays(g, s, shader::ARITHMETIC),
    },
    Workload {
        name: "generated",
        about: "sorting in local arrays, as other compilers write it",
        unit: "Mpixel/s",
        bounds: Bounds::Shading,
        prepare: |g, s| rays(g, s, shader::GENERATED),
    },
    Workload {
        name: "pointers",
        about: "64 physical pointers followed a pixel",
        unit: "Mpixel/s",
        bounds: Bounds::Shading,
        prepare: pointers,
    },
    Workload {
        name: "textures",
        about: "32 trilinear samples a pixel",
        unit: "Mpixel/s",
        bounds: Bounds::Shading,
        prepare: textures,
    },
    Workload {
        name: "launches",
        about: "2,000 launches of 8×8 rays, a barrier after each",
        unit: "klaunch/s",
        bounds: Bounds::Launching,
        prepare: launches,
    },
    row(
        "triangle",
        "one trivial ray a pixel, stored to an rgba8 image",
        Bounds::Programs,
        programs::triangle,
    ),
    row(
        "boxes",
        "boxes and a ground plane by ray queries in a compute shader",
        Bounds::Programs,
        programs::boxes,
    ),
    row(
        "mirrors",
        "mirroring spheres by ray queries in a compute shader",
        Bounds::Programs,
        programs::mirrors,
    ),
    row(
        "callable",
        "callables and record data, stored to an rgba8 image",
        Bounds::Programs,
        programs::callable,
    ),
    row(
        "textured",
        "closest hits that sample a texture's mip chain",
        Bounds::Programs,
        programs::textured,
    ),
    row(
        "bindless",
        "closest hits that pick one of 64 textures",
        Bounds::Programs,
        programs::bindless,
    ),
    row(
        "bindless heaps",
        "the same with the descriptors in heaps",
        Bounds::Programs,
        programs::bindless_heaps,
    ),
    row(
        "hybrid",
        "a frame: copied in, traced, tone mapped, copied out",
        Bounds::Programs,
        programs::hybrid,
    ),
    row(
        "stack",
        "glass by ray queries, rays on a stack of local arrays",
        Bounds::Programs,
        programs::stack,
    ),
    Workload {
        name: "frames",
        about: "100 small frames, each submitted and copied to be shown",
        unit: "frames/s",
        bounds: Bounds::Programs,
        prepare: programs::frames,
    },
    Workload {
        name: "mips",
        about: "mip chains of four textures of 1,024² texels, by blits",
        unit: "Mtexel/s",
        bounds: Bounds::Programs,
        prepare: programs::mip_chains,
    },
    Workload {
        name: "build",
        about: "building the ground's structure",
        unit: "Mtri/s",
        bounds: Bounds::Building,
        prepare: |g, s| Some(crate::building::build(g, s)),
    },
    Workload {
        name: "refit",
        about: "updating it after its corners moved",
        unit: "Mtri/s",
        bounds: Bounds::Building,
        prepare: |g, s| Some(crate::building::refit(g, s)),
    },
];

/// All workloads, in the order of the report.
pub fn all() -> impl Iterator<Item = &'static Workload> {
    TRACING.iter().chain(&drawing::ALL)
}

/// The workload of this name.
pub fn named(name: &str) -> Result<&'static Workload> {
    let found = all().find(|workload| workload.name == name);
    found.with_context(|| format!("there is no workload «{name}»"))
}

const fn row(
    name: &'static str,
    about: &'static str,
    bounds: Bounds,
    prepare: fn(&Gpu, &Scale) -> Option<Prepared>,
) -> Workload {
    Workload {
        name,
        about,
        unit: "Mrays/s",
        bounds,
        prepare,
    }
}

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

fn rays(gpu: &Gpu, scale: &Scale, raygen: &str) -> Option<Prepared> {
    let world = World::landscape(gpu, scale, 1);
    traced(gpu, scale, &plain(raygen), &world, 1)
}

fn reflection(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
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

fn spheres(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    let mut parts = plain(shader::SHADOW);
    parts.shaders[2].1 = shader::with_common(Stage::ClosestHit, shader::BALL_HIT);
    let ball = shader::with_common(Stage::Intersection, shader::BALL);
    parts.shaders.push((Stage::Intersection, ball));
    parts.groups[2].intersection = Some(3);
    traced(gpu, scale, &parts, &World::spheres(gpu, scale), 1)
}

fn materials(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
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

fn query(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
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

fn textures(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
    let parts = plain(shader::TEXTURES);
    let world = World::least(gpu, scale);
    let mut bindings = world.bindings();
    bindings.push((5, [texture(gpu)]));
    let rays = pipeline(gpu, &parts, &bindings);
    let turn = launch(gpu, scale, &rays, 1);
    Some(Prepared::picture(turn, &world))
}

/// A list of 4,096 places in memory, in an order that is no order.
fn pointers(gpu: &Gpu, scale: &Scale) -> Option<Prepared> {
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

fn launches(gpu: &Gpu, _scale: &Scale) -> Option<Prepared> {
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
