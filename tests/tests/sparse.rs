//! Sparse binding: buffers and images whose memory comes in pieces.

use tuff_tests::*;

/// A device whose queue binds sparse resources.
fn gpu_with_sparse_binding() -> Option<Gpu> {
    let gpu = Gpu::new();
    // SAFETY: the physical device is of this instance.
    let families = unsafe {
        gpu.instance
            .get_physical_device_queue_family_properties(gpu.physical)
    };
    let flags = families[gpu.family as usize].queue_flags;
    let binds = flags.contains(vk::QueueFlags::SPARSE_BINDING);
    gpu.with("sparse binding", |gpu| {
        gpu.features.sparse_binding != 0 && binds
    })
}

/// Binds, and waits until it is done.
fn bind(gpu: &Gpu, info: vk::BindSparseInfo) {
    // SAFETY: the handles are of this device, and the fence lives until the wait is over.
    unsafe {
        let fence = gpu
            .device
            .create_fence(&vk::FenceCreateInfo::default(), None);
        let fence = fence.expect("vkCreateFence");
        (gpu.device.queue_bind_sparse(gpu.queue, &[info], fence)).expect("vkQueueBindSparse");
        (gpu.device.wait_for_fences(&[fence], true, PATIENCE_NS)).expect("the bindings are made");
        gpu.device.destroy_fence(fence, None);
    }
}

fn bind_buffer(gpu: &Gpu, buffer: vk::Buffer, binds: &[vk::SparseMemoryBind]) {
    let buffers = [vk::SparseBufferMemoryBindInfo::default()
        .buffer(buffer)
        .binds(binds)];
    bind(gpu, vk::BindSparseInfo::default().buffer_binds(&buffers));
}

fn piece(offset: u64, size: u64, memory: vk::DeviceMemory, from: u64) -> vk::SparseMemoryBind {
    vk::SparseMemoryBind::default()
        .resource_offset(offset)
        .size(size)
        .memory(memory)
        .memory_offset(from)
}

#[test]
fn a_buffer_is_bound_in_pieces() {
    let Some(gpu) = gpu_with_sparse_binding() else {
        return;
    };
    let size = 1u64 << 20;
    let info = vk::BufferCreateInfo::default()
        .flags(vk::BufferCreateFlags::SPARSE_BINDING)
        .size(size)
        .usage(vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST);
    // SAFETY: `info` outlives the call; the buffer is destroyed at the end.
    let (sparse, needs) = unsafe {
        let buffer = gpu
            .device
            .create_buffer(&info, None)
            .expect("vkCreateBuffer");
        (buffer, gpu.device.get_buffer_memory_requirements(buffer))
    };
    let half = (needs.size / 2).next_multiple_of(needs.alignment);
    let rest = needs.size - half;
    let [first, second] =
        [half, rest].map(|size| gpu.allocate(vk::MemoryRequirements { size, ..needs }, true));
    // The halves are bound the wrong way round.
    bind_buffer(
        &gpu,
        sparse,
        &[piece(half, rest, second, 0), piece(0, half, first, 0)],
    );
    let words: Vec<u32> = (0..size as u32 / 4).collect();
    let input = gpu.buffer_with(&words);
    let output = gpu.buffer(size);
    let copy = [vk::BufferCopy::default().size(size)];
    gpu.run(|commands| {
        // SAFETY: the buffers are bound and live as long as the device.
        unsafe {
            gpu.device
                .cmd_copy_buffer(commands, input.handle, sparse, &copy);
            gpu.barrier(commands);
            gpu.device
                .cmd_copy_buffer(commands, sparse, output.handle, &copy);
        }
    });
    assert!(output.read::<u32>() == words);

    // Its first block now shows other memory, which another block has too if aliasing is allowed.
    let other = gpu.allocate(
        vk::MemoryRequirements {
            size: needs.alignment,
            ..needs
        },
        true,
    );
    bind_buffer(&gpu, sparse, &[piece(0, needs.alignment, other, 0)]);
    gpu.run(|commands| {
        // SAFETY: as above.
        unsafe {
            gpu.device
                .cmd_fill_buffer(commands, sparse, 0, needs.alignment, 0xabcd);
            gpu.barrier(commands);
            gpu.device
                .cmd_copy_buffer(commands, sparse, output.handle, &copy);
        }
    });
    let block = needs.alignment as usize / 4;
    let now: Vec<u32> = output.read();
    assert!(now[..block].iter().all(|&word| word == 0xabcd));
    assert!(now[block..] == words[block..]);
    // And the first memory again, which kept what it had.
    bind_buffer(&gpu, sparse, &[piece(0, needs.alignment, first, 0)]);
    gpu.run(|commands| {
        // SAFETY: as above.
        unsafe {
            gpu.device
                .cmd_copy_buffer(commands, sparse, output.handle, &copy);
        }
    });
    assert!(output.read::<u32>() == words);
    // SAFETY: nothing uses it any more.
    unsafe { gpu.device.destroy_buffer(sparse, None) };
}

#[test]
fn an_image_is_bound_in_pieces() {
    let Some(gpu) = gpu_with_sparse_binding() else {
        return;
    };
    let side = 256u32;
    let info = vk::ImageCreateInfo::default()
        .flags(vk::ImageCreateFlags::SPARSE_BINDING)
        .image_type(vk::ImageType::TYPE_2D)
        .format(vk::Format::R32_UINT)
        .extent(vk::Extent3D {
            width: side,
            height: side,
            depth: 1,
        })
        .mip_levels(1)
        .array_layers(1)
        .samples(vk::SampleCountFlags::TYPE_1)
        .usage(vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST);
    // SAFETY: `info` outlives the call; the image is destroyed at the end.
    let (image, needs) = unsafe {
        let image = gpu.device.create_image(&info, None).expect("vkCreateImage");
        (image, gpu.device.get_image_memory_requirements(image))
    };
    let blocks = needs.size / needs.alignment;
    let memory = gpu.allocate(needs, false);
    // Blocks in reverse order.
    let pieces: Vec<_> = (0..blocks)
        .map(|block| {
            let from = (blocks - 1 - block) * needs.alignment;
            piece(block * needs.alignment, needs.alignment, memory, from)
        })
        .collect();
    let images = [vk::SparseImageOpaqueMemoryBindInfo::default()
        .image(image)
        .binds(&pieces)];
    bind(
        &gpu,
        vk::BindSparseInfo::default().image_opaque_binds(&images),
    );

    let words: Vec<u32> = (0..side * side)
        .map(|i| i.wrapping_mul(0x9e37_79b9))
        .collect();
    let input = gpu.buffer_with(&words);
    let output = gpu.buffer(4 * u64::from(side * side));
    let layers = vk::ImageSubresourceLayers::default()
        .aspect_mask(vk::ImageAspectFlags::COLOR)
        .layer_count(1);
    let region = [vk::BufferImageCopy::default()
        .image_subresource(layers)
        .image_extent(info.extent)];
    let layout = vk::ImageLayout::GENERAL;
    let into_general = [vk::ImageMemoryBarrier::default()
        .new_layout(layout)
        .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .dst_access_mask(vk::AccessFlags::TRANSFER_WRITE)
        .image(image)
        .subresource_range(vk::ImageSubresourceRange {
            aspect_mask: vk::ImageAspectFlags::COLOR,
            level_count: 1,
            layer_count: 1,
            ..Default::default()
        })];
    gpu.run(|commands| {
        // SAFETY: the resources are bound and live as long as the device.
        unsafe {
            let all = vk::PipelineStageFlags::ALL_COMMANDS;
            let none = vk::DependencyFlags::empty();
            gpu.device
                .cmd_pipeline_barrier(commands, all, all, none, &[], &[], &into_general);
            gpu.device
                .cmd_copy_buffer_to_image(commands, input.handle, image, layout, &region);
            gpu.barrier(commands);
            gpu.device
                .cmd_copy_image_to_buffer(commands, image, layout, output.handle, &region);
        }
    });
    assert!(output.read::<u32>() == words);
    // SAFETY: nothing uses it any more.
    unsafe { gpu.device.destroy_image(image, None) };
}

/// Every second block of an image has memory, in reverse order; what is written there is read
/// there.
#[test]
fn an_image_is_resident_in_parts() {
    let Some(gpu) = gpu_with_sparse_binding() else {
        return;
    };
    let Some(gpu) = gpu.with("sparse residency of 2D images", |gpu| {
        gpu.features.sparse_residency_image2_d != 0
    }) else {
        return;
    };
    let format = vk::Format::R8G8B8A8_UNORM;
    let usage = vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST;
    // SAFETY: the physical device is of this instance.
    let blocks = unsafe {
        (gpu.instance).get_physical_device_sparse_image_format_properties(
            gpu.physical,
            format,
            vk::ImageType::TYPE_2D,
            vk::SampleCountFlags::TYPE_1,
            usage,
            vk::ImageTiling::OPTIMAL,
        )
    };
    let block = blocks[0].image_granularity;
    // The last column is not a whole block.
    let [width, height] = [2 * block.width + 5, 3 * block.height];
    let info = flat_info(format, width, height)
        .flags(vk::ImageCreateFlags::SPARSE_BINDING | vk::ImageCreateFlags::SPARSE_RESIDENCY)
        .usage(usage);
    // SAFETY: `info` outlives the call; the image is destroyed at the end.
    let (image, needs, of_image) = unsafe {
        let device = &gpu.device;
        let image = device.create_image(&info, None).expect("vkCreateImage");
        (
            image,
            device.get_image_memory_requirements(image),
            device.get_image_sparse_memory_requirements(image),
        )
    };
    assert_eq!(of_image.len(), 1);
    assert_eq!(of_image[0].format_properties.image_granularity, block);
    assert!(of_image[0].image_mip_tail_first_lod > 0);
    let corners: Vec<_> = (0..9u32)
        .step_by(2)
        .map(|index| [index % 3 * block.width, index / 3 * block.height])
        .collect();
    let count = corners.len() as u64;
    let memory = gpu.allocate(
        vk::MemoryRequirements {
            size: count * needs.alignment,
            ..needs
        },
        false,
    );
    let aspect = vk::ImageAspectFlags::COLOR;
    let part = |[x, y]: [u32; 2]| {
        let offset = vk::Offset3D {
            x: x as i32,
            y: y as i32,
            z: 0,
        };
        let extent = vk::Extent3D {
            width: block.width.min(width - x),
            height: block.height.min(height - y),
            depth: 1,
        };
        (offset, extent)
    };
    let binds: Vec<_> = (corners.iter().zip(0..))
        .map(|(&corner, index)| {
            let (offset, extent) = part(corner);
            vk::SparseImageMemoryBind::default()
                .subresource(vk::ImageSubresource::default().aspect_mask(aspect))
                .offset(offset)
                .extent(extent)
                .memory(memory)
                .memory_offset((count - 1 - index) * needs.alignment)
        })
        .collect();
    let images = [vk::SparseImageMemoryBindInfo::default()
        .image(image)
        .binds(&binds)];
    bind(&gpu, vk::BindSparseInfo::default().image_binds(&images));

    let mut size = 0;
    let regions: Vec<_> = (corners.iter())
        .map(|&corner| {
            let (offset, extent) = part(corner);
            let region = vk::BufferImageCopy::default()
                .buffer_offset(size)
                .image_subresource(
                    vk::ImageSubresourceLayers::default()
                        .aspect_mask(aspect)
                        .layer_count(1),
                )
                .image_offset(offset)
                .image_extent(extent);
            size += 4 * u64::from(extent.width * extent.height);
            region
        })
        .collect();
    let words: Vec<u32> = (0..size as u32 / 4)
        .map(|i| i.wrapping_mul(0x9e37_79b9))
        .collect();
    let input = gpu.buffer_with(&words);
    let output = gpu.buffer(size);
    let range = vk::ImageSubresourceRange::default()
        .aspect_mask(aspect)
        .level_count(1)
        .layer_count(1);
    gpu.to_general(image, range);
    let layout = vk::ImageLayout::GENERAL;
    gpu.run(|commands| {
        // SAFETY: the parts that are copied are bound, and all lives as long as the device.
        unsafe {
            gpu.device
                .cmd_copy_buffer_to_image(commands, input.handle, image, layout, &regions);
            gpu.barrier(commands);
            gpu.device
                .cmd_copy_image_to_buffer(commands, image, layout, output.handle, &regions);
        }
    });
    assert!(output.read::<u32>() == words);
    // SAFETY: nothing uses it any more.
    unsafe { gpu.device.destroy_image(image, None) };
}
