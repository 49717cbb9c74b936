//! Copies and property queries, which acceleration structures and micromaps share.

use ash::vk;
use spirv_jit::reach::Reach;
use traversal::Live;

use super::deferred::defer;
use crate::VkResult;
use crate::command::ray_tracing::{Built, BuiltCopy};
use crate::device::Device;
use crate::handle::from_handle;
use crate::structures;

/// Whether serialized data can be deserialized: the identifiers at its head must be those that this
/// driver writes.
pub fn compatibility_of(
    head: &[u8; 2 * vk::UUID_SIZE],
    ours: [[u8; vk::UUID_SIZE]; 2],
) -> vk::AccelerationStructureCompatibilityKHR {
    if *head == *ours.as_flattened() {
        vk::AccelerationStructureCompatibilityKHR::COMPATIBLE
    } else {
        vk::AccelerationStructureCompatibilityKHR::INCOMPATIBLE
    }
}

/// The live memory of a device's structures and micromaps.
///
/// # Safety
/// The handle is that of a device.
pub unsafe fn live(device: vk::Device) -> Live {
    // SAFETY: the caller guarantees that the handle is that of a device.
    unsafe { from_handle::<Device>(device) }
        .engine
        .memory
        .structures()
}

/// Performs copies on the host.
///
/// # Errors
/// As [`defer`].
///
/// # Safety
/// The handles are alive, and as [`structures::copy`].
pub unsafe fn copy(
    device: vk::Device,
    operation: vk::DeferredOperationKHR,
    built: Built,
    what: BuiltCopy,
) -> VkResult {
    // SAFETY: the caller guarantees that the handles are alive, and as [`structures::copy`].
    unsafe {
        let live = live(device);
        let in_blocks = from_handle::<Device>(device).engine.serializes_blocks;
        defer(operation, 1, move || {
            structures::copy(built, what, in_blocks, &Reach::everywhere(), &live);
            Ok(())
        })
    }
}

/// Defines entry points on the host and on the device: those that write properties, and those of
/// each copy, which the expression decodes.
macro_rules! built {
    (
        $of:ident, $handle:ident at $storage:ident, $write:ident, $cmd_write:ident;
        $($copy:ident, $cmd_copy:ident, $info:ident: |$it:ident| $what:expr;)*
    ) => {
        entry! {
            fn $write(
                device: vk::Device,
                count: u32,
                handles: *const vk::$handle,
                query_type: vk::QueryType,
                data_bytes: usize,
                data: *mut std::ffi::c_void,
                stride_bytes: usize,
            ) -> vk::Result {
                let live = $crate::entry::built::live(device);
                let values = slice(handles, count).iter().map(|&handle| {
                    $crate::structures::property(Built::$of, $storage(handle).address, query_type, &live)
                });
                $crate::ffi::write_strided(values, data, data_bytes, stride_bytes)
            }

            $(fn $copy(
                device: vk::Device,
                operation: vk::DeferredOperationKHR,
                info: *const vk::$info<'_>,
            ) -> vk::Result {
                let $it = &*info;
                $crate::entry::built::copy(device, operation, Built::$of, $what)
            })*
        }

        commands! {
            fn $cmd_write(
                commands,
                count: u32,
                handles: *const vk::$handle,
                query_type: vk::QueryType,
                pool: vk::QueryPool,
                first: u32,
            ) {
                let addresses = slice(handles, count).iter().map(|&handle| $storage(handle).address);
                commands.push(Command::RayTracing(RayTracingCommand::WriteProperties {
                    of: Built::$of,
                    addresses: addresses.collect(),
                    query_type,
                    pool: retain::<$crate::object::QueryPool>(pool),
                    first,
                }))
            }

            $(fn $cmd_copy(commands, info: *const vk::$info<'_>) {
                let $it = &*info;
                commands.push(Command::RayTracing(RayTracingCommand::Copy(Built::$of, $what)))
            })*
        }
    };
}
pub(super) use built;
