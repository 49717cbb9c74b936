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
        // SAFETY: the buffers are bound and live as long as the device.
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
        // SAFETY: the buffers are bound and live as long as the device.
        unsafe {
            gpu.device
                .cmd_copy_buffer(commands, sparse, output.handle, &copy);
        }
    });
    assert!(output.read::<u32>() == words);
    // SAFETY: nothing uses it any more.
    unsafe { gpu.device.destroy_buffer(sparse, None) };
}

/// Only accesses to a bound range itself must not race with the binding (vkQueueBindSparse): the
/// rest of the buffer, which was bound in one piece with it, stays readable all the time.
#[test]
fn a_buffer_is_read_while_another_queue_binds_a_part() {
    let Some(gpu) = gpu_with_sparse_binding() else {
        return;
    };
    let Some(gpu) = gpu.with("two queues", |gpu| gpu.second_queue.is_some()) else {
        return;
    };
    let Some(gpu) = gpu.with("sparse residency of buffers", |gpu| {
        gpu.features.sparse_residency_buffer != 0
    }) else {
        return;
    };
    let uses = vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS;
    let info = vk::BufferCreateInfo::default()
        .flags(vk::BufferCreateFlags::SPARSE_BINDING | vk::BufferCreateFlags::SPARSE_RESIDENCY)
        .size(3 << 20)
        .usage(uses | vk::BufferUsageFlags::TRANSFER_DST);
    // SAFETY: `info` outlives the call; the buffer is destroyed at the end.
    let (sparse, needs) = unsafe {
        let buffer = (gpu.device.create_buffer(&info, None)).expect("vkCreateBuffer");
        (buffer, gpu.device.get_buffer_memory_requirements(buffer))
    };
    let block = needs.alignment;
    let memory = gpu.allocate(needs, true);
    let whole = [piece(0, needs.size, memory, 0)];
    bind_buffer(&gpu, sparse, &whole);
    // The block in the middle, which is taken away and given back.
    let middle = needs.size / block / 2 * block;
    gpu.run(|commands| {
        // SAFETY: the buffer is bound, and lives as long as the device.
        unsafe {
            (gpu.device).cmd_fill_buffer(commands, sparse, 0, vk::WHOLE_SIZE, 7);
        }
    });

    let source = "
        layout(local_size_x = 64) in;
        layout(buffer_reference, std430) buffer Words { uint words[]; };
        layout(push_constant) uniform Push { Words read; Words counts; uint first; uint last; uint all; };
        void main() {
            uint at = gl_GlobalInvocationID.x * 97;
            uint good = 0;
            for (uint i = 0; i < 1024; i++) {
                at = (at + 4099) % all;
                if (at >= first && at < last) at = last % all;
                good += read.words[at] == 7 ? 1 : 0;
            }
            counts.words[gl_GlobalInvocationID.x] = good;
        }";
    let kernel = gpu.kernel(source, &[]);
    let counts = gpu.buffer(4 * 64 * 16);
    let address = vk::BufferDeviceAddressInfo::default().buffer(sparse);
    // SAFETY: the buffer is of this device.
    let address = unsafe { gpu.device.get_buffer_device_address(&address) };
    let words = |bytes: u64| bytes / 4;
    let push = [
        address,
        counts.address,
        words(middle) | words(middle + block) << 32,
        words(info.size),
    ];
    let (device, queue) = (&gpu.device.clone(), gpu.second_queue);
    std::thread::scope(|scope| {
        let binder = scope.spawn(move || {
            // SAFETY: only this thread uses the queue; the fence is destroyed behind the last wait.
            unsafe {
                let fence = device.create_fence(&vk::FenceCreateInfo::default(), None);
                let fence = [fence.expect("vkCreateFence")];
                for _ in 0..100 {
                    for memory in [vk::DeviceMemory::null(), memory] {
                        let binds = [piece(middle, block, memory, middle)];
                        let buffers = [vk::SparseBufferMemoryBindInfo::default()
                            .buffer(sparse)
                            .binds(&binds)];
                        let info = [vk::BindSparseInfo::default().buffer_binds(&buffers)];
                        let queue = queue.expect("two queues");
                        (device.queue_bind_sparse(queue, &info, fence[0]))
                            .expect("vkQueueBindSparse");
                        (device.wait_for_fences(&fence, true, PATIENCE_NS))
                            .expect("the bindings are made");
                        device.reset_fences(&fence).expect("vkResetFences");
                    }
                }
                device.destroy_fence(fence[0], None);
            }
        });
        let mut rounds = 0;
        while rounds < 10 || !binder.is_finished() {
            gpu.dispatch(kernel, &[], &push, [16, 1, 1]);
            assert!(counts.read::<u32>() == [1024; 64 * 16], "round {rounds}");
            rounds += 1;
        }
    });
    // The block has the memory again that it had at first.
    gpu.dispatch(kernel, &[], &[push[0], push[1], 0, push[3]], [16, 1, 1]);
    assert_eq!(counts.read::<u32>(), [1024; 64 * 16]);
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

/// An image of which every second block has memory, in reverse order.
struct Checkered {
    image: vk::Image,
    /// Texels of a block.
    block: vk::Extent3D,
    size: [u32; 2],
    /// First texels of the blocks with memory.
    corners: Vec<[u32; 2]>,
}

/// Blocks along each axis of a [`Checkered`] image.
const BLOCKS: u32 = 3;

impl Checkered {
    const FORMAT: vk::Format = vk::Format::R8G8B8A8_UNORM;

    fn new(gpu: &Gpu, usage: vk::ImageUsageFlags) -> Self {
        // SAFETY: the physical device is of this instance.
        let blocks = unsafe {
            (gpu.instance).get_physical_device_sparse_image_format_properties(
                gpu.physical,
                Self::FORMAT,
                vk::ImageType::TYPE_2D,
                vk::SampleCountFlags::TYPE_1,
                usage,
                vk::ImageTiling::OPTIMAL,
            )
        };
        let block = blocks[0].image_granularity;
        // The last column is not a whole block.
        let [width, height] = [(BLOCKS - 1) * block.width + 5, BLOCKS * block.height];
        let info = flat_info(Self::FORMAT, width, height)
            .flags(vk::ImageCreateFlags::SPARSE_BINDING | vk::ImageCreateFlags::SPARSE_RESIDENCY)
            .usage(usage);
        // SAFETY: `info` outlives the call; the test destroys the image.
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
        let corners: Vec<_> = (0..BLOCKS * BLOCKS)
            .step_by(2)
            .map(|index| [index % BLOCKS * block.width, index / BLOCKS * block.height])
            .collect();
        let count = corners.len() as u64;
        let memory = gpu.allocate(
            vk::MemoryRequirements {
                size: count * needs.alignment,
                ..needs
            },
            false,
        );
        let it = Self {
            image,
            block,
            size: [width, height],
            corners,
        };
        let binds: Vec<_> = (it.corners.iter().zip(0..))
            .map(|(&corner, index)| {
                let (offset, extent) = it.part(corner);
                vk::SparseImageMemoryBind::default()
                    .subresource(vk::ImageSubresource::default().aspect_mask(COLOR))
                    .offset(offset)
                    .extent(extent)
                    .memory(memory)
                    .memory_offset((count - 1 - index) * needs.alignment)
            })
            .collect();
        let images = [vk::SparseImageMemoryBindInfo::default()
            .image(image)
            .binds(&binds)];
        bind(gpu, vk::BindSparseInfo::default().image_binds(&images));
        gpu.to_general(image, WHOLE);
        it
    }

    /// The block at a corner, as far as the image goes.
    fn part(&self, [x, y]: [u32; 2]) -> (vk::Offset3D, vk::Extent3D) {
        let offset = vk::Offset3D {
            x: x as i32,
            y: y as i32,
            z: 0,
        };
        let extent = vk::Extent3D {
            width: self.block.width.min(self.size[0] - x),
            height: self.block.height.min(self.size[1] - y),
            depth: 1,
        };
        (offset, extent)
    }
}

const COLOR: vk::ImageAspectFlags = vk::ImageAspectFlags::COLOR;

const WHOLE: vk::ImageSubresourceRange = vk::ImageSubresourceRange {
    aspect_mask: COLOR,
    base_mip_level: 0,
    level_count: 1,
    base_array_layer: 0,
    layer_count: 1,
};

fn gpu_with_sparse_residency() -> Option<Gpu> {
    gpu_with_sparse_binding()?.with("sparse residency of 2D images", |gpu| {
        gpu.features.sparse_residency_image2_d != 0
    })
}

/// Data that is written to blocks with memory is read there.
#[test]
fn an_image_is_resident_in_parts() {
    let Some(gpu) = gpu_with_sparse_residency() else {
        return;
    };
    let usage = vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST;
    let checkered = Checkered::new(&gpu, usage);
    let image = checkered.image;
    let mut size = 0;
    let regions: Vec<_> = (checkered.corners.iter())
        .map(|&corner| {
            let (offset, extent) = checkered.part(corner);
            let region = vk::BufferImageCopy::default()
                .buffer_offset(size)
                .image_subresource(
                    vk::ImageSubresourceLayers::default()
                        .aspect_mask(COLOR)
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

/// Shaders learn which texels have memory: of fetches, gathers, samples and storage images.
#[test]
fn residency_codes_tell_which_texels_have_memory() {
    let Some(gpu) = gpu_with_sparse_residency() else {
        return;
    };
    let Some(gpu) = gpu.with("residency in shaders", |gpu| {
        gpu.features.shader_resource_residency != 0
    }) else {
        return;
    };
    let usage = vk::ImageUsageFlags::TRANSFER_DST
        | vk::ImageUsageFlags::SAMPLED
        | vk::ImageUsageFlags::STORAGE;
    let checkered = Checkered::new(&gpu, usage);
    let red = vk::ClearColorValue {
        float32: [1.0, 0.0, 0.0, 1.0],
    };
    let layout = vk::ImageLayout::GENERAL;
    gpu.run(|commands| {
        // SAFETY: the image lives until the end of the test.
        unsafe {
            (gpu.device).cmd_clear_color_image(commands, checkered.image, layout, &red, &[WHOLE]);
        }
    });
    let view = gpu.view(
        &vk::ImageViewCreateInfo::default()
            .image(checkered.image)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(Checkered::FORMAT)
            .subresource_range(WHOLE),
    );
    let edge = vk::SamplerAddressMode::CLAMP_TO_EDGE;
    let [nearest, linear] = [vk::Filter::NEAREST, vk::Filter::LINEAR].map(|filter| {
        gpu.sampler(
            &vk::SamplerCreateInfo::default()
                .mag_filter(filter)
                .min_filter(filter)
                .address_mode_u(edge)
                .address_mode_v(edge),
        )
    });
    let codes = gpu.buffer(u64::from(4 * BLOCKS * BLOCKS));
    let source = "
        #extension GL_ARB_sparse_texture2 : require
        layout(binding = 0) uniform sampler2D texels;
        layout(binding = 1, rgba8) uniform readonly image2D stored;
        layout(binding = 2) writeonly buffer Codes { uint codes[]; };
        layout(binding = 3) uniform sampler2D smoothed;
        layout(push_constant) uniform Sizes { ivec2 block; ivec2 size; };
        uint result(int code, vec4 texel) {
            return sparseTexelsResidentARB(code) && texel == vec4(1, 0, 0, 1) ? 1 : 0;
        }
        void main() {
            ivec2 at = ivec2(gl_WorkGroupID.xy);
            ivec2 texel = min(at * block + block / 2, size - 1);
            vec2 centre = (vec2(texel) + 0.5) / vec2(size);
            vec2 corner = vec2(at * block) / vec2(size);
            vec4 value;
            uint all = 0;
            int code = sparseTexelFetchARB(texels, texel, 0, value);
            all |= result(code, value);
            code = sparseImageLoadARB(stored, texel, value);
            all |= result(code, value) << 1;
            code = sparseTextureLodARB(texels, centre, 0, value);
            all |= result(code, value) << 2;
            code = sparseTextureGatherARB(texels, corner, value, 0);
            all |= result(code, value.x == 1 ? vec4(1, 0, 0, 1) : vec4(0)) << 3;
            code = sparseTextureLodARB(smoothed, corner, 0, value);
            all |= result(code, value) << 4;
            codes[at.y * 3 + at.x] = all;
        }";
    let set = gpu.set_of(&[
        Bound::Sampled(view, nearest),
        Bound::StorageImage(view),
        codes.into(),
        Bound::Sampled(view, linear),
    ]);
    let kernel = gpu.kernel(source, &[set.layout]);
    let push = [
        checkered.block.width,
        checkered.block.height,
        checkered.size[0],
        checkered.size[1],
    ];
    gpu.dispatch(kernel, &[set], &push, [BLOCKS, BLOCKS, 1]);
    // The four texels around a block's corner are all of one block only at the image's first.
    let wanted = [0b11111, 0, 0b00111, 0, 0b00111, 0, 0b00111, 0, 0b00111];
    assert_eq!(codes.read::<u32>(), wanted);
    // SAFETY: nothing uses it any more.
    unsafe { gpu.device.destroy_image(checkered.image, None) };
}
