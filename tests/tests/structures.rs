//! Acceleration structures as memory: updates, copies, compaction, serialization.

use tuff_tests::*;
use vk::AccelerationStructureBuildTypeKHR as On;
use vk::AccelerationStructureTypeKHR as Level;
use vk::BuildAccelerationStructureFlagsKHR as Flags;

fn stairs(count: u32, height: impl Fn(u32) -> f32) -> Vec<[f32; 3]> {
    (0..count)
        .flat_map(|i| {
            let (x, z) = (i as f32, height(i));
            [[x, 0.0, z], [x + 1.0, 0.0, z], [x, 1.0, z]]
        })
        .collect()
}

/// Builds, or updates in place, one geometry of 3-float corners.
fn build_or_update(
    gpu: &Gpu,
    corners: Buffer,
    count: u32,
    updated: Option<Structure>,
) -> Structure {
    let data = triangles_at(corners.at(), 3 * count);
    let geometry = [geometry_of(data).flags(vk::GeometryFlagsKHR::OPAQUE)];
    let mut info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
        .ty(Level::BOTTOM_LEVEL)
        .flags(Flags::ALLOW_UPDATE)
        .geometries(&geometry);
    let sizes = gpu.build_sizes(On::DEVICE, &info, &[count]);
    let structure = match updated {
        Some(structure) => {
            info = info
                .mode(vk::BuildAccelerationStructureModeKHR::UPDATE)
                .src_acceleration_structure(structure.handle);
            structure
        }
        None => gpu.empty_structure(Level::BOTTOM_LEVEL, sizes.acceleration_structure_size),
    };
    let scratch = gpu.buffer(sizes.build_scratch_size.max(sizes.update_scratch_size) + 256);
    info.scratch_data.device_address = scratch.address.next_multiple_of(256);
    info = info.dst_acceleration_structure(structure.handle);
    let range = [vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(count)];
    gpu.run(|commands| {
        // SAFETY: the buffers live as long as the device.
        unsafe {
            gpu.acceleration
                .cmd_build_acceleration_structures(commands, &[info], &[&range]);
        }
    });
    structure
}

#[test]
fn updates_follow_moved_vertices() {
    let gpu = Gpu::new();
    let count = 100;
    let corners = gpu.buffer_with(&stairs(count, |i| 1.0 + i as f32));
    let bottom = build_or_update(&gpu, corners, count, None);
    let world = gpu.top(&[Instance::of(bottom)]);
    let first: Vec<f32> = (0..count).map(|i| 1.0 + i as f32).collect();
    assert_eq!(gpu.depths(world, count), first);
    corners.write(0, &stairs(count, |i| 500.0 - 3.0 * i as f32));
    build_or_update(&gpu, corners, count, Some(bottom));
    let world = gpu.top(&[Instance::of(bottom)]);
    let second: Vec<f32> = (0..count).map(|i| 500.0 - 3.0 * i as f32).collect();
    assert_eq!(gpu.depths(world, count), second);
}

fn copy(gpu: &Gpu, from: Structure, to: Structure, mode: vk::CopyAccelerationStructureModeKHR) {
    let info = vk::CopyAccelerationStructureInfoKHR::default()
        .src(from.handle)
        .dst(to.handle)
        .mode(mode);
    gpu.run(|commands| {
        // SAFETY: the structures live as long as the device.
        unsafe {
            gpu.acceleration
                .cmd_copy_acceleration_structure(commands, &info)
        };
    });
}

#[test]
fn clones_and_compacted_copies_are_hit_alike() {
    use vk::CopyAccelerationStructureModeKHR as Mode;
    let gpu = Gpu::new();
    let count = 500;
    let geometry = Geometry::opaque(&stairs(count, |i| 1.0 + (i * 37 % 100) as f32));
    let original = gpu.bottom_with(&[geometry], Flags::ALLOW_COMPACTION);
    let expected: Vec<f32> = (0..count).map(|i| 1.0 + (i * 37 % 100) as f32).collect();

    let clone = gpu.empty_structure(Level::BOTTOM_LEVEL, original.size_bytes);
    copy(&gpu, original, clone, Mode::CLONE);
    let size = gpu.property(
        original,
        vk::QueryType::ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR,
    );
    assert!(size > 0 && size <= original.size_bytes);
    let compacted = gpu.empty_structure(Level::BOTTOM_LEVEL, size);
    copy(&gpu, original, compacted, Mode::COMPACT);
    for structure in [original, clone, compacted] {
        let world = gpu.top(&[Instance::of(structure)]);
        assert_eq!(gpu.depths(world, count), expected);
    }
}

#[test]
fn structures_are_written_out_and_read_back() {
    let gpu = Gpu::new();
    let count = 60;
    let bottom = gpu.bottom(&[Geometry::opaque(&stairs(count, |i| 2.0 + i as f32))]);
    let moved = Instance {
        transform: translated([0.0, 0.0, 5.0]),
        ..Instance::of(bottom)
    };
    let top = gpu.top(&[moved]);
    let write = |structure: Structure| {
        let kind = vk::QueryType::ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR;
        let size = gpu.property(structure, kind);
        let buffer = gpu.buffer(size + 256);
        let info = vk::CopyAccelerationStructureToMemoryInfoKHR::default()
            .src(structure.handle)
            .dst(vk::DeviceOrHostAddressKHR {
                device_address: buffer.address.next_multiple_of(256),
            })
            .mode(vk::CopyAccelerationStructureModeKHR::SERIALIZE);
        gpu.run(|commands| {
            // SAFETY: the buffer is large enough.
            unsafe {
                gpu.acceleration
                    .cmd_copy_acceleration_structure_to_memory(commands, &info)
            };
        });
        let offset = (buffer.address.next_multiple_of(256) - buffer.address) as usize;
        let bytes = buffer.read::<u8>()[offset..][..size as usize].to_vec();
        (buffer, offset, bytes)
    };
    let number =
        |bytes: &[u8], at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    let read = |(buffer, offset, bytes): &(Buffer, usize, Vec<u8>), level: Level| {
        // The header: two UUIDs, the serialized size, the size to be made, and the references.
        assert_eq!(number(bytes, 32), bytes.len() as u64);
        let structure = gpu.empty_structure(level, number(bytes, 40));
        let info = vk::CopyMemoryToAccelerationStructureInfoKHR::default()
            .src(vk::DeviceOrHostAddressConstKHR {
                device_address: buffer.address + *offset as u64,
            })
            .dst(structure.handle)
            .mode(vk::CopyAccelerationStructureModeKHR::DESERIALIZE);
        gpu.run(|commands| {
            // SAFETY: the structure is as large as the header says.
            unsafe {
                gpu.acceleration
                    .cmd_copy_memory_to_acceleration_structure(commands, &info)
            };
        });
        structure
    };
    let written = write(bottom);
    // No references. On devices with `VK_KHR_opacity_micromap` they stand in blocks. The number of
    // blocks is the lower half of this word; its upper half is all ones.
    let blocks = match gpu.optional.micromap_khr.micromap {
        0 => 0,
        _ => u64::from(u32::MAX) << 32,
    };
    assert_eq!(number(&written.2, 48), blocks);
    let mut version = vk::AccelerationStructureVersionInfoKHR::default();
    let data: [u8; 32] = written.2[..32].try_into().unwrap();
    version = version.version_data(&data);
    // SAFETY: the version data is 32 bytes.
    let compatible = unsafe {
        gpu.acceleration
            .get_device_acceleration_structure_compatibility(&version)
    };
    assert_eq!(
        compatible,
        vk::AccelerationStructureCompatibilityKHR::COMPATIBLE
    );
    let new_bottom = read(&written, Level::BOTTOM_LEVEL);

    // The top level refers to the new bottom level once its reference has been replaced.
    let written = write(top);
    assert_eq!(number(&written.2, 48), 1);
    assert_eq!(number(&written.2, 56), bottom.address);
    written.0.write(written.1 + 56, &[new_bottom.address]);
    let new_top = read(&written, Level::TOP_LEVEL);
    let expected: Vec<f32> = (0..count).map(|i| 7.0 + i as f32).collect();
    assert_eq!(gpu.depths(top, count), expected);
    assert_eq!(gpu.depths(new_top, count), expected);
}

#[test]
fn vertex_formats_index_types_offsets_and_transforms() {
    let gpu = Gpu::new();
    use vk::Format as F;
    let half = |x: f32| half::f16::from_f32(x).to_bits();
    let unit = |x: f32| (x * 32767.0) as i16 as u16;
    let words16 = |to: &dyn Fn(f32) -> u16, n: usize| -> Vec<u8> {
        [[0.0f32, 0.0, 0.5], [1.0, 0.0, 0.5], [0.0, 1.0, 0.5]]
            .iter()
            .flat_map(|p| (0..n).map(|k| to(if k < 3 { p[k] } else { 0.0 })))
            .flat_map(u16::to_le_bytes)
            .collect()
    };
    let floats = |n: usize| -> Vec<u8> {
        [[0.0f32, 0.0, 0.5], [1.0, 0.0, 0.5], [0.0, 1.0, 0.5]]
            .iter()
            .flat_map(|p| p[..n].to_vec())
            .flat_map(f32::to_le_bytes)
            .collect()
    };
    // Two-component formats have z = 0; the transform lifts everything by 2.
    for (format, bytes, stride, z) in [
        (F::R32G32B32_SFLOAT, floats(3), 12, 0.5),
        (F::R32G32_SFLOAT, floats(2), 8, 0.0),
        (F::R16G16_SFLOAT, words16(&half, 2), 4, 0.0),
        (F::R16G16B16A16_SFLOAT, words16(&half, 4), 8, 0.5),
        (F::R16G16_SNORM, words16(&unit, 2), 4, 0.0),
        (F::R16G16B16A16_SNORM, words16(&unit, 4), 8, 0.5),
    ] {
        // SAFETY: a plain query.
        let properties = unsafe {
            gpu.instance
                .get_physical_device_format_properties(gpu.physical, format)
        };
        let needed = vk::FormatFeatureFlags::ACCELERATION_STRUCTURE_VERTEX_BUFFER_KHR;
        assert!(properties.buffer_features.contains(needed), "{format:?}");
        for index_type in [
            vk::IndexType::NONE_KHR,
            vk::IndexType::UINT16,
            vk::IndexType::UINT32,
        ] {
            // Five vertices of garbage come first, and are skipped.
            let mut padded = vec![0xff; 5 * stride];
            padded.extend_from_slice(&bytes);
            let vertices = gpu.buffer_with(&padded);
            let transform = gpu.buffer_with(&translated([0.0, 0.0, 2.0]));
            let mut data = vk::AccelerationStructureGeometryTrianglesDataKHR::default()
                .vertex_format(format)
                .vertex_data(vertices.at())
                .vertex_stride(stride as u64)
                .max_vertex(7)
                .index_type(index_type)
                .transform_data(transform.at());
            let mut range =
                vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(1);
            let indices = match index_type {
                vk::IndexType::UINT16 => gpu.buffer_with(&[9u16, 9, 2, 0, 1, 9]),
                _ => gpu.buffer_with(&[9u32, 2, 0, 1]),
            };
            match index_type {
                vk::IndexType::NONE_KHR => {
                    range = range.primitive_offset(5 * stride as u32);
                }
                _ => {
                    data = data.index_data(indices.at());
                    range = range.first_vertex(5).primitive_offset(4);
                }
            }
            let geometry = [geometry_of(data).flags(vk::GeometryFlagsKHR::OPAQUE)];
            let bottom = gpu.build(Level::BOTTOM_LEVEL, &geometry, &[range], Flags::empty());
            let world = gpu.top(&[Instance::of(bottom)]);
            let depth = gpu.depths(world, 1)[0];
            assert!(
                (depth - 2.0 - z).abs() < 1e-4,
                "{format:?} {index_type:?}: {depth}"
            );
        }
    }
}

#[test]
fn instances_are_read_through_pointers() {
    let gpu = Gpu::new();
    let bottom = gpu.bottom(&[Geometry::opaque(&stairs(1, |_| 3.0))]);
    let record = |x: f32| vk::AccelerationStructureInstanceKHR {
        transform: vk::TransformMatrixKHR {
            matrix: translated([x, 0.0, x]),
        },
        instance_custom_index_and_mask: vk::Packed24_8::new(0, 0xff),
        instance_shader_binding_table_record_offset_and_flags: vk::Packed24_8::new(0, 0),
        acceleration_structure_reference: vk::AccelerationStructureReferenceKHR {
            device_handle: bottom.address,
        },
    };
    let records = [record(2.0), record(0.0), record(1.0)];
    // SAFETY: the records are plain data of 64 bytes without padding.
    let bytes =
        unsafe { std::slice::from_raw_parts(records.as_ptr().cast::<u8>(), size_of_val(&records)) };
    let stored = gpu.buffer_with(bytes);
    let pointers = gpu.buffer_with(&[stored.address + 128, stored.address, stored.address + 64]);
    let data = vk::AccelerationStructureGeometryInstancesDataKHR::default()
        .array_of_pointers(true)
        .data(pointers.at());
    let geometry = [vk::AccelerationStructureGeometryKHR::default()
        .geometry_type(vk::GeometryTypeKHR::INSTANCES)
        .geometry(vk::AccelerationStructureGeometryDataKHR { instances: data })];
    let mut info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
        .ty(Level::TOP_LEVEL)
        .geometries(&geometry);
    let sizes = gpu.build_sizes(On::DEVICE, &info, &[3]);
    let world = gpu.empty_structure(Level::TOP_LEVEL, sizes.acceleration_structure_size);
    let scratch = gpu.buffer(sizes.build_scratch_size + 256);
    info.scratch_data.device_address = scratch.address.next_multiple_of(256);
    info = info.dst_acceleration_structure(world.handle);
    let range = [vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(3)];
    gpu.run(|commands| {
        // SAFETY: the buffers live as long as the device.
        unsafe {
            gpu.acceleration
                .cmd_build_acceleration_structures(commands, &[info], &[&range]);
        }
    });
    assert_eq!(gpu.depths(world, 4), [3.0, 4.0, 5.0, -1.0]);
}
