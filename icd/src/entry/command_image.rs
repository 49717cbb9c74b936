//! Transfer commands on images. Both forms of each record the same command. Image layouts have no
//! effect.

use ash::vk;

use super::record::record;
use crate::VkResult;
use crate::command::{Command, Recording, TransferCommand, copied};
use crate::ffi::{self, vk as newer};
use crate::handle::{from_handle, retain};
use crate::object::render_pass::ResolveMode;
use crate::object::{Buffer, Image};

pub(crate) unsafe extern "system" fn vkCmdCopyImage(
    commands: vk::CommandBuffer,
    source: vk::Image,
    _source_layout: vk::ImageLayout,
    destination: vk::Image,
    _destination_layout: vk::ImageLayout,
    count: u32,
    regions: *const vk::ImageCopy,
) {
    record("vkCmdCopyImage", commands, move |commands| {
        let regions = copied(ffi::slice(regions, count), |&region| region)?;
        copy_image(commands, source, destination, regions)
    })
}

pub(crate) unsafe extern "system" fn vkCmdCopyImage2(
    commands: vk::CommandBuffer,
    info: *const vk::CopyImageInfo2,
) {
    record("vkCmdCopyImage2", commands, move |commands| {
        let info = &*info;
        let regions = copied(ffi::slice(info.p_regions, info.region_count), image_copy)?;
        copy_image(commands, info.src_image, info.dst_image, regions)
    })
}

pub(crate) unsafe extern "system" fn vkCmdCopyBufferToImage(
    commands: vk::CommandBuffer,
    source: vk::Buffer,
    destination: vk::Image,
    _layout: vk::ImageLayout,
    count: u32,
    regions: *const vk::BufferImageCopy,
) {
    record("vkCmdCopyBufferToImage", commands, move |commands| {
        let regions = copied(ffi::slice(regions, count), |&region| region)?;
        copy_buffer_to_image(commands, source, destination, regions)
    })
}

pub(crate) unsafe extern "system" fn vkCmdCopyBufferToImage2(
    commands: vk::CommandBuffer,
    info: *const vk::CopyBufferToImageInfo2,
) {
    record("vkCmdCopyBufferToImage2", commands, move |commands| {
        let info = &*info;
        let regions = ffi::slice(info.p_regions, info.region_count);
        let regions = copied(regions, buffer_image_copy)?;
        copy_buffer_to_image(commands, info.src_buffer, info.dst_image, regions)
    })
}

pub(crate) unsafe extern "system" fn vkCmdCopyImageToBuffer(
    commands: vk::CommandBuffer,
    source: vk::Image,
    _layout: vk::ImageLayout,
    destination: vk::Buffer,
    count: u32,
    regions: *const vk::BufferImageCopy,
) {
    record("vkCmdCopyImageToBuffer", commands, move |commands| {
        let regions = copied(ffi::slice(regions, count), |&region| region)?;
        copy_image_to_buffer(commands, source, destination, regions)
    })
}

pub(crate) unsafe extern "system" fn vkCmdCopyImageToBuffer2(
    commands: vk::CommandBuffer,
    info: *const vk::CopyImageToBufferInfo2,
) {
    record("vkCmdCopyImageToBuffer2", commands, move |commands| {
        let info = &*info;
        let regions = ffi::slice(info.p_regions, info.region_count);
        let regions = copied(regions, buffer_image_copy)?;
        copy_image_to_buffer(commands, info.src_image, info.dst_buffer, regions)
    })
}

pub(crate) unsafe extern "system" fn vkCmdBlitImage(
    commands: vk::CommandBuffer,
    source: vk::Image,
    _source_layout: vk::ImageLayout,
    destination: vk::Image,
    _destination_layout: vk::ImageLayout,
    count: u32,
    regions: *const vk::ImageBlit,
    filter: vk::Filter,
) {
    record("vkCmdBlitImage", commands, move |commands| {
        let regions = copied(ffi::slice(regions, count), |&region| region)?;
        blit_image(commands, source, destination, regions, filter)
    })
}

pub(crate) unsafe extern "system" fn vkCmdBlitImage2(
    commands: vk::CommandBuffer,
    info: *const vk::BlitImageInfo2,
) {
    record("vkCmdBlitImage2", commands, move |commands| {
        let info = &*info;
        let regions = copied(ffi::slice(info.p_regions, info.region_count), image_blit)?;
        blit_image(
            commands,
            info.src_image,
            info.dst_image,
            regions,
            info.filter,
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdResolveImage(
    commands: vk::CommandBuffer,
    source: vk::Image,
    _source_layout: vk::ImageLayout,
    destination: vk::Image,
    _destination_layout: vk::ImageLayout,
    count: u32,
    regions: *const vk::ImageResolve,
) {
    record("vkCmdResolveImage", commands, move |commands| {
        let regions = copied(ffi::slice(regions, count), |&region| region)?;
        resolve_image(commands, source, destination, regions, None)
    })
}

pub(crate) unsafe extern "system" fn vkCmdResolveImage2(
    commands: vk::CommandBuffer,
    info: *const vk::ResolveImageInfo2,
) {
    record("vkCmdResolveImage2", commands, move |commands| {
        let info = &*info;
        let modes = ffi::find::<newer::ResolveImageModeInfoKHR<'_>>(info.p_next);
        let regions = copied(ffi::slice(info.p_regions, info.region_count), image_resolve)?;
        resolve_image(commands, info.src_image, info.dst_image, regions, modes)
    })
}

pub(crate) unsafe extern "system" fn vkCmdClearColorImage(
    commands: vk::CommandBuffer,
    image: vk::Image,
    _layout: vk::ImageLayout,
    value: *const vk::ClearColorValue,
    count: u32,
    ranges: *const vk::ImageSubresourceRange,
) {
    record("vkCmdClearColorImage", commands, move |commands| {
        commands.push(Command::Transfer(TransferCommand::ClearColorImage {
            image: retain::<Image>(image),
            value: *value,
            ranges: copied(ffi::slice(ranges, count), |&range| range)?,
        }))
    })
}

pub(crate) unsafe extern "system" fn vkCmdClearDepthStencilImage(
    commands: vk::CommandBuffer,
    image: vk::Image,
    _layout: vk::ImageLayout,
    value: *const vk::ClearDepthStencilValue,
    count: u32,
    ranges: *const vk::ImageSubresourceRange,
) {
    record("vkCmdClearDepthStencilImage", commands, move |commands| {
        commands.push(Command::Transfer(TransferCommand::ClearDepthStencilImage {
            image: retain::<Image>(image),
            value: *value,
            ranges: copied(ffi::slice(ranges, count), |&range| range)?,
        }))
    })
}

/// # Safety
/// The handles are alive.
unsafe fn copy_image(
    commands: &mut Recording,
    source: vk::Image,
    destination: vk::Image,
    regions: Vec<vk::ImageCopy>,
) -> VkResult {
    // SAFETY: the caller guarantees that the handles are alive.
    let (source, destination) = unsafe { (retain(source), retain(destination)) };
    commands.push(Command::Transfer(TransferCommand::CopyImage {
        source,
        destination,
        regions,
    }))
}

/// # Safety
/// The handles are alive.
unsafe fn copy_buffer_to_image(
    commands: &mut Recording,
    source: vk::Buffer,
    destination: vk::Image,
    regions: Vec<vk::BufferImageCopy>,
) -> VkResult {
    // SAFETY: the caller guarantees that the handles are alive.
    let (source, destination) = unsafe { (address(source)?, retain(destination)) };
    commands.push(Command::Transfer(TransferCommand::CopyBufferToImage {
        source,
        destination,
        regions,
    }))
}

/// # Safety
/// The handles are alive.
unsafe fn copy_image_to_buffer(
    commands: &mut Recording,
    source: vk::Image,
    destination: vk::Buffer,
    regions: Vec<vk::BufferImageCopy>,
) -> VkResult {
    // SAFETY: the caller guarantees that the handles are alive.
    let (source, destination) = unsafe { (retain(source), address(destination)?) };
    commands.push(Command::Transfer(TransferCommand::CopyImageToBuffer {
        source,
        destination,
        regions,
    }))
}

/// # Safety
/// The handles are alive.
unsafe fn blit_image(
    commands: &mut Recording,
    source: vk::Image,
    destination: vk::Image,
    regions: Vec<vk::ImageBlit>,
    filter: vk::Filter,
) -> VkResult {
    // SAFETY: the caller guarantees that the handles are alive.
    let (source, destination) = unsafe { (retain(source), retain(destination)) };
    commands.push(Command::Transfer(TransferCommand::BlitImage {
        source,
        destination,
        regions,
        filter,
    }))
}

/// Without modes, colors and depth are averaged, and stencil values are those of sample 0.
///
/// # Safety
/// The handles are alive.
unsafe fn resolve_image(
    commands: &mut Recording,
    source: vk::Image,
    destination: vk::Image,
    regions: Vec<vk::ImageResolve>,
    modes: Option<&newer::ResolveImageModeInfoKHR<'_>>,
) -> VkResult {
    let mut other = ResolveMode::AVERAGE;
    let mut stencil = vk::ResolveModeFlags::SAMPLE_ZERO;
    if let Some(modes) = modes {
        other = ResolveMode {
            mode: modes.resolve_mode,
            encoded_mean: modes.flags & newer::RESOLVE_IMAGE_SKIP_TRANSFER_FUNCTION_KHR != 0,
        };
        stencil = modes.stencil_resolve_mode;
    }
    // SAFETY: the caller guarantees that the handles are alive.
    let (source, destination) = unsafe { (retain(source), retain(destination)) };
    commands.push(Command::Transfer(TransferCommand::ResolveImage {
        source,
        destination,
        regions,
        stencil: ResolveMode::linear(stencil),
        other,
    }))
}

/// The address of a buffer.
///
/// # Safety
/// The handle is alive.
unsafe fn address(buffer: vk::Buffer) -> VkResult<u64> {
    // SAFETY: the caller guarantees that the handle is alive.
    let (address, _) = unsafe { from_handle::<Buffer>(buffer) }.range(0, vk::WHOLE_SIZE)?;
    Ok(address as u64)
}

fn image_copy(region: &vk::ImageCopy2<'_>) -> vk::ImageCopy {
    vk::ImageCopy {
        src_subresource: region.src_subresource,
        src_offset: region.src_offset,
        dst_subresource: region.dst_subresource,
        dst_offset: region.dst_offset,
        extent: region.extent,
    }
}

fn image_blit(region: &vk::ImageBlit2<'_>) -> vk::ImageBlit {
    vk::ImageBlit {
        src_subresource: region.src_subresource,
        src_offsets: region.src_offsets,
        dst_subresource: region.dst_subresource,
        dst_offsets: region.dst_offsets,
    }
}

fn image_resolve(region: &vk::ImageResolve2<'_>) -> vk::ImageResolve {
    vk::ImageResolve {
        src_subresource: region.src_subresource,
        src_offset: region.src_offset,
        dst_subresource: region.dst_subresource,
        dst_offset: region.dst_offset,
        extent: region.extent,
    }
}

fn buffer_image_copy(region: &vk::BufferImageCopy2<'_>) -> vk::BufferImageCopy {
    vk::BufferImageCopy {
        buffer_offset: region.buffer_offset,
        buffer_row_length: region.buffer_row_length,
        buffer_image_height: region.buffer_image_height,
        image_subresource: region.image_subresource,
        image_offset: region.image_offset,
        image_extent: region.image_extent,
    }
}
