//! `VK_EXT_opacity_micromap`: objects, sizes, and the commands on the host and on the device.

use ash::vk;
use spirv_jit::reach::Reach;

use super::address_report::{destroy_addressed, report};
use super::built::{built, compatibility_of};
use super::deferred::defer_parallel;
use super::define::{commands, entry};
use crate::command::ray_tracing::{Built, BuiltCopy, CopyMode};
use crate::command::{Command, RayTracingCommand};
use crate::decode::micromap::{decode_build, storage, usages};
use crate::device::Device;
use crate::ffi::slice;
use crate::handle::{self, from_handle, retain};
use crate::object::addressed::AddressEvent;
use crate::object::{Buffer, Micromap};
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
        // A micromap's address follows from its buffer's, so replaying the buffer's address is
        // enough.
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
        *compatibility = compatibility_of(&*(*info).p_version_data, limits::micromap_uuids());
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
}

commands! {
    fn vkCmdBuildMicromapsEXT(command_buffer, count: u32, infos: *const vk::MicromapBuildInfoEXT<'_>) {
        let builds = slice(infos, count).iter().map(|info| decode_build(info));
        command_buffer.push(Command::RayTracing(RayTracingCommand::BuildMicromaps(builds.collect())))
    }
}

// A built micromap is compact already, so both modes do the same.
built! {
    Micromap, MicromapEXT at storage, vkWriteMicromapsPropertiesEXT, vkCmdWriteMicromapsPropertiesEXT;
    vkCopyMicromapEXT, vkCmdCopyMicromapEXT, CopyMicromapInfoEXT:
        |info| BuiltCopy::Whole { source: storage(info.src), destination: storage(info.dst), mode: CopyMode::Clone };
    vkCopyMicromapToMemoryEXT, vkCmdCopyMicromapToMemoryEXT, CopyMicromapToMemoryInfoEXT:
        |info| BuiltCopy::Serialize { source: storage(info.src), destination: info.dst.device_address };
    vkCopyMemoryToMicromapEXT, vkCmdCopyMemoryToMicromapEXT, CopyMemoryToMicromapInfoEXT:
        |info| BuiltCopy::Deserialize { source: info.src.device_address, destination: storage(info.dst) };
}
