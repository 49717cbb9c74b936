//! Devices.

use ash::vk;

use super::system;
use crate::capabilities::extensions::{ExtensionSet, Kind};
use crate::capabilities::features;
use crate::device::Device;
use crate::device::Enabled;
use crate::ffi::{self, array, vk as newer};
use crate::guard::{guard, guard_result};
use crate::handle::{self, from_handle};
use crate::object::{PhysicalDevice, PrivateDataSlot};
use crate::os::clock::Clock;
use crate::queue::MAX_QUEUES;

/// The features that change a device's behavior.
///
/// # Safety
/// `info` is valid usage of `vkCreateDevice`.
unsafe fn enabled(info: &vk::DeviceCreateInfo<'_>) -> Enabled {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkCreateDevice`.
    unsafe {
        let chained = ffi::find::<vk::PhysicalDeviceFeatures2>(info.p_next).map(|f| &f.features);
        let validation = ffi::find::<vk::PhysicalDeviceRayTracingValidationFeaturesNV>(info.p_next);
        let fault = ffi::find::<newer::PhysicalDeviceFaultFeaturesKHR<'_>>(info.p_next);
        let abort = ffi::find::<newer::PhysicalDeviceShaderAbortFeaturesKHR<'_>>(info.p_next);
        let older_fault = ffi::find::<vk::PhysicalDeviceFaultFeaturesEXT>(info.p_next);
        let addresses = ffi::find::<vk::PhysicalDeviceAddressBindingReportFeaturesEXT>(info.p_next);
        let zero_one = ffi::find::<vk::PhysicalDeviceDepthClampZeroOneFeaturesEXT>(info.p_next);
        let heaps = ffi::find::<newer::PhysicalDeviceDescriptorHeapFeaturesEXT<'_>>(info.p_next);
        let queues = ffi::slice(info.p_queue_create_infos, info.queue_create_info_count);
        Enabled {
            heap_capture_replay: heaps
                .is_some_and(|features| features.descriptor_heap_capture_replay != vk::FALSE),
            queue_flags: queues.first().map_or_else(Default::default, |it| it.flags),
            sparse_binding: (chained.into_iter().chain(info.p_enabled_features.as_ref()))
                .any(|features| features.sparse_binding != vk::FALSE),
            device_fault: fault.is_some_and(|features| features.device_fault != vk::FALSE)
                || older_fault.is_some_and(|features| features.device_fault != vk::FALSE),
            shader_abort: abort.is_some_and(|features| features.shader_abort != vk::FALSE),
            report_address_binding: addresses
                .is_some_and(|features| features.report_address_binding != vk::FALSE),
            depth_clamp_zero_one: zero_one
                .is_some_and(|features| features.depth_clamp_zero_one != vk::FALSE),
            ray_tracing_validation: validation
                .is_some_and(|features| features.ray_tracing_validation != vk::FALSE),
        }
    }
}

pub(crate) unsafe extern "system" fn vkCreateDevice(
    physical: vk::PhysicalDevice,
    info: *const vk::DeviceCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::Device,
) -> vk::Result {
    guard_result("vkCreateDevice", move || {
        let physical = from_handle::<PhysicalDevice>(physical);
        let info = &*info;
        let names = ffi::slice(
            info.pp_enabled_extension_names,
            info.enabled_extension_count,
        );
        let extensions =
            ExtensionSet::from_names(Kind::Device, names.iter().map(|&name| ffi::string(name)))
                .ok_or(vk::Result::ERROR_EXTENSION_NOT_PRESENT)?;
        features::check_requested(info)?;
        let queues = ffi::slice(info.p_queue_create_infos, info.queue_create_info_count);
        if queues
            .iter()
            .any(|queue| queue.queue_family_index != 0 || queue.queue_count > MAX_QUEUES)
        {
            return Err(vk::Result::ERROR_INITIALIZATION_FAILED);
        }
        let queue_count = queues
            .iter()
            .map(|queue| queue.queue_count)
            .max()
            .unwrap_or(0);
        *out = handle::create(Device::new(
            physical,
            extensions,
            queue_count,
            enabled(info),
        )?);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkDestroyDevice(
    device: vk::Device,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyDevice", move || {
        drop(handle::take::<Device>(device));
    })
}

pub(crate) unsafe extern "system" fn vkGetDeviceGroupPeerMemoryFeatures(
    _device: vk::Device,
    _heap: u32,
    _local: u32,
    _remote: u32,
    out: *mut vk::PeerMemoryFeatureFlags,
) {
    guard("vkGetDeviceGroupPeerMemoryFeatures", move || {
        *out = vk::PeerMemoryFeatureFlags::COPY_SRC
            | vk::PeerMemoryFeatureFlags::COPY_DST
            | vk::PeerMemoryFeatureFlags::GENERIC_SRC
            | vk::PeerMemoryFeatureFlags::GENERIC_DST;
    })
}

pub(crate) unsafe extern "system" fn vkGetCalibratedTimestampsKHR(
    _device: vk::Device,
    count: u32,
    infos: *const vk::CalibratedTimestampInfoKHR,
    timestamps: *mut u64,
    max_deviation: *mut u64,
) -> vk::Result {
    guard_result("vkGetCalibratedTimestampsKHR", move || {
        let start = Clock::Monotonic.now_ns();
        let timestamps = array::slice_mut(timestamps, count);
        for (info, out) in ffi::slice(infos, count).iter().zip(timestamps) {
            *out = system::time(info.time_domain);
        }
        // All clocks were read between `start` and now; the extra nanosecond is the clocks' period.
        *max_deviation = Clock::Monotonic.now_ns() - start + 1;
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCreatePrivateDataSlot(
    device: vk::Device,
    _info: *const vk::PrivateDataSlotCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::PrivateDataSlot,
) -> vk::Result {
    guard_result("vkCreatePrivateDataSlot", move || {
        let device = from_handle::<Device>(device);
        *out = handle::create(device.private_data.lock().new_slot());
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkDestroyPrivateDataSlot(
    device: vk::Device,
    slot: vk::PrivateDataSlot,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyPrivateDataSlot", move || {
        let device = from_handle::<Device>(device);
        if let Some(slot) = handle::take::<PrivateDataSlot>(slot) {
            device.private_data.lock().remove_slot(&slot);
        }
    })
}

pub(crate) unsafe extern "system" fn vkSetPrivateData(
    device: vk::Device,
    _ty: vk::ObjectType,
    object: u64,
    slot: vk::PrivateDataSlot,
    data: u64,
) -> vk::Result {
    guard_result("vkSetPrivateData", move || {
        let device = from_handle::<Device>(device);
        device
            .private_data
            .lock()
            .set(from_handle::<PrivateDataSlot>(slot), object, data);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetPrivateData(
    device: vk::Device,
    _ty: vk::ObjectType,
    object: u64,
    slot: vk::PrivateDataSlot,
    data: *mut u64,
) {
    guard("vkGetPrivateData", move || {
        let device = from_handle::<Device>(device);
        *data = device
            .private_data
            .lock()
            .word(from_handle::<PrivateDataSlot>(slot), object);
    })
}
