//! Micromaps built from data that is not there, and triangles that use them by indices of any kind.

use ash::vk;
use fastrand::Rng;

use super::builds::{address, fill, modest};
use crate::case::Case;
use crate::world::World;

/// Bytes of a micromap: too few for many of the builds.
const SIZE_BYTES: u64 = 1 << 14;

/// Counts of triangles that may have nothing to do with those in memory.
fn usages(rng: &mut Rng) -> Vec<vk::MicromapUsageEXT> {
    let count = rng.usize(0..4);
    (0..count)
        .map(|_| vk::MicromapUsageEXT {
            count: modest(rng) as u32,
            subdivision_level: match rng.u32(0..8) {
                0 => modest(rng) as u32,
                _ => rng.u32(0..8),
            },
            format: rng.u32(0..4),
        })
        .collect()
}

fn anywhere(world: &World, rng: &mut Rng) -> vk::DeviceOrHostAddressConstKHR {
    vk::DeviceOrHostAddressConstKHR {
        device_address: address(world, rng),
    }
}

/// A build of a micromap from data anywhere.
fn build_info<'a>(
    world: &World,
    rng: &mut Rng,
    micromap: vk::MicromapEXT,
    usages: &'a [vk::MicromapUsageEXT],
    scratch: vk::DeviceAddress,
) -> vk::MicromapBuildInfoEXT<'a> {
    vk::MicromapBuildInfoEXT::default()
        .ty(vk::MicromapTypeEXT::OPACITY_MICROMAP)
        .flags(vk::BuildMicromapFlagsEXT::from_raw(rng.u32(0..8)))
        .mode(vk::BuildMicromapModeEXT::BUILD)
        .dst_micromap(micromap)
        .usage_counts(usages)
        .data(anywhere(world, rng))
        .triangle_array(anywhere(world, rng))
        .triangle_array_stride(modest(rng))
        .scratch_data(vk::DeviceOrHostAddressKHR {
            device_address: scratch,
        })
}

/// The use of a micromap by triangles, with indices anywhere.
fn use_of<'a>(
    world: &World,
    rng: &mut Rng,
    micromap: vk::MicromapEXT,
    usages: &'a [vk::MicromapUsageEXT],
) -> vk::AccelerationStructureTrianglesOpacityMicromapEXT<'a> {
    let index_types = [
        vk::IndexType::NONE_KHR,
        vk::IndexType::UINT8_KHR,
        vk::IndexType::UINT16,
        vk::IndexType::UINT32,
    ];
    vk::AccelerationStructureTrianglesOpacityMicromapEXT::default()
        .index_type(index_types[rng.usize(0..index_types.len())])
        .index_buffer(anywhere(world, rng))
        .index_stride(modest(rng))
        .base_triangle(modest(rng) as u32)
        .usage_counts(usages)
        .micromap(micromap)
}

pub fn run(world: &World, case: &Case) {
    let gpu = &world.gpu;
    if gpu.optional.micromap.micromap == vk::FALSE {
        return;
    }
    let mut rng = case.common();
    fill(world, &mut rng);
    for mut rng in case.steps().take(4) {
        let rng = &mut rng;
        let usages = usages(rng);
        let micromap = gpu.empty_micromap(SIZE_BYTES);
        let scratch = gpu.buffer(1 << 16);
        let info = build_info(world, rng, micromap, &usages, scratch.address);
        let mut chained = use_of(world, rng, micromap, &usages);
        let triangles = vk::AccelerationStructureGeometryTrianglesDataKHR::default()
            .vertex_format(vk::Format::R32G32B32_SFLOAT)
            .vertex_data(vk::DeviceOrHostAddressConstKHR {
                device_address: world.guarded[0].address(),
            })
            .vertex_stride(12)
            .max_vertex(3 * 60)
            .index_type(vk::IndexType::NONE_KHR)
            .push_next(&mut chained);
        let geometries = [vk::AccelerationStructureGeometryKHR::default()
            .geometry_type(vk::GeometryTypeKHR::TRIANGLES)
            .geometry(vk::AccelerationStructureGeometryDataKHR { triangles })];
        let ty = vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL;
        let room = gpu.empty_structure(ty, 1 << 18);
        let structure_scratch = gpu.buffer(1 << 18);
        let build = vk::AccelerationStructureBuildGeometryInfoKHR::default()
            .ty(ty)
            .mode(vk::BuildAccelerationStructureModeKHR::BUILD)
            .geometries(&geometries)
            .dst_acceleration_structure(room.handle)
            .scratch_data(vk::DeviceOrHostAddressKHR {
                device_address: structure_scratch.address,
            });
        let range = vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(60);
        let barrier = [vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::MEMORY_WRITE)
            .dst_access_mask(vk::AccessFlags::MEMORY_READ)];
        let all = vk::PipelineStageFlags::ALL_COMMANDS;
        // SAFETY: the handles live as long as the device; the rest the driver has to bear.
        world.run(|commands| unsafe {
            (gpu.micromaps.fp().cmd_build_micromaps_ext)(commands, 1, &info);
            let flags = vk::DependencyFlags::empty();
            gpu.device
                .cmd_pipeline_barrier(commands, all, all, flags, &barrier, &[], &[]);
            gpu.acceleration
                .cmd_build_acceleration_structures(commands, &[build], &[&[range]]);
        });
        let above = gpu.top(&[tuff_tests::Instance::of(room)]);
        world.query(above.address, 0);
        gpu.destroy(above);
        gpu.destroy(room);
    }
    // Destinations may have been there: margins count from here on.
    world.guarded[0].renew();
}
