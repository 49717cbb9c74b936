//! `VK_EXT_opacity_micromap`: objects, sizes, and the commands on the host and on the device.

use std::ffi::c_void;

use ash::vk;
use spirv_jit::reach::Reach;

use super::address_report::report;
use super::built::{self, compatibility_of};
use super::deferred::defer_parallel;
use super::record::record;
use crate::capabilities::limits;
use crate::command::structures::{Built, BuiltCopy, CopyMode};
use crate::command::{Command, StructureCommand};
use crate::decode::micromap::{decode_build, storage, usages};
use crate::device::Device;
use crate::ffi::slice;
use crate::guard::{guard, guard_result};
use crate::handle::{self, from_handle, retain};
use crate::object::addressed::AddressEvent;
use crate::object::{Buffer, Micromap};
use crate::structures::micromap as execute;
use crate::validate::Caller;

pub(crate) unsafe extern "system" fn vkDestroyMicromapEXT(
    device: vk::Device,
    handle: vk::MicromapEXT,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyMicromapEXT", move || {
        report::<Micromap>(device, handle, AddressEvent::Unbound);
        drop(handle::take::<Micromap>(handle));
    })
}

pub(crate) unsafe extern "system" fn vkCreateMicromapEXT(
    device: vk::Device,
    info: *const vk::MicromapCreateInfoEXT<'_>,
    _allocator: *const vk::AllocationCallbacks<'_>,
    micromap: *mut vk::MicromapEXT,
) -> vk::Result {
    guard_result("vkCreateMicromapEXT", move || {
        let info = &*info;
        let created = Micromap {
            buffer: retain::<Buffer>(info.buffer),
            offset: info.offset,
            size_bytes: info.size,
        };
        // A micromap's address follows from its buffer's, so replaying the buffer's address is
        // enough.
        if info.device_address != 0 && info.device_address != created.storage().address {
            return Err(vk::Result::ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS);
        }
        *micromap = handle::create(created);
        report::<Micromap>(device, *micromap, AddressEvent::Created);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetMicromapBuildSizesEXT(
    _device: vk::Device,
    _build_type: vk::AccelerationStructureBuildTypeKHR,
    info: *const vk::MicromapBuildInfoEXT<'_>,
    sizes: *mut vk::MicromapBuildSizesInfoEXT<'_>,
) {
    guard("vkGetMicromapBuildSizesEXT", move || {
        (*sizes).micromap_size = traversal::micromap_size(usages(&*info)).unwrap_or(u64::MAX);
        (*sizes).build_scratch_size = execute::SCRATCH_BYTES;
        // Structures refer to micromaps.
        (*sizes).discardable = vk::FALSE;
    })
}

pub(crate) unsafe extern "system" fn vkGetDeviceMicromapCompatibilityEXT(
    _device: vk::Device,
    info: *const vk::MicromapVersionInfoEXT<'_>,
    compatibility: *mut vk::AccelerationStructureCompatibilityKHR,
) {
    guard("vkGetDeviceMicromapCompatibilityEXT", move || {
        *compatibility = compatibility_of(&*(*info).p_version_data, limits::micromap_uuids());
    })
}

pub(crate) unsafe extern "system" fn vkBuildMicromapsEXT(
    device: vk::Device,
    operation: vk::DeferredOperationKHR,
    count: u32,
    infos: *const vk::MicromapBuildInfoEXT<'_>,
) -> vk::Result {
    guard_result("vkBuildMicromapsEXT", move || {
        let builds: Vec<_> = slice(infos, count)
            .iter()
            .map(|info| decode_build(info))
            .collect();
        let device = from_handle::<Device>(device);
        let checks = device.engine.checks(Caller::Other);
        let live = device.engine.memory.structures();
        defer_parallel(device, operation, builds.len(), move || {
            execute::build(&builds, &Reach::everywhere(), &live, checks.as_ref());
        })
    })
}

pub(crate) unsafe extern "system" fn vkCmdBuildMicromapsEXT(
    commands: vk::CommandBuffer,
    count: u32,
    infos: *const vk::MicromapBuildInfoEXT<'_>,
) {
    record("vkCmdBuildMicromapsEXT", commands, move |commands| {
        let builds = slice(infos, count).iter().map(|info| decode_build(info));
        commands.push(Command::Structure(StructureCommand::BuildMicromaps(
            builds.collect(),
        )))
    })
}

/// A copy from micromap to micromap. Built micromaps are compact, so both modes do the same.
///
/// # Safety
/// The handles are alive.
unsafe fn decode_copy(info: &vk::CopyMicromapInfoEXT<'_>) -> BuiltCopy {
    // SAFETY: the caller guarantees that the handles are alive.
    unsafe {
        BuiltCopy::Whole {
            source: storage(info.src),
            destination: storage(info.dst),
            mode: CopyMode::Clone,
        }
    }
}

/// A copy from a micromap to serialized data.
///
/// # Safety
/// The handles are alive.
unsafe fn decode_serialization(info: &vk::CopyMicromapToMemoryInfoEXT<'_>) -> BuiltCopy {
    // SAFETY: the caller guarantees that the handles are alive.
    unsafe {
        BuiltCopy::Serialize {
            source: storage(info.src),
            destination: info.dst.device_address,
        }
    }
}

/// A copy from serialized data to a micromap.
///
/// # Safety
/// The handles are alive.
unsafe fn decode_deserialization(info: &vk::CopyMemoryToMicromapInfoEXT<'_>) -> BuiltCopy {
    // SAFETY: the caller guarantees that the handles are alive.
    unsafe {
        BuiltCopy::Deserialize {
            source: info.src.device_address,
            destination: storage(info.dst),
        }
    }
}

pub(crate) unsafe extern "system" fn vkWriteMicromapsPropertiesEXT(
    device: vk::Device,
    count: u32,
    handles: *const vk::MicromapEXT,
    query_type: vk::QueryType,
    data_bytes: usize,
    data: *mut c_void,
    stride_bytes: usize,
) -> vk::Result {
    guard_result("vkWriteMicromapsPropertiesEXT", move || {
        let addresses = slice(handles, count)
            .iter()
            .map(|&handle| storage(handle).address);
        let out = (data, data_bytes, stride_bytes);
        built::write_properties(device, Built::Micromap, addresses, query_type, out)
    })
}

pub(crate) unsafe extern "system" fn vkCopyMicromapEXT(
    device: vk::Device,
    operation: vk::DeferredOperationKHR,
    info: *const vk::CopyMicromapInfoEXT<'_>,
) -> vk::Result {
    guard_result("vkCopyMicromapEXT", move || {
        built::copy(device, operation, Built::Micromap, decode_copy(&*info))
    })
}

pub(crate) unsafe extern "system" fn vkCopyMicromapToMemoryEXT(
    device: vk::Device,
    operation: vk::DeferredOperationKHR,
    info: *const vk::CopyMicromapToMemoryInfoEXT<'_>,
) -> vk::Result {
    guard_result("vkCopyMicromapToMemoryEXT", move || {
        built::copy(
            device,
            operation,
            Built::Micromap,
            decode_serialization(&*info),
        )
    })
}

pub(crate) unsafe extern "system" fn vkCopyMemoryToMicromapEXT(
    device: vk::Device,
    operation: vk::DeferredOperationKHR,
    info: *const vk::CopyMemoryToMicromapInfoEXT<'_>,
) -> vk::Result {
    guard_result("vkCopyMemoryToMicromapEXT", move || {
        built::copy(
            device,
            operation,
            Built::Micromap,
            decode_deserialization(&*info),
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdWriteMicromapsPropertiesEXT(
    commands: vk::CommandBuffer,
    count: u32,
    handles: *const vk::MicromapEXT,
    query_type: vk::QueryType,
    pool: vk::QueryPool,
    first: u32,
) {
    record(
        "vkCmdWriteMicromapsPropertiesEXT",
        commands,
        move |commands| {
            let addresses = slice(handles, count)
                .iter()
                .map(|&handle| storage(handle).address);
            built::record_properties(
                commands,
                Built::Micromap,
                addresses,
                query_type,
                (pool, first),
            )
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdCopyMicromapEXT(
    commands: vk::CommandBuffer,
    info: *const vk::CopyMicromapInfoEXT<'_>,
) {
    record("vkCmdCopyMicromapEXT", commands, move |commands| {
        built::record_copy(commands, Built::Micromap, decode_copy(&*info))
    })
}

pub(crate) unsafe extern "system" fn vkCmdCopyMicromapToMemoryEXT(
    commands: vk::CommandBuffer,
    info: *const vk::CopyMicromapToMemoryInfoEXT<'_>,
) {
    record("vkCmdCopyMicromapToMemoryEXT", commands, move |commands| {
        built::record_copy(commands, Built::Micromap, decode_serialization(&*info))
    })
}

pub(crate) unsafe extern "system" fn vkCmdCopyMemoryToMicromapEXT(
    commands: vk::CommandBuffer,
    info: *const vk::CopyMemoryToMicromapInfoEXT<'_>,
) {
    record("vkCmdCopyMemoryToMicromapEXT", commands, move |commands| {
        built::record_copy(commands, Built::Micromap, decode_deserialization(&*info))
    })
}
