//! Transfer commands.

use ash::vk;

use super::record::record;
use crate::VkResult;
use crate::command::{Command, Recording, TransferCommand, copied};
use crate::ffi;
use crate::handle;
use crate::object::Buffer;

pub(crate) unsafe extern "system" fn vkCmdCopyBuffer(
    commands: vk::CommandBuffer,
    source: vk::Buffer,
    destination: vk::Buffer,
    count: u32,
    regions: *const vk::BufferCopy,
) {
    record("vkCmdCopyBuffer", commands, move |commands| {
        ffi::slice(regions, count)
            .iter()
            .try_for_each(|region| copy_buffer(commands, source, destination, *region))
    })
}

pub(crate) unsafe extern "system" fn vkCmdCopyBuffer2(
    commands: vk::CommandBuffer,
    info: *const vk::CopyBufferInfo2,
) {
    record("vkCmdCopyBuffer2", commands, move |commands| {
        let info = &*info;
        ffi::slice(info.p_regions, info.region_count)
            .iter()
            .try_for_each(|region| {
                let region = vk::BufferCopy {
                    src_offset: region.src_offset,
                    dst_offset: region.dst_offset,
                    size: region.size,
                };
                copy_buffer(commands, info.src_buffer, info.dst_buffer, region)
            })
    })
}

pub(crate) unsafe extern "system" fn vkCmdFillBuffer(
    commands: vk::CommandBuffer,
    buffer: vk::Buffer,
    offset: vk::DeviceSize,
    size_bytes: vk::DeviceSize,
    word: u32,
) {
    record("vkCmdFillBuffer", commands, move |commands| {
        // With VK_WHOLE_SIZE the bytes after the last whole word are not written.
        let (address, size_bytes) =
            handle::from_handle::<Buffer>(buffer).range(offset, size_bytes)?;
        commands.push(Command::Transfer(TransferCommand::FillBuffer {
            address: address as u64,
            size_bytes,
            word,
        }))
    })
}

pub(crate) unsafe extern "system" fn vkCmdUpdateBuffer(
    commands: vk::CommandBuffer,
    buffer: vk::Buffer,
    offset: vk::DeviceSize,
    size_bytes: vk::DeviceSize,
    data: *const std::ffi::c_void,
) {
    record("vkCmdUpdateBuffer", commands, move |commands| {
        let (address, _) = handle::from_handle::<Buffer>(buffer).range(offset, size_bytes)?;
        // At most 65,536 bytes (VUID-vkCmdUpdateBuffer-dataSize-00037).
        let bytes = ffi::slice::<u8>(data.cast(), size_bytes as u32);
        let bytes = copied(bytes, |&byte| byte)?.into();
        commands.push(Command::Transfer(TransferCommand::UpdateBuffer {
            address: address as u64,
            bytes,
        }))
    })
}

/// # Safety
/// The handles are alive.
unsafe fn copy_buffer(
    commands: &mut Recording,
    source: vk::Buffer,
    destination: vk::Buffer,
    region: vk::BufferCopy,
) -> VkResult {
    // SAFETY: the caller guarantees that the handles are alive.
    let (source, destination) = unsafe {
        (
            handle::from_handle::<Buffer>(source),
            handle::from_handle::<Buffer>(destination),
        )
    };
    let (source, _) = source.range(region.src_offset, region.size)?;
    let (destination, size_bytes) = destination.range(region.dst_offset, region.size)?;
    commands.push(Command::Transfer(TransferCommand::CopyBuffer {
        source: source as u64,
        destination: destination as u64,
        size_bytes,
    }))
}
