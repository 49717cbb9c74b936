//! `VK_KHR_device_address_commands`: commands on address ranges. All commands are recorded by
//! address; a null range is ignored. `VK_KHR_copy_memory_indirect`: copies with parameters in
//! memory.

use super::acceleration_structure::create;
use super::record::record;
use crate::VkResult;
use crate::command::{Command, CopyQueryPoolResults, Parameters, Recording, TransferCommand};
use crate::device::Device;
use crate::ffi;
use crate::ffi::vk;
use crate::guard::guard_result;
use crate::handle::{from_handle, retain};
use crate::object::acceleration_structure::Location;
use crate::object::{AccelerationStructure, Image, QueryPool};

fn copy_memory(commands: &mut Recording, copy: &vk::DeviceMemoryCopyKHR<'_>) -> VkResult {
    let (source, destination) = (copy.src_range, copy.dst_range);
    if source.address == 0 || destination.address == 0 {
        return Ok(());
    }
    commands.push(Command::Transfer(TransferCommand::CopyBuffer {
        source: source.address,
        destination: destination.address,
        size_bytes: source.size.min(destination.size),
    }))
}

/// The copy of a region, from or to the start of its range.
fn image_copy(region: &vk::DeviceMemoryImageCopyKHR<'_>) -> vk::BufferImageCopy {
    vk::BufferImageCopy {
        buffer_offset: 0,
        buffer_row_length: region.address_row_length,
        buffer_image_height: region.address_image_height,
        image_subresource: region.image_subresource,
        image_offset: region.image_offset,
        image_extent: region.image_extent,
    }
}

pub(crate) unsafe extern "system" fn vkCreateAccelerationStructure2KHR(
    device: vk::Device,
    info: *const vk::AccelerationStructureCreateInfo2KHR<'_>,
    _allocator: *const vk::AllocationCallbacks<'_>,
    structure: *mut vk::AccelerationStructureKHR,
) -> vk::Result {
    guard_result("vkCreateAccelerationStructure2KHR", move || {
        let info = &*info;
        *structure = create(
            from_handle::<Device>(device),
            AccelerationStructure {
                ty: info.ty,
                location: Location::Address(info.address_range.address),
                size_bytes: info.address_range.size,
                replayable: None,
            },
        );
        Ok(())
    })
}

fn parameters(range: vk::StridedDeviceAddressRangeKHR) -> Parameters {
    Parameters {
        address: range.address,
        stride_bytes: range.stride,
    }
}

pub(crate) unsafe extern "system" fn vkCmdCopyMemoryIndirectKHR(
    commands: vk::CommandBuffer,
    info: *const vk::CopyMemoryIndirectInfoKHR<'_>,
) {
    record("vkCmdCopyMemoryIndirectKHR", commands, move |commands| {
        let info = &*info;
        commands.push(Command::Transfer(TransferCommand::CopyMemoryIndirect {
            parameters: parameters(info.copy_address_range),
            count: info.copy_count,
        }))
    })
}

pub(crate) unsafe extern "system" fn vkCmdCopyMemoryToImageIndirectKHR(
    commands: vk::CommandBuffer,
    info: *const vk::CopyMemoryToImageIndirectInfoKHR<'_>,
) {
    record(
        "vkCmdCopyMemoryToImageIndirectKHR",
        commands,
        move |commands| {
            let info = &*info;
            commands.push(Command::Transfer(
                TransferCommand::CopyMemoryToImageIndirect {
                    parameters: parameters(info.copy_address_range),
                    destination: retain::<Image>(info.dst_image),
                    layers: ffi::slice(info.p_image_subresources, info.copy_count).to_vec(),
                },
            ))
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdCopyMemoryKHR(
    commands: vk::CommandBuffer,
    info: *const vk::CopyDeviceMemoryInfoKHR<'_>,
) {
    record("vkCmdCopyMemoryKHR", commands, move |commands| {
        let regions = ffi::slice((*info).p_regions, (*info).region_count);
        regions
            .iter()
            .try_for_each(|region| copy_memory(commands, region))
    })
}

pub(crate) unsafe extern "system" fn vkCmdCopyMemoryToImageKHR(
    commands: vk::CommandBuffer,
    info: *const vk::CopyDeviceMemoryImageInfoKHR<'_>,
) {
    record("vkCmdCopyMemoryToImageKHR", commands, move |commands| {
        let regions = ffi::slice((*info).p_regions, (*info).region_count);
        regions
            .iter()
            .filter(|region| region.address_range.address != 0)
            .try_for_each(|region| {
                commands.push(Command::Transfer(TransferCommand::CopyBufferToImage {
                    source: region.address_range.address,
                    destination: retain::<Image>((*info).image),
                    regions: vec![image_copy(region)],
                }))
            })
    })
}

pub(crate) unsafe extern "system" fn vkCmdCopyImageToMemoryKHR(
    commands: vk::CommandBuffer,
    info: *const vk::CopyDeviceMemoryImageInfoKHR<'_>,
) {
    record("vkCmdCopyImageToMemoryKHR", commands, move |commands| {
        let regions = ffi::slice((*info).p_regions, (*info).region_count);
        regions
            .iter()
            .filter(|region| region.address_range.address != 0)
            .try_for_each(|region| {
                commands.push(Command::Transfer(TransferCommand::CopyImageToBuffer {
                    source: retain::<Image>((*info).image),
                    destination: region.address_range.address,
                    regions: vec![image_copy(region)],
                }))
            })
    })
}

pub(crate) unsafe extern "system" fn vkCmdUpdateMemoryKHR(
    commands: vk::CommandBuffer,
    range: *const vk::DeviceAddressRangeKHR,
    _flags: vk::AddressCommandFlagsKHR,
    size_bytes: vk::DeviceSize,
    data: *const std::ffi::c_void,
) {
    record("vkCmdUpdateMemoryKHR", commands, move |commands| {
        let range = *range;
        if range.address == 0 {
            return Ok(());
        }
        let bytes = ffi::slice::<u8>(data.cast(), size_bytes.min(range.size) as u32).into();
        commands.push(Command::Transfer(TransferCommand::UpdateBuffer {
            address: range.address,
            bytes,
        }))
    })
}

pub(crate) unsafe extern "system" fn vkCmdFillMemoryKHR(
    commands: vk::CommandBuffer,
    range: *const vk::DeviceAddressRangeKHR,
    _flags: vk::AddressCommandFlagsKHR,
    word: u32,
) {
    record("vkCmdFillMemoryKHR", commands, move |commands| {
        let vk::DeviceAddressRangeKHR { address, size } = *range;
        if address == 0 {
            return Ok(());
        }
        commands.push(Command::Transfer(TransferCommand::FillBuffer {
            address,
            size_bytes: size,
            word,
        }))
    })
}

pub(crate) unsafe extern "system" fn vkCmdDispatchIndirect2KHR(
    commands: vk::CommandBuffer,
    info: *const vk::DispatchIndirect2InfoKHR<'_>,
) {
    record("vkCmdDispatchIndirect2KHR", commands, move |commands| {
        let address = (*info).address_range.address;
        if address == 0 {
            return Ok(());
        }
        commands.push(Command::DispatchIndirect { address })
    })
}

pub(crate) unsafe extern "system" fn vkCmdCopyQueryPoolResultsToMemoryKHR(
    commands: vk::CommandBuffer,
    pool: vk::QueryPool,
    first: u32,
    count: u32,
    range: *const vk::StridedDeviceAddressRangeKHR,
    _flags: vk::AddressCommandFlagsKHR,
    flags: vk::QueryResultFlags,
) {
    record(
        "vkCmdCopyQueryPoolResultsToMemoryKHR",
        commands,
        move |commands| {
            let range = *range;
            if range.address == 0 {
                return Ok(());
            }
            commands.push(Command::CopyQueryPoolResults(CopyQueryPoolResults {
                pool: retain::<QueryPool>(pool),
                first,
                count,
                address: range.address,
                stride_bytes: range.stride,
                flags,
            }))
        },
    )
}
