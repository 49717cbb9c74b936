//! Binding tables of nonsense, and dispatches that say where they are from memory.

use ash::vk;
use fastrand::Rng;

use crate::case::{Case, wild};
use crate::world::World;

fn region(world: &World, rng: &mut Rng, was: u64) -> vk::StridedDeviceAddressRegionKHR {
    let buffer = world.guarded[0].buffer;
    let address = match rng.u32(0..6) {
        0 => wild(rng),
        1 => buffer.address + buffer.size_bytes - 64,
        2 => buffer.address,
        _ => was,
    };
    let size = |rng: &mut Rng| match rng.u32(0..4) {
        0 => wild(rng),
        1 => 0,
        2 => 32,
        _ => 64 * rng.u64(1..9),
    };
    vk::StridedDeviceAddressRegionKHR {
        device_address: address,
        stride: size(rng),
        size: size(rng),
    }
}

pub fn run(world: &World, case: &Case) {
    let gpu = &world.gpu;
    let mut rng = case.common();
    let mut regions = world.regions;
    // Records: handles of the pipeline, some of them damaged.
    let table = gpu.buffer(4096);
    let mut bytes = vec![0u8; 4096];
    for record in bytes.chunks_exact_mut(64) {
        let handle = &world.rays.handles[rng.usize(0..world.rays.handles.len())];
        record[..handle.len()].copy_from_slice(handle);
    }
    for mut rng in case.steps() {
        let at = rng.usize(0..4096);
        match rng.u32(0..3) {
            0 => bytes[at] = rng.u8(..),
            1 => {
                let which = rng.usize(0..4);
                regions[which] = region(world, &mut rng, regions[which].device_address);
            }
            _ => {
                let which = rng.usize(0..4);
                let stride = 64 * rng.u64(0..3);
                regions[which] = vk::StridedDeviceAddressRegionKHR {
                    device_address: table.address + 64 * rng.u64(0..64),
                    stride,
                    size: stride * rng.u64(0..20),
                };
            }
        }
    }
    table.write(0, &bytes);
    let mut extent = [rng.u32(0..40), rng.u32(0..3), 1];
    if rng.u32(0..8) == 0 {
        extent[rng.usize(0..3)] = wild(&mut rng) as u32;
    }
    match rng.u32(0..3) {
        0 => indirect(world, &mut rng, &regions, extent),
        _ => {
            // More than a moment's work is no nonsense.
            let extent = extent.map(|n| n.min(64));
            world.run(|commands| {
                gpu.record_trace(commands, &world.rays, &regions, extent);
            });
        }
    }
}

/// The extent lies in memory, perhaps.
fn indirect(
    world: &World,
    rng: &mut Rng,
    regions: &[vk::StridedDeviceAddressRegionKHR; 4],
    extent: [u32; 3],
) {
    let gpu = &world.gpu;
    let words = gpu.buffer_with(&extent);
    let address = match rng.u32(0..4) {
        0 => wild(rng) & !3,
        1 => words.address + words.size_bytes - 4,
        _ => words.address,
    };
    world.run(|commands| {
        gpu.bind_rays(commands, &world.rays);
        let [raygen, miss, hit, callable] = regions;
        // SAFETY: the handles live as long as the device; the rest the driver has to bear.
        unsafe {
            gpu.ray_tracing
                .cmd_trace_rays_indirect(commands, raygen, miss, hit, callable, address);
        }
    });
}
