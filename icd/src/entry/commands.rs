//! The table of commands: from it come `vkGetInstanceProcAddr` and `vkGetDeviceProcAddr`.

use std::collections::HashMap;
use std::sync::OnceLock;

use super::*;
use crate::ffi::vk;
use crate::table::extensions::{Extension, ExtensionSet, Kind};

/// The object of a command's first argument.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    Global,
    Instance,
    PhysicalDevice,
    /// Devices, queues and command buffers.
    Device,
}

/// The condition under which a command is available.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Availability {
    /// A version of Vulkan, or a later one.
    Core(u32),
    Extension(Extension),
}

/// A row of the table.
#[derive(Clone, Copy)]
pub struct Command {
    pub name: &'static str,
    pub level: Level,
    pub availability: Availability,
    pub function: unsafe extern "system" fn(),
}

impl Command {
    /// Whether `vkGetInstanceProcAddr` gives it: instance extensions must be enabled.
    pub fn available_to_instance(&self, enabled: ExtensionSet) -> bool {
        match self.availability {
            Availability::Core(_) => true,
            Availability::Extension(extension) => match extension.kind() {
                Kind::Device => true,
                Kind::Instance => enabled.contains(extension),
            },
        }
    }

    /// Whether `vkGetDeviceProcAddr` gives it to an application that asked for a version of Vulkan.
    /// `enabled` has the extensions of the device and of its instance.
    pub fn available_to_device(&self, version: u32, enabled: ExtensionSet) -> bool {
        self.level == Level::Device
            && match self.availability {
                Availability::Core(since) => since <= version,
                Availability::Extension(extension) => enabled.contains(extension),
            }
    }
}

/// The rows of a name: several, where several extensions bring a command.
pub fn rows(name: &[u8]) -> impl Iterator<Item = &'static Command> {
    static INDEX: OnceLock<HashMap<&'static [u8], Vec<&'static Command>>> = OnceLock::new();
    let index = INDEX.get_or_init(|| {
        let mut index: HashMap<_, Vec<_>> = HashMap::new();
        for command in table() {
            let rows = index.entry(command.name.as_bytes()).or_default();
            rows.push(command);
        }
        index
    });
    index.get(name).into_iter().flatten().copied()
}

/// A row is `Level Availability [| Availability]* PFN_type module::function [as alias];`. That the
/// function has the PFN's type is checked by the compiler.
macro_rules! commands {
    ($($level:ident $($extension:ident)|+ $pfn:ident $module:ident::$name:ident $(as $alias:ident)?;)*) => {
        /// Adds the rows, one for each availability.
        #[allow(unused_variables)]
        pub fn add_rows(rows: &mut Vec<$crate::entry::commands::Command>) {
            $({
                let function: vk::$pfn = $module::$name;
                // SAFETY: `PFN_vkVoidFunction` is the type that such pointers are passed around
                // as; callers cast back.
                let function = unsafe { std::mem::transmute::<vk::$pfn, unsafe extern "system" fn()>(function) };
                let name = commands!(@name $name $($alias)?);
                let level = $crate::entry::commands::Level::$level;
                let availabilities = [$(commands!(@availability $extension)),+];
                rows.extend(availabilities.map(|availability| {
                    $crate::entry::commands::Command { name, level, availability, function }
                }));
            })*
        }
    };
    (@name $name:ident) => { stringify!($name) };
    (@name $name:ident $alias:ident) => { stringify!($alias) };
    (@availability Core) => { $crate::entry::commands::Availability::Core($crate::ffi::vk::API_VERSION_1_0) };
    (@availability Core11) => { $crate::entry::commands::Availability::Core($crate::ffi::vk::API_VERSION_1_1) };
    (@availability Core12) => { $crate::entry::commands::Availability::Core($crate::ffi::vk::API_VERSION_1_2) };
    (@availability Core13) => { $crate::entry::commands::Availability::Core($crate::ffi::vk::API_VERSION_1_3) };
    (@availability Core14) => { $crate::entry::commands::Availability::Core($crate::ffi::vk::API_VERSION_1_4) };
    (@availability $extension:ident) => {
        $crate::entry::commands::Availability::Extension($crate::table::extensions::Extension::$extension)
    };
}

pub(super) use commands;

/// All rows, those of this system included.
pub fn table() -> &'static [Command] {
    static TABLE: OnceLock<Vec<Command>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let mut rows = Vec::new();
        add_rows(&mut rows);
        system::add_rows(&mut rows);
        rows
    })
}

commands! {
    Instance EXT_DEBUG_UTILS PFN_vkCreateDebugUtilsMessengerEXT instance::vkCreateDebugUtilsMessengerEXT;
    Global Core PFN_vkCreateInstance instance::vkCreateInstance;
    Instance EXT_DEBUG_UTILS PFN_vkDestroyDebugUtilsMessengerEXT instance::vkDestroyDebugUtilsMessengerEXT;
    Instance Core PFN_vkDestroyInstance instance::vkDestroyInstance;
    Global Core PFN_vkEnumerateInstanceExtensionProperties instance::vkEnumerateInstanceExtensionProperties;
    Global Core PFN_vkEnumerateInstanceLayerProperties instance::vkEnumerateInstanceLayerProperties;
    Global Core11 PFN_vkEnumerateInstanceVersion instance::vkEnumerateInstanceVersion;
    Instance Core11 PFN_vkEnumeratePhysicalDeviceGroups instance::vkEnumeratePhysicalDeviceGroups;
    Instance KHR_DEVICE_GROUP_CREATION PFN_vkEnumeratePhysicalDeviceGroups instance::vkEnumeratePhysicalDeviceGroups as vkEnumeratePhysicalDeviceGroupsKHR;
    Instance Core PFN_vkEnumeratePhysicalDevices instance::vkEnumeratePhysicalDevices;
    Instance Core PFN_vkGetInstanceProcAddr instance::vkGetInstanceProcAddr;
    Instance EXT_DEBUG_UTILS PFN_vkSubmitDebugUtilsMessageEXT instance::vkSubmitDebugUtilsMessageEXT;

    PhysicalDevice Core PFN_vkEnumerateDeviceExtensionProperties physical_device::vkEnumerateDeviceExtensionProperties;
    PhysicalDevice Core PFN_vkEnumerateDeviceLayerProperties physical_device::vkEnumerateDeviceLayerProperties;
    PhysicalDevice KHR_CALIBRATED_TIMESTAMPS PFN_vkGetPhysicalDeviceCalibrateableTimeDomainsKHR physical_device::vkGetPhysicalDeviceCalibrateableTimeDomainsKHR;
    PhysicalDevice EXT_CALIBRATED_TIMESTAMPS PFN_vkGetPhysicalDeviceCalibrateableTimeDomainsKHR physical_device::vkGetPhysicalDeviceCalibrateableTimeDomainsKHR as vkGetPhysicalDeviceCalibrateableTimeDomainsEXT;
    PhysicalDevice Core11 PFN_vkGetPhysicalDeviceExternalBufferProperties physical_device::vkGetPhysicalDeviceExternalBufferProperties;
    PhysicalDevice KHR_EXTERNAL_MEMORY_CAPABILITIES PFN_vkGetPhysicalDeviceExternalBufferProperties physical_device::vkGetPhysicalDeviceExternalBufferProperties as vkGetPhysicalDeviceExternalBufferPropertiesKHR;
    PhysicalDevice Core11 PFN_vkGetPhysicalDeviceExternalFenceProperties physical_device::vkGetPhysicalDeviceExternalFenceProperties;
    PhysicalDevice KHR_EXTERNAL_FENCE_CAPABILITIES PFN_vkGetPhysicalDeviceExternalFenceProperties physical_device::vkGetPhysicalDeviceExternalFenceProperties as vkGetPhysicalDeviceExternalFencePropertiesKHR;
    PhysicalDevice Core11 PFN_vkGetPhysicalDeviceExternalSemaphoreProperties physical_device::vkGetPhysicalDeviceExternalSemaphoreProperties;
    PhysicalDevice KHR_EXTERNAL_SEMAPHORE_CAPABILITIES PFN_vkGetPhysicalDeviceExternalSemaphoreProperties physical_device::vkGetPhysicalDeviceExternalSemaphoreProperties as vkGetPhysicalDeviceExternalSemaphorePropertiesKHR;
    PhysicalDevice Core PFN_vkGetPhysicalDeviceFeatures physical_device::vkGetPhysicalDeviceFeatures;
    PhysicalDevice Core11 PFN_vkGetPhysicalDeviceFeatures2 physical_device::vkGetPhysicalDeviceFeatures2;
    PhysicalDevice KHR_GET_PHYSICAL_DEVICE_PROPERTIES_2 PFN_vkGetPhysicalDeviceFeatures2 physical_device::vkGetPhysicalDeviceFeatures2 as vkGetPhysicalDeviceFeatures2KHR;
    PhysicalDevice Core PFN_vkGetPhysicalDeviceFormatProperties physical_device::vkGetPhysicalDeviceFormatProperties;
    PhysicalDevice Core11 PFN_vkGetPhysicalDeviceFormatProperties2 physical_device::vkGetPhysicalDeviceFormatProperties2;
    PhysicalDevice KHR_GET_PHYSICAL_DEVICE_PROPERTIES_2 PFN_vkGetPhysicalDeviceFormatProperties2 physical_device::vkGetPhysicalDeviceFormatProperties2 as vkGetPhysicalDeviceFormatProperties2KHR;
    PhysicalDevice Core PFN_vkGetPhysicalDeviceImageFormatProperties physical_device::vkGetPhysicalDeviceImageFormatProperties;
    PhysicalDevice Core11 PFN_vkGetPhysicalDeviceImageFormatProperties2 physical_device::vkGetPhysicalDeviceImageFormatProperties2;
    PhysicalDevice KHR_GET_PHYSICAL_DEVICE_PROPERTIES_2 PFN_vkGetPhysicalDeviceImageFormatProperties2 physical_device::vkGetPhysicalDeviceImageFormatProperties2 as vkGetPhysicalDeviceImageFormatProperties2KHR;
    PhysicalDevice Core PFN_vkGetPhysicalDeviceMemoryProperties physical_device::vkGetPhysicalDeviceMemoryProperties;
    PhysicalDevice Core11 PFN_vkGetPhysicalDeviceMemoryProperties2 physical_device::vkGetPhysicalDeviceMemoryProperties2;
    PhysicalDevice KHR_GET_PHYSICAL_DEVICE_PROPERTIES_2 PFN_vkGetPhysicalDeviceMemoryProperties2 physical_device::vkGetPhysicalDeviceMemoryProperties2 as vkGetPhysicalDeviceMemoryProperties2KHR;
    PhysicalDevice Core PFN_vkGetPhysicalDeviceProperties physical_device::vkGetPhysicalDeviceProperties;
    PhysicalDevice Core11 PFN_vkGetPhysicalDeviceProperties2 physical_device::vkGetPhysicalDeviceProperties2;
    PhysicalDevice KHR_GET_PHYSICAL_DEVICE_PROPERTIES_2 PFN_vkGetPhysicalDeviceProperties2 physical_device::vkGetPhysicalDeviceProperties2 as vkGetPhysicalDeviceProperties2KHR;
    PhysicalDevice Core PFN_vkGetPhysicalDeviceQueueFamilyProperties physical_device::vkGetPhysicalDeviceQueueFamilyProperties;
    PhysicalDevice Core11 PFN_vkGetPhysicalDeviceQueueFamilyProperties2 physical_device::vkGetPhysicalDeviceQueueFamilyProperties2;
    PhysicalDevice KHR_GET_PHYSICAL_DEVICE_PROPERTIES_2 PFN_vkGetPhysicalDeviceQueueFamilyProperties2 physical_device::vkGetPhysicalDeviceQueueFamilyProperties2 as vkGetPhysicalDeviceQueueFamilyProperties2KHR;
    PhysicalDevice Core PFN_vkGetPhysicalDeviceSparseImageFormatProperties physical_device::vkGetPhysicalDeviceSparseImageFormatProperties;
    PhysicalDevice KHR_FRAGMENT_SHADING_RATE PFN_vkGetPhysicalDeviceFragmentShadingRatesKHR physical_device::vkGetPhysicalDeviceFragmentShadingRatesKHR;
    PhysicalDevice EXT_SAMPLE_LOCATIONS PFN_vkGetPhysicalDeviceMultisamplePropertiesEXT physical_device::vkGetPhysicalDeviceMultisamplePropertiesEXT;
    PhysicalDevice Core11 PFN_vkGetPhysicalDeviceSparseImageFormatProperties2 physical_device::vkGetPhysicalDeviceSparseImageFormatProperties2;
    PhysicalDevice KHR_GET_PHYSICAL_DEVICE_PROPERTIES_2 PFN_vkGetPhysicalDeviceSparseImageFormatProperties2 physical_device::vkGetPhysicalDeviceSparseImageFormatProperties2 as vkGetPhysicalDeviceSparseImageFormatProperties2KHR;
    PhysicalDevice Core13 PFN_vkGetPhysicalDeviceToolProperties physical_device::vkGetPhysicalDeviceToolProperties;
    PhysicalDevice EXT_TOOLING_INFO PFN_vkGetPhysicalDeviceToolProperties physical_device::vkGetPhysicalDeviceToolProperties as vkGetPhysicalDeviceToolPropertiesEXT;

    PhysicalDevice Core PFN_vkCreateDevice device::vkCreateDevice;
    Device Core13 PFN_vkCreatePrivateDataSlot device::vkCreatePrivateDataSlot;
    Device EXT_PRIVATE_DATA PFN_vkCreatePrivateDataSlot device::vkCreatePrivateDataSlot as vkCreatePrivateDataSlotEXT;
    Device Core PFN_vkDestroyDevice device::vkDestroyDevice;
    Device Core13 PFN_vkDestroyPrivateDataSlot device::vkDestroyPrivateDataSlot;
    Device EXT_PRIVATE_DATA PFN_vkDestroyPrivateDataSlot device::vkDestroyPrivateDataSlot as vkDestroyPrivateDataSlotEXT;
    Device KHR_CALIBRATED_TIMESTAMPS PFN_vkGetCalibratedTimestampsKHR device::vkGetCalibratedTimestampsKHR;
    Device EXT_CALIBRATED_TIMESTAMPS PFN_vkGetCalibratedTimestampsKHR device::vkGetCalibratedTimestampsKHR as vkGetCalibratedTimestampsEXT;
    Device EXT_DEVICE_FAULT PFN_vkGetDeviceFaultInfoEXT device_fault::vkGetDeviceFaultInfoEXT;
    Device Core11 PFN_vkGetDeviceGroupPeerMemoryFeatures device::vkGetDeviceGroupPeerMemoryFeatures;
    Device KHR_DEVICE_GROUP PFN_vkGetDeviceGroupPeerMemoryFeatures device::vkGetDeviceGroupPeerMemoryFeatures as vkGetDeviceGroupPeerMemoryFeaturesKHR;
    Device Core13 PFN_vkGetDeviceImageSparseMemoryRequirements image::vkGetDeviceImageSparseMemoryRequirements;
    Device KHR_MAINTENANCE_4 PFN_vkGetDeviceImageSparseMemoryRequirements image::vkGetDeviceImageSparseMemoryRequirements as vkGetDeviceImageSparseMemoryRequirementsKHR;
    Device Core PFN_vkGetDeviceProcAddr device::vkGetDeviceProcAddr;
    Device Core13 PFN_vkGetPrivateData device::vkGetPrivateData;
    Device EXT_PRIVATE_DATA PFN_vkGetPrivateData device::vkGetPrivateData as vkGetPrivateDataEXT;
    Device Core13 PFN_vkSetPrivateData device::vkSetPrivateData;
    Device EXT_PRIVATE_DATA PFN_vkSetPrivateData device::vkSetPrivateData as vkSetPrivateDataEXT;

    Device Core PFN_vkDeviceWaitIdle queue::vkDeviceWaitIdle;
    Device Core PFN_vkGetDeviceQueue queue::vkGetDeviceQueue;
    Device Core11 PFN_vkGetDeviceQueue2 queue::vkGetDeviceQueue2;
    Device EXT_DEBUG_UTILS PFN_vkQueueBeginDebugUtilsLabelEXT queue::vkQueueBeginDebugUtilsLabelEXT;
    Device Core PFN_vkQueueBindSparse queue::vkQueueBindSparse;
    Device EXT_DEBUG_UTILS PFN_vkQueueEndDebugUtilsLabelEXT queue::vkQueueEndDebugUtilsLabelEXT;
    Device EXT_DEBUG_UTILS PFN_vkQueueInsertDebugUtilsLabelEXT queue::vkQueueInsertDebugUtilsLabelEXT;
    Device Core PFN_vkQueueSubmit queue::vkQueueSubmit;
    Device Core13 PFN_vkQueueSubmit2 queue::vkQueueSubmit2;
    Device KHR_SYNCHRONIZATION_2 PFN_vkQueueSubmit2 queue::vkQueueSubmit2 as vkQueueSubmit2KHR;
    Device Core PFN_vkQueueWaitIdle queue::vkQueueWaitIdle;

    Device Core PFN_vkAllocateMemory memory::vkAllocateMemory;
    Device Core PFN_vkFlushMappedMemoryRanges memory::vkFlushMappedMemoryRanges;
    Device Core PFN_vkFreeMemory memory::vkFreeMemory;
    Device EXT_PAGEABLE_DEVICE_LOCAL_MEMORY PFN_vkSetDeviceMemoryPriorityEXT memory::vkSetDeviceMemoryPriorityEXT;
    Device Core PFN_vkGetDeviceMemoryCommitment memory::vkGetDeviceMemoryCommitment;
    Device Core12 PFN_vkGetDeviceMemoryOpaqueCaptureAddress memory::vkGetDeviceMemoryOpaqueCaptureAddress;
    Device KHR_BUFFER_DEVICE_ADDRESS PFN_vkGetDeviceMemoryOpaqueCaptureAddress memory::vkGetDeviceMemoryOpaqueCaptureAddress as vkGetDeviceMemoryOpaqueCaptureAddressKHR;
    Device EXT_EXTERNAL_MEMORY_HOST PFN_vkGetMemoryHostPointerPropertiesEXT memory::vkGetMemoryHostPointerPropertiesEXT;
    Device Core PFN_vkInvalidateMappedMemoryRanges memory::vkInvalidateMappedMemoryRanges;
    Device Core PFN_vkMapMemory memory::vkMapMemory;
    Device Core14 PFN_vkMapMemory2KHR memory::vkMapMemory2KHR as vkMapMemory2;
    Device KHR_MAP_MEMORY_2 PFN_vkMapMemory2KHR memory::vkMapMemory2KHR;
    Device Core PFN_vkUnmapMemory memory::vkUnmapMemory;
    Device Core14 PFN_vkUnmapMemory2KHR memory::vkUnmapMemory2KHR as vkUnmapMemory2;
    Device KHR_MAP_MEMORY_2 PFN_vkUnmapMemory2KHR memory::vkUnmapMemory2KHR;

    Device Core PFN_vkBindBufferMemory buffer::vkBindBufferMemory;
    Device Core11 PFN_vkBindBufferMemory2 buffer::vkBindBufferMemory2;
    Device KHR_BIND_MEMORY_2 PFN_vkBindBufferMemory2 buffer::vkBindBufferMemory2 as vkBindBufferMemory2KHR;
    Device Core PFN_vkCreateBuffer buffer::vkCreateBuffer;
    Device Core PFN_vkCreateBufferView buffer::vkCreateBufferView;
    Device Core PFN_vkDestroyBuffer buffer::vkDestroyBuffer;
    Device Core PFN_vkDestroyBufferView buffer::vkDestroyBufferView;
    Device Core12 PFN_vkGetBufferDeviceAddress buffer::vkGetBufferDeviceAddress;
    Device KHR_BUFFER_DEVICE_ADDRESS PFN_vkGetBufferDeviceAddress buffer::vkGetBufferDeviceAddress as vkGetBufferDeviceAddressKHR;
    Device Core PFN_vkGetBufferMemoryRequirements buffer::vkGetBufferMemoryRequirements;
    Device Core11 PFN_vkGetBufferMemoryRequirements2 buffer::vkGetBufferMemoryRequirements2;
    Device KHR_GET_MEMORY_REQUIREMENTS_2 PFN_vkGetBufferMemoryRequirements2 buffer::vkGetBufferMemoryRequirements2 as vkGetBufferMemoryRequirements2KHR;
    Device Core12 PFN_vkGetBufferOpaqueCaptureAddress buffer::vkGetBufferOpaqueCaptureAddress;
    Device KHR_BUFFER_DEVICE_ADDRESS PFN_vkGetBufferOpaqueCaptureAddress buffer::vkGetBufferOpaqueCaptureAddress as vkGetBufferOpaqueCaptureAddressKHR;
    Device Core13 PFN_vkGetDeviceBufferMemoryRequirements buffer::vkGetDeviceBufferMemoryRequirements;
    Device KHR_MAINTENANCE_4 PFN_vkGetDeviceBufferMemoryRequirements buffer::vkGetDeviceBufferMemoryRequirements as vkGetDeviceBufferMemoryRequirementsKHR;

    Device Core PFN_vkBindImageMemory image::vkBindImageMemory;
    Device Core11 PFN_vkBindImageMemory2 image::vkBindImageMemory2;
    Device KHR_BIND_MEMORY_2 PFN_vkBindImageMemory2 image::vkBindImageMemory2 as vkBindImageMemory2KHR;
    Device Core PFN_vkCreateImage image::vkCreateImage;
    Device Core PFN_vkCreateImageView image::vkCreateImageView;
    Device Core PFN_vkCreateSampler image::vkCreateSampler;
    Device Core PFN_vkDestroyImage image::vkDestroyImage;
    Device Core PFN_vkDestroyImageView image::vkDestroyImageView;
    Device Core PFN_vkDestroySampler image::vkDestroySampler;
    Device Core13 PFN_vkGetDeviceImageMemoryRequirements image::vkGetDeviceImageMemoryRequirements;
    Device KHR_MAINTENANCE_4 PFN_vkGetDeviceImageMemoryRequirements image::vkGetDeviceImageMemoryRequirements as vkGetDeviceImageMemoryRequirementsKHR;
    Device Core PFN_vkGetImageMemoryRequirements image::vkGetImageMemoryRequirements;
    Device Core11 PFN_vkGetImageMemoryRequirements2 image::vkGetImageMemoryRequirements2;
    Device KHR_GET_MEMORY_REQUIREMENTS_2 PFN_vkGetImageMemoryRequirements2 image::vkGetImageMemoryRequirements2 as vkGetImageMemoryRequirements2KHR;
    Device Core PFN_vkGetImageSparseMemoryRequirements image::vkGetImageSparseMemoryRequirements;
    Device Core11 PFN_vkGetImageSparseMemoryRequirements2 image::vkGetImageSparseMemoryRequirements2;
    Device KHR_GET_MEMORY_REQUIREMENTS_2 PFN_vkGetImageSparseMemoryRequirements2 image::vkGetImageSparseMemoryRequirements2 as vkGetImageSparseMemoryRequirements2KHR;
    Device Core PFN_vkGetImageSubresourceLayout image::vkGetImageSubresourceLayout;

    Device Core PFN_vkCreateEvent sync::vkCreateEvent;
    Device Core PFN_vkCreateFence sync::vkCreateFence;
    Device Core PFN_vkCreateSemaphore sync::vkCreateSemaphore;
    Device Core PFN_vkDestroyEvent sync::vkDestroyEvent;
    Device Core PFN_vkDestroyFence sync::vkDestroyFence;
    Device Core PFN_vkDestroySemaphore sync::vkDestroySemaphore;
    Device Core PFN_vkGetEventStatus sync::vkGetEventStatus;
    Device Core PFN_vkGetFenceStatus sync::vkGetFenceStatus;
    Device Core12 PFN_vkGetSemaphoreCounterValue sync::vkGetSemaphoreCounterValue;
    Device KHR_TIMELINE_SEMAPHORE PFN_vkGetSemaphoreCounterValue sync::vkGetSemaphoreCounterValue as vkGetSemaphoreCounterValueKHR;
    Device Core PFN_vkResetEvent sync::vkResetEvent;
    Device Core PFN_vkResetFences sync::vkResetFences;
    Device Core PFN_vkSetEvent sync::vkSetEvent;
    Device Core12 PFN_vkSignalSemaphore sync::vkSignalSemaphore;
    Device KHR_TIMELINE_SEMAPHORE PFN_vkSignalSemaphore sync::vkSignalSemaphore as vkSignalSemaphoreKHR;
    Device Core PFN_vkWaitForFences sync::vkWaitForFences;
    Device Core12 PFN_vkWaitSemaphores sync::vkWaitSemaphores;
    Device KHR_TIMELINE_SEMAPHORE PFN_vkWaitSemaphores sync::vkWaitSemaphores as vkWaitSemaphoresKHR;

    Device Core PFN_vkCmdCopyQueryPoolResults query::vkCmdCopyQueryPoolResults;
    Device Core PFN_vkCmdResetQueryPool query::vkCmdResetQueryPool;
    Device Core PFN_vkCmdWriteTimestamp query::vkCmdWriteTimestamp;
    Device Core13 PFN_vkCmdWriteTimestamp2 query::vkCmdWriteTimestamp2;
    Device KHR_SYNCHRONIZATION_2 PFN_vkCmdWriteTimestamp2 query::vkCmdWriteTimestamp2 as vkCmdWriteTimestamp2KHR;
    Device Core PFN_vkCreateQueryPool query::vkCreateQueryPool;
    Device Core PFN_vkDestroyQueryPool query::vkDestroyQueryPool;
    Device Core PFN_vkGetQueryPoolResults query::vkGetQueryPoolResults;
    Device Core12 PFN_vkResetQueryPool query::vkResetQueryPool;
    Device EXT_HOST_QUERY_RESET PFN_vkResetQueryPool query::vkResetQueryPool as vkResetQueryPoolEXT;

    Device Core PFN_vkAllocateDescriptorSets descriptor::vkAllocateDescriptorSets;
    Device Core PFN_vkCreateDescriptorPool descriptor::vkCreateDescriptorPool;
    Device Core PFN_vkCreateDescriptorSetLayout descriptor::vkCreateDescriptorSetLayout;
    Device Core11 PFN_vkCreateDescriptorUpdateTemplate descriptor::vkCreateDescriptorUpdateTemplate;
    Device KHR_DESCRIPTOR_UPDATE_TEMPLATE PFN_vkCreateDescriptorUpdateTemplate descriptor::vkCreateDescriptorUpdateTemplate as vkCreateDescriptorUpdateTemplateKHR;
    Device Core PFN_vkDestroyDescriptorPool descriptor::vkDestroyDescriptorPool;
    Device Core PFN_vkDestroyDescriptorSetLayout descriptor::vkDestroyDescriptorSetLayout;
    Device Core11 PFN_vkDestroyDescriptorUpdateTemplate descriptor::vkDestroyDescriptorUpdateTemplate;
    Device KHR_DESCRIPTOR_UPDATE_TEMPLATE PFN_vkDestroyDescriptorUpdateTemplate descriptor::vkDestroyDescriptorUpdateTemplate as vkDestroyDescriptorUpdateTemplateKHR;
    Device Core PFN_vkFreeDescriptorSets descriptor::vkFreeDescriptorSets;
    Device Core11 PFN_vkGetDescriptorSetLayoutSupport descriptor::vkGetDescriptorSetLayoutSupport;
    Device KHR_MAINTENANCE_3 PFN_vkGetDescriptorSetLayoutSupport descriptor::vkGetDescriptorSetLayoutSupport as vkGetDescriptorSetLayoutSupportKHR;
    Device Core PFN_vkResetDescriptorPool descriptor::vkResetDescriptorPool;

    Device Core11 PFN_vkUpdateDescriptorSetWithTemplate descriptor_set::vkUpdateDescriptorSetWithTemplate;
    Device KHR_DESCRIPTOR_UPDATE_TEMPLATE PFN_vkUpdateDescriptorSetWithTemplate descriptor_set::vkUpdateDescriptorSetWithTemplate as vkUpdateDescriptorSetWithTemplateKHR;
    Device Core PFN_vkUpdateDescriptorSets descriptor_set::vkUpdateDescriptorSets;

    Device Core14 PFN_vkCmdPushDescriptorSetKHR push_descriptor::vkCmdPushDescriptorSetKHR as vkCmdPushDescriptorSet;
    Device KHR_PUSH_DESCRIPTOR PFN_vkCmdPushDescriptorSetKHR push_descriptor::vkCmdPushDescriptorSetKHR;
    Device Core14 PFN_vkCmdPushDescriptorSetWithTemplateKHR push_descriptor::vkCmdPushDescriptorSetWithTemplateKHR as vkCmdPushDescriptorSetWithTemplate;
    Device KHR_PUSH_DESCRIPTOR PFN_vkCmdPushDescriptorSetWithTemplateKHR push_descriptor::vkCmdPushDescriptorSetWithTemplateKHR;

    Device EXT_DESCRIPTOR_BUFFER PFN_vkCmdBindDescriptorBufferEmbeddedSamplersEXT descriptor_buffer::vkCmdBindDescriptorBufferEmbeddedSamplersEXT;
    Device EXT_DESCRIPTOR_BUFFER PFN_vkCmdBindDescriptorBuffersEXT descriptor_buffer::vkCmdBindDescriptorBuffersEXT;
    Device EXT_DESCRIPTOR_BUFFER PFN_vkCmdSetDescriptorBufferOffsetsEXT descriptor_buffer::vkCmdSetDescriptorBufferOffsetsEXT;
    Device EXT_DESCRIPTOR_BUFFER PFN_vkGetAccelerationStructureOpaqueCaptureDescriptorDataEXT descriptor_buffer::vkGetAccelerationStructureOpaqueCaptureDescriptorDataEXT;
    Device EXT_DESCRIPTOR_BUFFER PFN_vkGetBufferOpaqueCaptureDescriptorDataEXT descriptor_buffer::vkGetBufferOpaqueCaptureDescriptorDataEXT;
    Device EXT_DESCRIPTOR_BUFFER PFN_vkGetDescriptorEXT descriptor_buffer::vkGetDescriptorEXT;
    Device EXT_DESCRIPTOR_BUFFER PFN_vkGetDescriptorSetLayoutBindingOffsetEXT descriptor_buffer::vkGetDescriptorSetLayoutBindingOffsetEXT;
    Device EXT_DESCRIPTOR_BUFFER PFN_vkGetDescriptorSetLayoutSizeEXT descriptor_buffer::vkGetDescriptorSetLayoutSizeEXT;
    Device EXT_DESCRIPTOR_BUFFER PFN_vkGetImageOpaqueCaptureDescriptorDataEXT descriptor_buffer::vkGetImageOpaqueCaptureDescriptorDataEXT;
    Device EXT_DESCRIPTOR_BUFFER PFN_vkGetImageViewOpaqueCaptureDescriptorDataEXT descriptor_buffer::vkGetImageViewOpaqueCaptureDescriptorDataEXT;
    Device EXT_DESCRIPTOR_BUFFER PFN_vkGetSamplerOpaqueCaptureDescriptorDataEXT descriptor_buffer::vkGetSamplerOpaqueCaptureDescriptorDataEXT;

    Device Core PFN_vkCreateComputePipelines pipeline::vkCreateComputePipelines;
    Device Core PFN_vkCreatePipelineCache pipeline::vkCreatePipelineCache;
    Device Core PFN_vkCreatePipelineLayout pipeline::vkCreatePipelineLayout;
    Device Core PFN_vkCreateShaderModule pipeline::vkCreateShaderModule;
    Device Core PFN_vkDestroyPipeline pipeline::vkDestroyPipeline;
    Device Core PFN_vkDestroyPipelineCache pipeline::vkDestroyPipelineCache;
    Device Core PFN_vkDestroyPipelineLayout pipeline::vkDestroyPipelineLayout;
    Device Core PFN_vkDestroyShaderModule pipeline::vkDestroyShaderModule;
    Device Core PFN_vkGetPipelineCacheData pipeline::vkGetPipelineCacheData;
    Device Core PFN_vkMergePipelineCaches pipeline::vkMergePipelineCaches;

    Device Core PFN_vkAllocateCommandBuffers command::vkAllocateCommandBuffers;
    Device Core PFN_vkBeginCommandBuffer command::vkBeginCommandBuffer;
    Device EXT_DEBUG_UTILS PFN_vkCmdBeginDebugUtilsLabelEXT command::vkCmdBeginDebugUtilsLabelEXT;
    Device Core PFN_vkCmdBindDescriptorSets command::vkCmdBindDescriptorSets;
    Device Core PFN_vkCmdBindPipeline command::vkCmdBindPipeline;
    Device Core PFN_vkCmdDispatch command::vkCmdDispatch;
    Device Core11 PFN_vkCmdDispatchBase command::vkCmdDispatchBase;
    Device KHR_DEVICE_GROUP PFN_vkCmdDispatchBase command::vkCmdDispatchBase as vkCmdDispatchBaseKHR;
    Device Core PFN_vkCmdDispatchIndirect command::vkCmdDispatchIndirect;
    Device EXT_DEBUG_UTILS PFN_vkCmdEndDebugUtilsLabelEXT command::vkCmdEndDebugUtilsLabelEXT;
    Device Core PFN_vkCmdExecuteCommands command::vkCmdExecuteCommands;
    Device EXT_DEBUG_UTILS PFN_vkCmdInsertDebugUtilsLabelEXT command::vkCmdInsertDebugUtilsLabelEXT;
    Device Core PFN_vkCmdPipelineBarrier command::vkCmdPipelineBarrier;
    Device Core13 PFN_vkCmdPipelineBarrier2 command::vkCmdPipelineBarrier2;
    Device KHR_SYNCHRONIZATION_2 PFN_vkCmdPipelineBarrier2 command::vkCmdPipelineBarrier2 as vkCmdPipelineBarrier2KHR;
    Device Core PFN_vkCmdPushConstants command::vkCmdPushConstants;
    Device Core PFN_vkCmdResetEvent command::vkCmdResetEvent;
    Device Core13 PFN_vkCmdResetEvent2 command::vkCmdResetEvent2;
    Device KHR_SYNCHRONIZATION_2 PFN_vkCmdResetEvent2 command::vkCmdResetEvent2 as vkCmdResetEvent2KHR;
    Device Core11 PFN_vkCmdSetDeviceMask command::vkCmdSetDeviceMask;
    Device KHR_DEVICE_GROUP PFN_vkCmdSetDeviceMask command::vkCmdSetDeviceMask as vkCmdSetDeviceMaskKHR;
    Device Core PFN_vkCmdSetEvent command::vkCmdSetEvent;
    Device Core13 PFN_vkCmdSetEvent2 command::vkCmdSetEvent2;
    Device KHR_SYNCHRONIZATION_2 PFN_vkCmdSetEvent2 command::vkCmdSetEvent2 as vkCmdSetEvent2KHR;
    Device Core PFN_vkCmdWaitEvents command::vkCmdWaitEvents;
    Device Core13 PFN_vkCmdWaitEvents2 command::vkCmdWaitEvents2;
    Device KHR_SYNCHRONIZATION_2 PFN_vkCmdWaitEvents2 command::vkCmdWaitEvents2 as vkCmdWaitEvents2KHR;
    Device Core PFN_vkCreateCommandPool command::vkCreateCommandPool;
    Device Core PFN_vkDestroyCommandPool command::vkDestroyCommandPool;
    Device Core PFN_vkEndCommandBuffer command::vkEndCommandBuffer;
    Device Core PFN_vkFreeCommandBuffers command::vkFreeCommandBuffers;
    Device Core PFN_vkResetCommandBuffer command::vkResetCommandBuffer;
    Device Core PFN_vkResetCommandPool command::vkResetCommandPool;
    Device Core11 PFN_vkTrimCommandPool command::vkTrimCommandPool;
    Device KHR_MAINTENANCE_1 PFN_vkTrimCommandPool command::vkTrimCommandPool as vkTrimCommandPoolKHR;

    Device Core PFN_vkCmdCopyBuffer command_transfer::vkCmdCopyBuffer;
    Device Core13 PFN_vkCmdCopyBuffer2 command_transfer::vkCmdCopyBuffer2;
    Device KHR_COPY_COMMANDS_2 PFN_vkCmdCopyBuffer2 command_transfer::vkCmdCopyBuffer2 as vkCmdCopyBuffer2KHR;
    Device Core PFN_vkCmdFillBuffer command_transfer::vkCmdFillBuffer;
    Device Core PFN_vkCmdUpdateBuffer command_transfer::vkCmdUpdateBuffer;

    Device Core PFN_vkCmdBlitImage command_image::vkCmdBlitImage;
    Device Core13 PFN_vkCmdBlitImage2 command_image::vkCmdBlitImage2;
    Device KHR_COPY_COMMANDS_2 PFN_vkCmdBlitImage2 command_image::vkCmdBlitImage2 as vkCmdBlitImage2KHR;
    Device Core PFN_vkCmdClearColorImage command_image::vkCmdClearColorImage;
    Device Core PFN_vkCmdClearDepthStencilImage command_image::vkCmdClearDepthStencilImage;
    Device Core PFN_vkCmdCopyBufferToImage command_image::vkCmdCopyBufferToImage;
    Device Core13 PFN_vkCmdCopyBufferToImage2 command_image::vkCmdCopyBufferToImage2;
    Device KHR_COPY_COMMANDS_2 PFN_vkCmdCopyBufferToImage2 command_image::vkCmdCopyBufferToImage2 as vkCmdCopyBufferToImage2KHR;
    Device Core PFN_vkCmdCopyImage command_image::vkCmdCopyImage;
    Device Core13 PFN_vkCmdCopyImage2 command_image::vkCmdCopyImage2;
    Device KHR_COPY_COMMANDS_2 PFN_vkCmdCopyImage2 command_image::vkCmdCopyImage2 as vkCmdCopyImage2KHR;
    Device Core PFN_vkCmdCopyImageToBuffer command_image::vkCmdCopyImageToBuffer;
    Device Core13 PFN_vkCmdCopyImageToBuffer2 command_image::vkCmdCopyImageToBuffer2;
    Device KHR_COPY_COMMANDS_2 PFN_vkCmdCopyImageToBuffer2 command_image::vkCmdCopyImageToBuffer2 as vkCmdCopyImageToBuffer2KHR;
    Device Core PFN_vkCmdResolveImage command_image::vkCmdResolveImage;
    Device Core13 PFN_vkCmdResolveImage2 command_image::vkCmdResolveImage2;
    Device KHR_COPY_COMMANDS_2 PFN_vkCmdResolveImage2 command_image::vkCmdResolveImage2 as vkCmdResolveImage2KHR;

    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdBeginConditionalRendering2EXT graphics_address::vkCmdBeginConditionalRendering2EXT;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdBeginTransformFeedback2EXT transform_feedback::vkCmdBeginTransformFeedback2EXT;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdBindTransformFeedbackBuffers2EXT transform_feedback::vkCmdBindTransformFeedbackBuffers2EXT;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdDrawIndirectByteCount2EXT transform_feedback::vkCmdDrawIndirectByteCount2EXT;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdEndTransformFeedback2EXT transform_feedback::vkCmdEndTransformFeedback2EXT;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdBindIndexBuffer3KHR graphics_address::vkCmdBindIndexBuffer3KHR;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdBindVertexBuffers3KHR graphics_address::vkCmdBindVertexBuffers3KHR;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdDrawIndexedIndirect2KHR graphics_address::vkCmdDrawIndexedIndirect2KHR;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdDrawIndexedIndirectCount2KHR graphics_address::vkCmdDrawIndexedIndirectCount2KHR;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdDrawIndirect2KHR graphics_address::vkCmdDrawIndirect2KHR;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdDrawIndirectCount2KHR graphics_address::vkCmdDrawIndirectCount2KHR;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdDrawMeshTasksIndirect2EXT graphics_address::vkCmdDrawMeshTasksIndirect2EXT;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdDrawMeshTasksIndirectCount2EXT graphics_address::vkCmdDrawMeshTasksIndirectCount2EXT;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdCopyImageToMemoryKHR device_address::vkCmdCopyImageToMemoryKHR;
    Device KHR_COPY_MEMORY_INDIRECT PFN_vkCmdCopyMemoryIndirectKHR device_address::vkCmdCopyMemoryIndirectKHR;
    Device KHR_COPY_MEMORY_INDIRECT PFN_vkCmdCopyMemoryToImageIndirectKHR device_address::vkCmdCopyMemoryToImageIndirectKHR;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdCopyMemoryKHR device_address::vkCmdCopyMemoryKHR;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdCopyMemoryToImageKHR device_address::vkCmdCopyMemoryToImageKHR;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdCopyQueryPoolResultsToMemoryKHR device_address::vkCmdCopyQueryPoolResultsToMemoryKHR;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdDispatchIndirect2KHR device_address::vkCmdDispatchIndirect2KHR;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdFillMemoryKHR device_address::vkCmdFillMemoryKHR;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCmdUpdateMemoryKHR device_address::vkCmdUpdateMemoryKHR;
    Device KHR_DEVICE_ADDRESS_COMMANDS PFN_vkCreateAccelerationStructure2KHR device_address::vkCreateAccelerationStructure2KHR;

    Device Core14 PFN_vkCmdBindIndexBuffer2KHR graphics_draw::vkCmdBindIndexBuffer2KHR as vkCmdBindIndexBuffer2;
    Device KHR_MAINTENANCE_5 PFN_vkCmdBindIndexBuffer2KHR graphics_draw::vkCmdBindIndexBuffer2KHR;
    Device Core11 PFN_vkCreateSamplerYcbcrConversion image::vkCreateSamplerYcbcrConversion;
    Device KHR_SAMPLER_YCBCR_CONVERSION PFN_vkCreateSamplerYcbcrConversion image::vkCreateSamplerYcbcrConversion as vkCreateSamplerYcbcrConversionKHR;
    Device Core11 PFN_vkDestroySamplerYcbcrConversion image::vkDestroySamplerYcbcrConversion;
    Device KHR_SAMPLER_YCBCR_CONVERSION PFN_vkDestroySamplerYcbcrConversion image::vkDestroySamplerYcbcrConversion as vkDestroySamplerYcbcrConversionKHR;
    Device Core14 PFN_vkGetDeviceImageSubresourceLayoutKHR maintenance5::vkGetDeviceImageSubresourceLayoutKHR as vkGetDeviceImageSubresourceLayout;
    Device KHR_MAINTENANCE_5 PFN_vkGetDeviceImageSubresourceLayoutKHR maintenance5::vkGetDeviceImageSubresourceLayoutKHR;
    Device Core14 PFN_vkGetImageSubresourceLayout2KHR maintenance5::vkGetImageSubresourceLayout2KHR as vkGetImageSubresourceLayout2;
    Device KHR_MAINTENANCE_5 PFN_vkGetImageSubresourceLayout2KHR maintenance5::vkGetImageSubresourceLayout2KHR;
    Device EXT_HOST_IMAGE_COPY PFN_vkGetImageSubresourceLayout2KHR maintenance5::vkGetImageSubresourceLayout2KHR as vkGetImageSubresourceLayout2EXT;
    Device Core14 PFN_vkCopyImageToImageEXT host_image_copy::vkCopyImageToImageEXT as vkCopyImageToImage;
    Device EXT_HOST_IMAGE_COPY PFN_vkCopyImageToImageEXT host_image_copy::vkCopyImageToImageEXT;
    Device Core14 PFN_vkCopyImageToMemoryEXT host_image_copy::vkCopyImageToMemoryEXT as vkCopyImageToMemory;
    Device EXT_HOST_IMAGE_COPY PFN_vkCopyImageToMemoryEXT host_image_copy::vkCopyImageToMemoryEXT;
    Device Core14 PFN_vkCopyMemoryToImageEXT host_image_copy::vkCopyMemoryToImageEXT as vkCopyMemoryToImage;
    Device EXT_HOST_IMAGE_COPY PFN_vkCopyMemoryToImageEXT host_image_copy::vkCopyMemoryToImageEXT;
    Device Core14 PFN_vkTransitionImageLayoutEXT host_image_copy::vkTransitionImageLayoutEXT as vkTransitionImageLayout;
    Device EXT_HOST_IMAGE_COPY PFN_vkTransitionImageLayoutEXT host_image_copy::vkTransitionImageLayoutEXT;
    Device Core14 PFN_vkGetRenderingAreaGranularityKHR maintenance5::vkGetRenderingAreaGranularityKHR as vkGetRenderingAreaGranularity;
    Device KHR_MAINTENANCE_5 PFN_vkGetRenderingAreaGranularityKHR maintenance5::vkGetRenderingAreaGranularityKHR;

    Device KHR_ACCELERATION_STRUCTURE PFN_vkBuildAccelerationStructuresKHR acceleration_structure::vkBuildAccelerationStructuresKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCmdBuildAccelerationStructuresIndirectKHR acceleration_structure::vkCmdBuildAccelerationStructuresIndirectKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCmdBuildAccelerationStructuresKHR acceleration_structure::vkCmdBuildAccelerationStructuresKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCmdCopyAccelerationStructureKHR acceleration_structure::vkCmdCopyAccelerationStructureKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCmdCopyAccelerationStructureToMemoryKHR acceleration_structure::vkCmdCopyAccelerationStructureToMemoryKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCmdCopyMemoryToAccelerationStructureKHR acceleration_structure::vkCmdCopyMemoryToAccelerationStructureKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCmdWriteAccelerationStructuresPropertiesKHR acceleration_structure::vkCmdWriteAccelerationStructuresPropertiesKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCopyAccelerationStructureKHR acceleration_structure::vkCopyAccelerationStructureKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCopyAccelerationStructureToMemoryKHR acceleration_structure::vkCopyAccelerationStructureToMemoryKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCopyMemoryToAccelerationStructureKHR acceleration_structure::vkCopyMemoryToAccelerationStructureKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCreateAccelerationStructureKHR acceleration_structure::vkCreateAccelerationStructureKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkDestroyAccelerationStructureKHR acceleration_structure::vkDestroyAccelerationStructureKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkGetAccelerationStructureBuildSizesKHR acceleration_structure::vkGetAccelerationStructureBuildSizesKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkGetAccelerationStructureDeviceAddressKHR acceleration_structure::vkGetAccelerationStructureDeviceAddressKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkGetDeviceAccelerationStructureCompatibilityKHR acceleration_structure::vkGetDeviceAccelerationStructureCompatibilityKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkWriteAccelerationStructuresPropertiesKHR acceleration_structure::vkWriteAccelerationStructuresPropertiesKHR;

    Device KHR_RAY_TRACING_PIPELINE PFN_vkCmdSetRayTracingPipelineStackSizeKHR ray_tracing::vkCmdSetRayTracingPipelineStackSizeKHR;
    Device NV_RAY_TRACING PFN_vkBindAccelerationStructureMemoryNV nv_ray_tracing::vkBindAccelerationStructureMemoryNV;
    Device NV_RAY_TRACING PFN_vkCmdBuildAccelerationStructureNV nv_ray_tracing::vkCmdBuildAccelerationStructureNV;
    Device NV_RAY_TRACING PFN_vkCmdCopyAccelerationStructureNV nv_ray_tracing::vkCmdCopyAccelerationStructureNV;
    Device NV_RAY_TRACING PFN_vkCmdTraceRaysNV nv_ray_tracing::vkCmdTraceRaysNV;
    Device NV_RAY_TRACING PFN_vkCmdWriteAccelerationStructuresPropertiesNV nv_ray_tracing::vkCmdWriteAccelerationStructuresPropertiesNV;
    Device NV_RAY_TRACING PFN_vkCompileDeferredNV nv_ray_tracing::vkCompileDeferredNV;
    Device NV_RAY_TRACING PFN_vkCreateAccelerationStructureNV nv_ray_tracing::vkCreateAccelerationStructureNV;
    Device NV_RAY_TRACING PFN_vkCreateRayTracingPipelinesNV nv_ray_tracing::vkCreateRayTracingPipelinesNV;
    Device NV_RAY_TRACING PFN_vkDestroyAccelerationStructureNV nv_ray_tracing::vkDestroyAccelerationStructureNV;
    Device NV_RAY_TRACING PFN_vkGetAccelerationStructureHandleNV nv_ray_tracing::vkGetAccelerationStructureHandleNV;
    Device NV_RAY_TRACING PFN_vkGetAccelerationStructureMemoryRequirementsNV nv_ray_tracing::vkGetAccelerationStructureMemoryRequirementsNV;
    Device NV_RAY_TRACING PFN_vkGetRayTracingShaderGroupHandlesKHR ray_tracing::vkGetRayTracingShaderGroupHandlesKHR as vkGetRayTracingShaderGroupHandlesNV;
    Device HUAWEI_INVOCATION_MASK PFN_vkCmdBindInvocationMaskHUAWEI ray_tracing::vkCmdBindInvocationMaskHUAWEI;
    Device KHR_RAY_TRACING_MAINTENANCE_1 PFN_vkCmdTraceRaysIndirect2KHR ray_tracing::vkCmdTraceRaysIndirect2KHR;
    Device KHR_RAY_TRACING_PIPELINE PFN_vkCmdTraceRaysIndirectKHR ray_tracing::vkCmdTraceRaysIndirectKHR;
    Device KHR_RAY_TRACING_PIPELINE PFN_vkCmdTraceRaysKHR ray_tracing::vkCmdTraceRaysKHR;
    Device KHR_RAY_TRACING_PIPELINE PFN_vkCreateRayTracingPipelinesKHR ray_tracing::vkCreateRayTracingPipelinesKHR;
    Device KHR_RAY_TRACING_PIPELINE PFN_vkGetRayTracingCaptureReplayShaderGroupHandlesKHR ray_tracing::vkGetRayTracingCaptureReplayShaderGroupHandlesKHR;
    Device KHR_RAY_TRACING_PIPELINE PFN_vkGetRayTracingShaderGroupHandlesKHR ray_tracing::vkGetRayTracingShaderGroupHandlesKHR;
    Device KHR_RAY_TRACING_PIPELINE PFN_vkGetRayTracingShaderGroupStackSizeKHR ray_tracing::vkGetRayTracingShaderGroupStackSizeKHR;

    Device EXT_OPACITY_MICROMAP PFN_vkBuildMicromapsEXT micromap::vkBuildMicromapsEXT;
    Device EXT_OPACITY_MICROMAP PFN_vkCmdBuildMicromapsEXT micromap::vkCmdBuildMicromapsEXT;
    Device EXT_OPACITY_MICROMAP PFN_vkCmdCopyMemoryToMicromapEXT micromap::vkCmdCopyMemoryToMicromapEXT;
    Device EXT_OPACITY_MICROMAP PFN_vkCmdCopyMicromapEXT micromap::vkCmdCopyMicromapEXT;
    Device EXT_OPACITY_MICROMAP PFN_vkCmdCopyMicromapToMemoryEXT micromap::vkCmdCopyMicromapToMemoryEXT;
    Device EXT_OPACITY_MICROMAP PFN_vkCmdWriteMicromapsPropertiesEXT micromap::vkCmdWriteMicromapsPropertiesEXT;
    Device EXT_OPACITY_MICROMAP PFN_vkCopyMemoryToMicromapEXT micromap::vkCopyMemoryToMicromapEXT;
    Device EXT_OPACITY_MICROMAP PFN_vkCopyMicromapEXT micromap::vkCopyMicromapEXT;
    Device EXT_OPACITY_MICROMAP PFN_vkCopyMicromapToMemoryEXT micromap::vkCopyMicromapToMemoryEXT;
    Device EXT_OPACITY_MICROMAP PFN_vkCreateMicromapEXT micromap::vkCreateMicromapEXT;
    Device EXT_OPACITY_MICROMAP PFN_vkDestroyMicromapEXT micromap::vkDestroyMicromapEXT;
    Device EXT_OPACITY_MICROMAP PFN_vkGetDeviceMicromapCompatibilityEXT micromap::vkGetDeviceMicromapCompatibilityEXT;
    Device EXT_OPACITY_MICROMAP PFN_vkGetMicromapBuildSizesEXT micromap::vkGetMicromapBuildSizesEXT;
    Device EXT_OPACITY_MICROMAP PFN_vkWriteMicromapsPropertiesEXT micromap::vkWriteMicromapsPropertiesEXT;

    Device Core PFN_vkCmdBeginQuery graphics_draw::vkCmdBeginQuery;
    Device Core PFN_vkCmdBeginRenderPass graphics_pass::vkCmdBeginRenderPass;
    Device Core12 PFN_vkCmdBeginRenderPass2 graphics_pass::vkCmdBeginRenderPass2;
    Device Core13 PFN_vkCmdBeginRendering graphics_pass::vkCmdBeginRendering;
    Device Core PFN_vkCmdBindIndexBuffer graphics_draw::vkCmdBindIndexBuffer;
    Device EXT_PRIMITIVE_RESTART_INDEX PFN_vkCmdSetPrimitiveRestartIndexEXT graphics_draw::vkCmdSetPrimitiveRestartIndexEXT;
    Device Core PFN_vkCmdBindVertexBuffers graphics_draw::vkCmdBindVertexBuffers;
    Device Core13 PFN_vkCmdBindVertexBuffers2 graphics_draw::vkCmdBindVertexBuffers2;
    Device Core PFN_vkCmdClearAttachments graphics_pass::vkCmdClearAttachments;
    Device Core PFN_vkCmdDraw graphics_draw::vkCmdDraw;
    Device Core PFN_vkCmdDrawIndexed graphics_draw::vkCmdDrawIndexed;
    Device Core PFN_vkCmdDrawIndexedIndirect graphics_draw::vkCmdDrawIndexedIndirect;
    Device Core12 PFN_vkCmdDrawIndexedIndirectCount graphics_draw::vkCmdDrawIndexedIndirectCount;
    Device Core PFN_vkCmdDrawIndirect graphics_draw::vkCmdDrawIndirect;
    Device Core12 PFN_vkCmdDrawIndirectCount graphics_draw::vkCmdDrawIndirectCount;
    Device Core PFN_vkCmdEndQuery graphics_draw::vkCmdEndQuery;
    Device Core PFN_vkCmdEndRenderPass graphics_pass::vkCmdEndRenderPass;
    Device Core12 PFN_vkCmdEndRenderPass2 graphics_pass::vkCmdEndRenderPass2;
    Device Core13 PFN_vkCmdEndRendering graphics_pass::vkCmdEndRendering;
    Device Core PFN_vkCmdNextSubpass graphics_pass::vkCmdNextSubpass;
    Device Core12 PFN_vkCmdNextSubpass2 graphics_pass::vkCmdNextSubpass2;
    Device Core PFN_vkCmdSetBlendConstants graphics_state::vkCmdSetBlendConstants;
    Device Core13 PFN_vkCmdSetCullMode graphics_state::vkCmdSetCullMode;
    Device Core PFN_vkCmdSetDepthBias graphics_state::vkCmdSetDepthBias;
    Device Core13 PFN_vkCmdSetDepthBiasEnable graphics_state::vkCmdSetDepthBiasEnable;
    Device Core PFN_vkCmdSetDepthBounds graphics_state::vkCmdSetDepthBounds;
    Device Core13 PFN_vkCmdSetDepthBoundsTestEnable graphics_state::vkCmdSetDepthBoundsTestEnable;
    Device Core13 PFN_vkCmdSetDepthCompareOp graphics_state::vkCmdSetDepthCompareOp;
    Device Core13 PFN_vkCmdSetDepthTestEnable graphics_state::vkCmdSetDepthTestEnable;
    Device Core13 PFN_vkCmdSetDepthWriteEnable graphics_state::vkCmdSetDepthWriteEnable;
    Device Core13 PFN_vkCmdSetFrontFace graphics_state::vkCmdSetFrontFace;
    Device Core PFN_vkCmdSetLineWidth graphics_state::vkCmdSetLineWidth;
    Device Core13 PFN_vkCmdSetPrimitiveRestartEnable graphics_state::vkCmdSetPrimitiveRestartEnable;
    Device Core13 PFN_vkCmdSetPrimitiveTopology graphics_state::vkCmdSetPrimitiveTopology;
    Device Core13 PFN_vkCmdSetRasterizerDiscardEnable graphics_state::vkCmdSetRasterizerDiscardEnable;
    Device Core PFN_vkCmdSetScissor graphics_state::vkCmdSetScissor;
    Device Core13 PFN_vkCmdSetScissorWithCount graphics_state::vkCmdSetScissorWithCount;
    Device Core PFN_vkCmdSetStencilCompareMask graphics_state::vkCmdSetStencilCompareMask;
    Device Core13 PFN_vkCmdSetStencilOp graphics_state::vkCmdSetStencilOp;
    Device Core PFN_vkCmdSetStencilReference graphics_state::vkCmdSetStencilReference;
    Device Core13 PFN_vkCmdSetStencilTestEnable graphics_state::vkCmdSetStencilTestEnable;
    Device Core PFN_vkCmdSetStencilWriteMask graphics_state::vkCmdSetStencilWriteMask;
    Device Core PFN_vkCmdSetViewport graphics_state::vkCmdSetViewport;
    Device Core13 PFN_vkCmdSetViewportWithCount graphics_state::vkCmdSetViewportWithCount;
    Device Core PFN_vkCreateFramebuffer graphics::vkCreateFramebuffer;
    Device Core PFN_vkCreateGraphicsPipelines graphics::vkCreateGraphicsPipelines;
    Device Core PFN_vkCreateRenderPass graphics::vkCreateRenderPass;
    Device Core12 PFN_vkCreateRenderPass2 graphics::vkCreateRenderPass2;
    Device Core PFN_vkDestroyFramebuffer graphics::vkDestroyFramebuffer;
    Device Core PFN_vkDestroyRenderPass graphics::vkDestroyRenderPass;
    Device Core PFN_vkGetRenderAreaGranularity graphics::vkGetRenderAreaGranularity;

    Device KHR_CREATE_RENDERPASS_2 PFN_vkCreateRenderPass2 graphics::vkCreateRenderPass2 as vkCreateRenderPass2KHR;
    Device KHR_CREATE_RENDERPASS_2 PFN_vkCmdBeginRenderPass2 graphics_pass::vkCmdBeginRenderPass2 as vkCmdBeginRenderPass2KHR;
    Device KHR_CREATE_RENDERPASS_2 PFN_vkCmdNextSubpass2 graphics_pass::vkCmdNextSubpass2 as vkCmdNextSubpass2KHR;
    Device KHR_CREATE_RENDERPASS_2 PFN_vkCmdEndRenderPass2 graphics_pass::vkCmdEndRenderPass2 as vkCmdEndRenderPass2KHR;
    Device KHR_DRAW_INDIRECT_COUNT PFN_vkCmdDrawIndirectCount graphics_draw::vkCmdDrawIndirectCount as vkCmdDrawIndirectCountKHR;
    Device KHR_DRAW_INDIRECT_COUNT PFN_vkCmdDrawIndexedIndirectCount graphics_draw::vkCmdDrawIndexedIndirectCount as vkCmdDrawIndexedIndirectCountKHR;
    Device KHR_DYNAMIC_RENDERING PFN_vkCmdBeginRendering graphics_pass::vkCmdBeginRendering as vkCmdBeginRenderingKHR;
    Device KHR_DYNAMIC_RENDERING PFN_vkCmdEndRendering graphics_pass::vkCmdEndRendering as vkCmdEndRenderingKHR;
    Device Core14 PFN_vkCmdSetRenderingAttachmentLocationsKHR graphics_pass::vkCmdSetRenderingAttachmentLocationsKHR as vkCmdSetRenderingAttachmentLocations;
    Device KHR_DYNAMIC_RENDERING_LOCAL_READ PFN_vkCmdSetRenderingAttachmentLocationsKHR graphics_pass::vkCmdSetRenderingAttachmentLocationsKHR;
    Device Core14 PFN_vkCmdSetRenderingInputAttachmentIndicesKHR graphics_pass::vkCmdSetRenderingInputAttachmentIndicesKHR as vkCmdSetRenderingInputAttachmentIndices;
    Device KHR_DYNAMIC_RENDERING_LOCAL_READ PFN_vkCmdSetRenderingInputAttachmentIndicesKHR graphics_pass::vkCmdSetRenderingInputAttachmentIndicesKHR;
    Device Core14 PFN_vkCmdSetLineStippleKHR graphics_state::vkCmdSetLineStippleKHR as vkCmdSetLineStipple;
    Device KHR_LINE_RASTERIZATION PFN_vkCmdSetLineStippleKHR graphics_state::vkCmdSetLineStippleKHR;
    Device EXT_LINE_RASTERIZATION PFN_vkCmdSetLineStippleKHR graphics_state::vkCmdSetLineStippleKHR as vkCmdSetLineStippleEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE | EXT_SHADER_OBJECT PFN_vkCmdSetCullMode graphics_state::vkCmdSetCullMode as vkCmdSetCullModeEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE | EXT_SHADER_OBJECT PFN_vkCmdSetFrontFace graphics_state::vkCmdSetFrontFace as vkCmdSetFrontFaceEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE | EXT_SHADER_OBJECT PFN_vkCmdSetPrimitiveTopology graphics_state::vkCmdSetPrimitiveTopology as vkCmdSetPrimitiveTopologyEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE | EXT_SHADER_OBJECT PFN_vkCmdSetViewportWithCount graphics_state::vkCmdSetViewportWithCount as vkCmdSetViewportWithCountEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE | EXT_SHADER_OBJECT PFN_vkCmdSetScissorWithCount graphics_state::vkCmdSetScissorWithCount as vkCmdSetScissorWithCountEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE | EXT_SHADER_OBJECT PFN_vkCmdBindVertexBuffers2 graphics_draw::vkCmdBindVertexBuffers2 as vkCmdBindVertexBuffers2EXT;
    Device EXT_EXTENDED_DYNAMIC_STATE | EXT_SHADER_OBJECT PFN_vkCmdSetDepthTestEnable graphics_state::vkCmdSetDepthTestEnable as vkCmdSetDepthTestEnableEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE | EXT_SHADER_OBJECT PFN_vkCmdSetDepthWriteEnable graphics_state::vkCmdSetDepthWriteEnable as vkCmdSetDepthWriteEnableEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE | EXT_SHADER_OBJECT PFN_vkCmdSetDepthCompareOp graphics_state::vkCmdSetDepthCompareOp as vkCmdSetDepthCompareOpEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE | EXT_SHADER_OBJECT PFN_vkCmdSetDepthBoundsTestEnable graphics_state::vkCmdSetDepthBoundsTestEnable as vkCmdSetDepthBoundsTestEnableEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE | EXT_SHADER_OBJECT PFN_vkCmdSetStencilTestEnable graphics_state::vkCmdSetStencilTestEnable as vkCmdSetStencilTestEnableEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE | EXT_SHADER_OBJECT PFN_vkCmdSetStencilOp graphics_state::vkCmdSetStencilOp as vkCmdSetStencilOpEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_2 | EXT_SHADER_OBJECT PFN_vkCmdSetRasterizerDiscardEnable graphics_state::vkCmdSetRasterizerDiscardEnable as vkCmdSetRasterizerDiscardEnableEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_2 | EXT_SHADER_OBJECT PFN_vkCmdSetDepthBiasEnable graphics_state::vkCmdSetDepthBiasEnable as vkCmdSetDepthBiasEnableEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_2 | EXT_SHADER_OBJECT PFN_vkCmdSetPrimitiveRestartEnable graphics_state::vkCmdSetPrimitiveRestartEnable as vkCmdSetPrimitiveRestartEnableEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_2 | EXT_SHADER_OBJECT PFN_vkCmdSetLogicOpEXT graphics_state::vkCmdSetLogicOpEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_2 | EXT_SHADER_OBJECT PFN_vkCmdSetPatchControlPointsEXT graphics_state::vkCmdSetPatchControlPointsEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetTessellationDomainOriginEXT graphics_state::vkCmdSetTessellationDomainOriginEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetDepthClampEnableEXT graphics_state::vkCmdSetDepthClampEnableEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetPolygonModeEXT graphics_state::vkCmdSetPolygonModeEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetRasterizationSamplesEXT graphics_state::vkCmdSetRasterizationSamplesEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetSampleMaskEXT graphics_state::vkCmdSetSampleMaskEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetSampleLocationsEnableEXT graphics_state::vkCmdSetSampleLocationsEnableEXT;
    Device EXT_DEPTH_CLAMP_CONTROL | EXT_SHADER_OBJECT PFN_vkCmdSetDepthClampRangeEXT graphics_state::vkCmdSetDepthClampRangeEXT;
    Device KHR_FRAGMENT_SHADING_RATE PFN_vkCmdSetFragmentShadingRateKHR graphics_state::vkCmdSetFragmentShadingRateKHR;
    Device EXT_SAMPLE_LOCATIONS PFN_vkCmdSetSampleLocationsEXT graphics_state::vkCmdSetSampleLocationsEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetAlphaToCoverageEnableEXT graphics_state::vkCmdSetAlphaToCoverageEnableEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetAlphaToOneEnableEXT graphics_state::vkCmdSetAlphaToOneEnableEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetLogicOpEnableEXT graphics_state::vkCmdSetLogicOpEnableEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetColorBlendEnableEXT graphics_state::vkCmdSetColorBlendEnableEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetColorBlendEquationEXT graphics_state::vkCmdSetColorBlendEquationEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetColorBlendAdvancedEXT graphics_state::vkCmdSetColorBlendAdvancedEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetColorWriteMaskEXT graphics_state::vkCmdSetColorWriteMaskEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetDepthClipEnableEXT graphics_state::vkCmdSetDepthClipEnableEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetProvokingVertexModeEXT graphics_state::vkCmdSetProvokingVertexModeEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetLineRasterizationModeEXT graphics_state::vkCmdSetLineRasterizationModeEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetLineStippleEnableEXT graphics_state::vkCmdSetLineStippleEnableEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetDepthClipNegativeOneToOneEXT graphics_state::vkCmdSetDepthClipNegativeOneToOneEXT;
    Device EXT_VERTEX_INPUT_DYNAMIC_STATE | EXT_SHADER_OBJECT PFN_vkCmdSetVertexInputEXT graphics_state::vkCmdSetVertexInputEXT;
    Device EXT_COLOR_WRITE_ENABLE PFN_vkCmdSetColorWriteEnableEXT graphics_state::vkCmdSetColorWriteEnableEXT;
    Device EXT_DEPTH_BIAS_CONTROL PFN_vkCmdSetDepthBias2EXT graphics_state::vkCmdSetDepthBias2EXT;
    Device EXT_TRANSFORM_FEEDBACK PFN_vkCmdBeginQueryIndexedEXT transform_feedback::vkCmdBeginQueryIndexedEXT;
    Device EXT_TRANSFORM_FEEDBACK PFN_vkCmdBeginTransformFeedbackEXT transform_feedback::vkCmdBeginTransformFeedbackEXT;
    Device EXT_TRANSFORM_FEEDBACK PFN_vkCmdBindTransformFeedbackBuffersEXT transform_feedback::vkCmdBindTransformFeedbackBuffersEXT;
    Device EXT_TRANSFORM_FEEDBACK PFN_vkCmdDrawIndirectByteCountEXT transform_feedback::vkCmdDrawIndirectByteCountEXT;
    Device EXT_TRANSFORM_FEEDBACK PFN_vkCmdEndQueryIndexedEXT transform_feedback::vkCmdEndQueryIndexedEXT;
    Device EXT_TRANSFORM_FEEDBACK PFN_vkCmdEndTransformFeedbackEXT transform_feedback::vkCmdEndTransformFeedbackEXT;
    Device EXT_EXTENDED_DYNAMIC_STATE_3 | EXT_SHADER_OBJECT PFN_vkCmdSetRasterizationStreamEXT graphics_state::vkCmdSetRasterizationStreamEXT;
    Device EXT_CONDITIONAL_RENDERING PFN_vkCmdBeginConditionalRenderingEXT graphics_draw::vkCmdBeginConditionalRenderingEXT;
    Device EXT_CONDITIONAL_RENDERING PFN_vkCmdEndConditionalRenderingEXT graphics_draw::vkCmdEndConditionalRenderingEXT;
    Device EXT_ATTACHMENT_FEEDBACK_LOOP_DYNAMIC_STATE PFN_vkCmdSetAttachmentFeedbackLoopEnableEXT graphics_state::vkCmdSetAttachmentFeedbackLoopEnableEXT;
    Device EXT_MESH_SHADER PFN_vkCmdDrawMeshTasksEXT graphics_draw::vkCmdDrawMeshTasksEXT;
    Device EXT_MESH_SHADER PFN_vkCmdDrawMeshTasksIndirectEXT graphics_draw::vkCmdDrawMeshTasksIndirectEXT;
    Device EXT_MESH_SHADER PFN_vkCmdDrawMeshTasksIndirectCountEXT graphics_draw::vkCmdDrawMeshTasksIndirectCountEXT;
    Device EXT_MULTI_DRAW PFN_vkCmdDrawMultiEXT graphics_draw::vkCmdDrawMultiEXT;
    Device EXT_MULTI_DRAW PFN_vkCmdDrawMultiIndexedEXT graphics_draw::vkCmdDrawMultiIndexedEXT;

    Device EXT_SHADER_OBJECT PFN_vkCreateShadersEXT shader_object::vkCreateShadersEXT;
    Device EXT_SHADER_OBJECT PFN_vkDestroyShaderEXT shader_object::vkDestroyShaderEXT;
    Device EXT_SHADER_OBJECT PFN_vkGetShaderBinaryDataEXT shader_object::vkGetShaderBinaryDataEXT;
    Device EXT_SHADER_OBJECT PFN_vkCmdBindShadersEXT shader_object::vkCmdBindShadersEXT;
    Device Core14 PFN_vkCmdBindDescriptorSets2KHR command::vkCmdBindDescriptorSets2KHR as vkCmdBindDescriptorSets2;
    Device KHR_MAINTENANCE_6 PFN_vkCmdBindDescriptorSets2KHR command::vkCmdBindDescriptorSets2KHR;
    Device Core14 PFN_vkCmdPushConstants2KHR command::vkCmdPushConstants2KHR as vkCmdPushConstants2;
    Device KHR_MAINTENANCE_6 PFN_vkCmdPushConstants2KHR command::vkCmdPushConstants2KHR;
    Device Core14 PFN_vkCmdPushDescriptorSet2KHR push_descriptor::vkCmdPushDescriptorSet2KHR as vkCmdPushDescriptorSet2;
    Device KHR_MAINTENANCE_6 PFN_vkCmdPushDescriptorSet2KHR push_descriptor::vkCmdPushDescriptorSet2KHR;
    Device Core14 PFN_vkCmdPushDescriptorSetWithTemplate2KHR push_descriptor::vkCmdPushDescriptorSetWithTemplate2KHR as vkCmdPushDescriptorSetWithTemplate2;
    Device KHR_MAINTENANCE_6 PFN_vkCmdPushDescriptorSetWithTemplate2KHR push_descriptor::vkCmdPushDescriptorSetWithTemplate2KHR;
    Device KHR_MAINTENANCE_6 PFN_vkCmdSetDescriptorBufferOffsets2EXT descriptor_buffer::vkCmdSetDescriptorBufferOffsets2EXT;
    Device KHR_MAINTENANCE_6 PFN_vkCmdBindDescriptorBufferEmbeddedSamplers2EXT descriptor_buffer::vkCmdBindDescriptorBufferEmbeddedSamplers2EXT;

    Instance EXT_HEADLESS_SURFACE PFN_vkCreateHeadlessSurfaceEXT surface::vkCreateHeadlessSurfaceEXT;
    Instance KHR_SURFACE PFN_vkDestroySurfaceKHR surface::vkDestroySurfaceKHR;
    PhysicalDevice KHR_SWAPCHAIN PFN_vkGetPhysicalDevicePresentRectanglesKHR surface::vkGetPhysicalDevicePresentRectanglesKHR;
    PhysicalDevice KHR_SURFACE PFN_vkGetPhysicalDeviceSurfaceCapabilitiesKHR surface::vkGetPhysicalDeviceSurfaceCapabilitiesKHR;
    PhysicalDevice KHR_GET_SURFACE_CAPABILITIES_2 PFN_vkGetPhysicalDeviceSurfaceCapabilities2KHR surface::vkGetPhysicalDeviceSurfaceCapabilities2KHR;
    PhysicalDevice KHR_SURFACE PFN_vkGetPhysicalDeviceSurfaceFormatsKHR surface::vkGetPhysicalDeviceSurfaceFormatsKHR;
    PhysicalDevice KHR_GET_SURFACE_CAPABILITIES_2 PFN_vkGetPhysicalDeviceSurfaceFormats2KHR surface::vkGetPhysicalDeviceSurfaceFormats2KHR;
    PhysicalDevice KHR_SURFACE PFN_vkGetPhysicalDeviceSurfacePresentModesKHR surface::vkGetPhysicalDeviceSurfacePresentModesKHR;
    PhysicalDevice KHR_SURFACE PFN_vkGetPhysicalDeviceSurfaceSupportKHR surface::vkGetPhysicalDeviceSurfaceSupportKHR;

    Device KHR_SWAPCHAIN PFN_vkAcquireNextImage2KHR swapchain::vkAcquireNextImage2KHR;
    Device KHR_SWAPCHAIN PFN_vkAcquireNextImageKHR swapchain::vkAcquireNextImageKHR;
    Device EXT_HDR_METADATA PFN_vkSetHdrMetadataEXT swapchain::vkSetHdrMetadataEXT;
    Device KHR_SWAPCHAIN PFN_vkCreateSwapchainKHR swapchain::vkCreateSwapchainKHR;
    Device KHR_SWAPCHAIN PFN_vkDestroySwapchainKHR swapchain::vkDestroySwapchainKHR;
    Device KHR_SWAPCHAIN PFN_vkGetDeviceGroupPresentCapabilitiesKHR swapchain::vkGetDeviceGroupPresentCapabilitiesKHR;
    Device KHR_SWAPCHAIN PFN_vkGetDeviceGroupSurfacePresentModesKHR swapchain::vkGetDeviceGroupSurfacePresentModesKHR;
    Device EXT_PRESENT_TIMING PFN_vkGetPastPresentationTimingEXT present_timing::vkGetPastPresentationTimingEXT;
    Device KHR_SWAPCHAIN PFN_vkGetSwapchainImagesKHR swapchain::vkGetSwapchainImagesKHR;
    Device KHR_SHARED_PRESENTABLE_IMAGE PFN_vkGetSwapchainStatusKHR swapchain::vkGetSwapchainStatusKHR;
    Device EXT_PRESENT_TIMING PFN_vkGetSwapchainTimeDomainPropertiesEXT present_timing::vkGetSwapchainTimeDomainPropertiesEXT;
    Device EXT_PRESENT_TIMING PFN_vkGetSwapchainTimingPropertiesEXT present_timing::vkGetSwapchainTimingPropertiesEXT;
    Device KHR_SWAPCHAIN PFN_vkQueuePresentKHR swapchain::vkQueuePresentKHR;
    Device EXT_SWAPCHAIN_MAINTENANCE_1 PFN_vkReleaseSwapchainImagesEXT swapchain::vkReleaseSwapchainImagesEXT;
    Device KHR_SWAPCHAIN_MAINTENANCE_1 PFN_vkReleaseSwapchainImagesEXT swapchain::vkReleaseSwapchainImagesEXT as vkReleaseSwapchainImagesKHR;
    Device EXT_PRESENT_TIMING PFN_vkSetSwapchainPresentTimingQueueSizeEXT present_timing::vkSetSwapchainPresentTimingQueueSizeEXT;
    Device KHR_PRESENT_WAIT PFN_vkWaitForPresentKHR swapchain::vkWaitForPresentKHR;
    Device KHR_PRESENT_WAIT_2 PFN_vkWaitForPresent2KHR swapchain::vkWaitForPresent2KHR;

    Device EXT_DEBUG_UTILS PFN_vkSetDebugUtilsObjectNameEXT debug::vkSetDebugUtilsObjectNameEXT;
    Device EXT_DEBUG_UTILS PFN_vkSetDebugUtilsObjectTagEXT debug::vkSetDebugUtilsObjectTagEXT;

    Device KHR_DEFERRED_HOST_OPERATIONS PFN_vkCreateDeferredOperationKHR deferred::vkCreateDeferredOperationKHR;
    Device KHR_DEFERRED_HOST_OPERATIONS PFN_vkDeferredOperationJoinKHR deferred::vkDeferredOperationJoinKHR;
    Device KHR_DEFERRED_HOST_OPERATIONS PFN_vkDestroyDeferredOperationKHR deferred::vkDestroyDeferredOperationKHR;
    Device KHR_DEFERRED_HOST_OPERATIONS PFN_vkGetDeferredOperationMaxConcurrencyKHR deferred::vkGetDeferredOperationMaxConcurrencyKHR;
    Device KHR_DEFERRED_HOST_OPERATIONS PFN_vkGetDeferredOperationResultKHR deferred::vkGetDeferredOperationResultKHR;
}
