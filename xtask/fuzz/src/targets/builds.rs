//! Builds and updates from geometry that is not there, or of no kind.

use ash::vk;
use fastrand::Rng;

use crate::case::{Case, wild};
use crate::world::World;

/// An address, mostly one at which there is something.
pub fn address(world: &World, rng: &mut Rng) -> u64 {
    let buffer = world.guarded[0].buffer;
    match rng.u32(0..5) {
        0 => wild(rng),
        1 => buffer.address + buffer.size_bytes - rng.u64(0..64),
        2 => world.levels[rng.usize(0..2)].address + rng.u64(0..4096),
        _ => buffer.address + rng.u64(0..buffer.size_bytes),
    }
}

fn format(rng: &mut Rng) -> vk::Format {
    let known = [
        vk::Format::R32G32B32_SFLOAT,
        vk::Format::R16G16_SNORM,
        vk::Format::R64G64B64_SFLOAT,
        vk::Format::A2B10G10R10_UNORM_PACK32,
        vk::Format::R8G8B8A8_UNORM,
        vk::Format::UNDEFINED,
    ];
    known[rng.usize(0..known.len())]
}

/// A stride or a count, mostly a modest one.
pub fn modest(rng: &mut Rng) -> u64 {
    match rng.u32(0..6) {
        0 => wild(rng),
        _ => rng.u64(0..64),
    }
}

fn geometry(world: &World, rng: &mut Rng) -> vk::AccelerationStructureGeometryKHR<'static> {
    let at = |rng: &mut Rng| vk::DeviceOrHostAddressConstKHR {
        device_address: address(world, rng),
    };
    let (kind, data) = match rng.u32(0..3) {
        0 => {
            let triangles = vk::AccelerationStructureGeometryTrianglesDataKHR::default()
                .vertex_format(format(rng))
                .vertex_data(at(rng))
                .vertex_stride(modest(rng))
                .max_vertex(modest(rng) as u32)
                .index_type(
                    [
                        vk::IndexType::NONE_KHR,
                        vk::IndexType::UINT16,
                        vk::IndexType::UINT32,
                    ][rng.usize(0..3)],
                )
                .index_data(at(rng))
                .transform_data(match rng.bool() {
                    true => at(rng),
                    false => vk::DeviceOrHostAddressConstKHR { device_address: 0 },
                });
            let data = vk::AccelerationStructureGeometryDataKHR { triangles };
            (vk::GeometryTypeKHR::TRIANGLES, data)
        }
        1 => {
            let aabbs = vk::AccelerationStructureGeometryAabbsDataKHR::default()
                .data(at(rng))
                .stride(modest(rng));
            let data = vk::AccelerationStructureGeometryDataKHR { aabbs };
            (vk::GeometryTypeKHR::AABBS, data)
        }
        _ => {
            let instances = vk::AccelerationStructureGeometryInstancesDataKHR::default()
                .array_of_pointers(rng.bool())
                .data(at(rng));
            let data = vk::AccelerationStructureGeometryDataKHR { instances };
            (vk::GeometryTypeKHR::INSTANCES, data)
        }
    };
    vk::AccelerationStructureGeometryKHR::default()
        .geometry_type(kind)
        .geometry(data)
        .flags(vk::GeometryFlagsKHR::from_raw(rng.u32(0..4)))
}

/// Fills the memory that builds read: numbers of all kinds, some of which are addresses.
pub fn fill(world: &World, rng: &mut Rng) {
    let buffer = world.guarded[0].buffer;
    let words: Vec<u64> = (0..world.guarded[0].size_bytes / 8)
        .map(|_| match rng.u32(0..4) {
            0 => address(world, rng),
            1 => wild(rng),
            _ => u64::from(rng.f32().to_bits()) << 32 | u64::from((-rng.f32()).to_bits()),
        })
        .collect();
    buffer.write(crate::guard::MARGIN as usize, &words);
}

pub fn run(world: &World, case: &Case) {
    let gpu = &world.gpu;
    let mut rng = case.common();
    fill(world, &mut rng);
    for mut rng in case.steps().take(4) {
        let rng = &mut rng;
        let geometry = geometry(world, rng);
        let is_top = geometry.geometry_type == vk::GeometryTypeKHR::INSTANCES;
        let ty = match is_top {
            true => vk::AccelerationStructureTypeKHR::TOP_LEVEL,
            false => vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL,
        };
        let count = rng.u32(0..200);
        let room = gpu.empty_structure(ty, 1 << 18);
        let scratch = gpu.buffer(1 << 18);
        let geometries = [geometry];
        let flags = [0, 1, 4, 8, 16][rng.usize(0..5)];
        let info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
            .ty(ty)
            .flags(vk::BuildAccelerationStructureFlagsKHR::from_raw(flags))
            .mode(vk::BuildAccelerationStructureModeKHR::BUILD)
            .geometries(&geometries)
            .dst_acceleration_structure(room.handle)
            .scratch_data(vk::DeviceOrHostAddressKHR {
                device_address: match rng.u32(0..6) {
                    0 => address(world, rng),
                    // Over what is read, too.
                    1 => world.guarded[0].address(),
                    _ => scratch.address,
                },
            });
        let range = vk::AccelerationStructureBuildRangeInfoKHR {
            primitive_count: count,
            primitive_offset: rng.u32(0..4) / 3 * wild(rng) as u32,
            first_vertex: rng.u32(0..4) / 3 * wild(rng) as u32,
            transform_offset: rng.u32(0..4) / 3 * wild(rng) as u32,
        };
        // SAFETY: the handles live as long as the device; the rest the driver has to bear.
        world.run(|commands| unsafe {
            gpu.acceleration
                .cmd_build_acceleration_structures(commands, &[info], &[&[range]]);
        });
        match is_top {
            true => world.query(room.address, 0),
            false => {
                let above = gpu.top(&[tuff_tests::Instance::of(room)]);
                world.query(above.address, 0);
                gpu.destroy(above);
            }
        }
        gpu.destroy(room);
    }
    // Scratch memory and destinations may have been there: margins count from here on.
    world.guarded[0].renew();
}

/// Updates a level of the scene in place, from triangles or instances that lie in the buffer.
pub fn update_in_place(world: &World, level: usize) {
    let gpu = &world.gpu;
    let at = vk::DeviceOrHostAddressConstKHR {
        device_address: world.guarded[0].address(),
    };
    let triangles = vk::AccelerationStructureGeometryTrianglesDataKHR::default()
        .vertex_format(vk::Format::R32G32B32_SFLOAT)
        .vertex_data(at)
        .vertex_stride(12)
        .max_vertex(179)
        .index_type(vk::IndexType::NONE_KHR);
    let triangles = vk::AccelerationStructureGeometryKHR::default()
        .geometry_type(vk::GeometryTypeKHR::TRIANGLES)
        .geometry(vk::AccelerationStructureGeometryDataKHR { triangles });
    let instances = vk::AccelerationStructureGeometryInstancesDataKHR::default().data(at);
    let instances = vk::AccelerationStructureGeometryKHR::default()
        .geometry_type(vk::GeometryTypeKHR::INSTANCES)
        .geometry(vk::AccelerationStructureGeometryDataKHR { instances });
    let range =
        |count: u32| vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(count);
    let (ty, geometries, ranges) = match level {
        0 => (
            vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL,
            vec![triangles, triangles],
            vec![range(60), range(40)],
        ),
        _ => (
            vk::AccelerationStructureTypeKHR::TOP_LEVEL,
            vec![instances],
            vec![range(8)],
        ),
    };
    let scratch = gpu.buffer(1 << 16);
    let handle = world.levels[level].handle;
    let info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
        .ty(ty)
        .flags(
            vk::BuildAccelerationStructureFlagsKHR::ALLOW_UPDATE
                | vk::BuildAccelerationStructureFlagsKHR::ALLOW_DATA_ACCESS,
        )
        .mode(vk::BuildAccelerationStructureModeKHR::UPDATE)
        .src_acceleration_structure(handle)
        .dst_acceleration_structure(handle)
        .geometries(&geometries)
        .scratch_data(vk::DeviceOrHostAddressKHR {
            device_address: scratch.address,
        });
    // SAFETY: all live as long as the device; what they hold the driver has to bear.
    world.run(|commands| unsafe {
        gpu.acceleration
            .cmd_build_acceleration_structures(commands, &[info], &[&ranges]);
    });
    world.query(world.levels[1].address, 0);
}
