//! Instances, devices and what they say of themselves; memory and its limits.

use std::ffi::CStr;

use tuff_tests::*;

#[test]
fn the_device_describes_itself() {
    let gpu = Gpu::new();
    // SAFETY: plain queries of this instance's device; the chains outlive the calls.
    unsafe {
        let mut driver = vk::PhysicalDeviceDriverProperties::default();
        let mut id = vk::PhysicalDeviceIDProperties::default();
        let mut p11 = vk::PhysicalDeviceVulkan11Properties::default();
        let mut p12 = vk::PhysicalDeviceVulkan12Properties::default();
        let mut p13 = vk::PhysicalDeviceVulkan13Properties::default();
        let mut structures = vk::PhysicalDeviceAccelerationStructurePropertiesKHR::default();
        let mut pipelines = vk::PhysicalDeviceRayTracingPipelinePropertiesKHR::default();
        let mut all = vk::PhysicalDeviceProperties2::default()
            .push_next(&mut driver)
            .push_next(&mut id)
            .push_next(&mut p11)
            .push_next(&mut p12)
            .push_next(&mut p13)
            .push_next(&mut structures)
            .push_next(&mut pipelines);
        gpu.instance
            .get_physical_device_properties2(gpu.physical, &mut all);
        let properties = all.properties;
        let plain = gpu.instance.get_physical_device_properties(gpu.physical);
        assert_eq!(plain.device_name, properties.device_name);
        assert_eq!(plain.vendor_id, properties.vendor_id);
        assert!(properties.api_version >= vk::API_VERSION_1_3);
        assert_eq!(id.device_uuid, p11.device_uuid);
        assert_ne!(id.device_uuid, [0; 16]);
        assert_eq!(driver.driver_id, p12.driver_id);
        assert!(!driver.driver_name_as_c_str().unwrap().is_empty());
        let limits = &properties.limits;
        // The required minima of "Limits".
        assert!(limits.max_image_dimension2_d >= 4096);
        assert!(limits.max_storage_buffer_range >= 1 << 27);
        assert!(limits.max_push_constants_size >= 128);
        assert!(limits.max_compute_work_group_invocations >= 128);
        assert!(limits.max_compute_shared_memory_size >= 16384);
        assert!(limits.max_bound_descriptor_sets >= 4);
        assert!(limits.min_memory_map_alignment >= 64);
        assert!(limits.non_coherent_atom_size.is_power_of_two());
        assert!(p11.subgroup_size.is_power_of_two());
        assert!(p13.min_subgroup_size <= p13.max_subgroup_size);
        assert_eq!(pipelines.shader_group_handle_size, 32);
        assert!(pipelines.max_ray_recursion_depth >= 1);
        assert!(pipelines.max_ray_hit_attribute_size >= 32);
        assert!(pipelines.shader_group_base_alignment.is_power_of_two());
        assert!(structures.max_instance_count >= (1 << 24) - 1);
        assert!(structures.max_primitive_count >= (1 << 29) - 1);
        assert!(structures.max_geometry_count >= (1 << 24) - 1);
        assert!(structures.min_acceleration_structure_scratch_offset_alignment <= 256);
    }
}

#[test]
fn ray_tracing_brings_the_features_it_needs() {
    let gpu = Gpu::new();
    assert_eq!(gpu.features12.buffer_device_address, vk::TRUE);
    assert_eq!(gpu.features12.descriptor_indexing, vk::TRUE);
    assert_eq!(gpu.features.robust_buffer_access, vk::TRUE);
    // Required of every device of version 1.3.
    assert_eq!(gpu.features12.timeline_semaphore, vk::TRUE);
    assert_eq!(gpu.features12.host_query_reset, vk::TRUE);
    assert_eq!(gpu.features12.vulkan_memory_model, vk::TRUE);
    assert_eq!(gpu.features13.synchronization2, vk::TRUE);
    assert_eq!(gpu.features13.maintenance4, vk::TRUE);
    assert_eq!(gpu.features13.private_data, vk::TRUE);
    assert_eq!(gpu.features13.pipeline_creation_cache_control, vk::TRUE);
    assert_eq!(
        gpu.features13.shader_zero_initialize_workgroup_memory,
        vk::TRUE
    );
}

#[test]
fn lists_are_enumerated_in_two_steps() {
    let gpu = Gpu::new();
    // SAFETY: the count and the array belong together, and the array is long enough.
    unsafe {
        let enumerate = gpu.instance.fp_v1_0().enumerate_device_extension_properties;
        let mut count = 0;
        let null = std::ptr::null_mut();
        let layer = std::ptr::null();
        assert_eq!(
            enumerate(gpu.physical, layer, &mut count, null),
            vk::Result::SUCCESS
        );
        assert!(count >= 3);
        let mut list = vec![vk::ExtensionProperties::default(); count as usize];
        let mut short = count - 1;
        let some = enumerate(gpu.physical, layer, &mut short, list.as_mut_ptr());
        assert_eq!((some, short), (vk::Result::INCOMPLETE, count - 1));
        let all = enumerate(gpu.physical, layer, &mut count, list.as_mut_ptr());
        assert_eq!(all, vk::Result::SUCCESS);
        let mut names: Vec<&CStr> = list
            .iter()
            .map(|e| e.extension_name_as_c_str().unwrap())
            .collect();
        names.sort();
        let before = names.len();
        names.dedup();
        assert_eq!(names.len(), before, "an extension is listed twice");
    }
}

#[test]
fn unknown_extensions_and_layers_are_refused() {
    let gpu = Gpu::without_validation();
    let queues = [vk::DeviceQueueCreateInfo::default()
        .queue_family_index(gpu.family)
        .queue_priorities(&[1.0])];
    let names = [c"VK_TUFF_no_such_thing".as_ptr()];
    let info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&names);
    // SAFETY: the infos outlive the calls.
    unsafe {
        let refused = gpu.instance.create_device(gpu.physical, &info, None);
        assert_eq!(refused.err(), Some(vk::Result::ERROR_EXTENSION_NOT_PRESENT));
        let info = vk::InstanceCreateInfo::default().enabled_extension_names(&names);
        let refused = gpu.entry.create_instance(&info, None);
        assert_eq!(refused.err(), Some(vk::Result::ERROR_EXTENSION_NOT_PRESENT));
    }
}

#[test]
fn features_that_are_missing_are_refused() {
    let gpu = Gpu::without_validation();
    let mut features = vk::PhysicalDeviceFeatures::default();
    // Few devices have all of these.
    let missing = if gpu.features.sparse_residency_aliased == vk::FALSE {
        &mut features.sparse_residency_aliased
    } else if gpu.features.sparse_residency16_samples == vk::FALSE {
        &mut features.sparse_residency16_samples
    } else {
        &mut features.alpha_to_one
    };
    *missing = vk::TRUE;
    let misses = gpu.features.alpha_to_one * gpu.features.sparse_residency16_samples == vk::FALSE;
    if !has("a feature that is missing", misses) {
        return;
    }
    let queues = [vk::DeviceQueueCreateInfo::default()
        .queue_family_index(gpu.family)
        .queue_priorities(&[1.0])];
    let info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_features(&features);
    // SAFETY: the info outlives the call.
    let refused = unsafe { gpu.instance.create_device(gpu.physical, &info, None) };
    assert_eq!(refused.err(), Some(vk::Result::ERROR_FEATURE_NOT_PRESENT));
}

#[test]
fn several_devices_work_side_by_side() {
    let gpus = [Gpu::new(), Gpu::new(), Gpu::new()];
    let source = r"
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer B { uint b; };
    void main() { b += 41u; }";
    for (i, gpu) in gpus.iter().enumerate() {
        let buffer = gpu.buffer_with(&[i as u32]);
        gpu.compute(source, &[buffer], [1, 1, 1]);
        assert_eq!(buffer.read::<u32>(), [i as u32 + 41]);
    }
}

#[test]
fn memory_keeps_what_is_written_over_maps() {
    let gpu = Gpu::new();
    let visible = vk::MemoryPropertyFlags::HOST_VISIBLE;
    let kind = gpu
        .memory
        .memory_types_as_slice()
        .iter()
        .position(|kind| kind.property_flags.contains(visible))
        .expect("memory for the host") as u32;
    let info = vk::MemoryAllocateInfo::default()
        .allocation_size(1 << 20)
        .memory_type_index(kind);
    // SAFETY: the pointers are used inside the mapped ranges while they are mapped.
    unsafe {
        let memory = gpu.device.allocate_memory(&info, None).expect("a megabyte");
        let none = vk::MemoryMapFlags::empty();
        let all = gpu
            .device
            .map_memory(memory, 0, vk::WHOLE_SIZE, none)
            .expect("a map");
        assert_eq!(all as usize % gpu.limits.min_memory_map_alignment, 0);
        let all = all.cast::<u8>();
        for i in 0..1 << 20 {
            *all.add(i) = (i % 251) as u8;
        }
        let range = vk::MappedMemoryRange::default()
            .memory(memory)
            .size(vk::WHOLE_SIZE);
        gpu.device
            .flush_mapped_memory_ranges(&[range])
            .expect("a flush");
        gpu.device.unmap_memory(memory);
        let offset = 12345u64;
        let part = gpu
            .device
            .map_memory(memory, offset, 1000, none)
            .expect("a map");
        let atom = gpu.limits.non_coherent_atom_size;
        let range = vk::MappedMemoryRange::default()
            .memory(memory)
            .offset(offset.next_multiple_of(atom))
            .size(atom);
        gpu.device
            .invalidate_mapped_memory_ranges(&[range])
            .expect("an invalidation");
        let part = part.cast::<u8>();
        for i in 0..1000 {
            assert_eq!(*part.add(i), ((offset as usize + i) % 251) as u8);
        }
        gpu.device.unmap_memory(memory);
        gpu.device.free_memory(memory, None);
    }
}

#[test]
fn what_is_too_large_is_out_of_memory() {
    let gpu = Gpu::without_validation();
    let heap = gpu.memory.memory_heaps_as_slice()[0].size;
    for size in [heap.saturating_mul(2).max(1 << 50), 1 << 60] {
        let info = vk::MemoryAllocateInfo::default().allocation_size(size);
        // SAFETY: the info outlives the call.
        let refused = unsafe { gpu.device.allocate_memory(&info, None) };
        let out = [
            Err(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY),
            Err(vk::Result::ERROR_OUT_OF_HOST_MEMORY),
        ];
        // SAFETY: the memory, if there is any, is unused.
        unsafe { gpu.device.free_memory(refused.unwrap_or_default(), None) };
        let why = "memory is given out without a look at how much there is";
        unless_known(&gpu, "llvmpipe", why, || {
            assert!(out.contains(&refused), "{size:#x}: {refused:?}");
        });
    }
    // The device goes on.
    let buffer = gpu.buffer_with(&[1u32, 2, 3]);
    assert_eq!(buffer.read::<u32>(), [1, 2, 3]);
}

#[test]
fn buffers_share_one_allocation() {
    let gpu = Gpu::new();
    let info = vk::BufferCreateInfo::default()
        .size(1000)
        .usage(vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST);
    // SAFETY: the ranges do not overlap; everything is destroyed after its last use.
    unsafe {
        let buffers: Vec<vk::Buffer> = (0..4)
            .map(|_| gpu.device.create_buffer(&info, None).expect("a buffer"))
            .collect();
        let mut needs = gpu.device.get_buffer_memory_requirements(buffers[0]);
        let each = needs.size.next_multiple_of(needs.alignment);
        needs.size = 4 * each;
        let memory = gpu.allocate(needs, true);
        for (i, buffer) in buffers.iter().enumerate() {
            gpu.device
                .bind_buffer_memory(*buffer, memory, i as u64 * each)
                .expect("a binding");
        }
        gpu.run(|commands| {
            for (i, buffer) in buffers.iter().enumerate() {
                gpu.device
                    .cmd_fill_buffer(commands, *buffer, 0, 1000, i as u32 + 1);
            }
        });
        let out = gpu.buffer(4000);
        gpu.run(|commands| {
            for (i, buffer) in buffers.iter().enumerate() {
                let copy = vk::BufferCopy {
                    src_offset: 0,
                    dst_offset: i as u64 * 1000,
                    size: 1000,
                };
                gpu.device
                    .cmd_copy_buffer(commands, *buffer, out.handle, &[copy]);
            }
        });
        let words: Vec<u32> = out.read();
        assert!(
            words
                .iter()
                .enumerate()
                .all(|(i, word)| *word == i as u32 / 250 + 1)
        );
        for buffer in buffers {
            gpu.device.destroy_buffer(buffer, None);
        }
    }
}

#[test]
fn format_support_includes_what_vulkan_requires() {
    use vk::{Format as F, FormatFeatureFlags as Has};
    let gpu = Gpu::new();
    let sampled = Has::SAMPLED_IMAGE | Has::BLIT_SRC | Has::TRANSFER_SRC | Has::TRANSFER_DST;
    let filtered = sampled | Has::SAMPLED_IMAGE_FILTER_LINEAR;
    // The rows of "Mandatory format support" for compute and transfer.
    for format in [
        F::R8_UNORM,
        F::R8_SNORM,
        F::R8G8_UNORM,
        F::R8G8B8A8_UNORM,
        F::R8G8B8A8_SNORM,
        F::R8G8B8A8_SRGB,
        F::B8G8R8A8_UNORM,
        F::B8G8R8A8_SRGB,
        F::A8B8G8R8_UNORM_PACK32,
        F::A2B10G10R10_UNORM_PACK32,
        F::R5G6B5_UNORM_PACK16,
        F::A1R5G5B5_UNORM_PACK16,
        F::R16_SFLOAT,
        F::R16G16_SFLOAT,
        F::R16G16B16A16_SFLOAT,
        F::B10G11R11_UFLOAT_PACK32,
        F::E5B9G9R9_UFLOAT_PACK32,
    ] {
        assert!(gpu.supports(format, filtered), "{format:?} is not filtered");
    }
    for format in [
        F::R8_UINT,
        F::R8G8B8A8_SINT,
        F::R16_UINT,
        F::R16G16B16A16_SINT,
        F::R32_UINT,
        F::R32_SFLOAT,
        F::R32G32_SFLOAT,
        F::R32G32B32A32_SFLOAT,
        F::R32G32B32A32_UINT,
        F::A2B10G10R10_UINT_PACK32,
    ] {
        assert!(gpu.supports(format, sampled), "{format:?} is not sampled");
    }
    for format in [
        F::R8G8B8A8_UNORM,
        F::R8G8B8A8_SNORM,
        F::R8G8B8A8_UINT,
        F::R8G8B8A8_SINT,
        F::R16G16B16A16_UINT,
        F::R16G16B16A16_SINT,
        F::R16G16B16A16_SFLOAT,
        F::R32_UINT,
        F::R32_SINT,
        F::R32_SFLOAT,
        F::R32G32_UINT,
        F::R32G32_SFLOAT,
        F::R32G32B32A32_UINT,
        F::R32G32B32A32_SINT,
        F::R32G32B32A32_SFLOAT,
    ] {
        assert!(
            gpu.supports(format, Has::STORAGE_IMAGE),
            "{format:?} is not stored"
        );
    }
    for format in [F::R32_UINT, F::R32_SINT] {
        assert!(
            gpu.supports(format, Has::STORAGE_IMAGE_ATOMIC),
            "{format:?} is not atomic"
        );
    }
    assert!(!gpu.supports(F::UNDEFINED, Has::SAMPLED_IMAGE));
}

/// `VK_DEVICE_QUEUE_CREATE_INTERNALLY_SYNCHRONIZED_BIT_KHR`.
const INTERNALLY_SYNCHRONIZED: vk::DeviceQueueCreateFlags =
    vk::DeviceQueueCreateFlags::from_raw(1 << 2);

/// `VkPhysicalDeviceInternallySynchronizedQueuesFeaturesKHR`.
#[repr(C)]
struct SynchronizedQueues {
    s_type: vk::StructureType,
    p_next: *mut std::ffi::c_void,
    internally_synchronized_queues: vk::Bool32,
}

#[test]
fn threads_share_a_queue_that_synchronizes_itself() {
    let gpu = Gpu::without_validation();
    let mut feature = SynchronizedQueues {
        s_type: vk::StructureType::from_raw(1_000_504_000),
        p_next: std::ptr::null_mut(),
        internally_synchronized_queues: vk::FALSE,
    };
    let mut features = vk::PhysicalDeviceFeatures2 {
        p_next: (&raw mut feature).cast(),
        ..Default::default()
    };
    // SAFETY: the chain is the two structures above.
    unsafe { (gpu.instance).get_physical_device_features2(gpu.physical, &mut features) };
    // SAFETY: as above; read through a pointer, because the driver wrote through one.
    let has_feature = unsafe { (&raw const feature.internally_synchronized_queues).read() };
    if !has("VK_KHR_internally_synchronized_queues", has_feature != 0) {
        return;
    }
    let queues = [vk::DeviceQueueCreateInfo::default()
        .flags(INTERNALLY_SYNCHRONIZED)
        .queue_family_index(gpu.family)
        .queue_priorities(&[1.0])];
    let names = [c"VK_KHR_internally_synchronized_queues".as_ptr()];
    let mut info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&names);
    info.p_next = (&raw const feature).cast();
    // SAFETY: the infos outlive the calls, and the device is destroyed last, when it is idle.
    unsafe {
        let device = gpu.instance.create_device(gpu.physical, &info, None);
        let device = device.expect("vkCreateDevice");
        let queue = |flags| {
            let info = vk::DeviceQueueInfo2::default()
                .queue_family_index(gpu.family)
                .flags(flags);
            device.get_device_queue2(&info)
        };
        let shared = queue(INTERNALLY_SYNCHRONIZED);
        assert_ne!(shared, vk::Queue::null());
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..50 {
                        let fence = device.create_fence(&vk::FenceCreateInfo::default(), None);
                        let fence = fence.expect("vkCreateFence");
                        let submitted = device.queue_submit(shared, &[], fence);
                        submitted.expect("vkQueueSubmit");
                        device.queue_wait_idle(shared).expect("vkQueueWaitIdle");
                        assert_eq!(device.get_fence_status(fence), Ok(true));
                        device.destroy_fence(fence, None);
                    }
                });
            }
        });
        device.destroy_device(None);
    }
}
