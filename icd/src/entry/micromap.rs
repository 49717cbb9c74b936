//! `VK_EXT_opacity_micromap`: objects, sizes, and the commands on the host and on the device.

use std::ffi::c_void;

use ash::vk;
use spirv_jit::reach::Reach;

use super::acceleration_structure::live;
use super::address_report::{destroy_addressed, report};
use super::deferred::{defer, defer_parallel};
use super::define::{commands, entry};
use crate::command::micromap::MicromapCommand;
use crate::command::{Command, RayTracingCommand};
use crate::decode::micromap::{decode_build, storage, usages};
use crate::device::Device;
use crate::ffi::{slice, write_strided};
use crate::handle::{self, from_handle, retain};
use crate::object::acceleration_structure::Storage;
use crate::object::addressed::AddressEvent;
use crate::object::{Buffer, Micromap, QueryPool};
use crate::structures::micromap as execute;
use crate::table::limits;
use crate::validate::Caller;

destroy_addressed! {
    vkDestroyMicromapEXT: Micromap, MicromapEXT;
}

entry! {
    fn vkCreateMicromapEXT(
        device: vk::Device,
        info: *const vk::MicromapCreateInfoEXT<'_>,
        _allocator: *const vk::AllocationCallbacks<'_>,
        micromap: *mut vk::MicromapEXT,
    ) -> vk::Result {
        let info = &*info;
        let created = Micromap {
            buffer: retain::<Buffer>(info.buffer),
            offset: info.offset,
            size_bytes: info.size,
        };
        // A micromap is where its buffer is: replaying the buffer's address replays it.
        if info.device_address != 0 && info.device_address != created.storage().address {
            return Err(vk::Result::ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS);
        }
        *micromap = handle::create(created);
        report::<Micromap>(device, *micromap, AddressEvent::Created);
        Ok(())
    }

    fn vkGetMicromapBuildSizesEXT(
        _device: vk::Device,
        _build_type: vk::AccelerationStructureBuildTypeKHR,
        info: *const vk::MicromapBuildInfoEXT<'_>,
        sizes: *mut vk::MicromapBuildSizesInfoEXT<'_>,
    ) {
        (*sizes).micromap_size = traversal::micromap_size(usages(&*info)).unwrap_or(u64::MAX);
        (*sizes).build_scratch_size = execute::SCRATCH_BYTES;
        // Structures refer to micromaps.
        (*sizes).discardable = vk::FALSE;
    }

    fn vkGetDeviceMicromapCompatibilityEXT(
        _device: vk::Device,
        info: *const vk::MicromapVersionInfoEXT<'_>,
        compatibility: *mut vk::AccelerationStructureCompatibilityKHR,
    ) {
        *compatibility = if *(*info).p_version_data == *limits::micromap_uuids().as_flattened() {
            vk::AccelerationStructureCompatibilityKHR::COMPATIBLE
        } else {
            vk::AccelerationStructureCompatibilityKHR::INCOMPATIBLE
        };
    }

    fn vkBuildMicromapsEXT(
        device: vk::Device,
        operation: vk::DeferredOperationKHR,
        count: u32,
        infos: *const vk::MicromapBuildInfoEXT<'_>,
    ) -> vk::Result {
        let builds: Vec<_> = slice(infos, count).iter().map(|info| decode_build(info)).collect();
        let device = from_handle::<Device>(device);
        let checks = device.engine.checks(Caller::Other);
        let live = device.engine.memory.structures();
        defer_parallel(device, operation, builds.len(), move || {
            execute::build(&builds, &Reach::everywhere(), &live, checks.as_ref());
        })
    }

    fn vkCopyMicromapEXT(
        device: vk::Device,
        operation: vk::DeferredOperationKHR,
        info: *const vk::CopyMicromapInfoEXT<'_>,
    ) -> vk::Result {
        let (source, destination) = (storage((*info).src), storage((*info).dst));
        let live = live(device);
        defer(operation, 1, move || {
            execute::copy(source, destination, &live);
            Ok(())
        })
    }

    fn vkCopyMicromapToMemoryEXT(
        device: vk::Device,
        operation: vk::DeferredOperationKHR,
        info: *const vk::CopyMicromapToMemoryInfoEXT<'_>,
    ) -> vk::Result {
        let (source, destination) = (storage((*info).src), (*info).dst.device_address);
        let live = live(device);
        defer(operation, 1, move || {
            let uuids = limits::micromap_uuids();
            execute::serialize(source, destination, &uuids, &Reach::everywhere(), &live);
            Ok(())
        })
    }

    fn vkCopyMemoryToMicromapEXT(
        device: vk::Device,
        operation: vk::DeferredOperationKHR,
        info: *const vk::CopyMemoryToMicromapInfoEXT<'_>,
    ) -> vk::Result {
        let (source, destination) = ((*info).src.device_address, storage((*info).dst));
        let live = live(device);
        defer(operation, 1, move || {
            execute::deserialize(source, destination, &Reach::everywhere(), &live);
            Ok(())
        })
    }

    fn vkWriteMicromapsPropertiesEXT(
        device: vk::Device,
        count: u32,
        micromaps: *const vk::MicromapEXT,
        query_type: vk::QueryType,
        data_bytes: usize,
        data: *mut c_void,
        stride_bytes: usize,
    ) -> vk::Result {
        let live = live(device);
        let values = slice(micromaps, count).iter().map(|&micromap| {
            execute::property(storage(micromap).address, query_type, &live)
        });
        write_strided(values, data, data_bytes, stride_bytes)
    }
}

fn recorded(command: MicromapCommand) -> Command {
    Command::RayTracing(RayTracingCommand::Micromap(command))
}

commands! {
    fn vkCmdBuildMicromapsEXT(command_buffer, count: u32, infos: *const vk::MicromapBuildInfoEXT<'_>) {
        let builds = slice(infos, count).iter().map(|info| decode_build(info));
        command_buffer.push(recorded(MicromapCommand::Build(builds.collect())))
    }

    fn vkCmdCopyMicromapEXT(command_buffer, info: *const vk::CopyMicromapInfoEXT<'_>) {
        command_buffer.push(recorded(MicromapCommand::Copy {
            source: storage((*info).src),
            destination: storage((*info).dst),
        }))
    }

    fn vkCmdCopyMicromapToMemoryEXT(command_buffer, info: *const vk::CopyMicromapToMemoryInfoEXT<'_>) {
        command_buffer.push(recorded(MicromapCommand::Serialize {
            source: storage((*info).src),
            destination: (*info).dst.device_address,
        }))
    }

    fn vkCmdCopyMemoryToMicromapEXT(command_buffer, info: *const vk::CopyMemoryToMicromapInfoEXT<'_>) {
        command_buffer.push(recorded(MicromapCommand::Deserialize {
            source: (*info).src.device_address,
            destination: storage((*info).dst),
        }))
    }

    fn vkCmdWriteMicromapsPropertiesEXT(
        command_buffer,
        count: u32,
        micromaps: *const vk::MicromapEXT,
        query_type: vk::QueryType,
        pool: vk::QueryPool,
        first: u32,
    ) {
        let storages = slice(micromaps, count).iter().map(|&micromap| storage(micromap));
        command_buffer.push(recorded(MicromapCommand::WriteProperties {
            micromaps: storages.map(|storage: Storage| storage.address).collect(),
            query_type,
            pool: retain::<QueryPool>(pool),
            first,
        }))
    }
}
