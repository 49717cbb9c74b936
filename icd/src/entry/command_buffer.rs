//! Commands on buffers.

use std::ffi::c_void;

use ash::vk;

use crate::VkResult;
use crate::command::{Command, Recording};
use crate::ffi::{self, commands};
use crate::handle::from_handle;
use crate::object::Buffer;

/// Records a copy of one region.
fn copy(
    recording: &mut Recording,
    source: &Buffer,
    destination: &Buffer,
    region: vk::BufferCopy,
) -> VkResult {
    let (source, size_bytes) = source.range(region.src_offset, region.size)?;
    let (destination, _) = destination.range(region.dst_offset, region.size)?;
    recording.push(Command::CopyBuffer {
        source: source as u64,
        destination: destination as u64,
        size_bytes,
    });
    Ok(())
}

commands! {
    fn vkCmdCopyBuffer(
        recording,
        source: vk::Buffer,
        destination: vk::Buffer,
        count: u32,
        regions: *const vk::BufferCopy,
    ) {
        let (source, destination) = (from_handle::<Buffer>(source), from_handle::<Buffer>(destination));
        ffi::slice(regions, count).iter().try_for_each(|region| copy(recording, source, destination, *region))
    }

    fn vkCmdCopyBuffer2(recording, info: *const vk::CopyBufferInfo2) {
        let info = &*info;
        let (source, destination) = (from_handle::<Buffer>(info.src_buffer), from_handle::<Buffer>(info.dst_buffer));
        ffi::slice(info.p_regions, info.region_count).iter().try_for_each(|region| {
            let region = vk::BufferCopy {
                src_offset: region.src_offset,
                dst_offset: region.dst_offset,
                size: region.size,
            };
            copy(recording, source, destination, region)
        })
    }

    fn vkCmdFillBuffer(recording, buffer: vk::Buffer, offset: vk::DeviceSize, size: vk::DeviceSize, word: u32) {
        let (address, size_bytes) = from_handle::<Buffer>(buffer).range(offset, size)?;
        // With `VK_WHOLE_SIZE` the rest after the last whole word stays as it is.
        recording.push(Command::FillBuffer { address: address as u64, size_bytes: size_bytes & !3, word });
        Ok(())
    }

    fn vkCmdUpdateBuffer(
        recording,
        buffer: vk::Buffer,
        offset: vk::DeviceSize,
        size: vk::DeviceSize,
        data: *const c_void,
    ) {
        let (address, size_bytes) = from_handle::<Buffer>(buffer).range(offset, size)?;
        let size_bytes = u32::try_from(size_bytes).map_err(|_| vk::Result::ERROR_UNKNOWN)?;
        let bytes = ffi::slice(data.cast::<u8>(), size_bytes).into();
        recording.push(Command::UpdateBuffer { address: address as u64, bytes });
        Ok(())
    }
}
