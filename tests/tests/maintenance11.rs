//! `VK_KHR_maintenance11` and `VK_KHR_extended_flags`: views of one layer as arrays and not, depth
//! clipping that is well defined, and the flags of images in 64 bits.

use ash::{ext, khr};
use tuff_tests::*;
use vk::ImageViewType as View;

/// `VK_IMAGE_CREATE_ALIAS_SINGLE_LAYER_DESCRIPTOR_BIT_KHR`.
const ALIAS_SINGLE_LAYER: vk::ImageCreateFlags = vk::ImageCreateFlags::from_raw(1 << 22);

const STORAGE_AND_SAMPLED: vk::ImageUsageFlags = vk::ImageUsageFlags::from_raw(
    vk::ImageUsageFlags::STORAGE.as_raw() | vk::ImageUsageFlags::SAMPLED.as_raw(),
);

fn maintained() -> Option<Gpu> {
    Gpu::new().with("VK_KHR_maintenance11", |gpu| {
        gpu.optional.maintenance11.maintenance11 == vk::TRUE
    })
}

fn with_extended_flags() -> Option<Gpu> {
    Gpu::new().with("VK_KHR_extended_flags", |gpu| {
        gpu.optional.extended_flags.extended_flags == vk::TRUE
    })
}

/// Views of one layer, flat and as arrays, accessed by shaders that take them for the other.
#[test]
fn views_of_one_layer_are_arrays_and_are_not() {
    let Some(gpu) = maintained() else { return };
    const LAYERS: u32 = 3;
    let source = "
    layout(local_size_x = 16) in;
    layout(binding = 0) uniform usamplerDIMArray flat_sampled;
    layout(binding = 1) uniform usamplerDIM array_sampled;
    layout(binding = 2, r32ui) uniform uimageDIMArray flat_stored;
    layout(binding = 3, r32ui) uniform uimageDIM array_stored;
    layout(binding = 4) buffer Words { uint words[]; };
    void main() {
        uint at = gl_LocalInvocationIndex;
        PLACE p = PLACE(PICK);
        uint sum = texelFetch(flat_sampled, ARRAY(p, 0), 0).x;
        words[8 * at] = sum;
        words[8 * at + 1] = texelFetch(array_sampled, p, 0).x;
        // Layers of samples are clamped to those that there are: one.
        words[8 * at + 2] = textureLod(flat_sampled, FARRAY((FPLACE(p) + 0.5) / SIDE, 2.0), 0.0).x;
        words[8 * at + 3] = textureLod(array_sampled, (FPLACE(p) + 0.5) / SIDE, 0.0).x;
        words[8 * at + 4] = imageLoad(flat_stored, ARRAY(p, 0)).x;
        words[8 * at + 5] = imageLoad(array_stored, p).x;
        words[8 * at + 6] = uint(textureSize(flat_sampled, 0).LAST);
        words[8 * at + 7] = uint(imageSize(flat_stored).LAST);
        if (at < 8)
            imageStore(flat_stored, ARRAY(p, 0), uvec4(sum + 1000));
        else
            imageStore(array_stored, p, uvec4(sum + 2000));
    }";
    let in_2d: [(&str, &str); 8] = [
        ("DIM", "2D"),
        ("FPLACE", "vec2"),
        ("FARRAY", "vec3"),
        ("PLACE", "ivec2"),
        ("ARRAY", "ivec3"),
        ("PICK", "at % 4, at / 4"),
        ("SIDE", "4.0"),
        ("LAST", "z"),
    ];
    let in_1d: [(&str, &str); 8] = [
        ("DIM", "1D"),
        ("FPLACE", "float"),
        ("FARRAY", "vec2"),
        ("PLACE", "int"),
        ("ARRAY", "ivec2"),
        ("PICK", "at"),
        ("SIDE", "16.0"),
        ("LAST", "y"),
    ];
    let cases = [
        (View::TYPE_2D, View::TYPE_2D_ARRAY, [4, 4, 1], in_2d),
        (View::TYPE_1D, View::TYPE_1D_ARRAY, [16, 1, 1], in_1d),
    ];
    let sampler = gpu.sampler(&vk::SamplerCreateInfo::default());
    for (flat, array, extent, words) in cases {
        let shape = Shape {
            kind: array,
            format: vk::Format::R32_UINT,
            extent,
            levels: 1,
            layers: LAYERS,
        };
        let transfer = vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST;
        let info = flat_info(shape.format, extent[0], extent[1])
            .flags(ALIAS_SINGLE_LAYER)
            .image_type(match flat {
                View::TYPE_1D => vk::ImageType::TYPE_1D,
                _ => vk::ImageType::TYPE_2D,
            })
            .array_layers(LAYERS)
            .usage(transfer | STORAGE_AND_SAMPLED);
        let handle = gpu.image(&info);
        gpu.to_general(handle, all_of(shape));
        let picture = Picture {
            handle,
            view: vk::ImageView::null(),
            shape,
        };
        let texels: Vec<u32> = (0..LAYERS * 16).map(|at| at / 16 * 100 + at % 16).collect();
        gpu.upload(&picture, 0, &texels);
        let view = |kind| {
            let middle = vk::ImageSubresourceRange {
                base_array_layer: 1,
                layer_count: 1,
                ..all_of(shape)
            };
            let info = vk::ImageViewCreateInfo::default()
                .image(handle)
                .view_type(kind)
                .format(shape.format)
                .subresource_range(middle);
            gpu.view(&info)
        };
        let (flat, array) = (view(flat), view(array));
        let output = gpu.buffer(16 * 8 * 4);
        let source = (words.iter()).fold(source.to_owned(), |source, (name, text)| {
            source.replace(name, text)
        });
        gpu.compute_with(
            &source,
            &[
                (0, &[Bound::Sampled(flat, sampler)]),
                (1, &[Bound::Sampled(array, sampler)]),
                (2, &[Bound::StorageImage(flat)]),
                (3, &[Bound::StorageImage(array)]),
                (4, &[Bound::Storage(output)]),
            ],
            [1, 1, 1],
        );
        for (at, words) in (100..).zip(output.read::<[u32; 8]>()) {
            assert_eq!(words, [at, at, at, at, at, at, 1, 1], "{:?}", shape.kind);
        }
        let stored = |(at, &texel): (usize, &u32)| match at {
            16..24 => texel + 1000,
            24..32 => texel + 2000,
            _ => texel,
        };
        let expected: Vec<u32> = texels.iter().enumerate().map(stored).collect();
        let got = gpu.download(&picture, 0, 4).read::<u32>();
        assert_eq!(got, expected, "{:?}", shape.kind);
    }
}

/// Depth clipping follows the current depth clamping, unless the pipeline says whether it clips.
#[test]
fn depth_is_clipped_as_the_pipeline_says() {
    let Some(gpu) = maintained().and_then(Gpu::drawing) else {
        return;
    };
    let has_clip = gpu.optional.depth_clip.depth_clip_enable == vk::TRUE;
    let dynamic = &gpu.optional.dynamic_state3;
    let is_dynamic = dynamic.extended_dynamic_state3_depth_clamp_enable == vk::TRUE;
    let clamps = gpu.features.depth_clamp == vk::TRUE;
    if !has("depthClampEnable as dynamic state", clamps && is_dynamic) {
        return;
    }
    let states = ext::extended_dynamic_state3::Device::new(&gpu.instance, &gpu.device);
    // Behind the far plane.
    let vertex = "void main() {
        vec2 place = vec2(gl_VertexIndex == 1 ? 3.0 : -1.0, gl_VertexIndex == 2 ? 3.0 : -1.0);
        gl_Position = vec4(place, 2.0, 1.0);
    }";
    let canvas = gpu.canvas(RGBA, 4, 4);
    for explicit in [None, Some(false), Some(true)] {
        if explicit.is_some() && !has_clip {
            continue;
        }
        let clip = vk::PipelineRasterizationDepthClipStateCreateInfoEXT::default()
            .depth_clip_enable(explicit == Some(true));
        for (in_pipeline, at_draw) in [
            (false, None),
            (true, None),
            (true, Some(false)),
            (false, Some(true)),
        ] {
            let mut painting = Painting::new(&gpu, vertex, WHITE, RGBA);
            painting.rasterization = painting.rasterization.depth_clamp_enable(in_pipeline);
            if explicit.is_some() {
                painting.rasterization.p_next = (&raw const clip).cast();
            }
            if at_draw.is_some() {
                painting.dynamic = vec![vk::DynamicState::DEPTH_CLAMP_ENABLE_EXT];
            }
            let pipeline = gpu.painting(&painting);
            gpu.paint(&canvas, pipeline, |commands| {
                if let Some(clamp) = at_draw {
                    // SAFETY: the command buffer is being recorded.
                    unsafe { states.cmd_set_depth_clamp_enable(commands, clamp) };
                }
                gpu.draw_vertices(commands, 3);
            });
            let clamped = at_draw.unwrap_or(in_pipeline);
            let clipped = explicit.unwrap_or(!clamped);
            let drawn = gpu.colors(&canvas)[0] != [0; 4];
            assert_eq!(drawn, !clipped, "{explicit:?}, {in_pipeline}, {at_draw:?}");
        }
    }
}

/// Copies of any region are possible; the optimal granularity is none or powers of two.
#[test]
fn transfers_have_any_granularity() {
    let Some(gpu) = maintained() else { return };
    // SAFETY: the structures outlive the calls.
    unsafe {
        let instance = &gpu.instance;
        let count = instance.get_physical_device_queue_family_properties2_len(gpu.physical);
        let mut optimal =
            vec![newer::QueueFamilyOptimalImageTransferGranularityPropertiesKHR::default(); count];
        let mut families = vec![vk::QueueFamilyProperties2::default(); count];
        for (family, optimal) in families.iter_mut().zip(&mut optimal) {
            family.p_next = std::ptr::from_mut(optimal).cast();
        }
        instance.get_physical_device_queue_family_properties2(gpu.physical, &mut families);
        for (family, optimal) in families.iter().zip(&optimal) {
            let sides = |it: vk::Extent3D| [it.width, it.height, it.depth];
            let family = family.queue_family_properties;
            let transfers =
                vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE | vk::QueueFlags::TRANSFER;
            if family.queue_flags.intersects(transfers) {
                assert_eq!(sides(family.min_image_transfer_granularity), [1, 1, 1]);
            }
            let best = sides(optimal.optimal_image_transfer_granularity);
            let is_power = |side: u32| side.is_power_of_two();
            assert!(best == [0; 3] || best.into_iter().all(is_power), "{best:?}");
        }
    }
}

/// Resources that one family shares with itself.
#[test]
fn one_family_shares_concurrently() {
    let Some(gpu) = maintained() else { return };
    let families = [gpu.family];
    let info = flat_info(RGBA, 4, 4)
        .usage(vk::ImageUsageFlags::TRANSFER_DST)
        .sharing_mode(vk::SharingMode::CONCURRENT)
        .queue_family_indices(&families);
    gpu.image(&info);
    let info = vk::BufferCreateInfo::default()
        .size(64)
        .usage(vk::BufferUsageFlags::TRANSFER_DST)
        .sharing_mode(vk::SharingMode::CONCURRENT)
        .queue_family_indices(&families);
    // SAFETY: the info outlives the call; nothing uses the buffer.
    unsafe {
        let buffer = gpu.device.create_buffer(&info, None);
        gpu.device
            .destroy_buffer(buffer.expect("vkCreateBuffer"), None);
    }
}

/// The structures of 64-bit flags come before the members of 32 bits, which are ignored.
#[test]
fn images_are_made_with_flags_of_64_bits() {
    let Some(gpu) = with_extended_flags() else {
        return;
    };
    let usage = newer::ImageUsageFlags2CreateInfoKHR {
        usage: vk::ImageUsageFlags::TRANSFER_DST.as_raw() as u64
            | vk::ImageUsageFlags::TRANSFER_SRC.as_raw() as u64
            | vk::ImageUsageFlags::STORAGE.as_raw() as u64,
        ..Default::default()
    };
    let flags = newer::ImageCreateFlags2CreateInfoKHR {
        p_next: (&raw const usage).cast(),
        flags: vk::ImageCreateFlags::MUTABLE_FORMAT.as_raw().into(),
        ..Default::default()
    };
    let mut info = flat_info(RGBA, 4, 4);
    info.p_next = (&raw const flags).cast();
    let handle = gpu.image(&info);
    // A description alone has the requirements of the image.
    let described = vk::DeviceImageMemoryRequirements::default().create_info(&info);
    let mut needs = vk::MemoryRequirements2::default();
    // SAFETY: the structures outlive the calls.
    let own = unsafe {
        (gpu.device).get_device_image_memory_requirements(&described, &mut needs);
        gpu.device.get_image_memory_requirements(handle)
    };
    assert_eq!(needs.memory_requirements.size, own.size);
    assert_eq!(needs.memory_requirements.alignment, own.alignment);
    let shape = Shape::flat(RGBA, 4, 4);
    gpu.to_general(handle, all_of(shape));
    let view_usage = newer::ImageViewUsage2CreateInfoKHR {
        usage: vk::ImageUsageFlags::STORAGE.as_raw().into(),
        ..Default::default()
    };
    let mut info = vk::ImageViewCreateInfo::default()
        .image(handle)
        .view_type(View::TYPE_2D)
        .format(vk::Format::R32_UINT)
        .subresource_range(all_of(shape));
    info.p_next = (&raw const view_usage).cast();
    let view = gpu.view(&info);
    let picture = Picture {
        handle,
        view,
        shape,
    };
    let source = "
    layout(local_size_x = 4, local_size_y = 4) in;
    layout(binding = 0, r32ui) uniform uimage2D codes;
    void main() {
        ivec2 p = ivec2(gl_LocalInvocationID.xy);
        imageStore(codes, p, uvec4(p.x + 256 * p.y + 65536 * 7));
    }";
    gpu.compute_with(source, &[(0, &[Bound::StorageImage(view)])], [1, 1, 1]);
    let texels = gpu.download(&picture, 0, 4).read::<[u8; 4]>();
    for (at, texel) in (0..16).zip(texels) {
        assert_eq!(texel, [at % 4, at / 4, 7, 0]);
    }
}

/// Queries read the structures of 64-bit flags, too.
#[test]
fn queries_read_and_answer_flags_of_64_bits() {
    let Some(gpu) = with_extended_flags() else {
        return;
    };
    // Of a depth format: colours are not written to it.
    let format = vk::Format::D16_UNORM;
    let supported = |usage, chained: Option<vk::ImageUsageFlags>| {
        let more = newer::ImageUsageFlags2CreateInfoKHR {
            usage: chained.unwrap_or_default().as_raw().into(),
            ..Default::default()
        };
        let mut info = vk::PhysicalDeviceImageFormatInfo2::default()
            .format(format)
            .ty(vk::ImageType::TYPE_2D)
            .usage(usage);
        if chained.is_some() {
            info.p_next = (&raw const more).cast();
        }
        let mut out = vk::ImageFormatProperties2::default();
        // SAFETY: the structures outlive the call.
        let answer = unsafe {
            (gpu.instance).get_physical_device_image_format_properties2(
                gpu.physical,
                &info,
                &mut out,
            )
        };
        answer.is_ok()
    };
    let (depth, color) = (
        vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT,
        vk::ImageUsageFlags::COLOR_ATTACHMENT,
    );
    assert!(supported(depth, None) && !supported(color, None));
    assert!(!supported(depth, Some(color)));
    assert!(supported(color, Some(depth)));

    let mut four = newer::FormatProperties4KHR {
        linear_tiling_features: u64::MAX,
        optimal_tiling_features: u64::MAX,
        buffer_features: u64::MAX,
        ..Default::default()
    };
    let mut properties = vk::FormatProperties2 {
        p_next: (&raw mut four).cast(),
        ..Default::default()
    };
    // SAFETY: the structures outlive the call.
    unsafe {
        (gpu.instance).get_physical_device_format_properties2(gpu.physical, RGBA, &mut properties);
        // Through a pointer, because the driver wrote through one.
        four = (&raw const four).read();
    }
    // A device may know flags of extensions, but not all 64.
    assert_ne!(four.optimal_tiling_features, u64::MAX);
    assert_ne!(four.linear_tiling_features, u64::MAX);
    assert_ne!(four.buffer_features, u64::MAX);
}

/// Surfaces answer with usages of 64 bits, the first of which are those of 32.
#[test]
fn surfaces_answer_with_usages_of_64_bits() {
    if with_extended_flags().is_none() {
        return;
    }
    let presenter = Presenter::new(ext::headless_surface::NAME, |entry, instance| {
        let surfaces = ext::headless_surface::Instance::new(entry, instance);
        let info = vk::HeadlessSurfaceCreateInfoEXT::default();
        // SAFETY: the info outlives the call.
        unsafe { surfaces.create_headless_surface(&info, None) }.unwrap()
    });
    let Some(presenter) = presenter else { return };
    let surfaces =
        khr::get_surface_capabilities2::Instance::new(&presenter.entry, &presenter.instance);
    let info = vk::PhysicalDeviceSurfaceInfo2KHR::default().surface(presenter.surface);
    let mut shared = newer::SharedPresentSurfaceCapabilities2KHR::default();
    let mut usage = newer::ImageUsageFlags2CreateInfoKHR {
        p_next: (&raw mut shared).cast_const().cast(),
        ..Default::default()
    };
    let mut capabilities = vk::SurfaceCapabilities2KHR {
        p_next: (&raw mut usage).cast(),
        ..Default::default()
    };
    // SAFETY: the structures outlive the call; they are read through pointers, because the driver
    // wrote through them.
    let (usage, shared) = unsafe {
        let physical = presenter.physical;
        surfaces
            .get_physical_device_surface_capabilities2(physical, &info, &mut capabilities)
            .expect("vkGetPhysicalDeviceSurfaceCapabilities2KHR");
        ((&raw const usage).read(), (&raw const shared).read())
    };
    let old = capabilities.surface_capabilities.supported_usage_flags;
    assert_eq!(usage.usage as u32, old.as_raw());
    if presenter.extends(khr::shared_presentable_image::NAME) {
        let color = u64::from(vk::ImageUsageFlags::COLOR_ATTACHMENT.as_raw());
        assert_ne!(shared.shared_present_supported_usage_flags & color, 0);
    }
}
