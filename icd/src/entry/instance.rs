//! Instances, and queries without one.

use std::ffi::c_char;
use std::sync::Arc;

use ash::vk;

use super::define::entry;
use crate::ffi::{self, array, enumerate};
use crate::handle;
use crate::object::messenger::Messengers;
use crate::object::{Instance, Messenger, PhysicalDevice};
use crate::os;
use crate::table::extensions::{self, Extension, ExtensionSet, Kind};
use crate::table::limits::API_VERSION;

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

entry! {
    fn vkEnumerateInstanceVersion(version: *mut u32) -> vk::Result {
        *version = API_VERSION;
        Ok(())
    }

    fn vkEnumerateInstanceLayerProperties(count: *mut u32, out: *mut vk::LayerProperties) -> vk::Result {
        enumerate(count, out, [].into_iter())
    }

    fn vkEnumerateInstanceExtensionProperties(
        layer: *const c_char,
        count: *mut u32,
        out: *mut vk::ExtensionProperties,
    ) -> vk::Result {
        if !layer.is_null() {
            return Err(vk::Result::ERROR_LAYER_NOT_PRESENT);
        }
        let all: Vec<_> = extensions::of_kind(Kind::Instance).collect();
        enumerate(count, out, all.into_iter().map(extension_properties))
    }

    fn vkCreateInstance(
        info: *const vk::InstanceCreateInfo,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::Instance,
    ) -> vk::Result {
        if let Some(what) = os::missing() {
            log::error!("the driver needs {what}");
            return Err(vk::Result::ERROR_INCOMPATIBLE_DRIVER);
        }
        let info = &*info;
        let names = ffi::slice(info.pp_enabled_extension_names, info.enabled_extension_count);
        let extensions = ExtensionSet::from_names(Kind::Instance, names.iter().map(|&name| ffi::string(name)))
            .ok_or(vk::Result::ERROR_EXTENSION_NOT_PRESENT)?;
        let asked = info.p_application_info.as_ref().map_or(0, |application| application.api_version);
        let api_version = asked.max(vk::API_VERSION_1_0);
        let messengers = Arc::new(Messengers::default());
        // A messenger in the chain is for creation and destruction, during which the driver sends
        // no messages.
        *out = handle::create(Instance {
            extensions,
            physical_device: handle::new(PhysicalDevice::new(api_version, Arc::clone(&messengers), extensions)),
            messengers,
        });
        Ok(())
    }

    fn vkDestroyInstance(instance: vk::Instance, _allocator: *const vk::AllocationCallbacks) {
        drop(handle::take::<Instance>(instance));
    }

    fn vkGetInstanceProcAddr(instance: vk::Instance, name: *const c_char) -> vk::PFN_vkVoidFunction {
        super::loader::vk_icdGetInstanceProcAddr(instance, name)
    }

    fn vkEnumeratePhysicalDevices(instance: vk::Instance, count: *mut u32, out: *mut vk::PhysicalDevice) -> vk::Result {
        let instance = handle::from_handle::<Instance>(instance);
        enumerate(count, out, [handle::handle_of(&instance.physical_device)].into_iter())
    }

    fn vkEnumeratePhysicalDeviceGroups(
        instance: vk::Instance,
        count: *mut u32,
        out: *mut vk::PhysicalDeviceGroupProperties,
    ) -> vk::Result {
        let instance = handle::from_handle::<Instance>(instance);
        let device = handle::handle_of(&instance.physical_device);
        ffi::enumerate::enumerate_with(count, out, [device].into_iter(), |group, device| {
            group.physical_device_count = 1;
            group.physical_devices = [vk::PhysicalDevice::null(); vk::MAX_DEVICE_GROUP_SIZE];
            group.physical_devices[0] = device;
            group.subset_allocation = vk::FALSE;
        })
    }

    fn vkCreateDebugUtilsMessengerEXT(
        instance: vk::Instance,
        info: *const vk::DebugUtilsMessengerCreateInfoEXT,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::DebugUtilsMessengerEXT,
    ) -> vk::Result {
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
    }

    fn vkDestroyDebugUtilsMessengerEXT(
        instance: vk::Instance,
        messenger: vk::DebugUtilsMessengerEXT,
        _allocator: *const vk::AllocationCallbacks,
    ) {
        let instance = handle::from_handle::<Instance>(instance);
        if let Some(messenger) = handle::take::<Messenger>(messenger) {
            instance.messengers.0.write().retain(|other| !Arc::ptr_eq(other, &messenger));
        }
    }

    fn vkSubmitDebugUtilsMessageEXT(
        instance: vk::Instance,
        severity: vk::DebugUtilsMessageSeverityFlagsEXT,
        types: vk::DebugUtilsMessageTypeFlagsEXT,
        data: *const vk::DebugUtilsMessengerCallbackDataEXT,
    ) {
        handle::from_handle::<Instance>(instance).messengers.forward(severity, types, &*data);
    }
}
