//! Images and texel buffers that shaders load, store and change.

use tuff_tests::*;
use vk::Format as F;

const STORAGE: vk::ImageUsageFlags = vk::ImageUsageFlags::STORAGE;

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

/// Formats that are not stored to, of packed, of three and of sRGB components.
#[test]
fn texel_buffers_read_what_images_have() {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 260));
    let Some(gpu) = gpu.with("VK_KHR_maintenance5", |gpu| {
        gpu.optional.maintenance5.maintenance5 != 0
    }) else {
        return;
    };
    let source = r"
    layout(local_size_x = 4) in;
    layout(set = 0, binding = 0) uniform samplerBuffer from;
    layout(set = 0, binding = 1, std430) buffer To { vec4 to[]; };
    void main() {
        int i = int(gl_GlobalInvocationID.x);
        to[i] = texelFetch(from, i);
    }";
    let five = |value: u16| f32::from(value) / 31.0;
    let srgb = |byte: u8| {
        let c = f32::from(byte) / 255.0;
        if c <= 0.04045 {
            c / 12.92
        } else {
            ((c + 0.055) / 1.055).powf(2.4)
        }
    };
    let words: [u16; 4] = [0xf81f, 0x07e0, 0x1234, 0xffff];
    let bytes: [[u8; 4]; 4] = [[0, 10, 128, 64], [255, 1, 2, 3], [9, 90, 200, 255], [77; 4]];
    let halves = [
        0.5f32, -2.0, 0.25, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0,
    ];
    let cases: [(F, Vec<u8>, [[f32; 4]; 4]); 3] = [
        (
            F::R5G6B5_UNORM_PACK16,
            words.iter().flat_map(|word| word.to_le_bytes()).collect(),
            words.map(|word| {
                let green = f32::from(word >> 5 & 63) / 63.0;
                [five(word >> 11), green, five(word & 31), 1.0]
            }),
        ),
        (
            F::R8G8B8A8_SRGB,
            bytes.as_flattened().to_vec(),
            bytes.map(|[r, g, b, a]| [srgb(r), srgb(g), srgb(b), f32::from(a) / 255.0]),
        ),
        (
            F::R16G16B16_SFLOAT,
            halves
                .iter()
                .flat_map(|value| half::f16::from_f32(*value).to_le_bytes())
                .collect(),
            std::array::from_fn(|i| [halves[3 * i], halves[3 * i + 1], halves[3 * i + 2], 1.0]),
        ),
    ];
    for (format, texels, expected) in cases {
        // SAFETY: the physical device is of this instance.
        let features =
            unsafe { (gpu.instance).get_physical_device_format_properties(gpu.physical, format) };
        let needed = vk::FormatFeatureFlags::UNIFORM_TEXEL_BUFFER;
        if !has(
            &format!("texel buffers of {format:?}"),
            features.buffer_features.contains(needed),
        ) {
            continue;
        }
        let from = gpu.buffer_with(&texels);
        let to = gpu.buffer(16 * 4);
        // The harness's buffers may be stored to as well, which these formats cannot be.
        let mut usage = vk::BufferUsageFlags2CreateInfoKHR::default()
            .usage(vk::BufferUsageFlags2KHR::UNIFORM_TEXEL_BUFFER);
        let info = vk::BufferViewCreateInfo::default()
            .buffer(from.handle)
            .format(format)
            .range(vk::WHOLE_SIZE)
            .push_next(&mut usage);
        // SAFETY: `info` outlives the call; the view is destroyed when the dispatch is done.
        let view = unsafe { gpu.device.create_buffer_view(&info, None) };
        let view = view.expect("vkCreateBufferView");
        gpu.compute_with(
            source,
            &[(0, &[Bound::UniformTexels(view)]), (1, &[to.into()])],
            [1, 1, 1],
        );
        // SAFETY: nothing uses it any more.
        unsafe { gpu.device.destroy_buffer_view(view, None) };
        for (got, expected) in to.read::<[f32; 4]>().iter().zip(&expected) {
            for (got, expected) in got.iter().zip(expected) {
                assert!(
                    (got - expected).abs() < 2e-3,
                    "{format:?}: {got} {expected}"
                );
            }
        }
    }
}

/// The view of slices 5 to 7 of a volume.
fn sliced_view(gpu: &Gpu, volume: &Picture) -> vk::ImageView {
    let mut slices = vk::ImageViewSlicedCreateInfoEXT::default()
        .slice_offset(5)
        .slice_count(3);
    let info = vk::ImageViewCreateInfo::default()
        .image(volume.handle)
        .view_type(vk::ImageViewType::TYPE_3D)
        .format(volume.shape.format)
        .subresource_range(
            vk::ImageSubresourceRange::default()
                .aspect_mask(vk::ImageAspectFlags::COLOR)
                .level_count(1)
                .layer_count(1),
        )
        .push_next(&mut slices);
    gpu.view(&info)
}

/// A driver with such views. Older validation layers do not know the extension and hide its
/// feature.
fn with_sliced_views() -> Option<Gpu> {
    Gpu::without_validation().with("VK_EXT_image_sliced_view_of_3d", |gpu| {
        gpu.optional.sliced_views.image_sliced_view_of3_d != 0
    })
}

/// A volume of 2×2×10 words.
fn ten_slices() -> Shape {
    Shape {
        kind: vk::ImageViewType::TYPE_3D,
        extent: [2, 2, 10],
        ..Shape::flat(F::R32_UINT, 0, 0)
    }
}

/// A view of slices 5 to 7 of a volume: they count from zero, and others are outside of it.
#[test]
fn a_view_of_some_slices_has_no_others() {
    let Some(gpu) = with_sliced_views() else {
        return;
    };
    let shape = ten_slices();
    let volume = gpu.picture(shape, STORAGE);
    gpu.upload(&volume, 0, &[7u32; 40]);
    let view = sliced_view(&gpu, &volume);
    let depth = gpu.buffer(4);
    let source = "
        layout(local_size_x = 2, local_size_y = 2, local_size_z = 4) in;
        layout(binding = 0, r32ui) uniform uimage3D slices;
        layout(binding = 1) writeonly buffer Depth { int depth; };
        void main() {
            ivec3 at = ivec3(gl_LocalInvocationID);
            imageStore(slices, at, uvec4(100 * at.z + 10 * at.y + at.x));
            depth = imageSize(slices).z;
        }";
    let bindings: [(u32, &[Bound]); 2] = [
        (0, &[Bound::StorageImage(view)]),
        (1, &[Bound::Storage(depth)]),
    ];
    gpu.compute_with(source, &bindings, [1, 1, 1]);
    assert_eq!(depth.read::<i32>(), [3]);
    let got: Vec<u32> = gpu.download(&volume, 0, 4).read();
    let wanted: Vec<u32> = (0..40)
        .map(|index| match index / 4 {
            slice @ 5..8 => 100 * (slice - 5) + 10 * (index / 2 % 2) + index % 2,
            _ => 7,
        })
        .collect();
    assert_eq!(got, wanted);
}

/// Only storage images see some slices of such a view: samplers see all
/// (`VkImageViewSlicedCreateInfoEXT`).
#[test]
fn samplers_see_all_slices_of_a_view_of_some() {
    let Some(gpu) = with_sliced_views() else {
        return;
    };
    let shape = ten_slices();
    let volume = gpu.picture(shape, STORAGE | vk::ImageUsageFlags::SAMPLED);
    let texels: Vec<u32> = (100..140).collect();
    gpu.upload(&volume, 0, &texels);
    let view = sliced_view(&gpu, &volume);
    let sampler = gpu.sampler(&vk::SamplerCreateInfo::default());
    let (found, depth) = (gpu.buffer(4 * 40), gpu.buffer(4));
    let source = "
        layout(local_size_x = 2, local_size_y = 2, local_size_z = 10) in;
        layout(binding = 0) uniform usampler3D volume;
        layout(binding = 1) writeonly buffer Found { uint found[]; };
        layout(binding = 2) writeonly buffer Depth { int depth; };
        void main() {
            ivec3 at = ivec3(gl_LocalInvocationID);
            found[4 * at.z + 2 * at.y + at.x] = texelFetch(volume, at, 0).x;
            depth = textureSize(volume, 0).z;
        }";
    let bindings: [(u32, &[Bound]); 3] = [
        (0, &[Bound::Sampled(view, sampler)]),
        (1, &[Bound::Storage(found)]),
        (2, &[Bound::Storage(depth)]),
    ];
    gpu.compute_with(source, &bindings, [1, 1, 1]);
    assert_eq!(depth.read::<i32>(), [10]);
    assert_eq!(found.read::<u32>(), texels);
}
