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
            Availability::Extension(extension) => extension.kind() == Kind::Device || enabled.contains(extension),
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
        .get_or_init(|| table.iter().map(|command| (command.name.as_bytes(), command)).collect())
        .get(name)
        .copied()
}
