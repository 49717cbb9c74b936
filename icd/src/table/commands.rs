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
