//! Pipeline caches: whole, cut, and changed with checksums that are right again.
//!
//! An entry of Tuff's is a key (16 bytes), a length (4), a checksum (8), and a module. Another
//! driver's is changed all the same.

use ash::vk;
use tuff_tests::{Kernel, Stage};
use xxhash_rust::xxh3::xxh3_64_with_seed;

use crate::case::{Case, wild};
use crate::world::{World, compiled};

const HEADER: usize = 32;
const ENTRY_HEAD: usize = 28;

const SOURCE: &str = r"
    layout(local_size_x = 16) in;
    void main() {
        uint i = gl_LocalInvocationIndex;
        vec4 c = texelFetch(t, ivec2(i & 7u, 0), 0) + u[i];
        for (uint k = 0u; k < 4u; k++) { b[i + k] = b[k] + uint(c.x); imageStore(p, ivec2(i, k), c); }
        rayQueryEXT q;
        rayQueryInitializeEXT(q, world, 0u, 0xff, vec3(0.01 * i, 0.01, 0), 0.0, vec3(0, 0, 1), 50.0);
        while (rayQueryProceedEXT(q)) {}
        b[64 + i] = rayQueryGetIntersectionTypeEXT(q, true);
    }";

fn words() -> &'static [u32] {
    static WORDS: std::sync::OnceLock<Vec<u32>> = std::sync::OnceLock::new();
    WORDS.get_or_init(|| compiled(Stage::Compute, SOURCE))
}

/// Makes the pipeline by a cache.
fn pipeline(world: &World, cache: vk::PipelineCache) -> Option<vk::Pipeline> {
    let device = &world.gpu.device;
    let info = vk::ShaderModuleCreateInfo::default().code(words());
    // SAFETY: the structures outlive the calls.
    unsafe {
        let module = device.create_shader_module(&info, None).ok()?;
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main");
        let info = vk::ComputePipelineCreateInfo::default()
            .stage(stage)
            .layout(world.layout);
        let made = device.create_compute_pipelines(cache, &[info], None);
        device.destroy_shader_module(module, None);
        made.ok().map(|made| made[0])
    }
}

/// The bytes that an empty cache has after the pipeline was made.
fn filled(world: &World) -> Vec<u8> {
    let device = &world.gpu.device;
    // SAFETY: plain, and destroyed below.
    unsafe {
        let cache = device
            .create_pipeline_cache(&vk::PipelineCacheCreateInfo::default(), None)
            .expect("a cache");
        let made = pipeline(world, cache).expect("a sound pipeline");
        let data = device.get_pipeline_cache_data(cache).expect("its data");
        device.destroy_pipeline(made, None);
        device.destroy_pipeline_cache(cache, None);
        data
    }
}

/// Makes the checksums of all entries right again.
fn correct(data: &mut [u8]) {
    let mut at = HEADER;
    while at + ENTRY_HEAD <= data.len() {
        let length = u32::from_le_bytes(data[at + 16..at + 20].try_into().expect("four bytes"));
        let start = at + ENTRY_HEAD;
        let Some(end) = start
            .checked_add(length as usize)
            .filter(|&end| end <= data.len())
        else {
            return;
        };
        let seed = (data[at..at + 16].iter())
            .fold(0u64, |seed, &byte| seed.rotate_left(8) ^ u64::from(byte));
        let sum = xxh3_64_with_seed(&data[start..end], seed);
        data[at + 20..start].copy_from_slice(&sum.to_le_bytes());
        at = end;
    }
}

pub fn run(world: &World, case: &Case) {
    let mut rng = case.common();
    let mut data = filled(world);
    for mut rng in case.steps().take(4) {
        if data.len() <= HEADER + ENTRY_HEAD + 1 {
            break;
        }
        let at = rng.usize(HEADER + ENTRY_HEAD..data.len());
        match rng.u32(0..7) {
            0 => data[at] ^= 1 << rng.u32(0..8),
            1 => data[at] = rng.u8(..),
            2 => data[at] = data[at].wrapping_add(1),
            3 => data[at] = data[rng.usize(HEADER..data.len())],
            4 => data[at] = wild(&mut rng) as u8,
            5 => {
                let other = rng.usize(HEADER + ENTRY_HEAD..data.len());
                data.swap(at, other);
            }
            _ => data[at] = data[at].wrapping_sub(1),
        }
    }
    if rng.u32(0..8) == 0 {
        data.truncate(rng.usize(0..data.len()));
    }
    if rng.u32(0..8) != 0 {
        correct(&mut data);
    }
    let device = &world.gpu.device;
    let info = vk::PipelineCacheCreateInfo::default().initial_data(&data);
    // SAFETY: the structures outlive the calls, and nothing uses what is destroyed.
    unsafe {
        let Ok(cache) = device.create_pipeline_cache(&info, None) else {
            return;
        };
        let made = pipeline(world, cache);
        device.destroy_pipeline_cache(cache, None);
        let Some(pipeline) = made else { return };
        let kernel = Kernel {
            pipeline,
            layout: world.layout,
        };
        world.run(|commands| {
            (world.gpu).record_dispatch::<u32>(commands, kernel, &[world.set], &[], [1, 1, 1]);
        });
        device.destroy_pipeline(pipeline, None);
    }
}
