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
pub fn motley(gpu: &Gpu, form: MicromapForm) -> (Micromap, Vec<u32>) {
    let state = |part: u32| (part.wrapping_mul(7) >> 1) as u8 & 3;
    let micromap = gpu.micromap_in(form, &[MicroTriangle::of(2, FOUR_STATES, state)]);
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
    in_each_form(|gpu, form| {
        let (original, expected) = motley(gpu, form);
        let [compacted_size, _] = gpu.micromap_sizes(&original);
        assert!(compacted_size > 0 && compacted_size <= original.size_bytes);
        for (compact, size) in [(false, original.size_bytes), (true, compacted_size)] {
            let copy = gpu.room_for_copy(&original, size);
            gpu.run(|commands| gpu.record_micromap_copy(commands, &original, &copy, compact));
            assert_eq!(found_with(gpu, &copy), expected, "{form:?} {compact}");
        }
    });
}

#[test]
fn serialized_micromaps_come_back() {
    in_each_form(|gpu, form| {
        let (original, expected) = motley(gpu, form);
        let [_, size] = gpu.micromap_sizes(&original);
        let buffer = gpu.buffer(size + 256);
        let aligned = buffer.address.next_multiple_of(256);
        let copy = gpu.room_for_copy(&original, original.size_bytes);
        gpu.run(|commands| {
            gpu.record_micromap_out(commands, &original, aligned);
            gpu.barrier(commands);
            gpu.record_micromap_in(commands, aligned, &copy);
        });
        assert_eq!(found_with(gpu, &copy), expected);

        let bytes: Vec<u8> = buffer.read();
        let start = (aligned - buffer.address) as usize;
        let head: [u8; 32] = bytes[start..start + 32].try_into().expect("32 bytes");
        assert!(is_compatible(gpu, form, head));
        assert!(!is_compatible(gpu, form, {
            let mut other = head;
            other[20] ^= 0x80;
            other
        }));
    });
}

/// Whether the device says that it can deserialize data with this head.
fn is_compatible(gpu: &Gpu, form: MicromapForm, head: [u8; 32]) -> bool {
    let mut found = vk::AccelerationStructureCompatibilityKHR::INCOMPATIBLE;
    let device = gpu.device.handle();
    // SAFETY: the infos outlive the calls.
    unsafe {
        match form {
            MicromapForm::Ext => {
                let info = vk::MicromapVersionInfoEXT::default().version_data(&head);
                let ask = gpu.micromaps.fp().get_device_micromap_compatibility_ext;
                ask(device, &info, &mut found);
            }
            MicromapForm::Khr => {
                let info = vk::AccelerationStructureVersionInfoKHR::default().version_data(&head);
                let fp = gpu.acceleration.fp();
                let ask = fp.get_device_acceleration_structure_compatibility_khr;
                ask(device, &info, &mut found);
            }
        }
    }
    found == vk::AccelerationStructureCompatibilityKHR::COMPATIBLE
}

#[test]
fn the_host_does_the_same() {
    let Some(gpu) = gpu_with_micromaps() else {
        return;
    };
    if gpu.optional.micromap.micromap_host_commands == 0 {
        return;
    }
    let (original, expected) = motley(&gpu, MicromapForm::Ext);
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
    let (micromap, expected) = motley(&gpu, MicromapForm::Ext);
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
        // SAFETY: all of it lives as long as the device.
        unsafe {
            gpu.acceleration
                .cmd_copy_memory_to_acceleration_structure(commands, &back);
        }
    });
    let world = gpu.top(&[Instance::of(copy)]);
    assert_eq!(shoot(&gpu, world, &part_centres(2), 0), expected);
}
