//! Devices without a graphics queue: graphics commands have entry points, and every use of them is an error that is told, not a crash.

use std::ffi::c_void;
use std::sync::{Mutex, Once};

use ash::ext;
use tuff_tests::*;

type Messages = Mutex<Vec<String>>;

unsafe extern "system" fn listen(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    list: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: valid data, and the list that `told` gave.
    unsafe {
        let text = (*data).message_as_c_str().unwrap_or(c"?");
        let list = &*list.cast::<Messages>();
        list.lock()
            .unwrap()
            .push(text.to_string_lossy().into_owned());
    }
    vk::FALSE
}

/// What the driver says meanwhile.
fn told(gpu: &Gpu, act: impl FnOnce()) -> Vec<String> {
    let messages = Messages::default();
    let debug = ext::debug_utils::Instance::new(&gpu.entry, &gpu.instance);
    let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
        .message_severity(vk::DebugUtilsMessageSeverityFlagsEXT::ERROR)
        .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
        .pfn_user_callback(Some(listen))
        .user_data((&raw const messages).cast_mut().cast());
    // SAFETY: the list outlives the messenger.
    unsafe {
        let messenger = debug.create_debug_utils_messenger(&info, None).unwrap();
        act();
        debug.destroy_debug_utils_messenger(messenger, None);
    }
    messages.into_inner().unwrap()
}

/// Tuff does not draw where it is told so, before the process's first device.
fn tell_not_to_draw() {
    static TOLD: Once = Once::new();
    // SAFETY: whatever else reads the environment in this process waits here first.
    TOLD.call_once(|| unsafe { std::env::set_var("TUFF_GRAPHICS", "0") });
}

fn device_that_does_not_draw() -> Gpu {
    tell_not_to_draw();
    Gpu::without_validation()
}

#[test]
fn graphics_pipelines_are_refused() {
    let gpu = device_that_does_not_draw();
    if !has("a device without a graphics queue", !gpu.has_graphics()) {
        return;
    }
    let messages = told(&gpu, || {
        let info = [vk::GraphicsPipelineCreateInfo::default(); 2];
        let none = vk::PipelineCache::null();
        // SAFETY: refused before the infos are looked at.
        let made = unsafe { gpu.device.create_graphics_pipelines(none, &info, None) };
        let (pipelines, error) = made.unwrap_err();
        assert_eq!(error, vk::Result::ERROR_VALIDATION_FAILED_EXT);
        assert_eq!(pipelines, [vk::Pipeline::null(); 2]);
    });
    assert_eq!(messages.len(), 1, "{messages:?}");
}

#[test]
fn drawing_commands_fail_the_recording_once() {
    let gpu = device_that_does_not_draw();
    if !has("a device without a graphics queue", !gpu.has_graphics()) {
        return;
    }
    let device = &gpu.device;
    let info = vk::CommandBufferAllocateInfo::default()
        .command_pool(gpu.pool)
        .command_buffer_count(1);
    // SAFETY: the command buffer is of this test alone.
    unsafe {
        let commands = device.allocate_command_buffers(&info).unwrap()[0];
        let begin = vk::CommandBufferBeginInfo::default();
        let messages = told(&gpu, || {
            device.begin_command_buffer(commands, &begin).unwrap();
            device.cmd_set_viewport(commands, 0, &[vk::Viewport::default()]);
            device.cmd_begin_rendering(commands, &vk::RenderingInfo::default());
            device.cmd_draw(commands, 3, 1, 0, 0);
            device.cmd_end_rendering(commands);
            let ended = device.end_command_buffer(commands);
            assert_eq!(ended, Err(vk::Result::ERROR_VALIDATION_FAILED_EXT));
        });
        assert_eq!(messages.len(), 1, "{messages:?}");
        assert!(messages[0].contains("vkCmdSetViewport"));
        // The buffer can be recorded again.
        device.begin_command_buffer(commands, &begin).unwrap();
        device.end_command_buffer(commands).unwrap();
        assert_eq!(gpu.submit(commands), Ok(()));
    }
}

/// Images of the formats that every implementation must have as attachments are images like any other.
#[test]
fn attachment_formats_can_be_cleared_viewed_and_copied() {
    use vk::FormatFeatureFlags as Has;
    tell_not_to_draw();
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
