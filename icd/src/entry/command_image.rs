//! Transfer commands on images. Both forms of each record the same command. Image layouts have no
//! effect.

use ash::vk;

use super::record::record;
use crate::VkResult;
use crate::command::{Command, TransferCommand, copied};
use crate::ffi::{self, vk as newer};
use crate::handle::{self, from_handle};
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
        commands.push(Command::Transfer(TransferCommand::CopyImage {
            source: handle::retain::<Image>(source),
            destination: handle::retain::<Image>(destination),
            regions: copied(ffi::slice(regions, count), |&region| region)?,
        }))
    })
}

pub(crate) unsafe extern "system" fn vkCmdCopyImage2(
    commands: vk::CommandBuffer,
    info: *const vk::CopyImageInfo2,
) {
    record("vkCmdCopyImage2", commands, move |commands| {
        let info = &*info;
        commands.push(Command::Transfer(TransferCommand::CopyImage {
            source: handle::retain::<Image>(info.src_image),
            destination: handle::retain::<Image>(info.dst_image),
            regions: copied(ffi::slice(info.p_regions, info.region_count), |region| {
                vk::ImageCopy {
                    src_subresource: region.src_subresource,
                    src_offset: region.src_offset,
                    dst_subresource: region.dst_subresource,
                    dst_offset: region.dst_offset,
                    extent: region.extent,
                }
            })?,
        }))
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
        commands.push(Command::Transfer(TransferCommand::CopyBufferToImage {
            source: address(source)?,
            destination: handle::retain::<Image>(destination),
            regions: copied(ffi::slice(regions, count), |&region| region)?,
        }))
    })
}

pub(crate) unsafe extern "system" fn vkCmdCopyBufferToImage2(
    commands: vk::CommandBuffer,
    info: *const vk::CopyBufferToImageInfo2,
) {
    record("vkCmdCopyBufferToImage2", commands, move |commands| {
        let info = &*info;
        commands.push(Command::Transfer(TransferCommand::CopyBufferToImage {
            source: address(info.src_buffer)?,
            destination: handle::retain::<Image>(info.dst_image),
            regions: copied(
                ffi::slice(info.p_regions, info.region_count),
                buffer_image_copy,
            )?,
        }))
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
        commands.push(Command::Transfer(TransferCommand::CopyImageToBuffer {
            source: handle::retain::<Image>(source),
            destination: address(destination)?,
            regions: copied(ffi::slice(regions, count), |&region| region)?,
        }))
    })
}

pub(crate) unsafe extern "system" fn vkCmdCopyImageToBuffer2(
    commands: vk::CommandBuffer,
    info: *const vk::CopyImageToBufferInfo2,
) {
    record("vkCmdCopyImageToBuffer2", commands, move |commands| {
        let info = &*info;
        commands.push(Command::Transfer(TransferCommand::CopyImageToBuffer {
            source: handle::retain::<Image>(info.src_image),
            destination: address(info.dst_buffer)?,
            regions: copied(
                ffi::slice(info.p_regions, info.region_count),
                buffer_image_copy,
            )?,
        }))
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
        commands.push(Command::Transfer(TransferCommand::BlitImage {
            source: handle::retain::<Image>(source),
            destination: handle::retain::<Image>(destination),
            regions: copied(ffi::slice(regions, count), |&region| region)?,
            filter,
        }))
    })
}

pub(crate) unsafe extern "system" fn vkCmdBlitImage2(
    commands: vk::CommandBuffer,
    info: *const vk::BlitImageInfo2,
) {
    record("vkCmdBlitImage2", commands, move |commands| {
        let info = &*info;
        commands.push(Command::Transfer(TransferCommand::BlitImage {
            source: handle::retain::<Image>(info.src_image),
            destination: handle::retain::<Image>(info.dst_image),
            regions: copied(ffi::slice(info.p_regions, info.region_count), |region| {
                vk::ImageBlit {
                    src_subresource: region.src_subresource,
                    src_offsets: region.src_offsets,
                    dst_subresource: region.dst_subresource,
                    dst_offsets: region.dst_offsets,
                }
            })?,
            filter: info.filter,
        }))
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
        commands.push(Command::Transfer(TransferCommand::ResolveImage {
            source: handle::retain::<Image>(source),
            destination: handle::retain::<Image>(destination),
            regions: copied(ffi::slice(regions, count), |&region| region)?,
            stencil: ResolveMode::linear(vk::ResolveModeFlags::SAMPLE_ZERO),
            other: ResolveMode::AVERAGE,
        }))
    })
}

pub(crate) unsafe extern "system" fn vkCmdResolveImage2(
    commands: vk::CommandBuffer,
    info: *const vk::ResolveImageInfo2,
) {
    record("vkCmdResolveImage2", commands, move |commands| {
        let info = &*info;
        let modes = ffi::find::<newer::ResolveImageModeInfoKHR<'_>>(info.p_next);
        let mut other = ResolveMode::AVERAGE;
        let mut stencil = vk::ResolveModeFlags::SAMPLE_ZERO;
        if let Some(modes) = modes {
            other = ResolveMode {
                mode: modes.resolve_mode,
                encoded_mean: modes.flags & newer::RESOLVE_IMAGE_SKIP_TRANSFER_FUNCTION_KHR != 0,
            };
            stencil = modes.stencil_resolve_mode;
        }
        commands.push(Command::Transfer(TransferCommand::ResolveImage {
            source: handle::retain::<Image>(info.src_image),
            destination: handle::retain::<Image>(info.dst_image),
            regions: copied(ffi::slice(info.p_regions, info.region_count), |region| {
                vk::ImageResolve {
                    src_subresource: region.src_subresource,
                    src_offset: region.src_offset,
                    dst_subresource: region.dst_subresource,
                    dst_offset: region.dst_offset,
                    extent: region.extent,
                }
            })?,
            stencil: ResolveMode::linear(stencil),
            other,
        }))
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
            image: handle::retain::<Image>(image),
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
            image: handle::retain::<Image>(image),
            value: *value,
            ranges: copied(ffi::slice(ranges, count), |&range| range)?,
        }))
    })
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
