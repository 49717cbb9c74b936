//! `VK_KHR_maintenance8` and `VK_KHR_maintenance9`, as far as commands and queries go.

use tuff_tests::*;

/// `VK_QUERY_POOL_CREATE_RESET_BIT_KHR`.
const QUERY_POOL_CREATE_RESET_KHR: vk::QueryPoolCreateFlags = vk::QueryPoolCreateFlags::from_raw(1);

fn newer() -> Gpu {
    Gpu::validated_since(vk::make_api_version(0, 1, 4, 330))
}

fn layers(aspect: vk::ImageAspectFlags) -> vk::ImageSubresourceLayers {
    vk::ImageSubresourceLayers::default()
        .aspect_mask(aspect)
        .layer_count(1)
}

/// Depth and stencil are copied to colours of as many bits, and back.
#[test]
fn depth_and_stencil_are_copied_to_colors() {
    let gpu = newer();
    let Some(gpu) = gpu.with("VK_KHR_maintenance8", |gpu| {
        gpu.optional.maintenance8.maintenance8 != 0
    }) else {
        return;
    };
    use vk::ImageAspectFlags as Aspect;
    for (special, aspect, color, bytes) in [
        (
            vk::Format::D16_UNORM,
            Aspect::DEPTH,
            vk::Format::R16_UNORM,
            2,
        ),
        (
            vk::Format::D32_SFLOAT,
            Aspect::DEPTH,
            vk::Format::R32_SFLOAT,
            4,
        ),
        (vk::Format::S8_UINT, Aspect::STENCIL, vk::Format::R8_UINT, 1),
    ] {
        if !gpu.supports(special, vk::FormatFeatureFlags::DEPTH_STENCIL_ATTACHMENT) {
            continue;
        }
        const SIDE: u32 = 12;
        let usage = vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST;
        let image = |format, aspect| {
            let image = gpu.image(&flat_info(format, SIDE, SIDE).usage(usage));
            let range = vk::ImageSubresourceRange::default()
                .aspect_mask(aspect)
                .level_count(1)
                .layer_count(1);
            gpu.to_general(image, range);
            image
        };
        let (depth, colors) = (image(special, aspect), image(color, Aspect::COLOR));
        let back = image(special, aspect);
        // Numbers from 0 to 1, whatever their format.
        let texels: Vec<u8> = (0..SIDE * SIDE)
            .flat_map(|index| match special {
                vk::Format::D32_SFLOAT => (index as f32 / 200.0).to_le_bytes().to_vec(),
                _ => (index * 311).to_le_bytes()[..bytes].to_vec(),
            })
            .collect();
        let input = gpu.buffer_with(&texels);
        let output = gpu.buffer(texels.len() as u64);
        let extent = vk::Extent3D {
            width: SIDE,
            height: SIDE,
            depth: 1,
        };
        let buffer_copy = |aspect| {
            [vk::BufferImageCopy::default()
                .image_subresource(layers(aspect))
                .image_extent(extent)]
        };
        let image_copy = |from, to| {
            [vk::ImageCopy::default()
                .src_subresource(layers(from))
                .dst_subresource(layers(to))
                .extent(extent)]
        };
        let layout = vk::ImageLayout::GENERAL;
        gpu.run(|commands| {
            // SAFETY: the resources are bound and live as long as the device.
            unsafe {
                let device = &gpu.device;
                let region = buffer_copy(aspect);
                device.cmd_copy_buffer_to_image(commands, input.handle, depth, layout, &region);
                gpu.barrier(commands);
                let region = image_copy(aspect, Aspect::COLOR);
                device.cmd_copy_image(commands, depth, layout, colors, layout, &region);
                gpu.barrier(commands);
                let region = image_copy(Aspect::COLOR, aspect);
                device.cmd_copy_image(commands, colors, layout, back, layout, &region);
                gpu.barrier(commands);
                let region = buffer_copy(aspect);
                device.cmd_copy_image_to_buffer(commands, back, layout, output.handle, &region);
            }
        });
        assert!(output.read::<u8>() == texels, "{special:?}");
    }
}

/// Queries of a pool that is made to are reset from the start.
#[test]
fn queries_begin_reset() {
    let gpu = newer();
    let Some(gpu) = gpu.with("VK_KHR_maintenance9", |gpu| {
        gpu.optional.maintenance9.maintenance9 != 0
    }) else {
        return;
    };
    let info = vk::QueryPoolCreateInfo::default()
        .flags(QUERY_POOL_CREATE_RESET_KHR)
        .query_type(vk::QueryType::TIMESTAMP)
        .query_count(2);
    // SAFETY: `info` outlives the call, and the pool is destroyed when its commands are done.
    unsafe {
        let device = &gpu.device;
        let pool = device
            .create_query_pool(&info, None)
            .expect("vkCreateQueryPool");
        let mut values = [[7u64; 2]; 2];
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WITH_AVAILABILITY;
        let got = device.get_query_pool_results(pool, 0, &mut values, flags);
        assert!(got.is_ok() || got == Err(vk::Result::NOT_READY));
        assert_eq!(values.map(|value| value[1]), [0, 0]);
        gpu.run(|commands| {
            let stage = vk::PipelineStageFlags::BOTTOM_OF_PIPE;
            device.cmd_write_timestamp(commands, stage, pool, 1);
        });
        let _ = device.get_query_pool_results(pool, 0, &mut values, flags);
        assert_eq!(values.map(|value| value[1] != 0), [false, true]);
        device.destroy_query_pool(pool, None);
    }
}
