//! `VK_KHR_maintenance5`: the commands that fit in no other file.

use ash::vk;

use super::image::subresource_layout;
use crate::decode::image::image_info;
use crate::ffi::chain;
use crate::guard::guard;
use crate::handle::from_handle;
use crate::object::Image;

/// Fills a layout structure and its chain.
///
/// # Safety
/// `out` is valid, with a valid chain.
unsafe fn write_layout(out: *mut vk::SubresourceLayout2KHR<'_>, layout: vk::SubresourceLayout) {
    // SAFETY: the caller guarantees that `out` is valid, with a valid chain.
    unsafe {
        (*out).subresource_layout = layout;
        if let Some(memcpy) = chain::find_mut::<vk::SubresourceHostMemcpySizeEXT>((*out).p_next) {
            memcpy.size = layout.size;
        }
    }
}

pub(crate) unsafe extern "system" fn vkGetRenderingAreaGranularityKHR(
    _device: vk::Device,
    _info: *const vk::RenderingAreaInfoKHR<'_>,
    out: *mut vk::Extent2D,
) {
    guard("vkGetRenderingAreaGranularityKHR", move || {
        // No render area granularity is better than another.
        *out = vk::Extent2D {
            width: 1,
            height: 1,
        };
    })
}

pub(crate) unsafe extern "system" fn vkGetImageSubresourceLayout2KHR(
    _device: vk::Device,
    image: vk::Image,
    subresource: *const vk::ImageSubresource2KHR<'_>,
    out: *mut vk::SubresourceLayout2KHR<'_>,
) {
    guard("vkGetImageSubresourceLayout2KHR", move || {
        let layout = subresource_layout(
            from_handle::<Image>(image),
            &(*subresource).image_subresource,
        );
        write_layout(out, layout.unwrap_or_default());
    })
}

pub(crate) unsafe extern "system" fn vkGetDeviceImageSubresourceLayoutKHR(
    _device: vk::Device,
    info: *const vk::DeviceImageSubresourceInfoKHR<'_>,
    out: *mut vk::SubresourceLayout2KHR<'_>,
) {
    guard("vkGetDeviceImageSubresourceLayoutKHR", move || {
        let info = &*info;
        let image = Image::new(&image_info(&*info.p_create_info));
        let layout = image
            .and_then(|image| subresource_layout(&image, &(*info.p_subresource).image_subresource));
        write_layout(out, layout.unwrap_or_default());
    })
}
