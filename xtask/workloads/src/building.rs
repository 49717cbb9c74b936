//! Workloads that build: a structure made anew, and one updated.

use tuff_tests::{Buffer, Gpu, Structure, vk};

use crate::scene::{self, Mesh};
use crate::workload::{Prepared, look};
use crate::world::{Scale, World};

/// A mesh on the device and room to build its structure in.
struct Site {
    mesh: Mesh,
    corners: Buffer,
    indices: Buffer,
    scratch_address: u64,
    structure: Structure,
    flags: vk::BuildAccelerationStructureFlagsKHR,
}

pub fn build(gpu: &Gpu, scale: &Scale) -> Prepared {
    let flags = vk::BuildAccelerationStructureFlagsKHR::PREFER_FAST_TRACE;
    let site = Site::new(gpu, scene::hills(scale.triangles), flags);
    let turn = gpu.record(|commands| {
        site.record(gpu, commands, vk::BuildAccelerationStructureModeKHR::BUILD);
    });
    gpu.submit(turn).expect("the build runs");
    site.prepared(gpu, scale, turn)
}

pub fn refit(gpu: &Gpu, scale: &Scale) -> Prepared {
    let flags = vk::BuildAccelerationStructureFlagsKHR::ALLOW_UPDATE
        | vk::BuildAccelerationStructureFlagsKHR::PREFER_FAST_TRACE;
    let site = Site::new(gpu, scene::hills(scale.triangles), flags);
    gpu.run(|commands| {
        site.record(gpu, commands, vk::BuildAccelerationStructureModeKHR::BUILD);
    });
    let moved: Vec<[f32; 3]> = site
        .mesh
        .corners
        .iter()
        .map(|&[x, y, z]| [x, y + 0.3 * libm::sinf(0.5 * x), z])
        .collect();
    site.corners.write(0, &moved);
    let turn = gpu.record(|commands| {
        site.record(gpu, commands, vk::BuildAccelerationStructureModeKHR::UPDATE);
    });
    gpu.submit(turn).expect("the update runs");
    let site = Site {
        mesh: Mesh {
            corners: moved,
            ..site.mesh
        },
        ..site
    };
    site.prepared(gpu, scale, turn)
}

impl Site {
    fn new(gpu: &Gpu, mesh: Mesh, flags: vk::BuildAccelerationStructureFlagsKHR) -> Site {
        let mut site = Site {
            corners: gpu.buffer_with(&mesh.corners),
            indices: gpu.buffer_with(&mesh.indices),
            mesh,
            scratch_address: 0,
            structure: Structure {
                handle: vk::AccelerationStructureKHR::null(),
                address: 0,
                size_bytes: 0,
                storage: None,
            },
            flags,
        };
        let mut sizes = vk::AccelerationStructureBuildSizesInfoKHR::default();
        let geometries = [site.geometry()];
        let info = site.info(&geometries, vk::BuildAccelerationStructureModeKHR::BUILD);
        // SAFETY: there is one count for the one geometry.
        unsafe {
            gpu.acceleration.get_acceleration_structure_build_sizes(
                vk::AccelerationStructureBuildTypeKHR::DEVICE,
                &info,
                &[site.mesh.triangle_count() as u32],
                &mut sizes,
            );
        }
        let alignment = u64::from(
            gpu.structure_properties
                .min_acceleration_structure_scratch_offset_alignment,
        );
        let scratch = sizes.build_scratch_size.max(sizes.update_scratch_size);
        let scratch = gpu.buffer(scratch + alignment);
        site.scratch_address = scratch.address.next_multiple_of(alignment);
        site.structure = gpu.empty_structure(
            vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL,
            sizes.acceleration_structure_size,
        );
        site
    }

    fn geometry(&self) -> vk::AccelerationStructureGeometryKHR<'static> {
        let triangles = vk::AccelerationStructureGeometryTrianglesDataKHR::default()
            .vertex_format(vk::Format::R32G32B32_SFLOAT)
            .vertex_data(at(self.corners))
            .vertex_stride(12)
            .max_vertex(self.mesh.corners.len() as u32 - 1)
            .index_type(vk::IndexType::UINT32)
            .index_data(at(self.indices));
        vk::AccelerationStructureGeometryKHR::default()
            .geometry_type(vk::GeometryTypeKHR::TRIANGLES)
            .geometry(vk::AccelerationStructureGeometryDataKHR { triangles })
            .flags(vk::GeometryFlagsKHR::OPAQUE)
    }

    fn info<'g>(
        &self,
        geometries: &'g [vk::AccelerationStructureGeometryKHR<'static>],
        mode: vk::BuildAccelerationStructureModeKHR,
    ) -> vk::AccelerationStructureBuildGeometryInfoKHR<'g> {
        let mut info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
            .ty(vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL)
            .flags(self.flags)
            .mode(mode)
            .dst_acceleration_structure(self.structure.handle)
            .geometries(geometries);
        if mode == vk::BuildAccelerationStructureModeKHR::UPDATE {
            info = info.src_acceleration_structure(self.structure.handle);
        }
        info.scratch_data.device_address = self.scratch_address;
        info
    }

    fn record(
        &self,
        gpu: &Gpu,
        commands: vk::CommandBuffer,
        mode: vk::BuildAccelerationStructureModeKHR,
    ) {
        let geometries = [self.geometry()];
        let info = self.info(&geometries, mode);
        let range = vk::AccelerationStructureBuildRangeInfoKHR::default()
            .primitive_count(self.mesh.triangle_count() as u32);
        // SAFETY: every buffer that the info refers to lives as long as the device.
        unsafe {
            gpu.acceleration
                .cmd_build_acceleration_structures(commands, &[info], &[&[range]]);
        }
        gpu.barrier(commands);
    }

    fn prepared(self, gpu: &Gpu, scale: &Scale, turn: vk::CommandBuffer) -> Prepared {
        let world = World::of_mesh(gpu, scale, &self.mesh, self.structure);
        Prepared {
            work: Some(self.mesh.triangle_count() as f64),
            look: Some(look(gpu, scale, &world)),
            ..Prepared::picture(turn, &world)
        }
    }
}

fn at(buffer: Buffer) -> vk::DeviceOrHostAddressConstKHR {
    vk::DeviceOrHostAddressConstKHR {
        device_address: buffer.address,
    }
}
