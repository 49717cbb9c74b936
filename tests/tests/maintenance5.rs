//! `VK_KHR_maintenance5`, as far as it goes without graphics.

use std::ffi::CStr;

use ash::khr;
use tuff_tests::*;

/// A device with the feature; without the validation layer where that is too old to know it.
fn gpu_with_maintenance5() -> Option<Gpu> {
    let gpu = Gpu::validated_since(vk::make_api_version(0, 1, 3, 260));
    gpu.with("VK_KHR_maintenance5", |gpu| {
        gpu.optional.maintenance5.maintenance5 != 0
    })
}

const DOUBLE: &str = "
layout(local_size_x = 4) in;
layout(set = 0, binding = 0, std430) buffer V { uint values[]; };
void main() { values[gl_GlobalInvocationID.x] *= 2; }";

#[test]
fn a_stage_needs_no_module() {
    let Some(gpu) = gpu_with_maintenance5() else {
        return;
    };
    let buffer = gpu.buffer_with(&[1u32, 2, 3, 4]);
    let set = gpu.set_of(&[buffer.into()]);
    let layout = gpu.layout(&[set.layout]);
    let words = glsl(Stage::Compute, DOUBLE);
    let mut module = vk::ShaderModuleCreateInfo::default().code(&words);
    let stage = vk::PipelineShaderStageCreateInfo::default()
        .stage(vk::ShaderStageFlags::COMPUTE)
        .name(c"main")
        .push_next(&mut module);
    // The flags are those of the chained structure, not these.
    let mut flags = vk::PipelineCreateFlags2CreateInfoKHR::default()
        .flags(vk::PipelineCreateFlags2KHR::empty());
    let info = vk::ComputePipelineCreateInfo::default()
        .flags(vk::PipelineCreateFlags::FAIL_ON_PIPELINE_COMPILE_REQUIRED)
        .stage(stage)
        .layout(layout)
        .push_next(&mut flags);
    // SAFETY: the structures outlive the call; the pipeline is destroyed when its commands have
    // ended.
    unsafe {
        let made = gpu
            .device
            .create_compute_pipelines(vk::PipelineCache::null(), &[info], None);
        let pipeline = made.expect("vkCreateComputePipelines")[0];
        let kernel = Kernel { pipeline, layout };
        gpu.dispatch::<u32>(kernel, &[set], &[], [1, 1, 1]);
        gpu.device.destroy_pipeline(pipeline, None);
    }
    assert_eq!(buffer.read::<u32>(), [2, 4, 6, 8]);
}

#[test]
fn layouts_are_known_without_an_image() {
    let Some(gpu) = gpu_with_maintenance5() else {
        return;
    };
    let extension = khr::maintenance5::Device::new(&gpu.instance, &gpu.device);
    let info = flat_info(vk::Format::R8G8B8A8_UNORM, 37, 19)
        .tiling(vk::ImageTiling::LINEAR)
        .usage(vk::ImageUsageFlags::TRANSFER_DST);
    let aspect = vk::ImageSubresource::default().aspect_mask(vk::ImageAspectFlags::COLOR);
    let subresource = vk::ImageSubresource2KHR::default().image_subresource(aspect);
    let question = vk::DeviceImageSubresourceInfoKHR::default()
        .create_info(&info)
        .subresource(&subresource);
    let mut of_info = vk::SubresourceLayout2KHR::default();
    let mut of_image = vk::SubresourceLayout2KHR::default();
    let rendering = vk::RenderingAreaInfoKHR::default();
    // SAFETY: the structures outlive the calls; the image is destroyed at the end.
    unsafe {
        extension.get_device_image_subresource_layout(&question, &mut of_info);
        let image = gpu.device.create_image(&info, None).expect("vkCreateImage");
        extension.get_image_subresource_layout2(image, &subresource, &mut of_image);
        let plain = gpu.device.get_image_subresource_layout(image, aspect);
        gpu.device.destroy_image(image, None);
        for layout in [of_info.subresource_layout, of_image.subresource_layout] {
            assert_eq!(layout.offset, plain.offset);
            assert_eq!(layout.size, plain.size);
            assert_eq!(layout.row_pitch, plain.row_pitch);
        }
        assert!(plain.row_pitch >= 4 * 37);
        let granularity = extension.get_rendering_area_granularity(&rendering);
        assert!(granularity.width > 0 && granularity.height > 0);
    }
}

#[test]
fn alpha_alone_is_a_format() {
    let Some(gpu) = gpu_with_maintenance5() else {
        return;
    };
    let format = vk::Format::A8_UNORM_KHR;
    let there = gpu.supports(format, vk::FormatFeatureFlags::SAMPLED_IMAGE);
    if !has("the format A8_UNORM", there) {
        return;
    }
    let shape = Shape::flat(format, 2, 2);
    let picture = gpu.picture(shape, vk::ImageUsageFlags::SAMPLED);
    gpu.upload(&picture, 0, &[0u8, 51, 102, 255]);
    let sampler = gpu.sampler(&vk::SamplerCreateInfo::default());
    let output = gpu.buffer(16 * 4);
    let source = "
    layout(local_size_x = 4) in;
    layout(set = 0, binding = 0) uniform sampler2D image;
    layout(set = 0, binding = 1, std430) buffer R { vec4 results[]; };
    void main() {
        uint i = gl_GlobalInvocationID.x;
        results[i] = texelFetch(image, ivec2(i & 1, i >> 1), 0);
    }";
    gpu.compute_with(
        source,
        &[
            (0, &[Bound::Sampled(picture.view, sampler)]),
            (1, &[Bound::Storage(output)]),
        ],
        [1, 1, 1],
    );
    let results: Vec<[f32; 4]> = output.read();
    for (texel, alpha) in results.iter().zip([0.0, 0.2, 0.4, 1.0]) {
        assert_eq!(texel[..3], [0.0; 3]);
        assert!((texel[3] - alpha).abs() < 1e-6, "{texel:?}");
    }
}

#[test]
fn formats_that_nobody_knows_can_be_asked_about() {
    let Some(gpu) = gpu_with_maintenance5() else {
        return;
    };
    // In the range of extension 900, which gave none.
    let unknown = vk::Format::from_raw(1_000_899_000);
    // SAFETY: maintenance5 allows any value in the range of formats.
    let found = unsafe {
        gpu.instance
            .get_physical_device_format_properties(gpu.physical, unknown)
    };
    assert_eq!(
        found.optimal_tiling_features,
        vk::FormatFeatureFlags::empty()
    );
    assert_eq!(found.buffer_features, vk::FormatFeatureFlags::empty());
}

#[test]
fn commands_of_later_versions_are_not_there() {
    let Some(gpu) = gpu_with_maintenance5() else {
        return;
    };
    let find = |instance: &ash::Instance, device: vk::Device, name: &CStr| {
        // SAFETY: the device is of the instance.
        unsafe { instance.get_device_proc_addr(device, name.as_ptr()) }.is_some()
    };
    assert!(find(&gpu.instance, gpu.device.handle(), c"vkQueueSubmit2"));
    let application = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_1);
    let info = vk::InstanceCreateInfo::default().application_info(&application);
    // SAFETY: the handles are destroyed in order at the end.
    unsafe {
        let instance = gpu.entry.create_instance(&info, None).expect("an instance");
        let physical = instance.enumerate_physical_devices().expect("devices")[0];
        let queues = [vk::DeviceQueueCreateInfo::default().queue_priorities(&[1.0])];
        let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues);
        let device = instance
            .create_device(physical, &info, None)
            .expect("vkCreateDevice");
        assert!(find(&instance, device.handle(), c"vkQueueSubmit"));
        assert!(find(&instance, device.handle(), c"vkTrimCommandPool"));
        assert!(!find(&instance, device.handle(), c"vkResetQueryPool"));
        assert!(!find(&instance, device.handle(), c"vkQueueSubmit2"));
        device.destroy_device(None);
        instance.destroy_instance(None);
    }
}
