//! Memory and sizes that break the rules. Vulkan leaves their effect open, so these tests look only
//! at Tuff, which promises an error, a lost device or zeros, and a process that lives on.
#![cfg(unix)]

use std::ffi::CStr;
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};

use ash::vk::Handle;
use ash::{ext, khr};
use tuff_tests::*;

unsafe extern "C" {
    fn fork() -> i32;
    fn _exit(code: i32) -> !;
    fn waitpid(child: i32, status: *mut i32, options: i32) -> i32;
    fn alarm(seconds: u32) -> u32;
    fn ftruncate(file: i32, length: i64) -> i32;
}

/// A second device, with extensions that other tests do not use; the caller destroys it.
fn device_with(gpu: &Gpu, extensions: &[&CStr], sparse_binding: bool) -> ash::Device {
    let names: Vec<_> = extensions.iter().map(|name| name.as_ptr()).collect();
    let queues = [vk::DeviceQueueCreateInfo::default()
        .queue_family_index(gpu.family)
        .queue_priorities(&[1.0])];
    let features = vk::PhysicalDeviceFeatures::default().sparse_binding(sparse_binding);
    let info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_features(&features)
        .enabled_extension_names(&names);
    // SAFETY: the physical device is of the instance, and has all of this.
    unsafe { gpu.instance.create_device(gpu.physical, &info, None) }.expect("vkCreateDevice")
}

#[test]
fn query_results_stay_within_their_size() {
    let Some(gpu) = Gpu::surviving() else { return };
    let info = vk::QueryPoolCreateInfo::default()
        .query_type(vk::QueryType::TIMESTAMP)
        .query_count(64);
    // SAFETY: handles are of this device; the third word is outside of what the call is given.
    unsafe {
        let pool = gpu.device.create_query_pool(&info, None).unwrap();
        gpu.run(|commands| {
            gpu.device.cmd_reset_query_pool(commands, pool, 0, 64);
            for query in 0..64 {
                let stage = vk::PipelineStageFlags::ALL_COMMANDS;
                gpu.device.cmd_write_timestamp(commands, stage, pool, query);
            }
        });
        let mut words = [77u64; 64];
        let results = gpu.device.fp_v1_0().get_query_pool_results;
        let flags = vk::QueryResultFlags::TYPE_64;
        let (device, out) = (gpu.device.handle(), words.as_mut_ptr().cast());
        let code = results(device, pool, 0, 64, 16, out, 8, flags);
        assert_eq!(code, vk::Result::SUCCESS);
        assert!(words[0] != 77 && words[1] != 77);
        assert_eq!(words[2..], [77; 62]);
        let code = results(device, pool, 0, u32::MAX, 16, out, u64::MAX / 2, flags);
        assert_eq!(code, vk::Result::SUCCESS);
        assert_eq!(words[2..], [77; 62]);
        gpu.device.destroy_query_pool(pool, None);
    }
}

#[test]
fn exported_memory_keeps_its_size() {
    let Some(gpu) = Gpu::surviving() else { return };
    let device = device_with(&gpu, &[khr::external_memory_fd::NAME], false);
    let files = khr::external_memory_fd::Device::new(&gpu.instance, &device);
    let opaque = vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD;
    let import = |file: i32| {
        let mut import = vk::ImportMemoryFdInfoKHR::default()
            .handle_type(opaque)
            .fd(file);
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(1 << 20)
            .push_next(&mut import);
        // SAFETY: the file is open, or refused.
        unsafe { device.allocate_memory(&info, None) }
    };
    // SAFETY: handles are of this device, and the memory is mapped whole.
    unsafe {
        let mut export = vk::ExportMemoryAllocateInfo::default().handle_types(opaque);
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(1 << 20)
            .push_next(&mut export);
        let memory = device.allocate_memory(&info, None).unwrap();
        let info = vk::MemoryGetFdInfoKHR::default()
            .memory(memory)
            .handle_type(opaque);
        let file = OwnedFd::from_raw_fd(files.get_memory_fd(&info).unwrap());
        assert_eq!(ftruncate(file.as_raw_fd(), 0), -1);
        let flags = vk::MemoryMapFlags::empty();
        let mapped = device.map_memory(memory, 0, vk::WHOLE_SIZE, flags).unwrap();
        mapped.cast::<u32>().write_volatile(5);
        let again = import(files.get_memory_fd(&info).unwrap()).expect("ours can be imported");
        device.free_memory(again, None);
        // A process that can open a file on a disk can shorten it.
        let path = std::env::temp_dir().join(format!("tuff-import-{}", std::process::id()));
        let plain = std::fs::File::create_new(&path).unwrap();
        plain.set_len(1 << 20).unwrap();
        std::fs::remove_file(&path).unwrap();
        let refused = import(plain.as_raw_fd());
        assert_eq!(refused, Err(vk::Result::ERROR_INVALID_EXTERNAL_HANDLE));
        device.free_memory(memory, None);
        device.destroy_device(None);
    }
}

#[test]
fn host_pointers_to_nothing_are_refused() {
    let Some(gpu) = Gpu::surviving() else { return };
    let device = device_with(&gpu, &[ext::external_memory_host::NAME], false);
    let own = gpu.buffer(1 << 20);
    for (pointer, size) in [(own.address, u64::MAX), (0, 4096), (1 << 46, 1 << 20)] {
        let mut import = vk::ImportMemoryHostPointerInfoEXT::default()
            .handle_type(vk::ExternalMemoryHandleTypeFlags::HOST_ALLOCATION_EXT);
        import.p_host_pointer = pointer as *mut _;
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(size)
            .push_next(&mut import);
        // SAFETY: what is not there is refused.
        let refused = unsafe { device.allocate_memory(&info, None) };
        assert_eq!(refused, Err(vk::Result::ERROR_INVALID_EXTERNAL_HANDLE));
    }
    // SAFETY: nothing is left on it.
    unsafe { device.destroy_device(None) };
}

#[test]
fn sizes_without_measure_are_errors() {
    let Some(gpu) = Gpu::surviving() else { return };
    let image = |levels, layers, side| {
        let info = flat_info(vk::Format::R32G32B32A32_SFLOAT, side, side)
            .mip_levels(levels)
            .array_layers(layers)
            .usage(vk::ImageUsageFlags::SAMPLED);
        // SAFETY: an image that cannot be is refused.
        unsafe { gpu.device.create_image(&info, None) }
    };
    assert!(image(u32::MAX, 1, 16).is_err());
    assert!(image(40, 1, 16).is_err());
    assert!(image(1, u32::MAX, u32::MAX).is_err());
    let types = [
        vk::DescriptorType::STORAGE_BUFFER,
        vk::DescriptorType::STORAGE_BUFFER_DYNAMIC,
    ];
    let bindings = [0, 1].map(|k| {
        vk::DescriptorSetLayoutBinding::default()
            .binding(k)
            .descriptor_type(types[k as usize])
            .descriptor_count(if k == 0 { u32::MAX } else { 4 })
            .stage_flags(vk::ShaderStageFlags::ALL)
    });
    let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
    // SAFETY: a layout that cannot be is refused.
    let layout = unsafe { gpu.device.create_descriptor_set_layout(&info, None) };
    assert_eq!(layout, Err(vk::Result::ERROR_OUT_OF_HOST_MEMORY));
}

/// As many instances as a number can say, from memory that has room for few.
#[test]
fn instances_without_measure_are_no_build() {
    let Some(gpu) = Gpu::surviving() else { return };
    let input = gpu.buffer(1 << 16);
    let top = gpu.empty_structure(vk::AccelerationStructureTypeKHR::TOP_LEVEL, 1 << 16);
    let scratch = gpu.buffer(1 << 20);
    for (count, address) in [
        (u32::MAX, input.address),
        (1 << 24, input.address),
        (u32::MAX, 0x4141_4141_4141_4140),
    ] {
        let mut data = vk::AccelerationStructureGeometryInstancesDataKHR::default();
        data.data.device_address = address;
        let geometry = [vk::AccelerationStructureGeometryKHR::default()
            .geometry_type(vk::GeometryTypeKHR::INSTANCES)
            .geometry(vk::AccelerationStructureGeometryDataKHR { instances: data })];
        let mut info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
            .ty(vk::AccelerationStructureTypeKHR::TOP_LEVEL)
            .dst_acceleration_structure(top.handle)
            .geometries(&geometry);
        info.scratch_data.device_address = scratch.address;
        let range = [vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(count)];
        // Either end is one.
        let _ = gpu.try_run(|commands| {
            // SAFETY: the build is refused where it is performed.
            unsafe {
                gpu.acceleration
                    .cmd_build_acceleration_structures(commands, &[info], &[&range]);
            }
        });
    }
}

#[test]
fn allocations_end_in_an_error_before_the_system_ends_them() {
    let Some(gpu) = Gpu::surviving() else { return };
    for sparse_binding in [false, true] {
        let device = device_with(&gpu, &[], sparse_binding);
        let info = vk::MemoryAllocateInfo::default().allocation_size(65536);
        let mut all = Vec::new();
        // SAFETY: memory of this device, mapped whole.
        let error = unsafe {
            loop {
                let memory = match device.allocate_memory(&info, None) {
                    Ok(memory) => memory,
                    Err(error) => break error,
                };
                let flags = vk::MemoryMapFlags::empty();
                let mapped = device.map_memory(memory, 0, vk::WHOLE_SIZE, flags).unwrap();
                mapped.cast::<u32>().write_volatile(1);
                all.push(memory);
            }
        };
        assert_eq!(error, vk::Result::ERROR_TOO_MANY_OBJECTS);
        assert_eq!(all.len() as u32, gpu.limits.max_memory_allocation_count);
        // SAFETY: none is used any more.
        unsafe {
            all.iter()
                .for_each(|&memory| device.free_memory(memory, None));
            let memory = device.allocate_memory(&info, None).unwrap();
            device.free_memory(memory, None);
            device.destroy_device(None);
        }
    }
}

/// Resources that have no memory, or are to lie past the end of some.
#[test]
fn resources_lie_inside_memory() {
    let Some(gpu) = Gpu::surviving() else { return };
    let device = &gpu.device;
    let memory = vk::MemoryAllocateInfo::default().allocation_size(1 << 16);
    let buffer = vk::BufferCreateInfo::default()
        .size(1 << 20)
        .usage(gpu.usual_uses());
    let image = flat_info(vk::Format::R8G8B8A8_UNORM, 512, 512).usage(vk::ImageUsageFlags::STORAGE);
    // SAFETY: what does not fit is refused, and nothing is used after it is destroyed.
    unsafe {
        let memory = device.allocate_memory(&memory, None).unwrap();
        let (buffer, image) = (
            device.create_buffer(&buffer, None).unwrap(),
            device.create_image(&image, None).unwrap(),
        );
        for offset in [0, 1 << 16, u64::MAX - 0xFFFF] {
            assert!(device.bind_buffer_memory(buffer, memory, offset).is_err());
            assert!(device.bind_image_memory(image, memory, offset).is_err());
            let bind = vk::BindBufferMemoryInfo::default()
                .buffer(buffer)
                .memory(memory)
                .memory_offset(offset);
            assert!(device.bind_buffer_memory2(&[bind]).is_err());
            let bind = vk::BindImageMemoryInfo::default()
                .image(image)
                .memory(memory)
                .memory_offset(offset);
            assert!(device.bind_image_memory2(&[bind]).is_err());
        }
        let view = vk::ImageViewCreateInfo::default()
            .image(image)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(vk::Format::R8G8B8A8_UNORM)
            .subresource_range(
                vk::ImageSubresourceRange::default()
                    .aspect_mask(vk::ImageAspectFlags::COLOR)
                    .level_count(1)
                    .layer_count(1),
            );
        assert!(device.create_image_view(&view, None).is_err());
        device.destroy_image(image, None);

        // Bound all the same: by a set, whole, from some offset on and past its end.
        let results = gpu.buffer(64);
        let mut unbound = results;
        unbound.handle = buffer;
        let set = gpu.set_of(&[unbound.into(), results.into()]);
        for (offset, range) in [(0, vk::WHOLE_SIZE), (1 << 19, 1 << 19), (1 << 21, 1 << 20)] {
            let info = [vk::DescriptorBufferInfo::default()
                .buffer(buffer)
                .offset(offset)
                .range(range)];
            let write = vk::WriteDescriptorSet::default()
                .dst_set(set.handle)
                .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                .buffer_info(&info);
            device.update_descriptor_sets(&[write], &[]);
            results.write(0, &[7u32; 16]);
            let kernel = gpu.kernel(WRITES_AND_READS, &[set.layout]);
            gpu.run(|commands| {
                gpu.record_dispatch(commands, kernel, &[set], &[0u32; 0], [1, 1, 1]);
            });
            assert_eq!(results.read::<u32>()[..2], [0, 0]);
        }
        device.destroy_buffer(buffer, None);
        device.free_memory(memory, None);
    }
}

/// Writes into a buffer, and says how long it is and what is read there.
const WRITES_AND_READS: &str = "
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) buffer B { uint b[]; };
    layout(set = 0, binding = 1) buffer R { uint r[]; };
    void main() {
        b[3] = 5u;
        b[70000] = 6u;
        r[0] = b[3] | b[70000];
        r[1] = uint(b.length());
    }";

/// The offset of a dynamic buffer leads past its end: that part of the range is not there.
#[test]
fn dynamic_offsets_end_with_the_buffer() {
    let Some(gpu) = Gpu::surviving() else { return };
    let results = gpu.buffer(64);
    let size = 1 << 20;
    let given = gpu.buffer(size);
    let window = 512 << 10;
    let set = gpu.set_of(&[Bound::StorageDynamic(given, window), results.into()]);
    let kernel = gpu.kernel(WRITES_AND_READS, &[set.layout]);
    for offset in [0, 768 << 10, 1 << 20, 1 << 31, !0xFF] {
        results.write(0, &[7u32; 16]);
        gpu.run(|commands| {
            gpu.bind_kernel(commands, kernel, &[set], &[offset]);
            // SAFETY: what is past the end of the buffer is not reached.
            unsafe { gpu.device.cmd_dispatch(commands, 1, 1, 1) };
        });
        let rest = size.saturating_sub(u64::from(offset)).min(window);
        let words = rest as u32 / 4;
        let read = (u32::from(words > 3) * 5) | (u32::from(words > 70000) * 6);
        assert_eq!(results.read::<u32>()[..2], [read, words], "{offset}");
    }
}

/// Kilobytes of page tables of this process.
fn page_table_kilobytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmPTE:"));
    let mut words = line.unwrap().split_whitespace();
    words.nth(1).unwrap().parse().unwrap()
}

#[test]
fn memory_that_comes_and_goes_leaves_nothing_behind() {
    let Some(gpu) = Gpu::surviving() else { return };
    let device = device_with(&gpu, &[], false);
    let info = vk::MemoryAllocateInfo::default().allocation_size((1 << 20) + 65536);
    let before = page_table_kilobytes();
    for round in 0..40_000u32 {
        // SAFETY: memory of this device, mapped whole, and not used after it is freed.
        unsafe {
            let memory = device.allocate_memory(&info, None).unwrap();
            let flags = vk::MemoryMapFlags::empty();
            let mapped = device.map_memory(memory, 0, vk::WHOLE_SIZE, flags).unwrap();
            let word = mapped.cast::<u32>();
            assert_eq!(word.read_volatile(), 0, "round {round}");
            word.write_volatile(round | 1);
            device.free_memory(memory, None);
        }
    }
    let grown = page_table_kilobytes().saturating_sub(before);
    // SAFETY: nothing is left on it.
    unsafe { device.destroy_device(None) };
    println!("page tables grew by {grown} kB");
    assert!(grown < 10_000, "{grown} kB");
}

#[test]
fn a_handle_of_another_kind_is_an_error() {
    let Some(gpu) = Gpu::surviving() else { return };
    let info = vk::BufferCreateInfo::default()
        .size(256)
        .usage(vk::BufferUsageFlags::TRANSFER_DST);
    // SAFETY: wrong handles lead to living objects, all of which begin alike.
    unsafe {
        let buffer = gpu.device.create_buffer(&info, None).unwrap();
        gpu.device
            .destroy_image(vk::Image::from_raw(buffer.as_raw()), None);
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(gpu.pool)
            .command_buffer_count(1);
        let commands = gpu.device.allocate_command_buffers(&info).unwrap()[0];
        let info = vk::CommandBufferBeginInfo::default();
        gpu.device.begin_command_buffer(commands, &info).unwrap();
        let wrong = vk::Buffer::from_raw(gpu.pool.as_raw());
        gpu.device.cmd_fill_buffer(commands, wrong, 0, 4, 0);
        assert!(gpu.device.end_command_buffer(commands).is_err());
        // The loader looks at no more of a command buffer than its first word.
        let (buffer_word, word) = (
            buffer.as_raw() as *mut u64,
            gpu.queue.as_raw() as *const u64,
        );
        let kept = buffer_word.read();
        buffer_word.write(word.read());
        let wrong = vk::CommandBuffer::from_raw(buffer.as_raw());
        gpu.device.cmd_fill_buffer(wrong, buffer, 0, 4, 0);
        buffer_word.write(kept);
        gpu.device.destroy_buffer(buffer, None);
    }
}

/// Small ones, wild ones, ones into the driver's own objects, and those of objects that are gone
/// with all that lay beside them.
#[test]
fn a_number_that_was_never_a_handle_is_an_error() {
    let Some(gpu) = Gpu::surviving() else { return };
    let info = vk::BufferCreateInfo::default()
        .size(256)
        .usage(vk::BufferUsageFlags::TRANSFER_DST);
    let info_of_commands = vk::CommandBufferAllocateInfo::default()
        .command_pool(gpu.pool)
        .command_buffer_count(1);
    // SAFETY: the driver looks at no number further than whether it is a handle.
    unsafe {
        let buffer = gpu.device.create_buffer(&info, None).unwrap();
        let real = buffer.as_raw();
        let commands = gpu
            .device
            .allocate_command_buffers(&info_of_commands)
            .unwrap()[0];
        for number in [
            1,
            16,
            0x0123_4560,
            0x4141_4141_4141_4140,
            u64::MAX - 15,
            real + 1,
            real + 16,
            real ^ 1 << 40,
        ] {
            let wrong = vk::Buffer::from_raw(number);
            gpu.device.destroy_buffer(wrong, None);
            let begin = vk::CommandBufferBeginInfo::default();
            gpu.device.begin_command_buffer(commands, &begin).unwrap();
            gpu.device.cmd_fill_buffer(commands, wrong, 0, 4, 0);
            assert!(
                gpu.device.end_command_buffer(commands).is_err(),
                "{number:#x}"
            );
        }
        gpu.device.destroy_buffer(buffer, None);
    }
}

/// A fork takes no threads along: to a child, its parent's devices are lost.
#[test]
fn a_forked_child_waits_for_nothing() {
    let Some(gpu) = Gpu::surviving() else { return };
    let target = gpu.buffer(64);
    let fill = gpu.record(|commands| {
        // SAFETY: the buffer is that long.
        unsafe {
            gpu.device
                .cmd_fill_buffer(commands, target.handle, 0, 64, 3);
        }
    });
    gpu.submit(fill).unwrap();
    let buffers = [fill];
    let submit = [vk::SubmitInfo::default().command_buffers(&buffers)];
    // SAFETY: the child makes a few calls and ends without running anything of the test's.
    unsafe {
        let child = fork();
        if child == 0 {
            alarm(20);
            let submitted = gpu
                .device
                .queue_submit(gpu.queue, &submit, vk::Fence::null());
            let idle = gpu.device.queue_wait_idle(gpu.queue);
            let lost = Err(vk::Result::ERROR_DEVICE_LOST);
            _exit(if (submitted, idle) == (lost, lost) {
                7
            } else {
                8
            });
        }
        let mut status = 0;
        assert_eq!(waitpid(child, &mut status, 0), child);
        assert_eq!(status, 7 << 8, "how the child ended");
    }
    gpu.submit(fill).unwrap();
    assert_eq!(target.read::<u32>(), [3; 16]);
}

/// Kilobytes of memory that this process has now.
fn resident_kilobytes() -> u64 {
    status_kilobytes("VmRSS:")
}

/// A line of the process's status.
fn status_kilobytes(name: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with(name));
    let mut words = line.unwrap().split_whitespace();
    words.nth(1).unwrap().parse().unwrap()
}

/// Recursion without an end has a budget, whatever the number of threads, and gives it back.
#[test]
fn endless_recursion_gives_its_memory_back() {
    let Some(gpu) = Gpu::surviving() else { return };
    let before = resident_kilobytes();
    let case = Case::endless();
    let rays = gpu.rays(&case);
    let regions = gpu.regions(&rays, &case.table());
    let lost = gpu.try_run(|commands| gpu.record_trace(commands, &rays, &regions, [1024, 1024, 1]));
    assert_eq!(lost, Err(vk::Result::ERROR_DEVICE_LOST));
    let kept = resident_kilobytes().saturating_sub(before);
    println!("{kept} kB are kept");
    assert!(kept < 200_000, "{kept} kB");
}

/// Workgroups in flight are within the budget of docs/security.md. Eight of these need 3 GiB.
#[test]
fn large_private_memory_is_within_the_budget() {
    const INVOCATIONS: usize = 384;
    const BUDGET_KILOBYTES: u64 = 2 << 20;
    let test = "large_private_memory_is_within_the_budget";
    if !alone(test, &[("TUFF_THREADS", "8"), ("TUFF_TIMEOUT", "300")]) {
        return;
    }
    let Some(gpu) = Gpu::surviving() else { return };
    let source = format!(
        "layout(local_size_x = {INVOCATIONS}) in;
        layout(set = 0, binding = 0) buffer A {{ uint a[]; }};
        void main() {{
            uint i = gl_GlobalInvocationID.x, sum = 0u, q[260000];
            for (uint k = 0u; k < 20u; k++) q[(k * 12345u + i * 7u) % 260000u] = k + i;
            for (uint k = 0u; k < 20u; k++) sum += q[(k * 12345u + i * 7u) % 260000u];
            a[i] = sum;
        }}"
    );
    let sums = gpu.buffer(8 * INVOCATIONS as u64 * 4);
    let before = resident_kilobytes();
    gpu.compute(&source, &[sums], [8, 1, 1]);
    let used = status_kilobytes("VmHWM:").saturating_sub(before);
    println!("{used} kB were used");
    // Memory of other things than invocations is small.
    assert!(used < BUDGET_KILOBYTES + (128 << 10), "{used} kB");
    let kept = resident_kilobytes().saturating_sub(before);
    assert!(kept < 200_000, "{kept} kB are kept");
    for (i, sum) in sums.read::<u32>().into_iter().enumerate() {
        assert_eq!(sum, 190 + 20 * i as u32, "invocation {i}");
    }
}

#[test]
fn memory_is_not_mapped_past_its_end() {
    let Some(gpu) = Gpu::surviving() else { return };
    let device = &gpu.device;
    let memory = vk::MemoryAllocateInfo::default().allocation_size(4096);
    let flags = vk::MemoryMapFlags::empty();
    // SAFETY: nothing is read or written by what is mapped.
    unsafe {
        let memory = device.allocate_memory(&memory, None).unwrap();
        for offset in [4096, 8192, u64::MAX - 4] {
            let mapped = device.map_memory(memory, offset, vk::WHOLE_SIZE, flags);
            assert_eq!(mapped, Err(vk::Result::ERROR_MEMORY_MAP_FAILED));
        }
        assert!(device.map_memory(memory, 4095, 1, flags).is_ok());
        device.free_memory(memory, None);
    }
}

#[test]
fn a_command_buffer_does_not_execute_itself() {
    let Some(gpu) = Gpu::surviving() else { return };
    let info = vk::CommandBufferAllocateInfo::default()
        .command_pool(gpu.pool)
        .level(vk::CommandBufferLevel::SECONDARY)
        .command_buffer_count(1);
    let inheritance = vk::CommandBufferInheritanceInfo::default();
    let begin = vk::CommandBufferBeginInfo::default().inheritance_info(&inheritance);
    // SAFETY: the driver promises to survive this; all else is as it should be.
    unsafe {
        let buffers = gpu.device.allocate_command_buffers(&info).unwrap();
        gpu.device.begin_command_buffer(buffers[0], &begin).unwrap();
        gpu.device.cmd_execute_commands(buffers[0], &buffers);
        assert!(gpu.device.end_command_buffer(buffers[0]).is_err());
        gpu.device.begin_command_buffer(buffers[0], &begin).unwrap();
        gpu.device.end_command_buffer(buffers[0]).unwrap();
        gpu.device.free_command_buffers(gpu.pool, &buffers);
    }
}

/// A command may wait for an event that is never set, or for a query that never begins.
#[test]
fn waits_of_commands_end_by_their_time_limit() {
    let test = "waits_of_commands_end_by_their_time_limit";
    if !alone(test, &[("TUFF_TIMEOUT", "1")]) {
        return;
    }
    for what in 0..2 {
        let Some(gpu) = Gpu::surviving() else { return };
        let device = &gpu.device;
        let pool = vk::QueryPoolCreateInfo::default()
            .query_type(vk::QueryType::TIMESTAMP)
            .query_count(1);
        let words = gpu.buffer(64);
        // SAFETY: handles are of this device. They are left to it, which is lost.
        unsafe {
            let event = device.create_event(&vk::EventCreateInfo::default(), None);
            let (event, pool) = (
                event.unwrap(),
                device.create_query_pool(&pool, None).unwrap(),
            );
            let ended = gpu.try_run(|commands| {
                let all = vk::PipelineStageFlags::ALL_COMMANDS;
                match what {
                    0 => device.cmd_wait_events(
                        commands,
                        &[event],
                        vk::PipelineStageFlags::HOST,
                        all,
                        &[],
                        &[],
                        &[],
                    ),
                    _ => {
                        device.cmd_reset_query_pool(commands, pool, 0, 1);
                        let wait = vk::QueryResultFlags::WAIT;
                        let to = words.handle;
                        device.cmd_copy_query_pool_results(commands, pool, 0, 1, to, 0, 8, wait);
                    }
                }
            });
            assert_eq!(ended, Err(vk::Result::ERROR_DEVICE_LOST));
        }
    }
}

/// Builds of one command that share scratch memory give what they give alone; one that has its
/// scratch memory in its destination is none.
#[test]
fn scratch_memory_is_one_builds_alone() {
    let Some(gpu) = Gpu::surviving() else { return };
    let level = vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL;
    let count = 3000;
    let corners = |seed: u32| {
        let number = move |i: u32| (i.wrapping_mul(2_654_435_761) ^ seed) as f32 / u32::MAX as f32;
        let corners = (0..3 * count).map(|i| [number(3 * i), number(3 * i + 1), number(3 * i + 2)]);
        gpu.buffer_with(&corners.collect::<Vec<_>>())
    };
    let geometries = [1, 2, 3, 4].map(|seed| {
        let triangles = triangles_at(corners(seed << 24).at(), 3 * count);
        [geometry_of(triangles)]
    });
    let range = [vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(count)];
    let mut infos = geometries.each_ref().map(|geometries| {
        vk::AccelerationStructureBuildGeometryInfoKHR::default()
            .ty(level)
            .geometries(geometries)
    });
    let on_device = vk::AccelerationStructureBuildTypeKHR::DEVICE;
    let sizes = gpu.build_sizes(on_device, &infos[0], &[count]);
    let scratch = gpu.buffer(sizes.build_scratch_size + 256);
    let structures = infos.each_mut().map(|info| {
        let structure = gpu.empty_structure(level, sizes.acceleration_structure_size);
        *info = info.dst_acceleration_structure(structure.handle);
        info.scratch_data.device_address = scratch.address.next_multiple_of(256);
        structure
    });
    let build = |infos: &[vk::AccelerationStructureBuildGeometryInfoKHR<'_>]| {
        gpu.run(|commands| {
            let ranges: Vec<&[_]> = infos.iter().map(|_| &range[..]).collect();
            // SAFETY: the driver promises to survive what is wrong here.
            unsafe {
                (gpu.acceleration).cmd_build_acceleration_structures(commands, infos, &ranges);
            }
        });
        structures.map(|structure| structure.storage.expect("it is known").read::<u32>())
    };
    for info in &infos {
        build(std::slice::from_ref(info));
    }
    let alone = build(&[]);
    for structure in structures {
        let storage = structure.storage.expect("it is known");
        storage.write(0, &vec![0u8; storage.size_bytes as usize]);
    }
    assert!(build(&infos) == alone);
    for (info, structure) in infos.iter_mut().zip(structures) {
        info.scratch_data.device_address = structure.storage.expect("it is known").address;
    }
    build(&infos);
}
