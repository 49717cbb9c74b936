//! `VK_KHR_acceleration_structure`: objects, sizes, and the commands on the host and on the device.

use std::ffi::c_void;
use std::sync::Arc;

use ash::vk::{self, Handle};
use spirv_jit::reach::Reach;
use spirv_jit::views::Key;
use traversal::BuildFlags;

use super::address_report::report;
use super::built::{self, compatibility_of};
use super::deferred::defer_parallel;
use super::descriptor_buffer::captured;
use super::record::record;
use crate::VkResult;
use crate::capabilities::limits;
use crate::command::structures::{Built, BuiltCopy, CopyMode, IndirectBuild};
use crate::command::{Command, StructureCommand};
use crate::decode::acceleration_structure::{
    decode_build, decode_builds, has_micromap, kind, resolve_host_instances,
};
use crate::decode::geometries::{geometries, storage};
use crate::decode::micromap;
use crate::device::Device;
use crate::ffi::slice;
use crate::guard::{guard, guard_result};
use crate::handle::{self, from_handle, retain};
use crate::object::acceleration_structure::{Location, ReplayableStructure};
use crate::object::addressed::{AddressEvent, Addressed};
use crate::object::{AccelerationStructure, Buffer};
use crate::structures::build;
use crate::structures::micromap::SCRATCH_BYTES;
use crate::validate::Caller;

pub(super) fn copy_mode(mode: vk::CopyAccelerationStructureModeKHR) -> CopyMode {
    match mode {
        vk::CopyAccelerationStructureModeKHR::COMPACT => CopyMode::Compact,
        _ => CopyMode::Clone,
    }
}

/// The handle of a new structure, which is reported to validation and to address callbacks.
pub fn create(device: &Device, structure: AccelerationStructure) -> vk::AccelerationStructureKHR {
    let structure = handle::new(structure);
    let handle: vk::AccelerationStructureKHR = handle::into_handle(Arc::clone(&structure));
    if let Some(validator) = device.validator() {
        let registry = &validator.registry;
        registry.add_structure(handle.as_raw(), Arc::clone(&structure));
    }
    if let Some(report) = &device.address_report {
        report.tell(handle, AddressEvent::Created, structure.ranges());
    }
    handle
}

pub(crate) unsafe extern "system" fn vkCreateAccelerationStructureKHR(
    device: vk::Device,
    info: *const vk::AccelerationStructureCreateInfoKHR<'_>,
    _allocator: *const vk::AllocationCallbacks<'_>,
    structure: *mut vk::AccelerationStructureKHR,
) -> vk::Result {
    guard_result("vkCreateAccelerationStructureKHR", move || {
        let info = &*info;
        let device = from_handle::<Device>(device);
        let mut made = AccelerationStructure {
            ty: info.ty,
            location: Location::Buffer(retain::<Buffer>(info.buffer), info.offset),
            size_bytes: info.size,
            replayable: None,
        };
        // A structure's address follows from its buffer's, so replaying the buffer's address is
        // enough.
        if info.device_address != 0 && info.device_address != made.address() {
            return Err(vk::Result::ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS);
        }
        if info
            .create_flags
            .contains(vk::AccelerationStructureCreateFlagsKHR::DESCRIPTOR_BUFFER_CAPTURE_REPLAY_EXT)
        {
            made.replayable = Some(ReplayableStructure::new(
                &device.engine.views,
                made.address(),
                captured(info.p_next).map(Key),
            )?);
        }
        *structure = create(device, made);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkDestroyAccelerationStructureKHR(
    device: vk::Device,
    structure: vk::AccelerationStructureKHR,
    _allocator: *const vk::AllocationCallbacks<'_>,
) {
    guard("vkDestroyAccelerationStructureKHR", move || {
        if let Some(validator) = from_handle::<Device>(device).validator() {
            validator.registry.remove_structure(structure.as_raw());
        }
        report::<AccelerationStructure>(device, structure, AddressEvent::Unbound);
        drop(handle::take::<AccelerationStructure>(structure));
    })
}

pub(crate) unsafe extern "system" fn vkGetAccelerationStructureDeviceAddressKHR(
    _device: vk::Device,
    info: *const vk::AccelerationStructureDeviceAddressInfoKHR<'_>,
) -> vk::DeviceAddress {
    guard("vkGetAccelerationStructureDeviceAddressKHR", move || {
        storage((*info).acceleration_structure).address
    })
}

pub(crate) unsafe extern "system" fn vkGetAccelerationStructureBuildSizesKHR(
    _device: vk::Device,
    _build_type: vk::AccelerationStructureBuildTypeKHR,
    info: *const vk::AccelerationStructureBuildGeometryInfoKHR<'_>,
    max_primitive_counts: *const u32,
    sizes: *mut vk::AccelerationStructureBuildSizesInfoKHR<'_>,
) {
    guard("vkGetAccelerationStructureBuildSizesKHR", move || {
        if let Some(usages) = micromap::structure_usages(&*info) {
            (*sizes).acceleration_structure_size =
                traversal::micromap_size(usages).unwrap_or(u64::MAX);
            (*sizes).build_scratch_size = SCRATCH_BYTES;
            (*sizes).update_scratch_size = 0;
            return;
        }
        let geometries = geometries(&*info);
        let kind = kind(&*info, &geometries);
        let counts = slice(max_primitive_counts, (*info).geometry_count);
        let found = traversal::build_sizes(kind, BuildFlags((*info).flags.as_raw()), counts);
        let micromap_bytes = match geometries.iter().any(|geometry| has_micromap(geometry)) {
            true => traversal::micromap_bytes(counts),
            false => 0,
        };
        (*sizes).acceleration_structure_size = found.structure_bytes + micromap_bytes;
        (*sizes).build_scratch_size = found.build_scratch_bytes;
        (*sizes).update_scratch_size = found.update_scratch_bytes;
    })
}

pub(crate) unsafe extern "system" fn vkGetDeviceAccelerationStructureCompatibilityKHR(
    _device: vk::Device,
    info: *const vk::AccelerationStructureVersionInfoKHR<'_>,
    compatibility: *mut vk::AccelerationStructureCompatibilityKHR,
) {
    guard(
        "vkGetDeviceAccelerationStructureCompatibilityKHR",
        move || {
            *compatibility =
                compatibility_of(&*(*info).p_version_data, limits::serialization_uuids());
        },
    )
}

pub(crate) unsafe extern "system" fn vkBuildAccelerationStructuresKHR(
    device: vk::Device,
    operation: vk::DeferredOperationKHR,
    count: u32,
    infos: *const vk::AccelerationStructureBuildGeometryInfoKHR<'_>,
    ranges: *const *const vk::AccelerationStructureBuildRangeInfoKHR,
) -> vk::Result {
    guard_result("vkBuildAccelerationStructuresKHR", move || {
        let mut builds = decode_builds(count, infos, ranges);
        let device = from_handle::<Device>(device);
        let checks = device.engine.checks(Caller::Other);
        let resolve = |build| resolve_host_instances(build, checks.as_ref());
        let records = builds
            .iter_mut()
            .map(resolve)
            .collect::<VkResult<Vec<_>>>()?;
        let threads = build::build_concurrency(&builds);
        let live = device.engine.memory.structures();
        defer_parallel(device, operation, threads, move || {
            build::build(&builds, &Reach::everywhere(), &live, checks.as_ref());
            drop(records);
        })
    })
}

pub(crate) unsafe extern "system" fn vkCmdBuildAccelerationStructuresKHR(
    commands: vk::CommandBuffer,
    count: u32,
    infos: *const vk::AccelerationStructureBuildGeometryInfoKHR<'_>,
    ranges: *const *const vk::AccelerationStructureBuildRangeInfoKHR,
) {
    record(
        "vkCmdBuildAccelerationStructuresKHR",
        commands,
        move |commands| {
            let infos_of = slice(infos, count).iter();
            let micromaps: Vec<_> = infos_of
                .filter_map(|info| micromap::decode_structure(info))
                .collect();
            let builds = decode_builds(count, infos, ranges);
            // The builds of one command are independent.
            if !micromaps.is_empty() {
                commands.push(Command::Structure(StructureCommand::BuildMicromaps(
                    micromaps,
                )))?;
            }
            if builds.is_empty() {
                return Ok(());
            }
            commands.push(Command::Structure(StructureCommand::Build(builds)))
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdBuildAccelerationStructuresIndirectKHR(
    commands: vk::CommandBuffer,
    count: u32,
    infos: *const vk::AccelerationStructureBuildGeometryInfoKHR<'_>,
    addresses: *const vk::DeviceAddress,
    strides: *const u32,
    max_primitive_counts: *const *const u32,
) {
    record(
        "vkCmdBuildAccelerationStructuresIndirectKHR",
        commands,
        move |commands| {
            let (addresses, strides) = (slice(addresses, count), slice(strides, count));
            let counts = slice(max_primitive_counts, count);
            let infos = slice(infos, count).iter().enumerate();
            let infos = infos.filter(|(_, info)| !micromap::is_micromap(info));
            let builds = infos.map(|(index, info)| IndirectBuild {
                build: decode_build(info),
                ranges: addresses[index],
                stride_bytes: strides[index],
                max_primitive_counts: slice(counts[index], info.geometry_count).to_vec(),
            });
            commands.push(Command::Structure(StructureCommand::BuildIndirect(
                builds.collect(),
            )))
        },
    )
}

/// A copy from structure to structure.
///
/// # Safety
/// The handles are alive.
unsafe fn decode_copy(info: &vk::CopyAccelerationStructureInfoKHR<'_>) -> BuiltCopy {
    // SAFETY: the caller guarantees that the handles are alive.
    unsafe {
        BuiltCopy::Whole {
            source: storage(info.src),
            destination: storage(info.dst),
            mode: copy_mode(info.mode),
        }
    }
}

/// A copy from a structure to serialized data.
///
/// # Safety
/// The handles are alive.
unsafe fn decode_serialization(
    info: &vk::CopyAccelerationStructureToMemoryInfoKHR<'_>,
) -> BuiltCopy {
    // SAFETY: the caller guarantees that the handles are alive.
    unsafe {
        BuiltCopy::Serialize {
            source: storage(info.src),
            destination: info.dst.device_address,
        }
    }
}

/// A copy from serialized data to a structure.
///
/// # Safety
/// The handles are alive.
unsafe fn decode_deserialization(
    info: &vk::CopyMemoryToAccelerationStructureInfoKHR<'_>,
) -> BuiltCopy {
    // SAFETY: the caller guarantees that the handles are alive.
    unsafe {
        BuiltCopy::Deserialize {
            source: info.src.device_address,
            destination: storage(info.dst),
        }
    }
}

pub(crate) unsafe extern "system" fn vkWriteAccelerationStructuresPropertiesKHR(
    device: vk::Device,
    count: u32,
    handles: *const vk::AccelerationStructureKHR,
    query_type: vk::QueryType,
    data_bytes: usize,
    data: *mut c_void,
    stride_bytes: usize,
) -> vk::Result {
    guard_result("vkWriteAccelerationStructuresPropertiesKHR", move || {
        let addresses = slice(handles, count)
            .iter()
            .map(|&handle| storage(handle).address);
        let out = (data, data_bytes, stride_bytes);
        built::write_properties(device, Built::Structure, addresses, query_type, out)
    })
}

pub(crate) unsafe extern "system" fn vkCopyAccelerationStructureKHR(
    device: vk::Device,
    operation: vk::DeferredOperationKHR,
    info: *const vk::CopyAccelerationStructureInfoKHR<'_>,
) -> vk::Result {
    guard_result("vkCopyAccelerationStructureKHR", move || {
        built::copy(device, operation, Built::Structure, decode_copy(&*info))
    })
}

pub(crate) unsafe extern "system" fn vkCopyAccelerationStructureToMemoryKHR(
    device: vk::Device,
    operation: vk::DeferredOperationKHR,
    info: *const vk::CopyAccelerationStructureToMemoryInfoKHR<'_>,
) -> vk::Result {
    guard_result("vkCopyAccelerationStructureToMemoryKHR", move || {
        built::copy(
            device,
            operation,
            Built::Structure,
            decode_serialization(&*info),
        )
    })
}

pub(crate) unsafe extern "system" fn vkCopyMemoryToAccelerationStructureKHR(
    device: vk::Device,
    operation: vk::DeferredOperationKHR,
    info: *const vk::CopyMemoryToAccelerationStructureInfoKHR<'_>,
) -> vk::Result {
    guard_result("vkCopyMemoryToAccelerationStructureKHR", move || {
        built::copy(
            device,
            operation,
            Built::Structure,
            decode_deserialization(&*info),
        )
    })
}

pub(crate) unsafe extern "system" fn vkCmdWriteAccelerationStructuresPropertiesKHR(
    commands: vk::CommandBuffer,
    count: u32,
    handles: *const vk::AccelerationStructureKHR,
    query_type: vk::QueryType,
    pool: vk::QueryPool,
    first: u32,
) {
    record(
        "vkCmdWriteAccelerationStructuresPropertiesKHR",
        commands,
        move |commands| {
            let addresses = slice(handles, count)
                .iter()
                .map(|&handle| storage(handle).address);
            built::record_properties(
                commands,
                Built::Structure,
                addresses,
                query_type,
                (pool, first),
            )
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdCopyAccelerationStructureKHR(
    commands: vk::CommandBuffer,
    info: *const vk::CopyAccelerationStructureInfoKHR<'_>,
) {
    record(
        "vkCmdCopyAccelerationStructureKHR",
        commands,
        move |commands| built::record_copy(commands, Built::Structure, decode_copy(&*info)),
    )
}

pub(crate) unsafe extern "system" fn vkCmdCopyAccelerationStructureToMemoryKHR(
    commands: vk::CommandBuffer,
    info: *const vk::CopyAccelerationStructureToMemoryInfoKHR<'_>,
) {
    record(
        "vkCmdCopyAccelerationStructureToMemoryKHR",
        commands,
        move |commands| {
            built::record_copy(commands, Built::Structure, decode_serialization(&*info))
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdCopyMemoryToAccelerationStructureKHR(
    commands: vk::CommandBuffer,
    info: *const vk::CopyMemoryToAccelerationStructureInfoKHR<'_>,
) {
    record(
        "vkCmdCopyMemoryToAccelerationStructureKHR",
        commands,
        move |commands| {
            built::record_copy(commands, Built::Structure, decode_deserialization(&*info))
        },
    )
}
