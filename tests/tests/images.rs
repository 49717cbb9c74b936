//! Images: copies, clears, blits, storage access, and sampling against a reference.

use tuff_tests::*;
use vk::Format as F;

const SAMPLED: vk::ImageUsageFlags = vk::ImageUsageFlags::SAMPLED;
const STORAGE: vk::ImageUsageFlags = vk::ImageUsageFlags::STORAGE;

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

fn bytes(random: &mut Random, count: u64) -> Vec<u8> {
    (0..count).map(|_| random.bits() as u8).collect()
}

#[test]
fn every_format_carries_its_texels() {
    let gpu = Gpu::new();
    let mut random = Random::new(21);
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
    let mut random = Random::new(22);
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
    // Blits are for graphics queues; where there is none Tuff does them all the same.
    let mut gpu = Gpu::new();
    if !gpu.has_graphics() {
        if !has("a graphics queue", gpu.is_tuff()) {
            return;
        }
        gpu = Gpu::without_validation();
    }
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

#[test]
fn storage_images_are_loaded_stored_and_changed_atomically() {
    let gpu = Gpu::new();
    let shape = Shape::flat(F::R32G32B32A32_SFLOAT, 16, 16);
    let floats = gpu.picture(shape, STORAGE);
    let colours = gpu.picture(Shape::flat(F::R8G8B8A8_UNORM, 16, 16), STORAGE);
    let halves = gpu.picture(Shape::flat(F::R16G16B16A16_SFLOAT, 16, 16), STORAGE);
    let counters = gpu.picture(Shape::flat(F::R32_UINT, 4, 4), STORAGE);
    let volume_shape = Shape {
        kind: vk::ImageViewType::TYPE_3D,
        extent: [4, 4, 16],
        ..Shape::flat(F::R32_SINT, 0, 0)
    };
    let volume = gpu.picture(volume_shape, STORAGE);
    gpu.upload(&counters, 0, &[0u32; 16]);
    gpu.upload(
        &floats,
        0,
        &(0..1024).map(|i| i as f32).collect::<Vec<f32>>(),
    );
    let source = r"
    layout(local_size_x = 8, local_size_y = 8) in;
    layout(set = 0, binding = 0, rgba32f) uniform image2D floats;
    layout(set = 0, binding = 1, rgba8) uniform writeonly image2D colours;
    layout(set = 0, binding = 2, rgba16f) uniform image2D halves;
    layout(set = 0, binding = 3, r32ui) uniform uimage2D counters;
    layout(set = 0, binding = 4, r32i) uniform iimage3D volume;
    void main() {
        ivec2 p = ivec2(gl_GlobalInvocationID.xy);
        vec4 v = imageLoad(floats, p);
        imageStore(floats, p, v.wzyx + vec4(imageSize(floats), 0, 0));
        imageStore(colours, p, vec4(p, 0.0, 15.0) / 15.0);
        imageStore(halves, p, v * 0.5);
        imageAtomicAdd(counters, p / 4, uint(p.x));
        imageAtomicMax(counters, ivec2(0, 0), 1000u);
        imageStore(volume, ivec3(p.x % 4, p.y % 4, (p.x / 4) + 4 * (p.y / 4)), ivec4(p.x - 100 * p.y));
    }";
    gpu.compute_with(
        source,
        &[
            (0, &[Bound::StorageImage(floats.view)]),
            (1, &[Bound::StorageImage(colours.view)]),
            (2, &[Bound::StorageImage(halves.view)]),
            (3, &[Bound::StorageImage(counters.view)]),
            (4, &[Bound::StorageImage(volume.view)]),
        ],
        [2, 2, 1],
    );
    let got_floats: Vec<[f32; 4]> = gpu.download(&floats, 0, 16).read();
    let got_colours: Vec<[u8; 4]> = gpu.download(&colours, 0, 4).read();
    let got_halves: Vec<[u16; 4]> = gpu.download(&halves, 0, 8).read();
    let got_volume: Vec<i32> = gpu.download(&volume, 0, 4).read();
    for y in 0..16usize {
        for x in 0..16usize {
            let i = y * 16 + x;
            let v = 4.0 * i as f32;
            assert_eq!(got_floats[i], [v + 19.0, v + 18.0, v + 1.0, v]);
            assert_eq!(got_colours[i], [17 * x as u8, 17 * y as u8, 0, 255]);
            assert_eq!(
                got_halves[i][1],
                half::f16::from_f32((v + 1.0) * 0.5).to_bits()
            );
            let z = x / 4 + 4 * (y / 4);
            assert_eq!(
                got_volume[z * 16 + (y % 4) * 4 + x % 4],
                x as i32 - 100 * y as i32
            );
        }
    }
    let got_counters: Vec<u32> = gpu.download(&counters, 0, 4).read();
    assert_eq!(got_counters[1..4], [4 * (4 + 5 + 6 + 7), 4 * 38, 4 * 54]);
    assert!(got_counters[0] >= 1000);
}

#[test]
fn texel_buffers_convert() {
    let gpu = Gpu::new();
    let bytes: Vec<[u8; 4]> = (0..64u8).map(|i| [i, 255 - i, 2 * i, 255]).collect();
    let from = gpu.buffer_with(bytes.as_flattened());
    let to = gpu.buffer(16 * 64);
    let source = r"
    layout(local_size_x = 64) in;
    layout(set = 0, binding = 0) uniform samplerBuffer from;
    layout(set = 0, binding = 1, rgba32f) uniform imageBuffer to;
    void main() {
        int i = int(gl_GlobalInvocationID.x);
        imageStore(to, i, texelFetch(from, i) * float(textureSize(from)) + imageSize(to));
    }";
    let view = gpu.buffer_view(&from, F::R8G8B8A8_UNORM);
    let target = gpu.buffer_view(&to, F::R32G32B32A32_SFLOAT);
    gpu.compute_with(
        source,
        &[
            (0, &[Bound::UniformTexels(view)]),
            (1, &[Bound::StorageTexels(target)]),
        ],
        [1, 1, 1],
    );
    for (got, texel) in to.read::<[f32; 4]>().iter().zip(&bytes) {
        for (got, byte) in got.iter().zip(texel) {
            assert!((got - (f32::from(*byte) / 255.0 * 64.0 + 64.0)).abs() < 1e-4);
        }
    }
}

/// Samples `picture` at each of `places` by the GLSL expression, in which `p` is the place.
fn sample(
    gpu: &Gpu,
    declared: &str,
    picture: &Picture,
    sampler: vk::Sampler,
    expression: &str,
    places: &[[f32; 4]],
) -> Vec<[f32; 4]> {
    let source = format!(
        "layout(local_size_x = 64) in;
        layout(set = 0, binding = 0) uniform {declared} t;
        layout(set = 0, binding = 1) buffer P {{ vec4 places[]; }};
        layout(set = 0, binding = 2) buffer O {{ vec4 o[]; }};
        void main() {{
            uint i = gl_GlobalInvocationID.x;
            if (i >= places.length()) return;
            vec4 p = places[i];
            o[i] = vec4({expression});
        }}"
    );
    let (input, output) = (
        gpu.buffer_with(places),
        gpu.buffer(16 * places.len() as u64),
    );
    gpu.compute_with(
        &source,
        &[
            (0, &[Bound::Sampled(picture.view, sampler)]),
            (1, &[Bound::Storage(input)]),
            (2, &[Bound::Storage(output)]),
        ],
        [places.len().div_ceil(64) as u32, 1, 1],
    );
    output.read()
}

/// The texel that an address mode finds for `i` on a side of `n`; `None` is the border.
fn wrapped(mode: vk::SamplerAddressMode, i: i32, n: i32) -> Option<usize> {
    use vk::SamplerAddressMode as Mode;
    let mirrored = |i: i32| if i >= 0 { i } else { -(1 + i) };
    let j = match mode {
        Mode::REPEAT => i.rem_euclid(n),
        Mode::MIRRORED_REPEAT => (n - 1) - mirrored(i.rem_euclid(2 * n) - n),
        Mode::CLAMP_TO_EDGE => i.clamp(0, n - 1),
        Mode::CLAMP_TO_BORDER => i,
        Mode::MIRROR_CLAMP_TO_EDGE => mirrored(i).clamp(0, n - 1),
        _ => unreachable!("a mode of the core"),
    };
    (0..n).contains(&j).then_some(j as usize)
}

#[test]
fn filters_and_address_modes() {
    use vk::SamplerAddressMode as Mode;
    let gpu = Gpu::new();
    let mut random = Random::new(23);
    let (width, height) = (7i32, 5i32);
    let texels: Vec<[f32; 4]> = (0..35)
        .map(|_| std::array::from_fn(|_| random.between(0.0, 1.0)))
        .collect();
    let picture = gpu.picture(Shape::flat(F::R32G32B32A32_SFLOAT, 7, 5), SAMPLED);
    gpu.upload(&picture, 0, texels.as_flattened());
    let places: Vec<[f32; 4]> = (0..1500)
        .map(|_| {
            [
                random.between(-2.3, 3.3),
                random.between(-2.3, 3.3),
                0.0,
                0.0,
            ]
        })
        .collect();
    let mut modes = vec![
        Mode::REPEAT,
        Mode::MIRRORED_REPEAT,
        Mode::CLAMP_TO_EDGE,
        Mode::CLAMP_TO_BORDER,
    ];
    if gpu.features12.sampler_mirror_clamp_to_edge != 0 {
        modes.push(Mode::MIRROR_CLAMP_TO_EDGE);
    }
    for (k, mode_u) in modes.iter().enumerate() {
        let mode_v = modes[(k + 1) % modes.len()];
        for filter in [vk::Filter::NEAREST, vk::Filter::LINEAR] {
            let sampler = gpu.sampler(
                &vk::SamplerCreateInfo::default()
                    .mag_filter(filter)
                    .min_filter(filter)
                    .address_mode_u(*mode_u)
                    .address_mode_v(mode_v)
                    .border_color(vk::BorderColor::FLOAT_OPAQUE_WHITE),
            );
            let got = sample(
                &gpu,
                "sampler2D",
                &picture,
                sampler,
                "textureLod(t, p.xy, 0.0)",
                &places,
            );
            let texel =
                |i: i32, j: i32| match (wrapped(*mode_u, i, width), wrapped(mode_v, j, height)) {
                    (Some(i), Some(j)) => texels[j * 7 + i],
                    _ => [1.0; 4],
                };
            for (place, got) in places.iter().zip(got) {
                let (u, v) = (place[0] * 7.0, place[1] * 5.0);
                let expected: [f32; 4] = if filter == vk::Filter::NEAREST {
                    if (u - u.round()).abs() < 1e-3 || (v - v.round()).abs() < 1e-3 {
                        continue;
                    }
                    texel(u.floor() as i32, v.floor() as i32)
                } else {
                    let (u, v) = (u - 0.5, v - 0.5);
                    let (i, j) = (u.floor() as i32, v.floor() as i32);
                    let (a, b) = (u - u.floor(), v - v.floor());
                    std::array::from_fn(|c| {
                        let row = |j| texel(i, j)[c] * (1.0 - a) + texel(i + 1, j)[c] * a;
                        row(j) * (1.0 - b) + row(j + 1) * b
                    })
                };
                // Filter weights may have as few as four bits, and everybody has eight.
                let error = if filter == vk::Filter::LINEAR {
                    0.01
                } else {
                    0.0
                };
                for c in 0..4 {
                    assert!(
                        (got[c] - expected[c]).abs() <= error,
                        "{mode_u:?} {mode_v:?} {filter:?} {place:?}: {got:?} {expected:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn levels_of_detail() {
    let gpu = Gpu::new();
    let shape = Shape {
        levels: 5,
        ..Shape::flat(F::R32G32B32A32_SFLOAT, 16, 16)
    };
    let picture = gpu.picture(shape, SAMPLED);
    for level in 0..5u32 {
        let texels = (16 >> level) * (16 >> level);
        gpu.upload(
            &picture,
            level,
            &vec![[10.0 * level as f32, 1.0, 0.0, 0.0f32]; texels],
        );
    }
    let sampler = |mode, bias: f32, low: f32, high: f32| {
        gpu.sampler(
            &vk::SamplerCreateInfo::default()
                .mag_filter(vk::Filter::LINEAR)
                .min_filter(vk::Filter::LINEAR)
                .mipmap_mode(mode)
                .mip_lod_bias(bias)
                .min_lod(low)
                .max_lod(high),
        )
    };
    let (near, linear) = (
        vk::SamplerMipmapMode::NEAREST,
        vk::SamplerMipmapMode::LINEAR,
    );
    let places: Vec<[f32; 4]> = (0..60)
        .map(|i| [0.3, 0.6, -1.0 + 0.11 * i as f32, 0.0])
        .collect();
    for (mode, bias, low, high) in [
        (near, 0.0, 0.0, 100.0),
        (linear, 0.0, 0.0, 100.0),
        (linear, 1.5, 0.0, 100.0),
        (linear, 0.0, 0.75, 2.25),
    ] {
        let sampler = sampler(mode, bias, low, high);
        let got = sample(
            &gpu,
            "sampler2D",
            &picture,
            sampler,
            "textureLod(t, p.xy, p.z)",
            &places,
        );
        for (place, got) in places.iter().zip(got) {
            let lod = (place[2] + bias).clamp(low, high).clamp(0.0, 4.0);
            let expected = if mode == near {
                if (lod.fract() - 0.5).abs() < 0.01 {
                    continue;
                }
                10.0 * lod.round()
            } else {
                10.0 * lod
            };
            assert!(
                (got[0] - expected).abs() < 0.06,
                "{mode:?} {bias} {low} {place:?}: {got:?}"
            );
        }
    }
    let plain = sampler(linear, 0.0, 0.0, 100.0);
    let zero = [[0.0f32; 4]];
    let queried =
        "float(textureQueryLevels(t)), vec2(textureSize(t, 2)), texelFetch(t, ivec2(1, 0), 3).x";
    let got = sample(&gpu, "sampler2D", &picture, plain, queried, &zero);
    assert_eq!(got[0], [5.0, 4.0, 4.0, 30.0]);
    // Explicit gradients of four texels choose level 2.
    let graded = "textureGrad(t, vec2(0.5), vec2(0.25, 0.0), vec2(0.0, 0.25))";
    let got = sample(&gpu, "sampler2D", &picture, plain, graded, &zero);
    assert!((got[0][0] - 20.0).abs() < 0.2, "{got:?}");
}

#[test]
fn cubes_arrays_volumes_and_gathers() {
    let gpu = Gpu::new();
    let nearest = gpu.sampler(&vk::SamplerCreateInfo::default());
    // Faces in the order +x −x +y −y +z −z.
    let shape = |kind, extent, layers| Shape {
        kind,
        format: F::R32_SFLOAT,
        extent,
        levels: 1,
        layers,
    };
    let cube = gpu.picture(shape(vk::ImageViewType::CUBE, [2, 2, 1], 6), SAMPLED);
    let texels: Vec<f32> = (0..24).map(|i| i as f32).collect();
    gpu.upload(&cube, 0, &texels);
    let directions = [
        [1.0, 0.5, -0.5, 0.0],
        [-1.0, 0.5, -0.5, 0.0],
        [0.5, 1.0, -0.5, 0.0],
        [0.5, -1.0, -0.5, 0.0],
        [0.5, -0.5, 1.0, 0.0],
        [0.5, -0.5, -1.0, 0.0f32],
    ];
    let got = sample(
        &gpu,
        "samplerCube",
        &cube,
        nearest,
        "textureLod(t, p.xyz, 0.0).xxxx",
        &directions,
    );
    // By the table "Cube map face and coordinate selection": s and t of each face.
    let expected = directions.map(|[x, y, z, _]| {
        let (face, s, t) = match [x, y, z] {
            [1.0, ..] => (0, -z, -y),
            [-1.0, ..] => (1, z, -y),
            [_, 1.0, _] => (2, x, z),
            [_, -1.0, _] => (3, x, -z),
            [_, _, 1.0] => (4, x, -y),
            _ => (5, -x, -y),
        };
        4.0 * face as f32 + if t > 0.0 { 2.0 } else { 0.0 } + if s > 0.0 { 1.0 } else { 0.0 }
    });
    assert_eq!(
        got.iter().map(|texel| texel[0]).collect::<Vec<f32>>(),
        expected
    );

    let array = gpu.picture(
        shape(vk::ImageViewType::TYPE_2D_ARRAY, [2, 2, 1], 3),
        SAMPLED,
    );
    gpu.upload(&array, 0, &texels[..12]);
    // The layer is rounded to the nearest even and clamped.
    let places = [
        [0.25, 0.25, 0.0, 0.0],
        [0.75, 0.25, 1.4, 0.0],
        [0.25, 0.75, 1.6, 0.0],
        [0.75, 0.75, 9.0, 0.0],
        [0.25, 0.25, -3.0, 0.0f32],
    ];
    let got = sample(
        &gpu,
        "sampler2DArray",
        &array,
        nearest,
        "textureLod(t, p.xyz, 0.0).xxxx",
        &places,
    );
    assert_eq!(
        got.iter().map(|t| t[0]).collect::<Vec<f32>>(),
        [0.0, 5.0, 10.0, 11.0, 0.0]
    );

    let volume = gpu.picture(shape(vk::ImageViewType::TYPE_3D, [2, 3, 4], 1), SAMPLED);
    gpu.upload(&volume, 0, &texels);
    let linear = gpu.sampler(
        &vk::SamplerCreateInfo::default()
            .mag_filter(vk::Filter::LINEAR)
            .min_filter(vk::Filter::LINEAR)
            .address_mode_u(vk::SamplerAddressMode::CLAMP_TO_EDGE)
            .address_mode_v(vk::SamplerAddressMode::CLAMP_TO_EDGE)
            .address_mode_w(vk::SamplerAddressMode::CLAMP_TO_EDGE),
    );
    let places = [
        [0.5, 0.5, 0.5, 0.0],
        [0.25, 0.5, 0.125, 0.0],
        [0.6, 0.4, 0.7, 0.0f32],
    ];
    let got = sample(
        &gpu,
        "sampler3D",
        &volume,
        linear,
        "textureLod(t, p.xyz, 0.0).xxxx",
        &places,
    );
    for (place, got) in places.iter().zip(got) {
        // The texels are a linear function of the place, so filtering gives that function.
        let [x, y, z, _] = *place;
        let expected = (x * 2.0 - 0.5) + 2.0 * (y * 3.0 - 0.5) + 6.0 * (z * 4.0 - 0.5);
        assert!(
            (got[0] - expected).abs() < 0.1,
            "{place:?} {got:?} {expected}"
        );
    }

    let flat = gpu.picture(shape(vk::ImageViewType::TYPE_2D, [4, 4, 1], 1), SAMPLED);
    gpu.upload(&flat, 0, &texels[..16]);
    let got = sample(
        &gpu,
        "sampler2D",
        &flat,
        linear,
        "textureGather(t, p.xy)",
        &[[0.5, 0.5, 0.0, 0.0]],
    );
    assert_eq!(got[0], [9.0, 10.0, 6.0, 5.0]);
    let offset = "textureLodOffset(t, p.xy, 0.0, ivec2(1, -1)).xxxx";
    let got = sample(
        &gpu,
        "sampler2D",
        &flat,
        nearest,
        offset,
        &[[0.4, 0.6, 0.0, 0.0]],
    );
    assert_eq!(got[0][0], 6.0);
}

#[test]
fn formats_are_decoded_when_sampled() {
    let gpu = Gpu::new();
    let nearest = gpu.sampler(&vk::SamplerCreateInfo::default());
    let read = |format: F, texel: &[u8]| {
        let picture = gpu.picture(Shape::flat(format, 1, 1), SAMPLED);
        gpu.upload(&picture, 0, texel);
        sample(
            &gpu,
            "sampler2D",
            &picture,
            nearest,
            "texelFetch(t, ivec2(0), 0)",
            &[[0.0; 4]],
        )[0]
    };
    let close = |got: [f32; 4], expected: [f32; 4]| {
        let fine = got.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3);
        assert!(fine, "{got:?} {expected:?}");
    };
    close(
        read(F::R8G8B8A8_UNORM, &[255, 51, 0, 102]),
        [1.0, 0.2, 0.0, 0.4],
    );
    close(
        read(F::B8G8R8A8_UNORM, &[255, 51, 0, 102]),
        [0.0, 0.2, 1.0, 0.4],
    );
    close(
        read(F::R8G8B8A8_SNORM, &[127, 129, 0, 128]),
        [1.0, -1.0, 0.0, -1.0],
    );
    close(
        read(F::R8G8B8A8_SRGB, &[255, 188, 0, 102]),
        [1.0, 0.5029, 0.0, 0.4],
    );
    close(read(F::R8_UNORM, &[51]), [0.2, 0.0, 0.0, 1.0]);
    close(read(F::R8G8_UNORM, &[51, 255]), [0.2, 1.0, 0.0, 1.0]);
    close(
        read(F::R5G6B5_UNORM_PACK16, &0xf81fu16.to_le_bytes()),
        [1.0, 0.0, 1.0, 1.0],
    );
    close(
        read(F::A1R5G5B5_UNORM_PACK16, &0x83e0u16.to_le_bytes()),
        [0.0, 1.0, 0.0, 1.0],
    );
    let packed = 0x4000_03ffu32.to_le_bytes();
    close(
        read(F::A2B10G10R10_UNORM_PACK32, &packed),
        [1.0, 0.0, 0.0, 0.3333],
    );
    let halves: Vec<u8> = [0x3c00u16, 0xc000, 0x3800, 0]
        .iter()
        .flat_map(|h| h.to_le_bytes())
        .collect();
    close(read(F::R16G16B16A16_SFLOAT, &halves), [1.0, -2.0, 0.5, 0.0]);
    // 1.0 in 11 bits is 15 << 6, in 10 bits 15 << 5; 2.0 has the next exponent.
    let small = (15u32 << 6 | (16 << 6) << 11 | (15 << 5) << 22).to_le_bytes();
    close(
        read(F::B10G11R11_UFLOAT_PACK32, &small),
        [1.0, 2.0, 1.0, 1.0],
    );
    // Mantissas over 512, times 2^(exponent − 15).
    let shared = (256u32 | 128 << 9 | 64 << 18 | 16 << 27).to_le_bytes();
    close(
        read(F::E5B9G9R9_UFLOAT_PACK32, &shared),
        [1.0, 0.5, 0.25, 1.0],
    );
}

#[test]
fn separate_samplers_and_view_swizzles() {
    let gpu = Gpu::new();
    let shape = Shape::flat(F::R8G8B8A8_UNORM, 2, 1);
    let picture = gpu.picture(shape, SAMPLED);
    gpu.upload(&picture, 0, &[255u8, 51, 102, 153, 0, 0, 0, 0]);
    use vk::ComponentSwizzle as Swizzle;
    let info = vk::ImageViewCreateInfo::default()
        .image(picture.handle)
        .view_type(vk::ImageViewType::TYPE_2D)
        .format(shape.format)
        .components(vk::ComponentMapping {
            r: Swizzle::A,
            g: Swizzle::ZERO,
            b: Swizzle::R,
            a: Swizzle::ONE,
        })
        .subresource_range(
            vk::ImageSubresourceRange::default()
                .aspect_mask(vk::ImageAspectFlags::COLOR)
                .level_count(1)
                .layer_count(1),
        );
    // SAFETY: the view is destroyed below, after its last use.
    let view = unsafe { gpu.device.create_image_view(&info, None) }.expect("a view");
    let nearest = gpu.sampler(&vk::SamplerCreateInfo::default());
    let output = gpu.buffer(16);
    let source = r"
    layout(local_size_x = 1) in;
    layout(set = 0, binding = 0) uniform texture2D t;
    layout(set = 0, binding = 1) uniform sampler s[2];
    layout(set = 0, binding = 2) buffer O { vec4 o; };
    void main() { o = textureLod(sampler2D(t, s[1]), vec2(0.25, 0.5), 0.0); }";
    gpu.compute_with(
        source,
        &[
            (0, &[Bound::SampledImage(view)]),
            (1, &[Bound::Sampler(nearest), Bound::Sampler(nearest)]),
            (2, &[Bound::Storage(output)]),
        ],
        [1, 1, 1],
    );
    let [r, g, b, a] = output.read::<[f32; 4]>()[0];
    assert!(
        (r - 0.6).abs() < 1e-3 && g == 0.0 && b == 1.0 && a == 1.0,
        "{r} {g} {b} {a}"
    );
    // SAFETY: nothing uses the view any more.
    unsafe { gpu.device.destroy_image_view(view, None) };
}

/// In compute, a quad is two by two invocations or four in a row.
#[test]
fn derivatives_in_compute() {
    let gpu = Gpu::new();
    let features = gpu.optional.derivatives;
    let quads = features.compute_derivative_group_quads;
    let there = quads * features.compute_derivative_group_linear != 0;
    if !has("derivatives in compute", there) {
        return;
    }
    let shape = Shape {
        levels: 5,
        ..Shape::flat(F::R32G32B32A32_SFLOAT, 16, 16)
    };
    let picture = gpu.picture(shape, SAMPLED);
    for level in 0..5u32 {
        let texels = (16 >> level) * (16 >> level);
        gpu.upload(&picture, level, &vec![[level as f32; 4]; texels]);
    }
    let sampler = gpu.sampler(
        &vk::SamplerCreateInfo::default()
            .mipmap_mode(vk::SamplerMipmapMode::LINEAR)
            .max_lod(100.0),
    );
    let results = gpu.buffer(32 * 64);
    let set = gpu.set(&[
        (0, &[Bound::Sampled(picture.view, sampler)]),
        (1, &[Bound::Storage(results)]),
    ]);
    for (group, dx, dy) in [("quads", 3.0, 50.0), ("linear", 3.0, 6.0)] {
        let source = format!(
            r"
            #extension GL_NV_compute_shader_derivatives : enable
            layout(derivative_group_{group}NV) in;
            layout(local_size_x = 8, local_size_y = 4, local_size_z = 2) in;
            layout(set = 0, binding = 0) uniform sampler2D t;
            layout(set = 0, binding = 1, std430) buffer Results {{ vec4 results[][2]; }};
            void main() {{
                vec3 id = vec3(gl_LocalInvocationID);
                float f = 3.0 * id.x + 50.0 * id.y + 1000.0 * id.z;
                vec2 at = vec2(4.0 * id.x, 0.5 * id.y) / 16.0;
                results[gl_LocalInvocationIndex] = vec4[2](
                    vec4(dFdx(f), dFdyFine(f), fwidthCoarse(f), textureQueryLod(t, at).y),
                    vec4(texture(t, at).x, texture(t, at, 1.0).x, textureLod(t, at, 0.5).x, 0.0));
            }}"
        );
        let kernel = gpu.kernel(&source, &[set.layout]);
        gpu.dispatch::<u32>(kernel, &[set], &[], [1, 1, 1]);
        // Four texels from one invocation to its neighbour, eight to the one after that.
        let level = if group == "quads" { 2.0 } else { 3.0 };
        let words: Vec<[f32; 8]> = results.read();
        for (i, got) in words.iter().enumerate() {
            assert_eq!(got[..3], [dx, dy, dx + dy], "{group} {i}");
            let levels = [level, level, level + 1.0, 0.5];
            for (got, expected) in got[3..7].iter().zip(levels) {
                assert!(
                    (got - expected).abs() < 0.05,
                    "{group} {i}: {got} for {expected}"
                );
            }
        }
    }
}
