//! The table of commands: from it come `vkGetInstanceProcAddr` and `vkGetDeviceProcAddr`.

use std::collections::HashMap;
use std::sync::OnceLock;

use ash::vk;

use super::extensions::{Extension, ExtensionSet, Kind};

/// What a command's first argument belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    Global,
    Instance,
    PhysicalDevice,
    /// Devices, queues and command buffers.
    Device,
}

/// What makes a command available.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Availability {
    Core,
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
    /// Whether `vkGetInstanceProcAddr` gives it: instance extensions must be enabled, device extensions advertised.
    pub fn available_to_instance(&self, enabled: ExtensionSet) -> bool {
        match self.availability {
            Availability::Core => true,
            Availability::Extension(extension) => {
                extension.kind() == Kind::Device || enabled.contains(extension)
            }
        }
    }

    /// Whether `vkGetDeviceProcAddr` gives it.
    pub fn available_to_device(&self, enabled: ExtensionSet) -> bool {
        self.level == Level::Device
            && match self.availability {
                Availability::Core => true,
                Availability::Extension(extension) => {
                    // Device-level commands of instance extensions (debug utils) come with the instance.
                    extension.kind() == Kind::Instance || enabled.contains(extension)
                }
            }
    }
}

/// The row of a name.
pub fn find(name: &[u8]) -> Option<&'static Command> {
    static INDEX: OnceLock<HashMap<&'static [u8], &'static Command>> = OnceLock::new();
    let table = table();
    INDEX
        .get_or_init(|| {
            table
                .iter()
                .map(|command| (command.name.as_bytes(), command))
                .collect()
        })
        .get(name)
        .copied()
}

/// The name a row goes by: its alias, or its function's.
macro_rules! command_name {
    ($name:ident) => {
        stringify!($name)
    };
    ($name:ident $alias:ident) => {
        stringify!($alias)
    };
}

/// A row is `Level Availability PFN_type module::function [as alias];`. That the function has the PFN's type is checked by the compiler.
macro_rules! commands {
    ($($level:ident $extension:ident $pfn:ident $module:ident::$name:ident $(as $alias:ident)?;)*) => {
        fn table() -> &'static [Command] {
            static TABLE: OnceLock<Vec<Command>> = OnceLock::new();
            TABLE.get_or_init(|| vec![$({
                let function: vk::$pfn = crate::entry::$module::$name;
                Command {
                    name: command_name!($name $($alias)?),
                    level: Level::$level,
                    availability: commands!(@availability $extension),
                    // SAFETY: `PFN_vkVoidFunction` is the type that such pointers are passed around as; callers cast back.
                    function: unsafe { std::mem::transmute::<vk::$pfn, unsafe extern "system" fn()>(function) },
                }
            },)*])
        }
    };
    (@availability Core) => { Availability::Core };
    (@availability $extension:ident) => { Availability::Extension(Extension::$extension) };
}

commands! {
    Global Core PFN_vkCreateInstance instance::vkCreateInstance;
    Global Core PFN_vkEnumerateInstanceExtensionProperties instance::vkEnumerateInstanceExtensionProperties;
    Global Core PFN_vkEnumerateInstanceVersion instance::vkEnumerateInstanceVersion;
    Global Core PFN_vkEnumerateInstanceLayerProperties instance::vkEnumerateInstanceLayerProperties;
    Instance Core PFN_vkDestroyInstance instance::vkDestroyInstance;
    Instance Core PFN_vkGetInstanceProcAddr instance::vkGetInstanceProcAddr;
    Instance Core PFN_vkEnumeratePhysicalDevices instance::vkEnumeratePhysicalDevices;
    Instance Core PFN_vkEnumeratePhysicalDeviceGroups instance::vkEnumeratePhysicalDeviceGroups;
    Instance KHR_DEVICE_GROUP_CREATION PFN_vkEnumeratePhysicalDeviceGroups instance::vkEnumeratePhysicalDeviceGroups as vkEnumeratePhysicalDeviceGroupsKHR;
    Device Core PFN_vkGetDeviceQueue queue::vkGetDeviceQueue;
    Device Core PFN_vkGetDeviceQueue2 queue::vkGetDeviceQueue2;
    Device Core PFN_vkQueueSubmit queue::vkQueueSubmit;
    Device Core PFN_vkQueueSubmit2 queue::vkQueueSubmit2;
    Device KHR_SYNCHRONIZATION_2 PFN_vkQueueSubmit2 queue::vkQueueSubmit2 as vkQueueSubmit2KHR;
    Device Core PFN_vkQueueBindSparse queue::vkQueueBindSparse;
    Device Core PFN_vkQueueWaitIdle queue::vkQueueWaitIdle;
    Device Core PFN_vkDeviceWaitIdle queue::vkDeviceWaitIdle;
    Device EXT_DEBUG_UTILS PFN_vkQueueBeginDebugUtilsLabelEXT queue::vkQueueBeginDebugUtilsLabelEXT;
    Device EXT_DEBUG_UTILS PFN_vkQueueEndDebugUtilsLabelEXT queue::vkQueueEndDebugUtilsLabelEXT;
    Device EXT_DEBUG_UTILS PFN_vkQueueInsertDebugUtilsLabelEXT queue::vkQueueInsertDebugUtilsLabelEXT;
    Device Core PFN_vkCreateFence sync::vkCreateFence;
    Device Core PFN_vkDestroyFence sync::vkDestroyFence;
    Device Core PFN_vkResetFences sync::vkResetFences;
    Device Core PFN_vkGetFenceStatus sync::vkGetFenceStatus;
    Device Core PFN_vkWaitForFences sync::vkWaitForFences;
    Device Core PFN_vkCreateSemaphore sync::vkCreateSemaphore;
    Device Core PFN_vkDestroySemaphore sync::vkDestroySemaphore;
    Device Core PFN_vkGetSemaphoreCounterValue sync::vkGetSemaphoreCounterValue;
    Device Core PFN_vkSignalSemaphore sync::vkSignalSemaphore;
    Device Core PFN_vkWaitSemaphores sync::vkWaitSemaphores;
    Device KHR_TIMELINE_SEMAPHORE PFN_vkGetSemaphoreCounterValue sync::vkGetSemaphoreCounterValue as vkGetSemaphoreCounterValueKHR;
    Device KHR_TIMELINE_SEMAPHORE PFN_vkSignalSemaphore sync::vkSignalSemaphore as vkSignalSemaphoreKHR;
    Device KHR_TIMELINE_SEMAPHORE PFN_vkWaitSemaphores sync::vkWaitSemaphores as vkWaitSemaphoresKHR;
    Device Core PFN_vkCreateEvent sync::vkCreateEvent;
    Device Core PFN_vkDestroyEvent sync::vkDestroyEvent;
    Device Core PFN_vkGetEventStatus sync::vkGetEventStatus;
    Device Core PFN_vkSetEvent sync::vkSetEvent;
    Device Core PFN_vkResetEvent sync::vkResetEvent;
    Device Core PFN_vkCreateQueryPool query::vkCreateQueryPool;
    Device Core PFN_vkDestroyQueryPool query::vkDestroyQueryPool;
    Device Core PFN_vkResetQueryPool query::vkResetQueryPool;
    Device EXT_HOST_QUERY_RESET PFN_vkResetQueryPool query::vkResetQueryPool as vkResetQueryPoolEXT;
    Device Core PFN_vkGetQueryPoolResults query::vkGetQueryPoolResults;
    Device Core PFN_vkCmdResetQueryPool query::vkCmdResetQueryPool;
    Device Core PFN_vkCmdWriteTimestamp query::vkCmdWriteTimestamp;
    Device Core PFN_vkCmdWriteTimestamp2 query::vkCmdWriteTimestamp2;
    Device KHR_SYNCHRONIZATION_2 PFN_vkCmdWriteTimestamp2 query::vkCmdWriteTimestamp2 as vkCmdWriteTimestamp2KHR;
    Device Core PFN_vkCmdCopyQueryPoolResults query::vkCmdCopyQueryPoolResults;
    Device Core PFN_vkCreateCommandPool command::vkCreateCommandPool;
    Device Core PFN_vkDestroyCommandPool command::vkDestroyCommandPool;
    Device Core PFN_vkResetCommandPool command::vkResetCommandPool;
    Device Core PFN_vkTrimCommandPool command::vkTrimCommandPool;
    Device KHR_MAINTENANCE_1 PFN_vkTrimCommandPool command::vkTrimCommandPool as vkTrimCommandPoolKHR;
    Device Core PFN_vkAllocateCommandBuffers command::vkAllocateCommandBuffers;
    Device Core PFN_vkFreeCommandBuffers command::vkFreeCommandBuffers;
    Device Core PFN_vkBeginCommandBuffer command::vkBeginCommandBuffer;
    Device Core PFN_vkEndCommandBuffer command::vkEndCommandBuffer;
    Device Core PFN_vkResetCommandBuffer command::vkResetCommandBuffer;
    Device Core PFN_vkCmdBindPipeline command::vkCmdBindPipeline;
    Device Core PFN_vkCmdBindDescriptorSets command::vkCmdBindDescriptorSets;
    Device Core PFN_vkCmdPushConstants command::vkCmdPushConstants;
    Device Core PFN_vkCmdDispatch command::vkCmdDispatch;
    Device Core PFN_vkCmdDispatchBase command::vkCmdDispatchBase;
    Device KHR_DEVICE_GROUP PFN_vkCmdDispatchBase command::vkCmdDispatchBase as vkCmdDispatchBaseKHR;
    Device Core PFN_vkCmdDispatchIndirect command::vkCmdDispatchIndirect;
    Device Core PFN_vkCmdExecuteCommands command::vkCmdExecuteCommands;
    Device Core PFN_vkCmdSetDeviceMask command::vkCmdSetDeviceMask;
    Device KHR_DEVICE_GROUP PFN_vkCmdSetDeviceMask command::vkCmdSetDeviceMask as vkCmdSetDeviceMaskKHR;
    Device Core PFN_vkCmdPipelineBarrier command::vkCmdPipelineBarrier;
    Device Core PFN_vkCmdPipelineBarrier2 command::vkCmdPipelineBarrier2;
    Device Core PFN_vkCmdSetEvent command::vkCmdSetEvent;
    Device Core PFN_vkCmdSetEvent2 command::vkCmdSetEvent2;
    Device Core PFN_vkCmdResetEvent command::vkCmdResetEvent;
    Device Core PFN_vkCmdResetEvent2 command::vkCmdResetEvent2;
    Device Core PFN_vkCmdWaitEvents command::vkCmdWaitEvents;
    Device Core PFN_vkCmdWaitEvents2 command::vkCmdWaitEvents2;
    Device KHR_SYNCHRONIZATION_2 PFN_vkCmdPipelineBarrier2 command::vkCmdPipelineBarrier2 as vkCmdPipelineBarrier2KHR;
    Device KHR_SYNCHRONIZATION_2 PFN_vkCmdSetEvent2 command::vkCmdSetEvent2 as vkCmdSetEvent2KHR;
    Device KHR_SYNCHRONIZATION_2 PFN_vkCmdResetEvent2 command::vkCmdResetEvent2 as vkCmdResetEvent2KHR;
    Device KHR_SYNCHRONIZATION_2 PFN_vkCmdWaitEvents2 command::vkCmdWaitEvents2 as vkCmdWaitEvents2KHR;
    Device EXT_DEBUG_UTILS PFN_vkCmdBeginDebugUtilsLabelEXT command::vkCmdBeginDebugUtilsLabelEXT;
    Device EXT_DEBUG_UTILS PFN_vkCmdEndDebugUtilsLabelEXT command::vkCmdEndDebugUtilsLabelEXT;
    Device EXT_DEBUG_UTILS PFN_vkCmdInsertDebugUtilsLabelEXT command::vkCmdInsertDebugUtilsLabelEXT;
    Device Core PFN_vkCmdCopyBuffer command_transfer::vkCmdCopyBuffer;
    Device Core PFN_vkCmdCopyBuffer2 command_transfer::vkCmdCopyBuffer2;
    Device KHR_COPY_COMMANDS_2 PFN_vkCmdCopyBuffer2 command_transfer::vkCmdCopyBuffer2 as vkCmdCopyBuffer2KHR;
    Device Core PFN_vkCmdFillBuffer command_transfer::vkCmdFillBuffer;
    Device Core PFN_vkCmdUpdateBuffer command_transfer::vkCmdUpdateBuffer;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCreateAccelerationStructureKHR acceleration_structure::vkCreateAccelerationStructureKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkDestroyAccelerationStructureKHR acceleration_structure::vkDestroyAccelerationStructureKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkGetAccelerationStructureDeviceAddressKHR acceleration_structure::vkGetAccelerationStructureDeviceAddressKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkGetAccelerationStructureBuildSizesKHR acceleration_structure::vkGetAccelerationStructureBuildSizesKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkGetDeviceAccelerationStructureCompatibilityKHR acceleration_structure::vkGetDeviceAccelerationStructureCompatibilityKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkBuildAccelerationStructuresKHR acceleration_structure::vkBuildAccelerationStructuresKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCopyAccelerationStructureKHR acceleration_structure::vkCopyAccelerationStructureKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCopyAccelerationStructureToMemoryKHR acceleration_structure::vkCopyAccelerationStructureToMemoryKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCopyMemoryToAccelerationStructureKHR acceleration_structure::vkCopyMemoryToAccelerationStructureKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkWriteAccelerationStructuresPropertiesKHR acceleration_structure::vkWriteAccelerationStructuresPropertiesKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCmdBuildAccelerationStructuresKHR acceleration_structure::vkCmdBuildAccelerationStructuresKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCmdBuildAccelerationStructuresIndirectKHR acceleration_structure::vkCmdBuildAccelerationStructuresIndirectKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCmdCopyAccelerationStructureKHR acceleration_structure::vkCmdCopyAccelerationStructureKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCmdCopyAccelerationStructureToMemoryKHR acceleration_structure::vkCmdCopyAccelerationStructureToMemoryKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCmdCopyMemoryToAccelerationStructureKHR acceleration_structure::vkCmdCopyMemoryToAccelerationStructureKHR;
    Device KHR_ACCELERATION_STRUCTURE PFN_vkCmdWriteAccelerationStructuresPropertiesKHR acceleration_structure::vkCmdWriteAccelerationStructuresPropertiesKHR;
    Device KHR_RAY_TRACING_PIPELINE PFN_vkCreateRayTracingPipelinesKHR ray_tracing::vkCreateRayTracingPipelinesKHR;
    Device KHR_RAY_TRACING_PIPELINE PFN_vkGetRayTracingShaderGroupHandlesKHR ray_tracing::vkGetRayTracingShaderGroupHandlesKHR;
    Device KHR_RAY_TRACING_PIPELINE PFN_vkGetRayTracingCaptureReplayShaderGroupHandlesKHR ray_tracing::vkGetRayTracingCaptureReplayShaderGroupHandlesKHR;
    Device KHR_RAY_TRACING_PIPELINE PFN_vkGetRayTracingShaderGroupStackSizeKHR ray_tracing::vkGetRayTracingShaderGroupStackSizeKHR;
    Device KHR_RAY_TRACING_PIPELINE PFN_vkCmdTraceRaysKHR ray_tracing::vkCmdTraceRaysKHR;
    Device KHR_RAY_TRACING_PIPELINE PFN_vkCmdTraceRaysIndirectKHR ray_tracing::vkCmdTraceRaysIndirectKHR;
    Device KHR_RAY_TRACING_PIPELINE PFN_vkCmdSetRayTracingPipelineStackSizeKHR ray_tracing::vkCmdSetRayTracingPipelineStackSizeKHR;
}
