//! Instances, and queries without one.

use std::ffi::c_char;
use std::sync::Arc;

use ash::vk;

use crate::capabilities::extensions::{self, Extension, ExtensionSet, Kind};
use crate::capabilities::limits::API_VERSION;
use crate::ffi::{self, array, enumerate};
use crate::guard::{guard, guard_result};
use crate::handle;
use crate::object::messenger::Messengers;
use crate::object::{Instance, Messenger, PhysicalDevice};
use crate::os;

/// A row of an extension enumeration.
pub fn extension_properties(extension: Extension) -> vk::ExtensionProperties {
    let mut properties = vk::ExtensionProperties {
        spec_version: extension.version(),
        ..Default::default()
    };
    array::write_text(
        &mut properties.extension_name,
        &extension.name().to_string_lossy(),
    );
    properties
}

pub(crate) unsafe extern "system" fn vkEnumerateInstanceVersion(version: *mut u32) -> vk::Result {
    guard_result("vkEnumerateInstanceVersion", move || {
        *version = API_VERSION;
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkEnumerateInstanceLayerProperties(
    count: *mut u32,
    out: *mut vk::LayerProperties,
) -> vk::Result {
    guard_result("vkEnumerateInstanceLayerProperties", move || {
        enumerate(count, out, [].into_iter())
    })
}

pub(crate) unsafe extern "system" fn vkEnumerateInstanceExtensionProperties(
    layer: *const c_char,
    count: *mut u32,
    out: *mut vk::ExtensionProperties,
) -> vk::Result {
    guard_result("vkEnumerateInstanceExtensionProperties", move || {
        if !layer.is_null() {
            return Err(vk::Result::ERROR_LAYER_NOT_PRESENT);
        }
        let all: Vec<_> = extensions::of_kind(Kind::Instance).collect();
        enumerate(count, out, all.into_iter().map(extension_properties))
    })
}

pub(crate) unsafe extern "system" fn vkCreateInstance(
    info: *const vk::InstanceCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::Instance,
) -> vk::Result {
    guard_result("vkCreateInstance", move || {
        if let Some(what) = os::missing() {
            log::error!("the driver needs {what}");
            return Err(vk::Result::ERROR_INCOMPATIBLE_DRIVER);
        }
        let info = &*info;
        let names = ffi::slice(
            info.pp_enabled_extension_names,
            info.enabled_extension_count,
        );
        let extensions =
            ExtensionSet::from_names(Kind::Instance, names.iter().map(|&name| ffi::string(name)))
                .ok_or(vk::Result::ERROR_EXTENSION_NOT_PRESENT)?;
        let asked = info
            .p_application_info
            .as_ref()
            .map_or(0, |application| application.api_version);
        let api_version = asked.max(vk::API_VERSION_1_0);
        let messengers = Arc::new(Messengers::default());
        // A messenger in the chain is for creation and destruction, during which the driver sends
        // no messages.
        *out = handle::create(Instance {
            extensions,
            physical_device: handle::new(PhysicalDevice::new(
                api_version,
                Arc::clone(&messengers),
                extensions,
            )),
            messengers,
        });
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkDestroyInstance(
    instance: vk::Instance,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyInstance", move || {
        drop(handle::take::<Instance>(instance));
    })
}

pub(crate) unsafe extern "system" fn vkEnumeratePhysicalDevices(
    instance: vk::Instance,
    count: *mut u32,
    out: *mut vk::PhysicalDevice,
) -> vk::Result {
    guard_result("vkEnumeratePhysicalDevices", move || {
        let instance = handle::from_handle::<Instance>(instance);
        enumerate(
            count,
            out,
            [handle::handle_of(&instance.physical_device)].into_iter(),
        )
    })
}

pub(crate) unsafe extern "system" fn vkEnumeratePhysicalDeviceGroups(
    instance: vk::Instance,
    count: *mut u32,
    out: *mut vk::PhysicalDeviceGroupProperties,
) -> vk::Result {
    guard_result("vkEnumeratePhysicalDeviceGroups", move || {
        let instance = handle::from_handle::<Instance>(instance);
        let device = handle::handle_of(&instance.physical_device);
        ffi::enumerate::enumerate_with(count, out, [device].into_iter(), |group, device| {
            group.physical_device_count = 1;
            group.physical_devices = [vk::PhysicalDevice::null(); vk::MAX_DEVICE_GROUP_SIZE];
            group.physical_devices[0] = device;
            group.subset_allocation = vk::FALSE;
        })
    })
}

pub(crate) unsafe extern "system" fn vkCreateDebugUtilsMessengerEXT(
    instance: vk::Instance,
    info: *const vk::DebugUtilsMessengerCreateInfoEXT,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::DebugUtilsMessengerEXT,
) -> vk::Result {
    guard_result("vkCreateDebugUtilsMessengerEXT", move || {
        let instance = handle::from_handle::<Instance>(instance);
        let info = &*info;
        let messenger = handle::new(Messenger {
            severity: info.message_severity,
            types: info.message_type,
            callback: info.pfn_user_callback,
            user_data: info.p_user_data,
        });
        instance.messengers.0.write().push(Arc::clone(&messenger));
        *out = handle::into_handle(messenger);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkDestroyDebugUtilsMessengerEXT(
    instance: vk::Instance,
    messenger: vk::DebugUtilsMessengerEXT,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyDebugUtilsMessengerEXT", move || {
        let instance = handle::from_handle::<Instance>(instance);
        if let Some(messenger) = handle::take::<Messenger>(messenger) {
            instance
                .messengers
                .0
                .write()
                .retain(|other| !Arc::ptr_eq(other, &messenger));
        }
    })
}

pub(crate) unsafe extern "system" fn vkSubmitDebugUtilsMessageEXT(
    instance: vk::Instance,
    severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    types: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT,
) {
    guard("vkSubmitDebugUtilsMessageEXT", move || {
        handle::from_handle::<Instance>(instance)
            .messengers
            .forward(severity, types, &*data);
    })
}
