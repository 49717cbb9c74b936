//! Broken rules of builds: on the host, of round primitives, of micromaps. Reported by their names,
//! and survived.

use tuff_tests::*;
use vk::AccelerationStructureTypeKHR as Level;

const TRIANGLE: [[f32; 3]; 3] = [[-1.0, -1.0, 2.0], [1.0, -1.0, 2.0], [0.0, 1.0, 2.0]];

fn host<T>(items: &[T]) -> vk::DeviceOrHostAddressConstKHR {
    vk::DeviceOrHostAddressConstKHR {
        host_address: items.as_ptr().cast(),
    }
}

/// Builds on the host from one geometry.
fn build_on_host(
    gpu: &Gpu,
    level: Level,
    geometry: &vk::AccelerationStructureGeometryKHR,
    count: u32,
) -> Structure {
    let geometries = std::slice::from_ref(geometry);
    let mut info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
        .ty(level)
        .geometries(geometries);
    let range = vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(count);
    // SAFETY: the driver promises to survive what is wrong here; the memory outlives the calls.
    unsafe {
        let on_host = vk::AccelerationStructureBuildTypeKHR::HOST;
        let sizes = gpu.build_sizes(on_host, &info, &[count]);
        let structure = gpu.empty_structure(level, sizes.acceleration_structure_size);
        let mut scratch = vec![0u8; sizes.build_scratch_size as usize];
        info = info.dst_acceleration_structure(structure.handle);
        info.scratch_data.host_address = scratch.as_mut_ptr().cast();
        let operation = vk::DeferredOperationKHR::null();
        gpu.acceleration
            .build_acceleration_structures(operation, &[info], &[&[range]])
            .expect("vkBuildAccelerationStructuresKHR");
        structure
    }
}

/// One indexed triangle with a transform.
fn triangle_on_host(gpu: &Gpu, indices: [u32; 3], transform: [f32; 12]) -> Structure {
    let triangles = triangles_at(host(&TRIANGLE), 3)
        .index_type(vk::IndexType::UINT32)
        .index_data(host(&indices))
        .transform_data(host(&transform));
    build_on_host(gpu, Level::BOTTOM_LEVEL, &geometry_of(triangles), 1)
}

/// One instance of what a reference names.
fn instance_on_host(gpu: &Gpu, reference: u64) -> Structure {
    let record = [vk::AccelerationStructureInstanceKHR {
        transform: vk::TransformMatrixKHR { matrix: identity() },
        instance_custom_index_and_mask: vk::Packed24_8::new(0, 0xff),
        instance_shader_binding_table_record_offset_and_flags: vk::Packed24_8::new(0, 0),
        acceleration_structure_reference: vk::AccelerationStructureReferenceKHR {
            device_handle: reference,
        },
    }];
    let instances =
        vk::AccelerationStructureGeometryInstancesDataKHR::default().data(host(&record));
    let geometry = vk::AccelerationStructureGeometryKHR::default()
        .geometry_type(vk::GeometryTypeKHR::INSTANCES)
        .geometry(vk::AccelerationStructureGeometryDataKHR { instances });
    build_on_host(gpu, Level::TOP_LEVEL, &geometry, 1)
}

fn raw(structure: Structure) -> u64 {
    vk::Handle::as_raw(structure.handle)
}

/// A scene of round primitives with these numbers of ends.
fn swept(gpu: &Gpu, sweep: Sweep, indices: &[u32]) -> Structure {
    gpu.scene(&[Geometry::Swept {
        ends: vec![[0.25, 0.25, 4.0, 1.0], [0.25, 0.25, 9.0, 1.0]],
        indices: indices.to_vec(),
        sweep,
        flags: vk::GeometryFlagsKHR::OPAQUE,
    }])
}

/// Four triangles of a micromap, whose records and usages a check spoils.
fn micromap(gpu: &Gpu, spoil: impl FnOnce(&mut MicromapParts)) -> vk::MicromapEXT {
    let triangles = [0, 1, 2, 3].map(|level| MicroTriangle::of(level, 1, |part| (part % 2) as u8));
    let mut parts = gpu.micromap_parts(&triangles);
    spoil(&mut parts);
    let mut info = parts.build_info();
    let handle = gpu.empty_micromap(4096);
    info.dst_micromap = handle;
    info.scratch_data.device_address = gpu.buffer(4096).address.next_multiple_of(256);
    gpu.run(|commands| {
        // SAFETY: the driver promises to survive this.
        unsafe { (gpu.micromaps.fp().cmd_build_micromaps_ext)(commands, 1, &info) };
    });
    handle
}

/// A triangle with the micromap's triangle of this number.
fn triangle_with_micromap(gpu: &Gpu, micromap: vk::MicromapEXT, number: u32) -> Structure {
    let chained = vk::AccelerationStructureTrianglesOpacityMicromapEXT::default()
        .index_type(vk::IndexType::NONE_KHR)
        .base_triangle(number)
        .micromap(micromap);
    let mut triangles = triangles_at(gpu.buffer_with(&TRIANGLE).at(), 3);
    triangles.p_next = (&raw const chained).cast();
    let range = vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(1);
    let flags = vk::BuildAccelerationStructureFlagsKHR::empty();
    gpu.build(
        Level::BOTTOM_LEVEL,
        &[geometry_of(triangles)],
        &[range],
        flags,
    )
}

/// Each check breaks one rule, whose name is on the left; what it asserts holds with validation and
/// without.
const CHECKS: &[(&str, Misuse)] = &[
    (
        "VUID-VkAccelerationStructureBuildRangeInfoKHR-maxVertex-10774",
        |gpu| {
            let bottom = triangle_on_host(gpu, [0, 1, 3], identity());
            let world = gpu.top(&[Instance::of(bottom)]);
            gpu.depths(world, 2);
        },
    ),
    ("TUFF-build-transform", |gpu| {
        let mut transform = identity();
        transform[3] = f32::NAN;
        let bottom = triangle_on_host(gpu, [0, 1, 2], transform);
        let world = gpu.top(&[Instance::of(bottom)]);
        assert_eq!(gpu.depths(world, 1), [-1.0]);
    }),
    ("TUFF-build-input", |gpu| {
        // Nothing is mapped at the lowest addresses.
        let boxes = vk::AccelerationStructureGeometryAabbsDataKHR::default()
            .data(vk::DeviceOrHostAddressConstKHR { device_address: 8 })
            .stride(24);
        let geometry = vk::AccelerationStructureGeometryKHR::default()
            .geometry_type(vk::GeometryTypeKHR::AABBS)
            .geometry(vk::AccelerationStructureGeometryDataKHR { aabbs: boxes });
        let bottom = build_on_host(gpu, Level::BOTTOM_LEVEL, &geometry, 3);
        let world = gpu.top(&[Instance::of(bottom)]);
        assert_eq!(gpu.depths(world, 1), [-1.0]);
    }),
    ("TUFF-build-input", |gpu| {
        for sweep in [
            Sweep::Spheres,
            Sweep::Pairs { caps: true },
            Sweep::Successive { caps: true },
        ] {
            let world = swept(gpu, sweep, &[0, u32::MAX - 7]);
            gpu.depths(world, 2);
        }
    }),
    ("VUID-VkMicromapBuildInfoEXT-format-11657", |gpu| {
        micromap(gpu, |parts| parts.triangles.write(0, &[0u32, 7 << 16]));
    }),
    (
        "VUID-VkMicromapBuildInfoEXT-subdivisionLevel-11659",
        |gpu| {
            micromap(gpu, |parts| {
                parts.triangles.write(8, &[0u32, 16 | 1 << 16]);
            });
        },
    ),
    (
        "VUID-VkMicromapBuildInfoEXT-subdivisionLevel-11660",
        |gpu| {
            micromap(gpu, |parts| {
                parts.triangles.write(8, &[0u32, 0xffff | 2 << 16]);
            });
        },
    ),
    ("TUFF-micromap-usage", |gpu| {
        micromap(gpu, |parts| parts.usages[3].count = 9);
        micromap(gpu, |parts| parts.usages[3].subdivision_level = 2);
    }),
    ("TUFF-build-input", |gpu| {
        micromap(gpu, |parts| {
            parts.triangles.write(24, &[u32::MAX - 3, 3 | 1 << 16]);
        });
        micromap(gpu, |parts| parts.triangles.address = 1 << 45);
        micromap(gpu, |parts| parts.data.address = 64);
    }),
    ("TUFF-micromap-index", |gpu| {
        let map = micromap(gpu, |_| {});
        let bottom = triangle_with_micromap(gpu, map, 4);
        let world = gpu.top(&[Instance::of(bottom)]);
        gpu.depths(world, 1);
    }),
];

const NEEDS: &str = "builds of all kinds, on the host, too";

fn has_all(gpu: &Gpu) -> bool {
    let swept = gpu.optional.swept_spheres;
    gpu.has_host_commands
        && gpu.optional.micromap.micromap * swept.spheres * swept.linear_swept_spheres == vk::TRUE
}

/// Builds do what they should, after all that.
fn still_works(gpu: &Gpu) {
    let bottom = triangle_on_host(gpu, [0, 1, 2], translated([0.0, 0.0, 1.0]));
    let world = gpu.top(&[Instance::of(bottom)]);
    assert_eq!(gpu.depths(world, 2), [3.0, -1.0]);
    let world = instance_on_host(gpu, raw(bottom));
    assert_eq!(gpu.depths(world, 1), [3.0]);
    let world = swept(gpu, Sweep::Spheres, &[]);
    assert_eq!(gpu.depths(world, 1), [3.0]);
    let map = micromap(gpu, |_| {});
    triangle_with_micromap(gpu, map, 3);
}

#[test]
fn misuse_is_survived() {
    let gpu = Gpu::surviving().and_then(|gpu| gpu.with(NEEDS, has_all));
    let Some(gpu) = gpu else { return };
    gpu.assert_survived(CHECKS);
    still_works(&gpu);
}

#[test]
fn misuse_is_reported_by_its_name() {
    let gpu = Gpu::reporting().and_then(|gpu| gpu.with(NEEDS, has_all));
    let Some(gpu) = gpu else { return };
    still_works(&gpu);
    gpu.assert_silent();
    gpu.assert_reported(CHECKS);
    // Handles of nothing: only validation knows what there is.
    let gone = triangle_on_host(&gpu, [0, 1, 2], identity());
    // The next structure may be given the memory, and so the handle, of the one that was destroyed
    // last: that is another one.
    let last = triangle_on_host(&gpu, [0, 1, 2], identity());
    gpu.destroy(gone);
    gpu.destroy(last);
    for reference in [raw(gone), 0x1230, gone.address] {
        let world = instance_on_host(&gpu, reference);
        let said = gpu.take_complaints();
        let name = "TUFF-build-reference";
        assert!(
            said.len() == 1 && said[0].starts_with(name),
            "{reference:#x}: {said:#?}"
        );
        assert_eq!(gpu.depths(world, 1), [-1.0]);
    }
    still_works(&gpu);
    gpu.assert_silent();
}
