//! `VK_EXT_host_image_copy`: immediate copies by the host. Images are stored linearly, so
//! `VK_HOST_IMAGE_COPY_MEMCPY_EXT` has no effect: the rows of a whole subresource are as dense in
//! the image as in memory.

use std::ffi::c_void;

use ash::vk;

use crate::device::Device;
use crate::ffi::slice;
use crate::guard::guard_result;
use crate::handle::from_handle;
use crate::object::Image;
use crate::transfer::copy;

/// The region as one of a buffer that starts at the host pointer.
fn of_buffer(
    (row_length, image_height): (u32, u32),
    subresource: vk::ImageSubresourceLayers,
    offset: vk::Offset3D,
    extent: vk::Extent3D,
) -> vk::BufferImageCopy {
    vk::BufferImageCopy {
        buffer_offset: 0,
        buffer_row_length: row_length,
        buffer_image_height: image_height,
        image_subresource: subresource,
        image_offset: offset,
        image_extent: extent,
    }
}

fn address(pointer: *const c_void) -> u64 {
    pointer as u64
}

pub(crate) unsafe extern "system" fn vkCopyMemoryToImageEXT(
    device: vk::Device,
    info: *const vk::CopyMemoryToImageInfoEXT<'_>,
) -> vk::Result {
    guard_result("vkCopyMemoryToImageEXT", move || {
        let workers = &from_handle::<Device>(device).engine.workers;
        let info = &*info;
        let image = from_handle::<Image>(info.dst_image);
        for region in slice(info.p_regions, info.region_count) {
            let lengths = (region.memory_row_length, region.memory_image_height);
            let copy = of_buffer(
                lengths,
                region.image_subresource,
                region.image_offset,
                region.image_extent,
            );
            copy::copy_buffer_to_image(workers, address(region.p_host_pointer), image, &copy);
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCopyImageToMemoryEXT(
    device: vk::Device,
    info: *const vk::CopyImageToMemoryInfoEXT<'_>,
) -> vk::Result {
    guard_result("vkCopyImageToMemoryEXT", move || {
        let workers = &from_handle::<Device>(device).engine.workers;
        let info = &*info;
        let image = from_handle::<Image>(info.src_image);
        for region in slice(info.p_regions, info.region_count) {
            let lengths = (region.memory_row_length, region.memory_image_height);
            let copy = of_buffer(
                lengths,
                region.image_subresource,
                region.image_offset,
                region.image_extent,
            );
            copy::copy_image_to_buffer(workers, image, address(region.p_host_pointer), &copy);
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCopyImageToImageEXT(
    device: vk::Device,
    info: *const vk::CopyImageToImageInfoEXT<'_>,
) -> vk::Result {
    guard_result("vkCopyImageToImageEXT", move || {
        let workers = &from_handle::<Device>(device).engine.workers;
        let info = &*info;
        let (source, destination) = (
            from_handle::<Image>(info.src_image),
            from_handle::<Image>(info.dst_image),
        );
        for region in slice(info.p_regions, info.region_count) {
            let copy = vk::ImageCopy {
                src_subresource: region.src_subresource,
                src_offset: region.src_offset,
                dst_subresource: region.dst_subresource,
                dst_offset: region.dst_offset,
                extent: region.extent,
            };
            copy::copy_image(workers, source, destination, &copy);
        }
        Ok(())
    })
}

/// Layouts have no effect.
pub(crate) unsafe extern "system" fn vkTransitionImageLayoutEXT(
    _device: vk::Device,
    _count: u32,
    _transitions: *const vk::HostImageLayoutTransitionInfoEXT<'_>,
) -> vk::Result {
    vk::Result::SUCCESS
}
