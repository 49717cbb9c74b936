//! Images: copies, clears and blits.

use tuff_tests::*;
use vk::Format as F;

const SAMPLED: vk::ImageUsageFlags = vk::ImageUsageFlags::SAMPLED;

/// Colour formats and the bytes of a texel; those that a device must be able to transfer.
const FORMATS: [(F, u64); 34] = [
    (F::R8_UNORM, 1),
    (F::R8_SNORM, 1),
    (F::R8_UINT, 1),
    (F::R8_SINT, 1),
    (F::R8G8_UNORM, 2),
    (F::R8G8_UINT, 2),
    (F::R8G8B8A8_UNORM, 4),
    (F::R8G8B8A8_SNORM, 4),
    (F::R8G8B8A8_UINT, 4),
    (F::R8G8B8A8_SINT, 4),
    (F::R8G8B8A8_SRGB, 4),
    (F::B8G8R8A8_UNORM, 4),
    (F::B8G8R8A8_SRGB, 4),
    (F::A8B8G8R8_UNORM_PACK32, 4),
    (F::A8B8G8R8_SRGB_PACK32, 4),
    (F::A2B10G10R10_UNORM_PACK32, 4),
    (F::A2B10G10R10_UINT_PACK32, 4),
    (F::R5G6B5_UNORM_PACK16, 2),
    (F::A1R5G5B5_UNORM_PACK16, 2),
    (F::R16_UINT, 2),
    (F::R16_SFLOAT, 2),
    (F::R16G16_SFLOAT, 4),
    (F::R16G16B16A16_UINT, 8),
    (F::R16G16B16A16_SFLOAT, 8),
    (F::R32_UINT, 4),
    (F::R32_SINT, 4),
    (F::R32_SFLOAT, 4),
    (F::R32G32_SFLOAT, 8),
    (F::R32G32_UINT, 8),
    (F::R32G32B32A32_UINT, 16),
    (F::R32G32B32A32_SINT, 16),
    (F::R32G32B32A32_SFLOAT, 16),
    (F::B10G11R11_UFLOAT_PACK32, 4),
    (F::E5B9G9R9_UFLOAT_PACK32, 4),
];

fn bytes(random: &mut Rng, count: u64) -> Vec<u8> {
    (0..count).map(|_| random.u8(..)).collect()
}

#[test]
fn every_format_carries_its_texels() {
    let gpu = Gpu::new();
    let mut random = Rng::with_seed(21);
    for (format, texel) in FORMATS {
        let features = vk::FormatFeatureFlags::TRANSFER_SRC | vk::FormatFeatureFlags::TRANSFER_DST;
        assert!(
            gpu.supports(format, features),
            "{format:?} cannot be copied"
        );
        let picture = gpu.picture(Shape::flat(format, 13, 7), vk::ImageUsageFlags::empty());
        let texels = bytes(&mut random, 13 * 7 * texel);
        gpu.upload(&picture, 0, &texels);
        assert_eq!(
            gpu.download(&picture, 0, texel).read::<u8>()[..texels.len()],
            texels
        );
    }
}

#[test]
fn every_shape_carries_its_texels() {
    use vk::ImageViewType as View;
    let gpu = Gpu::new();
    let mut random = Rng::with_seed(22);
    for (kind, extent, levels, layers) in [
        (View::TYPE_1D, [37, 1, 1], 6, 1),
        (View::TYPE_1D_ARRAY, [16, 1, 1], 5, 7),
        (View::TYPE_2D, [33, 20, 1], 6, 1),
        (View::TYPE_2D_ARRAY, [9, 21, 1], 3, 5),
        (View::TYPE_3D, [11, 6, 5], 4, 1),
        (View::CUBE, [16, 16, 1], 5, 6),
        (View::CUBE_ARRAY, [8, 8, 1], 2, 12),
    ] {
        let shape = Shape {
            kind,
            format: F::R8G8B8A8_UNORM,
            extent,
            levels,
            layers,
        };
        let picture = gpu.picture(shape, SAMPLED);
        let level_bytes: Vec<Vec<u8>> = (0..levels)
            .map(|level| {
                let texels: u32 = extent.iter().map(|side| (side >> level).max(1)).product();
                bytes(&mut random, 4 * u64::from(texels * layers))
            })
            .collect();
        for (level, bytes) in level_bytes.iter().enumerate() {
            gpu.upload(&picture, level as u32, bytes);
        }
        for (level, bytes) in level_bytes.iter().enumerate() {
            let got = gpu.download(&picture, level as u32, 4).read::<u8>();
            assert_eq!(got, *bytes, "{kind:?} level {level}");
        }
    }
}

#[test]
fn parts_of_images_are_copied_with_strides() {
    let gpu = Gpu::new();
    let texels: Vec<u32> = (0..20 * 10).collect();
    let from = gpu.picture(Shape::flat(F::R32_UINT, 20, 10), SAMPLED);
    let to = gpu.picture(Shape::flat(F::R32_UINT, 16, 12), SAMPLED);
    gpu.upload(&from, 0, &texels);
    gpu.upload(&to, 0, &[9999u32; 16 * 12]);
    let output = gpu.buffer(4 * 30 * 9);
    let layers = vk::ImageSubresourceLayers::default()
        .aspect_mask(vk::ImageAspectFlags::COLOR)
        .layer_count(1);
    let extent = vk::Extent3D {
        width: 7,
        height: 5,
        depth: 1,
    };
    let copy = vk::ImageCopy::default()
        .src_subresource(layers)
        .src_offset(vk::Offset3D { x: 10, y: 3, z: 0 })
        .dst_subresource(layers)
        .dst_offset(vk::Offset3D { x: 2, y: 6, z: 0 })
        .extent(extent);
    let out = vk::BufferImageCopy::default()
        .buffer_offset(8)
        .buffer_row_length(30)
        .buffer_image_height(6)
        .image_subresource(layers)
        .image_offset(vk::Offset3D { x: 1, y: 5, z: 0 })
        .image_extent(extent);
    gpu.run(|commands| {
        let general = vk::ImageLayout::GENERAL;
        // SAFETY: the regions lie inside the images and the buffer.
        unsafe {
            gpu.device
                .cmd_copy_image(commands, from.handle, general, to.handle, general, &[copy]);
            gpu.barrier(commands);
            gpu.device.cmd_copy_image_to_buffer(
                commands,
                to.handle,
                general,
                output.handle,
                &[out],
            );
        }
    });
    let value = |x: i32, y: i32| match (x - 2, y - 6) {
        (dx @ 0..7, dy @ 0..5) => (dy as u32 + 3) * 20 + dx as u32 + 10,
        _ => 9999,
    };
    let got: Vec<u32> = output.read();
    for y in 0..5 {
        for x in 0..7 {
            assert_eq!(
                got[2 + y * 30 + x],
                value(x as i32 + 1, y as i32 + 5),
                "{x} {y}"
            );
        }
    }
}

#[test]
fn clears_fill_levels_and_layers() {
    let gpu = Gpu::new();
    let shape = Shape {
        kind: vk::ImageViewType::TYPE_2D_ARRAY,
        format: F::R8G8B8A8_UNORM,
        extent: [8, 8, 1],
        levels: 3,
        layers: 4,
    };
    let clear = |picture: &Picture, value: vk::ClearColorValue, level: u32, layer: u32| {
        let range = vk::ImageSubresourceRange::default()
            .aspect_mask(vk::ImageAspectFlags::COLOR)
            .base_mip_level(level)
            .level_count(1)
            .base_array_layer(layer)
            .layer_count(vk::REMAINING_ARRAY_LAYERS);
        gpu.run(|commands| {
            let general = vk::ImageLayout::GENERAL;
            // SAFETY: the range is one of the image.
            unsafe {
                gpu.device.cmd_clear_color_image(
                    commands,
                    picture.handle,
                    general,
                    &value,
                    &[range],
                );
            }
        });
    };
    let float = |float32: [f32; 4]| vk::ClearColorValue { float32 };
    let picture = gpu.picture(shape, SAMPLED);
    for level in 0..3 {
        clear(&picture, float([0.0; 4]), level, 0);
    }
    clear(&picture, float([1.0, 0.5, -3.0, 0.2]), 1, 2);
    let got: Vec<[u8; 4]> = gpu.download(&picture, 1, 4).read();
    for (i, texel) in got.iter().enumerate() {
        let half = texel[1] == 127 || texel[1] == 128;
        let right = i < 32 && *texel == [0; 4] || i >= 32 && half && texel[0] == 255;
        assert!(right && (i < 32 || texel[2..] == [0, 51]), "{i}: {texel:?}");
    }
    assert!(
        gpu.download(&picture, 0, 4)
            .read::<u32>()
            .iter()
            .all(|texel| *texel == 0)
    );

    let single = |format: F| gpu.picture(Shape::flat(format, 4, 4), SAMPLED);
    let wide = single(F::R32G32B32A32_SFLOAT);
    clear(&wide, float([1.5, -2.0, 1e10, 0.25]), 0, 0);
    assert_eq!(
        gpu.download(&wide, 0, 16).read::<[f32; 4]>()[5],
        [1.5, -2.0, 1e10, 0.25]
    );
    let whole = single(F::R16G16B16A16_UINT);
    clear(
        &whole,
        vk::ClearColorValue {
            uint32: [1, 2, 65535, 7],
        },
        0,
        0,
    );
    assert_eq!(
        gpu.download(&whole, 0, 8).read::<[u16; 4]>()[15],
        [1, 2, 65535, 7]
    );
    let halves = single(F::R16G16B16A16_SFLOAT);
    clear(&halves, float([0.5, 1.0, -4.0, 0.0]), 0, 0);
    assert_eq!(
        gpu.download(&halves, 0, 8).read::<[u16; 4]>()[3],
        [0x3800, 0x3c00, 0xc400, 0]
    );
    let swapped = single(F::B8G8R8A8_UNORM);
    clear(&swapped, float([1.0, 0.0, 0.2, 1.0]), 0, 0);
    assert_eq!(
        gpu.download(&swapped, 0, 4).read::<[u8; 4]>()[3],
        [51, 0, 255, 255]
    );
    let packed = single(F::A2B10G10R10_UNORM_PACK32);
    clear(&packed, float([1.0, 0.0, 1.0, 1.0]), 0, 0);
    assert_eq!(gpu.download(&packed, 0, 4).read::<u32>()[3], 0xfff0_03ff);
    let coded = single(F::R8G8B8A8_SRGB);
    clear(&coded, float([0.0, 1.0, 0.2140, 0.5]), 0, 0);
    let texel = gpu.download(&coded, 0, 4).read::<[u8; 4]>()[3];
    assert!(texel[..2] == [0, 255] && texel[2].abs_diff(127) <= 1 && texel[3].abs_diff(128) <= 1);
}

#[test]
fn blits_scale_flip_and_convert() {
    let Some(gpu) = Gpu::new().with("a graphics queue", Gpu::has_graphics) else {
        return;
    };
    let texels: Vec<[u8; 4]> = (0..64u8)
        .map(|i| [i * 4, 255 - i * 4, (i % 8) * 30, 255])
        .collect();
    let from = gpu.picture(Shape::flat(F::R8G8B8A8_UNORM, 8, 8), SAMPLED);
    gpu.upload(&from, 0, texels.as_flattened());
    let to = gpu.picture(Shape::flat(F::R32G32B32A32_SFLOAT, 16, 16), SAMPLED);
    let layers = vk::ImageSubresourceLayers::default()
        .aspect_mask(vk::ImageAspectFlags::COLOR)
        .layer_count(1);
    let corner = |x: i32, y: i32, z: i32| vk::Offset3D { x, y, z };
    let blit = |src: [vk::Offset3D; 2], dst: [vk::Offset3D; 2], filter: vk::Filter| {
        let region = vk::ImageBlit::default()
            .src_subresource(layers)
            .src_offsets(src)
            .dst_subresource(layers)
            .dst_offsets(dst);
        gpu.run(|commands| {
            let general = vk::ImageLayout::GENERAL;
            // SAFETY: the regions lie inside the images.
            unsafe {
                gpu.device.cmd_blit_image(
                    commands,
                    from.handle,
                    general,
                    to.handle,
                    general,
                    &[region],
                    filter,
                );
            }
        });
        gpu.download(&to, 0, 16).read::<[f32; 4]>()
    };
    let source = |x: usize, y: usize| texels[y * 8 + x].map(|c| f32::from(c) / 255.0);
    let near =
        |a: [f32; 4], b: [f32; 4], error: f32| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= error);
    let (src, dst) = (
        [corner(0, 0, 0), corner(8, 8, 1)],
        [corner(0, 0, 0), corner(16, 16, 1)],
    );
    let doubled = blit(src, dst, vk::Filter::NEAREST);
    let mirrored = blit(
        src,
        [corner(16, 0, 0), corner(0, 16, 1)],
        vk::Filter::NEAREST,
    );
    for y in 0..16 {
        for x in 0..16 {
            let expected = source(x / 2, y / 2);
            assert!(near(doubled[y * 16 + x], expected, 1e-6), "{x} {y}");
            assert!(near(mirrored[y * 16 + 15 - x], expected, 1e-6), "{x} {y}");
        }
    }
    let linear = blit(src, dst, vk::Filter::LINEAR);
    for y in 1..15 {
        for x in 1..15 {
            let (u, v) = (x as f32 * 0.5 - 0.25, y as f32 * 0.5 - 0.25);
            let (i, j) = (u.floor() as usize, v.floor() as usize);
            let (a, b) = (u.fract(), v.fract());
            let expected = std::array::from_fn(|c| {
                let row = |j: usize| source(i, j)[c] * (1.0 - a) + source(i + 1, j)[c] * a;
                row(j) * (1.0 - b) + row(j + 1) * b
            });
            assert!(near(linear[y * 16 + x], expected, 0.008), "{x} {y}");
        }
    }
}

/// Images of the formats that every implementation must have as attachments are images like any
/// other.
#[test]
fn attachment_formats_can_be_cleared_viewed_and_copied() {
    use vk::FormatFeatureFlags as Has;
    let gpu = Gpu::new();
    for (format, has) in [
        (
            vk::Format::R8G8B8A8_UNORM,
            Has::COLOR_ATTACHMENT | Has::COLOR_ATTACHMENT_BLEND,
        ),
        (
            vk::Format::B8G8R8A8_SRGB,
            Has::COLOR_ATTACHMENT | Has::COLOR_ATTACHMENT_BLEND,
        ),
        (
            vk::Format::A2B10G10R10_UNORM_PACK32,
            Has::COLOR_ATTACHMENT | Has::COLOR_ATTACHMENT_BLEND,
        ),
        (
            vk::Format::R16G16B16A16_SFLOAT,
            Has::COLOR_ATTACHMENT | Has::COLOR_ATTACHMENT_BLEND,
        ),
        (vk::Format::R32G32B32A32_SFLOAT, Has::COLOR_ATTACHMENT),
        (vk::Format::R32_UINT, Has::COLOR_ATTACHMENT),
        (vk::Format::D16_UNORM, Has::DEPTH_STENCIL_ATTACHMENT),
    ] {
        assert!(gpu.supports(format, has), "{format:?}");
    }
    let usage = vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::SAMPLED;
    let picture = gpu.picture(Shape::flat(vk::Format::R8G8B8A8_UNORM, 4, 4), usage);
    let color = vk::ClearColorValue {
        float32: [1.0, 0.0, 0.2, 1.0],
    };
    gpu.run(|commands| {
        let layout = vk::ImageLayout::GENERAL;
        let all = vk::ImageSubresourceRange::default()
            .aspect_mask(vk::ImageAspectFlags::COLOR)
            .level_count(1)
            .layer_count(1);
        // SAFETY: the image outlives the commands.
        unsafe {
            gpu.device
                .cmd_clear_color_image(commands, picture.handle, layout, &color, &[all]);
        }
    });
    let texels: Vec<[u8; 4]> = gpu.download(&picture, 0, 4).read();
    assert_eq!(texels, [[255, 0, 51, 255]; 16]);
}
