//! Copies, serialized ones, and builds on the host.

use super::*;

fn micromap_property(gpu: &Gpu, micromap: vk::MicromapEXT, ty: vk::QueryType) -> u64 {
    gpu.query(ty, |commands, pool| {
        // SAFETY: the micromap is built, and the query reset.
        unsafe {
            (gpu.micromaps.fp().cmd_write_micromaps_properties_ext)(
                commands, 1, &micromap, ty, pool, 0,
            );
        }
    })
}

/// A micromap of one triangle with states of all kinds, and what rays at its parts' middles find.
fn motley(gpu: &Gpu) -> (Micromap, Vec<u32>) {
    let state = |part: u32| (part.wrapping_mul(7) >> 1) as u8 & 3;
    let micromap = gpu.micromap(&[MicroTriangle::of(2, FOUR_STATES, state)]);
    (micromap, (0..16).map(|part| outcome(state(part))).collect())
}

/// The results of rays if a structure uses this micromap.
fn found_with(gpu: &Gpu, micromap: &Micromap) -> Vec<u32> {
    let bottom = bottom(gpu, 1, &Use::of(micromap), Flags::empty());
    let world = gpu.top(&[Instance::of(bottom)]);
    shoot(gpu, world, &part_centres(2), 0)
}

#[test]
fn copies_are_as_good() {
    let Some(gpu) = gpu_with_micromaps() else {
        return;
    };
    let (original, expected) = motley(&gpu);
    let compacted_size = micromap_property(
        &gpu,
        original.handle,
        vk::QueryType::MICROMAP_COMPACTED_SIZE_EXT,
    );
    assert!(compacted_size > 0 && compacted_size <= original.size_bytes);
    for (mode, size) in [
        (vk::CopyMicromapModeEXT::CLONE, original.size_bytes),
        (vk::CopyMicromapModeEXT::COMPACT, compacted_size),
    ] {
        let copy = Micromap {
            handle: gpu.empty_micromap(size),
            ..original.clone()
        };
        let info = vk::CopyMicromapInfoEXT::default()
            .src(original.handle)
            .dst(copy.handle)
            .mode(mode);
        gpu.run(|commands| {
            // SAFETY: both live as long as the device.
            unsafe { (gpu.micromaps.fp().cmd_copy_micromap_ext)(commands, &info) };
        });
        assert_eq!(found_with(&gpu, &copy), expected, "{mode:?}");
    }
}

#[test]
fn serialized_micromaps_come_back() {
    let Some(gpu) = gpu_with_micromaps() else {
        return;
    };
    let (original, expected) = motley(&gpu);
    let ty = vk::QueryType::MICROMAP_SERIALIZATION_SIZE_EXT;
    let size = micromap_property(&gpu, original.handle, ty);
    let buffer = gpu.buffer(size + 256);
    let aligned = buffer.address.next_multiple_of(256);
    let copy = Micromap {
        handle: gpu.empty_micromap(original.size_bytes),
        ..original.clone()
    };
    let out = vk::CopyMicromapToMemoryInfoEXT::default()
        .src(original.handle)
        .dst(vk::DeviceOrHostAddressKHR {
            device_address: aligned,
        })
        .mode(vk::CopyMicromapModeEXT::SERIALIZE);
    let back = vk::CopyMemoryToMicromapInfoEXT::default()
        .src(vk::DeviceOrHostAddressConstKHR {
            device_address: aligned,
        })
        .dst(copy.handle)
        .mode(vk::CopyMicromapModeEXT::DESERIALIZE);
    gpu.run(|commands| {
        // SAFETY: all of it lives as long as the device.
        unsafe { (gpu.micromaps.fp().cmd_copy_micromap_to_memory_ext)(commands, &out) };
        gpu.barrier(commands);
        // SAFETY: as above.
        unsafe { (gpu.micromaps.fp().cmd_copy_memory_to_micromap_ext)(commands, &back) };
    });
    assert_eq!(found_with(&gpu, &copy), expected);

    let bytes: Vec<u8> = buffer.read();
    let start = (aligned - buffer.address) as usize;
    let mut head: [u8; 32] = bytes[start..start + 32].try_into().expect("32 bytes");
    let mut is_compatible = |change: u8| {
        head[20] ^= change;
        let info = vk::MicromapVersionInfoEXT::default().version_data(&head);
        let mut found = vk::AccelerationStructureCompatibilityKHR::INCOMPATIBLE;
        // SAFETY: the info outlives the call.
        unsafe {
            (gpu.micromaps.fp().get_device_micromap_compatibility_ext)(
                gpu.device.handle(),
                &info,
                &mut found,
            );
        }
        found == vk::AccelerationStructureCompatibilityKHR::COMPATIBLE
    };
    assert!(is_compatible(0));
    assert!(!is_compatible(0x80));
}

#[test]
fn the_host_does_the_same() {
    let Some(gpu) = gpu_with_micromaps() else {
        return;
    };
    if gpu.optional.micromap.micromap_host_commands == 0 {
        return;
    }
    let (original, expected) = motley(&gpu);
    let device = gpu.device.handle();
    let none = vk::DeferredOperationKHR::null();
    let micromaps = gpu.micromaps.fp();

    // Built from the host's own memory; the states are those of the original.
    let state = |part: u32| (part.wrapping_mul(7) >> 1) as u8 & 3;
    let states: Vec<u8> = (0..4)
        .map(|byte| (0..4).fold(0, |sum, i| sum | state(4 * byte + i) << (2 * i)))
        .collect();
    let triangle = [0u32, 2 | u32::from(FOUR_STATES) << 16];
    let built = Micromap {
        handle: gpu.empty_micromap(original.size_bytes),
        ..original.clone()
    };
    let mut scratch = vec![0u64; 4096];
    let info = vk::MicromapBuildInfoEXT::default()
        .ty(vk::MicromapTypeEXT::OPACITY_MICROMAP)
        .mode(vk::BuildMicromapModeEXT::BUILD)
        .dst_micromap(built.handle)
        .usage_counts(&original.usages)
        .data(vk::DeviceOrHostAddressConstKHR {
            host_address: states.as_ptr().cast(),
        })
        .triangle_array(vk::DeviceOrHostAddressConstKHR {
            host_address: triangle.as_ptr().cast(),
        })
        .scratch_data(vk::DeviceOrHostAddressKHR {
            host_address: scratch.as_mut_ptr().cast(),
        })
        .triangle_array_stride(8);
    // SAFETY: all that the info refers to outlives the call.
    let done = unsafe { (micromaps.build_micromaps_ext)(device, none, 1, &info) };
    assert_eq!(done, vk::Result::SUCCESS);
    assert_eq!(found_with(&gpu, &built), expected);

    let mut sizes = [0u64; 2];
    for (size, ty) in sizes.iter_mut().zip([
        vk::QueryType::MICROMAP_SERIALIZATION_SIZE_EXT,
        vk::QueryType::MICROMAP_COMPACTED_SIZE_EXT,
    ]) {
        let out = std::ptr::from_mut(size).cast();
        // SAFETY: eight bytes may be written.
        let done = unsafe {
            (micromaps.write_micromaps_properties_ext)(device, 1, &original.handle, ty, 8, out, 8)
        };
        assert_eq!(done, vk::Result::SUCCESS);
        assert_eq!(*size, micromap_property(&gpu, original.handle, ty));
    }

    let copy = Micromap {
        handle: gpu.empty_micromap(sizes[1]),
        ..original.clone()
    };
    let info = vk::CopyMicromapInfoEXT::default()
        .src(built.handle)
        .dst(copy.handle)
        .mode(vk::CopyMicromapModeEXT::CLONE);
    // SAFETY: both are built or large enough.
    let done = unsafe { (micromaps.copy_micromap_ext)(device, none, &info) };
    assert_eq!(done, vk::Result::SUCCESS);

    let mut memory = vec![0u128; sizes[0].div_ceil(16) as usize];
    let out = vk::CopyMicromapToMemoryInfoEXT::default()
        .src(copy.handle)
        .dst(vk::DeviceOrHostAddressKHR {
            host_address: memory.as_mut_ptr().cast(),
        })
        .mode(vk::CopyMicromapModeEXT::SERIALIZE);
    let last = Micromap {
        handle: gpu.empty_micromap(original.size_bytes),
        ..original.clone()
    };
    let back = vk::CopyMemoryToMicromapInfoEXT::default()
        .src(vk::DeviceOrHostAddressConstKHR {
            host_address: memory.as_ptr().cast(),
        })
        .dst(last.handle)
        .mode(vk::CopyMicromapModeEXT::DESERIALIZE);
    // SAFETY: the memory is as long as was asked, and outlives the calls.
    unsafe {
        let done = (micromaps.copy_micromap_to_memory_ext)(device, none, &out);
        assert_eq!(done, vk::Result::SUCCESS);
        let done = (micromaps.copy_memory_to_micromap_ext)(device, none, &back);
        assert_eq!(done, vk::Result::SUCCESS);
    }
    assert_eq!(found_with(&gpu, &last), expected);
}

#[test]
fn structures_with_micromaps_are_copied_and_serialized() {
    let Some(gpu) = gpu_with_micromaps() else {
        return;
    };
    let (micromap, expected) = motley(&gpu);
    let original = bottom(&gpu, 1, &Use::of(&micromap), Flags::ALLOW_COMPACTION);
    let property = |ty| {
        gpu.query(ty, |commands, pool| {
            // SAFETY: the structure is built, and the query reset.
            unsafe {
                gpu.acceleration
                    .cmd_write_acceleration_structures_properties(
                        commands,
                        &[original.handle],
                        ty,
                        pool,
                        0,
                    );
            }
        })
    };
    let compacted_size = property(vk::QueryType::ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR);
    let compacted = gpu.empty_structure(Level::BOTTOM_LEVEL, compacted_size);
    let info = vk::CopyAccelerationStructureInfoKHR::default()
        .src(original.handle)
        .dst(compacted.handle)
        .mode(vk::CopyAccelerationStructureModeKHR::COMPACT);
    gpu.run(|commands| {
        // SAFETY: both live as long as the device.
        unsafe {
            gpu.acceleration
                .cmd_copy_acceleration_structure(commands, &info);
        }
    });
    let world = gpu.top(&[Instance::of(compacted)]);
    assert_eq!(shoot(&gpu, world, &part_centres(2), 0), expected);

    let size = property(vk::QueryType::ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR);
    let buffer = gpu.buffer(size + 256);
    let aligned = buffer.address.next_multiple_of(256);
    let out = vk::CopyAccelerationStructureToMemoryInfoKHR::default()
        .src(original.handle)
        .dst(vk::DeviceOrHostAddressKHR {
            device_address: aligned,
        })
        .mode(vk::CopyAccelerationStructureModeKHR::SERIALIZE);
    gpu.run(|commands| {
        // SAFETY: all of it lives as long as the device.
        unsafe {
            gpu.acceleration
                .cmd_copy_acceleration_structure_to_memory(commands, &out);
        }
    });
    let bytes: Vec<u8> = buffer.read();
    let word = (aligned - buffer.address) as usize + 40;
    let deserialized_size = u64::from_le_bytes(bytes[word..word + 8].try_into().expect("a word"));
    let copy = gpu.empty_structure(Level::BOTTOM_LEVEL, deserialized_size);
    let back = vk::CopyMemoryToAccelerationStructureInfoKHR::default()
        .src(vk::DeviceOrHostAddressConstKHR {
            device_address: aligned,
        })
        .dst(copy.handle)
        .mode(vk::CopyAccelerationStructureModeKHR::DESERIALIZE);
    gpu.run(|commands| {
        // SAFETY: as above.
        unsafe {
            gpu.acceleration
                .cmd_copy_memory_to_acceleration_structure(commands, &back);
        }
    });
    let world = gpu.top(&[Instance::of(copy)]);
    assert_eq!(shoot(&gpu, world, &part_centres(2), 0), expected);
}
