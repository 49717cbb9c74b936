//! A row of the table of commands, and the macro that writes rows.

use crate::capabilities::extensions::{Extension, ExtensionSet, Kind};

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
    /// Whether `vkGetInstanceProcAddr` returns it: instance extensions must be enabled.
    pub fn available_to_instance(&self, enabled: ExtensionSet) -> bool {
        match self.availability {
            Availability::Core(_) => true,
            Availability::Extension(extension) => match extension.kind() {
                Kind::Device => true,
                Kind::Instance => enabled.contains(extension),
            },
        }
    }

    /// Whether `vkGetDeviceProcAddr` returns it to an application of a Vulkan version. `enabled`
    /// has the extensions of the device and of its instance.
    pub fn available_to_device(&self, version: u32, enabled: ExtensionSet) -> bool {
        self.level == Level::Device
            && match self.availability {
                Availability::Core(since) => since <= version,
                Availability::Extension(extension) => enabled.contains(extension),
            }
    }
}

/// A row is `Level Availability [| Availability]* PFN_type module::function [as alias];`. The
/// compiler checks that the function has the PFN's type.
macro_rules! command_table {
    ($($level:ident $($extension:ident)|+ $pfn:ident $module:ident::$name:ident $(as $alias:ident)?;)*) => {
        /// Adds the rows, one for each availability.
        #[allow(unused_variables)]
        pub fn add_rows(rows: &mut Vec<$crate::entry::row::Command>) {
            $({
                let function: vk::$pfn = $module::$name;
                // SAFETY: `PFN_vkVoidFunction` is the generic type of such pointers; callers cast
                // them back.
                let function = unsafe { std::mem::transmute::<vk::$pfn, unsafe extern "system" fn()>(function) };
                let name = command_table!(@name $name $($alias)?);
                let level = $crate::entry::row::Level::$level;
                let availabilities = [$(command_table!(@availability $extension)),+];
                rows.extend(availabilities.map(|availability| {
                    $crate::entry::row::Command { name, level, availability, function }
                }));
            })*
        }
    };
    (@name $name:ident) => { stringify!($name) };
    (@name $name:ident $alias:ident) => { stringify!($alias) };
    (@availability Core) => { $crate::entry::row::Availability::Core($crate::ffi::vk::API_VERSION_1_0) };
    (@availability Core11) => { $crate::entry::row::Availability::Core($crate::ffi::vk::API_VERSION_1_1) };
    (@availability Core12) => { $crate::entry::row::Availability::Core($crate::ffi::vk::API_VERSION_1_2) };
    (@availability Core13) => { $crate::entry::row::Availability::Core($crate::ffi::vk::API_VERSION_1_3) };
    (@availability Core14) => { $crate::entry::row::Availability::Core($crate::ffi::vk::API_VERSION_1_4) };
    (@availability $extension:ident) => {
        $crate::entry::row::Availability::Extension(
            $crate::capabilities::extensions::Extension::$extension,
        )
    };
}

pub(super) use command_table;
