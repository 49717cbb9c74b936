//! Swapchains on a surface without a window.

use std::ffi::{CStr, c_char};

use ash::{ext, khr};
use tuff_tests::*;

/// An instance and a device that present, or nothing where the driver has no headless surfaces.
struct Presenter {
    _entry: ash::Entry,
    instance: ash::Instance,
    device: ash::Device,
    queue: vk::Queue,
    surfaces: khr::surface::Instance,
    surface: vk::SurfaceKHR,
    swapchains: khr::swapchain::Device,
    physical: vk::PhysicalDevice,
}

impl Presenter {
    fn new() -> Option<Presenter> {
        let application = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_3);
        let names = [khr::surface::NAME, ext::headless_surface::NAME];
        let pointers: Vec<*const c_char> = names.map(CStr::as_ptr).to_vec();
        let info = vk::InstanceCreateInfo::default()
            .application_info(&application)
            .enabled_extension_names(&pointers);
        // SAFETY: the structures outlive the calls, and handles are used with what they are of.
        unsafe {
            let entry = ash::Entry::load().unwrap();
            let instance = match entry.create_instance(&info, None) {
                Ok(instance) => instance,
                Err(vk::Result::ERROR_EXTENSION_NOT_PRESENT) => {
                    has("VK_EXT_headless_surface", false);
                    return None;
                }
                Err(other) => panic!("{other}"),
            };
            let physical = instance.enumerate_physical_devices().unwrap()[0];
            let surface = ext::headless_surface::Instance::new(&entry, &instance)
                .create_headless_surface(&vk::HeadlessSurfaceCreateInfoEXT::default(), None)
                .unwrap();
            let surfaces = khr::surface::Instance::new(&entry, &instance);
            assert!(
                surfaces
                    .get_physical_device_surface_support(physical, 0, surface)
                    .unwrap()
            );
            let queues = [vk::DeviceQueueCreateInfo::default().queue_priorities(&[1.0])];
            let extensions = [khr::swapchain::NAME.as_ptr()];
            let info = vk::DeviceCreateInfo::default()
                .queue_create_infos(&queues)
                .enabled_extension_names(&extensions);
            let device = instance.create_device(physical, &info, None).unwrap();
            Some(Presenter {
                queue: device.get_device_queue(0, 0),
                swapchains: khr::swapchain::Device::new(&instance, &device),
                _entry: entry,
                instance,
                device,
                surfaces,
                surface,
                physical,
            })
        }
    }

    fn swapchain(&self, old: vk::SwapchainKHR) -> vk::SwapchainKHR {
        // SAFETY: the surface is of this instance; `info` outlives the call.
        unsafe {
            let limits = self
                .surfaces
                .get_physical_device_surface_capabilities(self.physical, self.surface)
                .unwrap();
            assert!(
                limits
                    .supported_usage_flags
                    .contains(vk::ImageUsageFlags::COLOR_ATTACHMENT)
            );
            let formats = self
                .surfaces
                .get_physical_device_surface_formats(self.physical, self.surface)
                .unwrap();
            let modes = self
                .surfaces
                .get_physical_device_surface_present_modes(self.physical, self.surface)
                .unwrap();
            assert!(modes.contains(&vk::PresentModeKHR::FIFO));
            let info = vk::SwapchainCreateInfoKHR::default()
                .surface(self.surface)
                .min_image_count(limits.min_image_count.max(2))
                .image_format(formats[0].format)
                .image_color_space(formats[0].color_space)
                .image_extent(vk::Extent2D {
                    width: 16,
                    height: 8,
                })
                .image_array_layers(1)
                .image_usage(
                    vk::ImageUsageFlags::TRANSFER_DST | vk::ImageUsageFlags::COLOR_ATTACHMENT,
                )
                .pre_transform(limits.current_transform)
                .composite_alpha(vk::CompositeAlphaFlagsKHR::OPAQUE)
                .present_mode(vk::PresentModeKHR::FIFO)
                .old_swapchain(old);
            self.swapchains.create_swapchain(&info, None).unwrap()
        }
    }
}

impl Drop for Presenter {
    fn drop(&mut self) {
        // SAFETY: everything made of them is gone.
        unsafe {
            self.device.destroy_device(None);
            self.surfaces.destroy_surface(self.surface, None);
            self.instance.destroy_instance(None);
        }
    }
}

#[test]
fn images_are_acquired_cleared_and_presented_in_turn() {
    let Some(presenter) = Presenter::new() else {
        return;
    };
    let device = &presenter.device;
    // SAFETY: each frame waits for its end before the next, and everything is destroyed once.
    unsafe {
        let swapchain = presenter.swapchain(vk::SwapchainKHR::null());
        let images = presenter
            .swapchains
            .get_swapchain_images(swapchain)
            .unwrap();
        assert!(images.len() >= 2);
        let semaphore = || {
            device
                .create_semaphore(&vk::SemaphoreCreateInfo::default(), None)
                .unwrap()
        };
        let (acquired, drawn) = (semaphore(), semaphore());
        let pool = device
            .create_command_pool(&vk::CommandPoolCreateInfo::default(), None)
            .unwrap();
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(pool)
            .command_buffer_count(1);
        let mut seen = Vec::new();
        for _ in 0..3 * images.len() {
            let (index, suboptimal) = presenter
                .swapchains
                .acquire_next_image(swapchain, PATIENCE_NS, acquired, vk::Fence::null())
                .unwrap();
            assert!(!suboptimal);
            seen.push(index);
            let commands = device.allocate_command_buffers(&info).unwrap()[0];
            device
                .begin_command_buffer(commands, &vk::CommandBufferBeginInfo::default())
                .unwrap();
            clear(device, commands, images[index as usize]);
            device.end_command_buffer(commands).unwrap();
            let (waits, stages) = ([acquired], [vk::PipelineStageFlags::TRANSFER]);
            let (buffers, signals) = ([commands], [drawn]);
            let submit = vk::SubmitInfo::default()
                .wait_semaphores(&waits)
                .wait_dst_stage_mask(&stages)
                .command_buffers(&buffers)
                .signal_semaphores(&signals);
            device
                .queue_submit(presenter.queue, &[submit], vk::Fence::null())
                .unwrap();
            let (swapchains, indices) = ([swapchain], [index]);
            let present = vk::PresentInfoKHR::default()
                .wait_semaphores(&signals)
                .swapchains(&swapchains)
                .image_indices(&indices);
            assert_eq!(
                presenter
                    .swapchains
                    .queue_present(presenter.queue, &present),
                Ok(false)
            );
            device.queue_wait_idle(presenter.queue).unwrap();
        }
        for index in 0..images.len() as u32 {
            assert!(seen.contains(&index), "image {index} has its turn");
        }
        let fence = device
            .create_fence(&vk::FenceCreateInfo::default(), None)
            .unwrap();
        let next = presenter.swapchain(swapchain);
        let first = presenter.swapchains.acquire_next_image(
            next,
            PATIENCE_NS,
            vk::Semaphore::null(),
            fence,
        );
        assert!(first.is_ok());
        device.wait_for_fences(&[fence], true, PATIENCE_NS).unwrap();
        device.destroy_fence(fence, None);
        device.destroy_command_pool(pool, None);
        device.destroy_semaphore(acquired, None);
        device.destroy_semaphore(drawn, None);
        presenter.swapchains.destroy_swapchain(swapchain, None);
        presenter.swapchains.destroy_swapchain(next, None);
    }
}

/// # Safety
/// The command buffer is being recorded, and the image is an acquired one.
unsafe fn clear(device: &ash::Device, commands: vk::CommandBuffer, image: vk::Image) {
    let range = vk::ImageSubresourceRange::default()
        .aspect_mask(vk::ImageAspectFlags::COLOR)
        .level_count(1)
        .layer_count(1);
    let barrier = |from, to| {
        vk::ImageMemoryBarrier::default()
            .old_layout(from)
            .new_layout(to)
            .dst_access_mask(vk::AccessFlags::TRANSFER_WRITE)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .image(image)
            .subresource_range(range)
    };
    let stage = vk::PipelineStageFlags::TRANSFER;
    let none = vk::DependencyFlags::empty();
    let cleared = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
    // SAFETY: the caller's promise.
    unsafe {
        let before = barrier(vk::ImageLayout::UNDEFINED, cleared);
        device.cmd_pipeline_barrier(commands, stage, stage, none, &[], &[], &[before]);
        let color = vk::ClearColorValue::default();
        device.cmd_clear_color_image(commands, image, cleared, &color, &[range]);
        let after = barrier(cleared, vk::ImageLayout::PRESENT_SRC_KHR);
        device.cmd_pipeline_barrier(commands, stage, stage, none, &[], &[], &[after]);
    }
}
