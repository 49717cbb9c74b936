//! Copying and serializing acceleration structures: from addresses in recorded commands to the
//! `traversal` crate.
//!
//! Host and device commands use the same functions, since a device address is a host address.

use ash::vk;
use spirv_jit::reach::Reach;
use traversal::{Live, Structure};

use crate::capabilities::limits;
use crate::capture;
use crate::command::structures::CopyMode;
use crate::object::acceleration_structure::Storage;
use crate::wave::reachable::{bytes, writable};

/// The used bytes of the structure at an address; `None` if none was built there.
///
/// # Safety
/// A structure at the address is unchanged for `'a`.
pub(super) unsafe fn structure_bytes<'a>(live: &Live, address: u64) -> Option<&'a [u8]> {
    // SAFETY: a structure that is found ends in live memory, and the caller keeps it unchanged.
    unsafe {
        let size_bytes = Structure::at(address, live)?.size_bytes();
        Some(std::slice::from_raw_parts(
            address as *const u8,
            size_bytes as usize,
        ))
    }
}

/// The memory of an object; empty if it is not live.
///
/// # Safety
/// The memory is used by nothing else for `'a`.
pub(super) unsafe fn storage_bytes<'a>(live: &Live, storage: Storage) -> &'a mut [u8] {
    let Storage {
        address,
        size_bytes,
    } = storage;
    if size_bytes == 0 || !live.contains(address, size_bytes) {
        return &mut [];
    }
    // SAFETY: the range is live memory, which the caller keeps from other uses.
    unsafe { std::slice::from_raw_parts_mut(address as *mut u8, size_bytes as usize) }
}

/// `VkCopyAccelerationStructureInfoKHR`.
///
/// # Safety
/// Both are the memory of acceleration structure objects. The source is built and not written
/// during the call; the destination is not used elsewhere.
pub unsafe fn copy(source: Storage, destination: Storage, mode: CopyMode, live: &Live) {
    capture::note_copy(Some(source.address), destination.address);
    // SAFETY: the caller passes the memory of built structures and keeps other uses away.
    unsafe {
        let Some(source) = structure_bytes(live, source.address) else {
            return;
        };
        let destination = storage_bytes(live, destination);
        let done = match mode {
            CopyMode::Clone => traversal::copy_into(source, destination),
            CopyMode::Compact => traversal::compact_into(source, destination),
        };
        report(done, "acceleration structure copy");
    }
}

/// `VkCopyAccelerationStructureToMemoryInfoKHR`; `in_blocks` as in [`traversal::serialize`].
///
/// # Safety
/// As [`copy`], and `destination`, which lies in `reach`, is writable for the serialized size.
pub unsafe fn serialize(
    source: Storage,
    destination: u64,
    in_blocks: bool,
    reach: &Reach,
    live: &Live,
) {
    // SAFETY: the caller passes the memory of built structures and keeps other uses away.
    unsafe {
        let Some(source) = structure_bytes(live, source.address) else {
            return;
        };
        let Ok(size_bytes) = traversal::serialized_size(source, live) else {
            return;
        };
        let destination = writable(reach, destination, size_bytes);
        let uuids = limits::serialization_uuids();
        let done = traversal::serialize(source, &uuids, in_blocks, destination, live);
        report(done, "acceleration structure serialization");
    }
}

/// `VkCopyMemoryToAccelerationStructureInfoKHR`.
///
/// # Safety
/// As [`copy`], and `source`, which lies in `reach`, is as long as its head says.
pub unsafe fn deserialize(source: u64, destination: Storage, reach: &Reach, live: &Live) {
    capture::note_copy(None, destination.address);
    // SAFETY: the caller keeps the source readable for the size that its head says.
    unsafe {
        let head = bytes(reach, source, traversal::Serialized::HEAD_BYTES as u64);
        let Ok(head) = traversal::Serialized::read(head) else {
            return;
        };
        let data = bytes(reach, source, head.serialized_bytes);
        let destination = storage_bytes(live, destination);
        let done = traversal::deserialize(data, destination, live);
        report(done, "acceleration structure deserialization");
    }
}

/// Logs a failure. The destination is undefined then.
pub(super) fn report<T, E: std::fmt::Display>(result: Result<T, E>, what: &str) {
    if let Err(error) = result {
        log::error!("{what}: {error}");
    }
}

/// A property that `vkCmdWriteAccelerationStructuresPropertiesKHR` writes.
///
/// # Safety
/// `address` is the memory of an acceleration structure object that is built.
pub unsafe fn property(address: u64, query_type: vk::QueryType, live: &Live) -> u64 {
    // SAFETY: the caller passes the memory of built structures and keeps other uses away.
    unsafe {
        let Some(structure) = Structure::at(address, live) else {
            return 0;
        };
        let bytes = structure_bytes(live, address).unwrap_or(&[]);
        match query_type {
            vk::QueryType::ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR
            | vk::QueryType::ACCELERATION_STRUCTURE_COMPACTED_SIZE_NV => {
                traversal::compacted_size(bytes).unwrap_or(0)
            }
            vk::QueryType::ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR => {
                traversal::serialized_size(bytes, live).unwrap_or(0)
            }
            vk::QueryType::ACCELERATION_STRUCTURE_SERIALIZATION_BOTTOM_LEVEL_POINTERS_KHR => {
                structure.reference_count()
            }
            // `ACCELERATION_STRUCTURE_SIZE_KHR`: the structure's size, independent of its location.
            _ => structure.size_bytes(),
        }
    }
}
