//! Commands by name, and the loader's interface (Khronos "LoaderDriverInterface"): the three
//! symbols that the shared library exports.

use std::collections::HashMap;
use std::ffi::c_char;
use std::sync::OnceLock;

use ash::vk;

use super::row::command_table;
pub use super::row::{Availability, Command, Level};
use super::{commands, system};
use crate::device::Device;
use crate::guard::{catch_panic_messages, code, guard};
use crate::object::Instance;
use crate::os::library::keep_loaded;
use crate::{ffi, handle, logger};

/// Supported interface versions.
const OLDEST: u32 = 2;
const NEWEST: u32 = 7;

/// Negotiates the interface version: the loader's, up to the driver's.
///
/// # Safety
/// `version` is valid.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn vk_icdNegotiateLoaderICDInterfaceVersion(
    version: *mut u32,
) -> vk::Result {
    code(guard("vk_icdNegotiateLoaderICDInterfaceVersion", || {
        // SAFETY: the loader passes a valid pointer.
        let version = unsafe { &mut *version };
        if *version < OLDEST {
            return Err(vk::Result::ERROR_INCOMPATIBLE_DRIVER);
        }
        *version = NEWEST.min(*version);
        keep_loaded();
        logger::start();
        catch_panic_messages();
        Ok(())
    }))
}

/// Entry points by name: only global ones without an instance.
///
/// # Safety
/// `instance` is null or alive; `name` is a C string.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn vk_icdGetInstanceProcAddr(
    instance: vk::Instance,
    name: *const c_char,
) -> vk::PFN_vkVoidFunction {
    guard("vk_icdGetInstanceProcAddr", || {
        // SAFETY: the loader's promise.
        let (instance, name) =
            unsafe { (handle::optional::<Instance>(instance), ffi::string(name)) };
        if let Some(function) = loader_function(name.to_bytes()) {
            return Some(function);
        }
        let mut found = rows(name.to_bytes());
        let command = found.find(|command| match instance {
            None => command.level == Level::Global,
            Some(instance) => command.available_to_instance(instance.extensions),
        });
        Some(command?.function)
    })
}

/// Entry points whose first argument is a physical device; null for all else.
///
/// # Safety
/// `instance` is null or alive; `name` is a C string.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn vk_icdGetPhysicalDeviceProcAddr(
    instance: vk::Instance,
    name: *const c_char,
) -> vk::PFN_vkVoidFunction {
    guard("vk_icdGetPhysicalDeviceProcAddr", || {
        // SAFETY: the loader's promise.
        let (instance, name) =
            unsafe { (handle::optional::<Instance>(instance), ffi::string(name)) };
        let mut found = rows(name.to_bytes());
        let available = |command: &&Command| {
            command.level == Level::PhysicalDevice
                && instance.is_none_or(|it| command.available_to_instance(it.extensions))
        };
        Some(found.find(available)?.function)
    })
}

pub(crate) unsafe extern "system" fn vkGetInstanceProcAddr(
    instance: vk::Instance,
    name: *const c_char,
) -> vk::PFN_vkVoidFunction {
    guard("vkGetInstanceProcAddr", move || {
        vk_icdGetInstanceProcAddr(instance, name)
    })
}

pub(crate) unsafe extern "system" fn vkGetDeviceProcAddr(
    device: vk::Device,
    name: *const c_char,
) -> vk::PFN_vkVoidFunction {
    guard("vkGetDeviceProcAddr", move || {
        let device = handle::from_handle::<Device>(device);
        let mut found = rows(ffi::string(name).to_bytes());
        let command =
            found.find(|it| it.available_to_device(device.api_version, device.extensions));
        Some(command?.function)
    })
}

command_table! {
    Instance Core PFN_vkGetInstanceProcAddr self::vkGetInstanceProcAddr;
    Device Core PFN_vkGetDeviceProcAddr self::vkGetDeviceProcAddr;
}

/// The rows of a name: several if several extensions add the command.
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

/// All rows, with those of this operating system.
pub fn table() -> &'static [Command] {
    static TABLE: OnceLock<Vec<Command>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let mut rows = Vec::new();
        commands::add_rows(&mut rows);
        system::add_rows(&mut rows);
        add_rows(&mut rows);
        rows
    })
}

/// The functions of the loader interface, which version 7 also looks up by name.
fn loader_function(name: &[u8]) -> vk::PFN_vkVoidFunction {
    // SAFETY: `PFN_vkVoidFunction` is the generic type of such pointers; callers cast them back.
    unsafe {
        match name {
            b"vk_icdNegotiateLoaderICDInterfaceVersion" => {
                Some(std::mem::transmute::<
                    unsafe extern "system" fn(*mut u32) -> vk::Result,
                    unsafe extern "system" fn(),
                >(vk_icdNegotiateLoaderICDInterfaceVersion))
            }
            b"vk_icdGetPhysicalDeviceProcAddr" => Some(std::mem::transmute::<
                unsafe extern "system" fn(vk::Instance, *const c_char) -> vk::PFN_vkVoidFunction,
                unsafe extern "system" fn(),
            >(
                vk_icdGetPhysicalDeviceProcAddr
            )),
            b"vk_icdGetInstanceProcAddr" => Some(std::mem::transmute::<
                unsafe extern "system" fn(vk::Instance, *const c_char) -> vk::PFN_vkVoidFunction,
                unsafe extern "system" fn(),
            >(vk_icdGetInstanceProcAddr)),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_negotiated() {
        for (asked, answer) in [
            (2, Some(2)),
            (5, Some(5)),
            (7, Some(7)),
            (9, Some(7)),
            (1, None),
        ] {
            let mut version = asked;
            // SAFETY: a valid pointer.
            let result = unsafe { vk_icdNegotiateLoaderICDInterfaceVersion(&mut version) };
            assert_eq!((result == vk::Result::SUCCESS).then_some(version), answer);
        }
    }

    #[test]
    fn only_global_commands_without_an_instance() {
        let find = |name: &std::ffi::CStr| {
            // SAFETY: a C string and no instance.
            unsafe { vk_icdGetInstanceProcAddr(vk::Instance::null(), name.as_ptr()) }.is_some()
        };
        assert!(find(c"vkCreateInstance"));
        assert!(!find(c"vkCreateDevice"));
        assert!(!find(c"vkNoSuchCommand"));
    }
}
