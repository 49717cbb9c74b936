//! Images of formats that are compressed or have planes: fetched, sampled, viewed by blocks,
//! converted, and copied by the host.

use tuff_tests::*;
use vk::Format as F;

const BOTH_COPIES: vk::ImageUsageFlags = vk::ImageUsageFlags::from_raw(
    vk::ImageUsageFlags::TRANSFER_SRC.as_raw() | vk::ImageUsageFlags::TRANSFER_DST.as_raw(),
);

/// The texels of a picture's first level, fetched by a shader.
fn fetched(gpu: &Gpu, picture: &Picture) -> Vec<[f32; 4]> {
    let [width, height, _] = picture.shape.extent;
    let output = gpu.buffer(16 * u64::from(width) * u64::from(height));
    let sampler = gpu.sampler(&vk::SamplerCreateInfo::default());
    gpu.compute_with(
        "layout(local_size_x = 1) in;
        layout(set = 0, binding = 0) uniform sampler2D t;
        layout(set = 0, binding = 1) buffer O { vec4 o[]; };
        void main() {
            uvec2 at = gl_WorkGroupID.xy;
            o[at.y * gl_NumWorkGroups.x + at.x] = texelFetch(t, ivec2(at), 0);
        }",
        &[
            (0, &[Bound::Sampled(picture.view, sampler)]),
            (1, &[Bound::Storage(output)]),
        ],
        [width, height, 1],
    );
    output.read()
}

/// Blocks of each kind, and their first texels, worked out by hand from the Khronos Data Format
/// specification.
#[test]
fn blocks_decode_as_the_data_format_specification_says() {
    let big_endian = |bytes: u64| u128::from(bytes.swap_bytes());
    let third = 1.0 / 3.0;
    // Name, format, footprint, bytes of a block, block, texels of the first row.
    let cases: [(F, _, usize, u128, [_; 4]); 7] = [
        (
            // Red to blue: both ends, and the two between.
            F::BC1_RGBA_UNORM_BLOCK,
            [4, 4],
            8,
            0xf800 | 0x001f << 16 | 0b11_10_01_00 << 32,
            [
                [1.0, 0.0, 0.0, 1.0],
                [0.0, 0.0, 1.0, 1.0],
                [2.0 * third, 0.0, third, 1.0],
                [third, 0.0, 2.0 * third, 1.0],
            ],
        ),
        (
            // -1 and 1 with indices 0, 1, 6, 7: four steps, then the ends of the range.
            F::BC4_SNORM_BLOCK,
            [4, 4],
            8,
            0x7f81 | (1 << 3 | 6 << 6 | 7 << 9) << 16,
            [-1.0, 1.0, -1.0, 1.0].map(|red| [red, 0.0, 0.0, 1.0]),
        ),
        (
            // Mode 5, one colour of 7 bits, alpha of 8.
            F::BC7_UNORM_BLOCK,
            [4, 4],
            16,
            1 << 5 | 0x7f << 8 | 0x40 << 22 | 0x80 << 50,
            [[1.0, 129.0 / 255.0, 0.0, 128.0 / 255.0]; 4],
        ),
        (
            // Individual mode, table 0, all indices 0 but the first texel's, which is 3.
            F::ETC2_R8G8B8_UNORM_BLOCK,
            [4, 4],
            8,
            big_endian(0x8f40_2000_0001_0001),
            [
                [128.0, 60.0, 26.0],
                [138.0, 70.0, 36.0],
                [255.0, 2.0, 2.0],
                [255.0, 2.0, 2.0],
            ]
            .map(|[r, g, b]| [r / 255.0, g / 255.0, b / 255.0, 1.0]),
        ),
        (
            // Base -128, which is -127, multiplier 0: an eighth; index 4 of table 0 in the first
            // texel, then 0.
            F::EAC_R11_SNORM_BLOCK,
            [4, 4],
            8,
            big_endian(0x8000_8000_0000_0000),
            [-1014.0, -1019.0, -1019.0, -1019.0].map(|red| [red / 1023.0, 0.0, 0.0, 1.0]),
        ),
        (
            F::ASTC_6X5_UNORM_BLOCK,
            [6, 5],
            16,
            0xdfc | ((1 << 52) - 1) << 12 | 0xffff << 64 | 0x8000 << 80 | 0x4000 << 112,
            [[1.0, 0.5, 0.0, 0.25]; 4],
        ),
        (
            // The error colour: a reserved block mode.
            F::ASTC_4X4_UNORM_BLOCK,
            [4, 4],
            16,
            0,
            [[1.0, 0.0, 1.0, 1.0]; 4],
        ),
    ];
    let gpu = Gpu::new();
    for (format, [width, height], size, block, expected) in cases {
        if !has(
            &format!("{format:?}"),
            gpu.supports(format, vk::FormatFeatureFlags::SAMPLED_IMAGE),
        ) {
            continue;
        }
        // Two blocks by one, of which the second is cut.
        let shape = Shape::flat(format, width + 1, height);
        let picture = gpu.picture(shape, vk::ImageUsageFlags::SAMPLED);
        let bytes = [block.to_le_bytes(); 2];
        let blocks = [&bytes[0][..size], &bytes[1][..size]].concat();
        gpu.upload(&picture, 0, &blocks);
        let texels = fetched(&gpu, &picture);
        for (x, expected) in [0, 1, 2, 3, width as usize]
            .into_iter()
            .zip(expected.into_iter().chain(std::iter::once(expected[0])))
        {
            let far = texels[x]
                .iter()
                .zip(expected)
                .any(|(a, b)| (a - b).abs() > 1.5 / 255.0);
            assert!(!far, "{format:?} {x}: {:?}, not {expected:?}", texels[x]);
        }
        // Blocks come back as they went.
        assert_eq!(
            gpu.download(&picture, 0, 2).read::<u8>()[..2 * size],
            blocks
        );
    }
}

/// An image of its own making: bound, in the general layout.
fn image(gpu: &Gpu, info: &vk::ImageCreateInfo, aspect: vk::ImageAspectFlags) -> vk::Image {
    let image = gpu.image(info);
    let range = vk::ImageSubresourceRange::default()
        .aspect_mask(aspect)
        .level_count(info.mip_levels)
        .layer_count(info.array_layers);
    gpu.to_general(image, range);
    image
}

fn layers(aspect: vk::ImageAspectFlags) -> vk::ImageSubresourceLayers {
    vk::ImageSubresourceLayers::default()
        .aspect_mask(aspect)
        .layer_count(1)
}

/// A region of the whole of a plane.
fn whole(aspect: vk::ImageAspectFlags, width: u32, height: u32) -> vk::BufferImageCopy {
    vk::BufferImageCopy::default()
        .image_subresource(layers(aspect))
        .image_extent(vk::Extent3D {
            width,
            height,
            depth: 1,
        })
}

/// Blocks are texels of an uncompressed format to a view, to which shaders can write.
#[test]
fn blocks_are_written_through_views() {
    let format = F::BC1_RGBA_UNORM_BLOCK;
    let info = flat_info(format, 10, 7)
        .flags(
            vk::ImageCreateFlags::MUTABLE_FORMAT
                | vk::ImageCreateFlags::EXTENDED_USAGE
                | vk::ImageCreateFlags::BLOCK_TEXEL_VIEW_COMPATIBLE,
        )
        .usage(BOTH_COPIES | vk::ImageUsageFlags::STORAGE | vk::ImageUsageFlags::SAMPLED);
    let Some(gpu) = Gpu::new().with("views of BC1 blocks", |gpu| {
        // SAFETY: a plain query.
        let properties = unsafe {
            gpu.instance.get_physical_device_image_format_properties(
                gpu.physical,
                format,
                info.image_type,
                info.tiling,
                info.usage,
                info.flags,
            )
        };
        properties.is_ok()
    }) else {
        return;
    };
    let color = vk::ImageAspectFlags::COLOR;
    let handle = image(&gpu, &info, color);
    let mut usage = vk::ImageViewUsageCreateInfo::default().usage(vk::ImageUsageFlags::STORAGE);
    let view_info = vk::ImageViewCreateInfo::default()
        .image(handle)
        .view_type(vk::ImageViewType::TYPE_2D)
        .format(F::R32G32_UINT)
        .subresource_range(
            vk::ImageSubresourceRange::default()
                .aspect_mask(color)
                .level_count(1)
                .layer_count(1),
        )
        .push_next(&mut usage);
    let view = gpu.view(&view_info);
    let size = gpu.buffer(8);
    gpu.compute_with(
        "layout(local_size_x = 1) in;
        layout(set = 0, binding = 0, rg32ui) uniform uimage2D t;
        layout(set = 0, binding = 1) buffer O { ivec2 size; };
        void main() {
            ivec2 at = ivec2(gl_WorkGroupID.xy);
            imageStore(t, at, uvec4(at, 0, 0));
            size = imageSize(t);
        }",
        &[
            (0, &[Bound::StorageImage(view)]),
            (1, &[Bound::Storage(size)]),
        ],
        [3, 2, 1],
    );
    assert_eq!(size.read::<i32>(), [3, 2]);
    let buffer = gpu.buffer(8 * 6);
    gpu.run(|commands| {
        // SAFETY: the buffer holds the blocks.
        unsafe {
            gpu.device.cmd_copy_image_to_buffer(
                commands,
                handle,
                vk::ImageLayout::GENERAL,
                buffer.handle,
                &[whole(color, 10, 7)],
            );
        }
    });
    let expected: Vec<[u32; 2]> = (0..6).map(|i| [i % 3, i / 3]).collect();
    assert_eq!(buffer.read::<[u32; 2]>(), expected);
}

/// Two planes, BT.601 of narrow range: codes of grey, red and blue (ITU-R BT.601-7) become them,
/// chroma in the middle of its texels.
#[test]
fn planes_are_converted() {
    let Some(gpu) = Gpu::new().with("samplerYcbcrConversion", |gpu| {
        gpu.features11.sampler_ycbcr_conversion == vk::TRUE
    }) else {
        return;
    };
    let format = F::G8_B8R8_2PLANE_420_UNORM;
    let info = flat_info(format, 6, 2).usage(BOTH_COPIES | vk::ImageUsageFlags::SAMPLED);
    let color = vk::ImageAspectFlags::COLOR;
    let handle = image(&gpu, &info, color);
    // Luma of six columns, two rows; C'B and C'R of three.
    let luma = gpu.buffer_with(&[126u8, 126, 81, 81, 41, 41, 126, 126, 81, 81, 41, 41]);
    let chroma = gpu.buffer_with(&[128u8, 128, 90, 240, 240, 110, 0, 0]);
    gpu.run(|commands| {
        let planes = [
            (luma, whole(vk::ImageAspectFlags::PLANE_0, 6, 2)),
            (chroma, whole(vk::ImageAspectFlags::PLANE_1, 3, 1)),
        ];
        for (buffer, region) in planes {
            // SAFETY: the buffers hold the planes.
            unsafe {
                gpu.device.cmd_copy_buffer_to_image(
                    commands,
                    buffer.handle,
                    handle,
                    vk::ImageLayout::GENERAL,
                    &[region],
                );
            }
        }
    });
    let conversion_info = vk::SamplerYcbcrConversionCreateInfo::default()
        .format(format)
        .ycbcr_model(vk::SamplerYcbcrModelConversion::YCBCR_601)
        .ycbcr_range(vk::SamplerYcbcrRange::ITU_NARROW)
        .x_chroma_offset(vk::ChromaLocation::MIDPOINT)
        .y_chroma_offset(vk::ChromaLocation::MIDPOINT)
        .chroma_filter(vk::Filter::NEAREST);
    // SAFETY: the structures outlive the calls; all is destroyed when nothing uses it any more.
    unsafe {
        let conversion = gpu
            .device
            .create_sampler_ycbcr_conversion(&conversion_info, None)
            .expect("vkCreateSamplerYcbcrConversion");
        let mut of_sampler = vk::SamplerYcbcrConversionInfo::default().conversion(conversion);
        let mut of_view = of_sampler;
        let sampler = gpu.sampler(
            &vk::SamplerCreateInfo::default()
                .address_mode_u(vk::SamplerAddressMode::CLAMP_TO_EDGE)
                .address_mode_v(vk::SamplerAddressMode::CLAMP_TO_EDGE)
                .address_mode_w(vk::SamplerAddressMode::CLAMP_TO_EDGE)
                .push_next(&mut of_sampler),
        );
        let view_info = vk::ImageViewCreateInfo::default()
            .image(handle)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(format)
            .subresource_range(
                vk::ImageSubresourceRange::default()
                    .aspect_mask(color)
                    .level_count(1)
                    .layer_count(1),
            )
            .push_next(&mut of_view);
        let view = gpu
            .device
            .create_image_view(&view_info, None)
            .expect("vkCreateImageView");
        let samplers = [sampler];
        let bindings = [
            vk::DescriptorSetLayoutBinding::default()
                .binding(0)
                .descriptor_type(vk::DescriptorType::COMBINED_IMAGE_SAMPLER)
                .descriptor_count(1)
                .stage_flags(vk::ShaderStageFlags::COMPUTE)
                .immutable_samplers(&samplers),
            vk::DescriptorSetLayoutBinding::default()
                .binding(1)
                .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                .descriptor_count(1)
                .stage_flags(vk::ShaderStageFlags::COMPUTE),
        ];
        let layout_info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        let layout = gpu.set_layout_from(&layout_info);
        // Drivers may take several descriptors for one with a conversion.
        let sizes = [
            vk::DescriptorPoolSize {
                ty: vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
                descriptor_count: 4,
            },
            vk::DescriptorPoolSize {
                ty: vk::DescriptorType::STORAGE_BUFFER,
                descriptor_count: 1,
            },
        ];
        let handle = gpu.allocate_set(layout, &sizes);
        let set = Set { layout, handle };
        let output = gpu.buffer(16 * 12);
        gpu.write(set.handle, 0, 0, &Bound::Sampled(view, sampler));
        gpu.write(set.handle, 1, 0, &Bound::Storage(output));
        let kernel = gpu.kernel(
            "layout(local_size_x = 1) in;
            layout(set = 0, binding = 0) uniform sampler2D t;
            layout(set = 0, binding = 1) buffer O { vec4 o[]; };
            void main() {
                uvec2 at = gl_WorkGroupID.xy;
                o[at.y * 6 + at.x] = textureLod(t, (vec2(at) + 0.5) / vec2(6, 2), 0);
            }",
            &[layout],
        );
        gpu.dispatch::<u32>(kernel, &[set], &[], [6, 2, 1]);
        let grey = 110.0 / 219.0;
        let expected = [
            [grey, grey, grey, 1.0],
            [1.0, 0.0, 0.0, 1.0],
            [0.0, 0.0, 1.0, 1.0],
        ];
        for (i, texel) in output.read::<[f32; 4]>().into_iter().enumerate() {
            let expected = expected[i % 6 / 2];
            let far = texel
                .iter()
                .zip(expected)
                .any(|(a, b)| (a - b).abs() > 0.01);
            assert!(!far, "{i}: {texel:?}, not {expected:?}");
        }
        gpu.device.destroy_image_view(view, None);
        gpu.device
            .destroy_sampler_ycbcr_conversion(conversion, None);
    }
}

/// Texels go from memory to an image, to another, and back, without a queue.
#[test]
fn the_host_copies_images() {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 258));
    let Some(gpu) = gpu.with("VK_EXT_host_image_copy", |gpu| {
        gpu.optional.host_image_copy.host_image_copy == vk::TRUE
    }) else {
        return;
    };
    let host = ash::ext::host_image_copy::Device::new(&gpu.instance, &gpu.device);
    let usage = BOTH_COPIES | vk::ImageUsageFlags::HOST_TRANSFER_EXT;
    let info = flat_info(F::R8G8_UINT, 5, 3).usage(usage);
    let color = vk::ImageAspectFlags::COLOR;
    let (first, second) = (image(&gpu, &info, color), image(&gpu, &info, color));
    let general = vk::ImageLayout::GENERAL;
    let texels: Vec<u16> = (0..24).map(|i| 0x101 * i).collect();
    let extent = |width, height| vk::Extent3D {
        width,
        height,
        depth: 1,
    };
    // SAFETY: pointers reach as far as the regions do.
    unsafe {
        // Rows of eight texels in memory.
        let region = vk::MemoryToImageCopyEXT::default()
            .host_pointer(texels.as_ptr().cast())
            .memory_row_length(8)
            .image_subresource(layers(color))
            .image_extent(extent(5, 3));
        let regions = [region];
        let copy = vk::CopyMemoryToImageInfoEXT::default()
            .dst_image(first)
            .dst_image_layout(general)
            .regions(&regions);
        (host.fp().copy_memory_to_image_ext)(gpu.device.handle(), &copy)
            .result()
            .expect("vkCopyMemoryToImageEXT");
        let regions = [vk::ImageCopy2::default()
            .src_subresource(layers(color))
            .dst_subresource(layers(color))
            .extent(extent(5, 3))];
        let copy = vk::CopyImageToImageInfoEXT::default()
            .src_image(first)
            .src_image_layout(general)
            .dst_image(second)
            .dst_image_layout(general)
            .regions(&regions);
        (host.fp().copy_image_to_image_ext)(gpu.device.handle(), &copy)
            .result()
            .expect("vkCopyImageToImageEXT");
        // The middle of the image, tightly packed.
        let mut back = [0u16; 6];
        let region = vk::ImageToMemoryCopyEXT::default()
            .host_pointer(back.as_mut_ptr().cast())
            .image_subresource(layers(color))
            .image_offset(vk::Offset3D { x: 1, y: 1, z: 0 })
            .image_extent(extent(3, 2));
        let regions = [region];
        let copy = vk::CopyImageToMemoryInfoEXT::default()
            .src_image(second)
            .src_image_layout(general)
            .regions(&regions);
        (host.fp().copy_image_to_memory_ext)(gpu.device.handle(), &copy)
            .result()
            .expect("vkCopyImageToMemoryEXT");
        assert_eq!(back, [9, 10, 11, 17, 18, 19].map(|i| 0x101 * i));
    }
}

/// Views of single planes are attachments of the plane's size.
#[test]
fn planes_are_attachments() {
    let format = F::G8_B8R8_2PLANE_420_UNORM;
    let info = flat_info(format, 6, 4)
        .flags(vk::ImageCreateFlags::MUTABLE_FORMAT | vk::ImageCreateFlags::EXTENDED_USAGE)
        .usage(BOTH_COPIES | vk::ImageUsageFlags::COLOR_ATTACHMENT);
    let Some(gpu) = Gpu::new().drawing() else {
        return;
    };
    let Some(gpu) = gpu.with("attachments with planes", |gpu| {
        // SAFETY: a plain query.
        let properties = unsafe {
            gpu.instance.get_physical_device_image_format_properties(
                gpu.physical,
                format,
                info.image_type,
                info.tiling,
                info.usage,
                info.flags,
            )
        };
        properties.is_ok() && gpu.features11.sampler_ycbcr_conversion == vk::TRUE
    }) else {
        return;
    };
    let handle = image(&gpu, &info, vk::ImageAspectFlags::COLOR);
    let planes = [
        (vk::ImageAspectFlags::PLANE_0, F::R8_UNORM, [6, 4], 1),
        (vk::ImageAspectFlags::PLANE_1, F::R8G8_UNORM, [3, 2], 2),
    ];
    let fragment = "
        layout(location = 0) out vec4 color;
        void main() {
            vec2 at = floor(gl_FragCoord.xy);
            color = vec4(1.0 + at.x + 16.0 * at.y, 200.0 - at.x, 0.0, 0.0) / 255.0;
        }";
    let canvases = planes.map(|(aspects, format, [width, height], _)| {
        let range = vk::ImageSubresourceRange::default()
            .aspect_mask(aspects)
            .level_count(1)
            .layer_count(1);
        let view = vk::ImageViewCreateInfo::default()
            .image(handle)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(format)
            .subresource_range(range);
        Canvas {
            image: handle,
            view: gpu.view(&view),
            format,
            aspects,
            width,
            height,
            layers: 1,
            samples: 1,
        }
    });
    for canvas in &canvases {
        let pipeline = gpu.painting(&Painting::new(&gpu, COVER, fragment, canvas.format));
        gpu.paint(canvas, pipeline, |commands| gpu.draw_vertices(commands, 3));
    }
    for (aspect, _, [width, height], components) in planes {
        let buffer = gpu.buffer(24);
        gpu.run(|commands| {
            // SAFETY: the buffer holds the plane.
            unsafe {
                gpu.device.cmd_copy_image_to_buffer(
                    commands,
                    handle,
                    vk::ImageLayout::GENERAL,
                    buffer.handle,
                    &[whole(aspect, width, height)],
                );
            }
        });
        let texel = |i: u32| {
            let (x, y) = ((i % width) as u8, (i / width) as u8);
            [1 + x + 16 * y, 200 - x].into_iter().take(components)
        };
        let expected: Vec<u8> = (0..width * height).flat_map(texel).collect();
        assert_eq!(
            buffer.read::<u8>()[..expected.len()],
            expected,
            "{aspect:?}"
        );
    }
}
