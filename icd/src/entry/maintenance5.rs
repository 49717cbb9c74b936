//! `VK_KHR_maintenance5`: what it adds that no other file has.

use ash::vk;

use super::define::entry;
use super::image::subresource_layout;
use crate::handle::from_handle;
use crate::object::Image;

entry! {
    fn vkGetRenderingAreaGranularityKHR(
        _device: vk::Device,
        _info: *const vk::RenderingAreaInfoKHR<'_>,
        out: *mut vk::Extent2D,
    ) {
        // No area is better than another.
        *out = vk::Extent2D { width: 1, height: 1 };
    }

    fn vkGetImageSubresourceLayout2KHR(
        _device: vk::Device,
        image: vk::Image,
        subresource: *const vk::ImageSubresource2KHR<'_>,
        out: *mut vk::SubresourceLayout2KHR<'_>,
    ) {
        let layout = subresource_layout(from_handle::<Image>(image), &(*subresource).image_subresource);
        (*out).subresource_layout = layout.unwrap_or_default();
    }

    fn vkGetDeviceImageSubresourceLayoutKHR(
        _device: vk::Device,
        info: *const vk::DeviceImageSubresourceInfoKHR<'_>,
        out: *mut vk::SubresourceLayout2KHR<'_>,
    ) {
        let info = &*info;
        let image = Image::new(&*info.p_create_info);
        let layout = image.and_then(|image| subresource_layout(&image, &(*info.p_subresource).image_subresource));
        (*out).subresource_layout = layout.unwrap_or_default();
    }
}
