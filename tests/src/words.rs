//! Rays through layers of triangles, by shaders that leave words.

use crate::{Bound, Gpu, Group, RaysInput, Stage, Structure, Table};

/// A screen-filling triangle at z = 1, 2, 3, … for each layer.
pub fn layers(count: u32) -> Vec<[f32; 3]> {
    (1..=count)
        .flat_map(|z| {
            let z = z as f32;
            [[-9.0, -9.0, z], [9.0, -9.0, z], [0.0, 9.0, z]]
        })
        .collect()
}

/// The structure that [`trace_words`] binds.
pub const WORLD: &str = "layout(set = 0, binding = 0) uniform accelerationStructureEXT world;\n";
/// Where its shaders leave words.
pub const RESULTS: &str =
    "layout(set = 0, binding = 1, std430) buffer Results { uint results[]; };\n";
/// The miss shader of its pipelines.
pub const MISS: &str = r"
layout(location = 0) rayPayloadInEXT uint payload;
void main() { payload = 0xffffffffu; }
";

/// Traces with a ray generation shader (group 0), [`MISS`] (group 1) and other shaders, whose hit groups follow. [`WORLD`] and
/// [`RESULTS`] stand before the ray generation shader.
pub fn trace_words(
    gpu: &Gpu,
    world: Structure,
    raygen: &str,
    others: &[(Stage, &str)],
    hit_groups: &[Group],
    size: [u32; 3],
    words: usize,
) -> Vec<u32> {
    let output = gpu.buffer(4 * words as u64);
    let raygen = format!("{WORLD}{RESULTS}{raygen}");
    let mut shaders = vec![(Stage::RayGeneration, raygen.as_str()), (Stage::Miss, MISS)];
    shaders.extend_from_slice(others);
    let mut groups = vec![Group::general(0), Group::general(1)];
    groups.extend_from_slice(hit_groups);
    let rays = gpu.rays(&RaysInput {
        shaders: &shaders,
        groups: &groups,
        recursion: 1,
        bindings: &[
            (0, &[Bound::Structure(world.handle)]),
            (1, &[Bound::Storage(output)]),
        ],
    });
    let hits: Vec<u32> = (2..groups.len() as u32).collect();
    gpu.trace(&rays, &Table::of(0, &[1], &hits), size);
    output.read()
}
