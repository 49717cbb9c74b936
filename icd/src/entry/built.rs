//! Copies and property queries, which acceleration structures and micromaps share.

use std::ffi::c_void;

use ash::vk;
use spirv_jit::reach::Reach;
use traversal::Live;

use super::deferred::defer;
use crate::VkResult;
use crate::command::structures::{Built, BuiltCopy};
use crate::command::{Command, Recording, StructureCommand};
use crate::device::Device;
use crate::handle::{from_handle, retain};
use crate::object::QueryPool;
use crate::{ffi, structures};

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
        let in_blocks = from_handle::<Device>(device)
            .engine
            .options
            .serializes_blocks;
        defer(operation, 1, move || {
            structures::copy(built, what, in_blocks, &Reach::everywhere(), &live);
            Ok(())
        })
    }
}

/// Writes a property of each object to the application's memory.
///
/// # Safety
/// The device is alive, the addresses are those of built objects, and `data` has `data_bytes`.
pub unsafe fn write_properties(
    device: vk::Device,
    of: Built,
    addresses: impl Iterator<Item = u64>,
    query_type: vk::QueryType,
    (data, data_bytes, stride_bytes): (*mut c_void, usize, usize),
) -> VkResult {
    // SAFETY: the caller guarantees that the device is alive, the addresses are those of built
    // objects, and `data` has `data_bytes`.
    unsafe {
        let live = live(device);
        let values = addresses.map(|it| structures::property(of, it, query_type, &live));
        ffi::write_strided(values, data, data_bytes, stride_bytes)
    }
}

/// Records a write of properties to queries.
///
/// # Safety
/// The query pool is alive.
pub unsafe fn record_properties(
    commands: &mut Recording,
    of: Built,
    addresses: impl Iterator<Item = u64>,
    query_type: vk::QueryType,
    (pool, first): (vk::QueryPool, u32),
) -> VkResult {
    commands.push(Command::Structure(StructureCommand::WriteProperties {
        of,
        addresses: addresses.collect(),
        query_type,
        // SAFETY: the caller guarantees that the query pool is alive.
        pool: unsafe { retain::<QueryPool>(pool) },
        first,
    }))
}

/// Records a copy.
pub fn record_copy(commands: &mut Recording, of: Built, copy: BuiltCopy) -> VkResult {
    commands.push(Command::Structure(StructureCommand::Copy(of, copy)))
}
