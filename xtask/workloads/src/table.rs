//! The table of workloads.

use anyhow::{Context, Result};
use tuff_tests::Gpu;

use crate::workload::{
    Bounds, Prepared, Workload, foliage, launches, materials, pointers, query, rays, reflection,
    spheres, textures,
};
use crate::world::Scale;
use crate::{building, drawing, micromaps, network, programs, shader};

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
        prepare: |g, s| Some(building::build(g, s)),
    },
    Workload {
        name: "refit",
        about: "updating it after its corners moved",
        unit: "Mtri/s",
        bounds: Bounds::Building,
        prepare: |g, s| Some(building::refit(g, s)),
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
