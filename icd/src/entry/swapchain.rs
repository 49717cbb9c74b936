//! `VK_KHR_surface`, `VK_EXT_headless_surface` and `VK_KHR_swapchain`.

use std::sync::Arc;

use ash::vk;

use super::define::entry;
use super::destroy;
use crate::VkResult;
use crate::device::Device;
use crate::ffi::enumerate::enumerate;
use crate::ffi::{array, slice};
use crate::handle::{self, from_handle, optional, retain};
use crate::object::swapchain::{FORMATS, PRESENT_MODES, capabilities};
use crate::object::{Fence, Semaphore, Surface, Swapchain};
use crate::queue::{Queue, Submission};

destroy! {
    vkDestroySwapchainKHR: Swapchain, SwapchainKHR;
}

/// The images of a swapchain.
fn image_info<'a>(info: &vk::SwapchainCreateInfoKHR<'_>) -> vk::ImageCreateInfo<'a> {
    let mutable = info
        .flags
        .contains(vk::SwapchainCreateFlagsKHR::MUTABLE_FORMAT);
    vk::ImageCreateInfo::default()
        .flags(if mutable {
            vk::ImageCreateFlags::MUTABLE_FORMAT | vk::ImageCreateFlags::EXTENDED_USAGE
        } else {
            vk::ImageCreateFlags::empty()
        })
        .image_type(vk::ImageType::TYPE_2D)
        .format(info.image_format)
        .extent(vk::Extent3D {
            width: info.image_extent.width,
            height: info.image_extent.height,
            depth: 1,
        })
        .mip_levels(1)
        .array_layers(info.image_array_layers)
        .samples(vk::SampleCountFlags::TYPE_1)
        .tiling(vk::ImageTiling::OPTIMAL)
        .usage(info.image_usage)
}

/// Acquires an image, and signals at once: whoever presented it has read it.
///
/// # Safety
/// The handles are alive, or null where that is allowed.
unsafe fn acquire(
    device: vk::Device,
    swapchain: vk::SwapchainKHR,
    timeout_ns: u64,
    semaphore: vk::Semaphore,
    fence: vk::Fence,
) -> VkResult<u32> {
    // SAFETY: the caller's promise.
    unsafe {
        let index = from_handle::<Swapchain>(swapchain).acquire(timeout_ns)?;
        if let Some(semaphore) = optional::<Semaphore>(semaphore) {
            semaphore.signal(1);
        }
        if let Some(fence) = optional::<Fence>(fence) {
            fence.set(true);
            from_handle::<Device>(device).engine.waiting.notify();
        }
        Ok(index)
    }
}

entry! {
    fn vkCreateHeadlessSurfaceEXT(
        _instance: vk::Instance,
        _info: *const vk::HeadlessSurfaceCreateInfoEXT,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::SurfaceKHR,
    ) -> vk::Result {
        *out = handle::create(Surface);
        Ok(())
    }

    fn vkDestroySurfaceKHR(
        _instance: vk::Instance,
        surface: vk::SurfaceKHR,
        _allocator: *const vk::AllocationCallbacks,
    ) {
        drop(handle::take::<Surface>(surface));
    }

    fn vkGetPhysicalDeviceSurfaceSupportKHR(
        _device: vk::PhysicalDevice,
        _family: u32,
        _surface: vk::SurfaceKHR,
        out: *mut vk::Bool32,
    ) -> vk::Result {
        *out = vk::TRUE;
        Ok(())
    }

    fn vkGetPhysicalDeviceSurfaceCapabilitiesKHR(
        _device: vk::PhysicalDevice,
        _surface: vk::SurfaceKHR,
        out: *mut vk::SurfaceCapabilitiesKHR,
    ) -> vk::Result {
        *out = capabilities();
        Ok(())
    }

    fn vkGetPhysicalDeviceSurfaceFormatsKHR(
        _device: vk::PhysicalDevice,
        _surface: vk::SurfaceKHR,
        count: *mut u32,
        out: *mut vk::SurfaceFormatKHR,
    ) -> vk::Result {
        let color_space = vk::ColorSpaceKHR::SRGB_NONLINEAR;
        enumerate(count, out, FORMATS.map(|format| vk::SurfaceFormatKHR { format, color_space }).into_iter())
    }

    fn vkGetPhysicalDeviceSurfacePresentModesKHR(
        _device: vk::PhysicalDevice,
        _surface: vk::SurfaceKHR,
        count: *mut u32,
        out: *mut vk::PresentModeKHR,
    ) -> vk::Result {
        enumerate(count, out, PRESENT_MODES.into_iter())
    }

    fn vkGetPhysicalDevicePresentRectanglesKHR(
        _device: vk::PhysicalDevice,
        _surface: vk::SurfaceKHR,
        count: *mut u32,
        out: *mut vk::Rect2D,
    ) -> vk::Result {
        // As large as a swapchain makes it.
        let extent = vk::Extent2D { width: u32::MAX, height: u32::MAX };
        enumerate(count, out, [vk::Rect2D { extent, ..Default::default() }].into_iter())
    }

    fn vkGetDeviceGroupPresentCapabilitiesKHR(
        _device: vk::Device,
        out: *mut vk::DeviceGroupPresentCapabilitiesKHR,
    ) -> vk::Result {
        (*out).present_mask = [0; vk::MAX_DEVICE_GROUP_SIZE];
        (*out).present_mask[0] = 1;
        (*out).modes = vk::DeviceGroupPresentModeFlagsKHR::LOCAL;
        Ok(())
    }

    fn vkGetDeviceGroupSurfacePresentModesKHR(
        _device: vk::Device,
        _surface: vk::SurfaceKHR,
        out: *mut vk::DeviceGroupPresentModeFlagsKHR,
    ) -> vk::Result {
        *out = vk::DeviceGroupPresentModeFlagsKHR::LOCAL;
        Ok(())
    }

    fn vkCreateSwapchainKHR(
        device: vk::Device,
        info: *const vk::SwapchainCreateInfoKHR,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::SwapchainKHR,
    ) -> vk::Result {
        let device = from_handle::<Device>(device);
        let info = &*info;
        if let Some(old) = optional::<Swapchain>(info.old_swapchain) {
            old.retire();
        }
        let waiting = Arc::clone(&device.engine.waiting);
        let images = image_info(info);
        *out = handle::create(Swapchain::new(&images, info.min_image_count, &device.window, waiting)?);
        Ok(())
    }

    fn vkGetSwapchainImagesKHR(
        _device: vk::Device,
        swapchain: vk::SwapchainKHR,
        count: *mut u32,
        out: *mut vk::Image,
    ) -> vk::Result {
        let images = &from_handle::<Swapchain>(swapchain).images;
        enumerate(count, out, images.iter().map(handle::handle_of))
    }

    fn vkAcquireNextImageKHR(
        device: vk::Device,
        swapchain: vk::SwapchainKHR,
        timeout_ns: u64,
        semaphore: vk::Semaphore,
        fence: vk::Fence,
        out: *mut u32,
    ) -> vk::Result {
        *out = acquire(device, swapchain, timeout_ns, semaphore, fence)?;
        Ok(())
    }

    fn vkAcquireNextImage2KHR(
        device: vk::Device,
        info: *const vk::AcquireNextImageInfoKHR,
        out: *mut u32,
    ) -> vk::Result {
        let info = &*info;
        *out = acquire(device, info.swapchain, info.timeout, info.semaphore, info.fence)?;
        Ok(())
    }

    fn vkQueuePresentKHR(queue: vk::Queue, info: *const vk::PresentInfoKHR) -> vk::Result {
        let info = &*info;
        let semaphores = slice(info.p_wait_semaphores, info.wait_semaphore_count);
        let swapchains = slice(info.p_swapchains, info.swapchain_count);
        let indices = slice(info.p_image_indices, info.swapchain_count);
        let submission = Submission {
            waits: semaphores.iter().map(|&semaphore| (retain::<Semaphore>(semaphore), 1)).collect(),
            presents: swapchains
                .iter()
                .zip(indices)
                .map(|(&swapchain, &index)| (retain::<Swapchain>(swapchain), index))
                .collect(),
            ..Submission::default()
        };
        let result = from_handle::<Queue>(queue).submit([submission]);
        let code = crate::guard::code(result);
        array::slice_mut(info.p_results, info.swapchain_count).fill(code);
        result
    }
}
