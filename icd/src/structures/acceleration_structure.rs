//! Copying and serializing acceleration structures: from addresses in recorded commands to the `traversal` crate.
//!
//! Host and device commands end here alike, since a device address is a host address.

use ash::vk;
use spirv_jit::reach::Reach;
use traversal::Structure;

use crate::command::build::CopyMode;
use crate::object::acceleration_structure::Storage;
use crate::table::limits;
use crate::wave::reachable::{bytes, writable};

/// The bytes in use of the structure at an address, or `None` where none was built.
///
/// # Safety
/// A structure at the address is unchanged for `'a`.
pub(super) unsafe fn structure_bytes<'a>(reach: &Reach, address: u64) -> Option<&'a [u8]> {
    // SAFETY: the caller's promise.
    unsafe {
        let size_bytes = structure_at(reach, address)?.size_bytes();
        Some(bytes(reach, address, size_bytes)).filter(|bytes| !bytes.is_empty())
    }
}

/// The structure at an address, or `None` where none was built.
///
/// # Safety
/// As [`structure_bytes`].
unsafe fn structure_at(reach: &Reach, address: u64) -> Option<Structure> {
    if !reach.contains(address, Structure::HEADER_BYTES) {
        return None;
    }
    // SAFETY: there is memory, and the caller's promise.
    unsafe { Structure::at(address) }
}

/// `VkCopyAccelerationStructureInfoKHR`.
///
/// # Safety
/// Both are the memory of acceleration structure objects; the source is built and not written meanwhile, the destination not used elsewhere.
pub unsafe fn copy(source: Storage, destination: Storage, mode: CopyMode, reach: &Reach) {
    // SAFETY: the caller's promise.
    unsafe {
        let Some(source) = structure_bytes(reach, source.address) else {
            return;
        };
        let destination = writable(reach, destination.address, destination.size_bytes);
        let done = match mode {
            CopyMode::Clone => traversal::copy_into(source, destination),
            CopyMode::Compact => traversal::compact_into(source, destination),
        };
        report(done.map(drop), "copy");
    }
}

/// Identifiers at the head of serialized data: the driver's, then the format's.
pub type Uuids = [[u8; 16]; 2];

/// `VkCopyAccelerationStructureToMemoryInfoKHR`.
///
/// # Safety
/// As [`copy`], and `destination` is writable for the serialized size.
pub unsafe fn serialize(source: Storage, destination: u64, uuids: &Uuids, reach: &Reach) {
    // SAFETY: the caller's promise.
    unsafe {
        let Some(source) = structure_bytes(reach, source.address) else {
            return;
        };
        let Ok(size_bytes) = traversal::serialized_size(source) else {
            return;
        };
        report(
            traversal::serialize(source, uuids, writable(reach, destination, size_bytes)).map(drop),
            "serialization",
        );
    }
}

/// `VkCopyMemoryToAccelerationStructureInfoKHR`.
///
/// # Safety
/// As [`copy`], and `source` holds what [`serialize`] wrote.
pub unsafe fn deserialize(source: u64, destination: Storage, reach: &Reach) {
    // SAFETY: the caller's promise; the head says how long the rest is.
    unsafe {
        let head = bytes(reach, source, traversal::Serialized::HEAD_BYTES as u64);
        let Ok(head) = traversal::Serialized::read(head) else {
            return;
        };
        let data = bytes(reach, source, head.serialized_bytes);
        let destination = writable(reach, destination.address, destination.size_bytes);
        report(
            traversal::deserialize(data, destination).map(drop),
            "deserialization",
        );
    }
}

/// A failed transfer leaves the destination undefined, and a line in the log.
fn report(result: Result<(), traversal::StructureError>, what: &str) {
    if let Err(error) = result {
        crate::log::write(
            crate::log::Level::Error,
            &format!("acceleration structure {what}: {error:?}"),
        );
    }
}

/// A property that `vkCmdWriteAccelerationStructuresPropertiesKHR` writes.
///
/// # Safety
/// `address` is the memory of an acceleration structure object that is built.
pub unsafe fn property(address: u64, query_type: vk::QueryType, reach: &Reach) -> u64 {
    // SAFETY: the caller's promise.
    unsafe {
        let Some(structure) = structure_at(reach, address) else {
            return 0;
        };
        let bytes = structure_bytes(reach, address).unwrap_or(&[]);
        match query_type {
            vk::QueryType::ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR
            | vk::QueryType::ACCELERATION_STRUCTURE_COMPACTED_SIZE_NV => {
                traversal::compacted_size(bytes).unwrap_or(0)
            }
            vk::QueryType::ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR => {
                traversal::serialized_size(bytes).unwrap_or(0)
            }
            vk::QueryType::ACCELERATION_STRUCTURE_SERIALIZATION_BOTTOM_LEVEL_POINTERS_KHR => {
                structure.reference_count()
            }
            // `ACCELERATION_STRUCTURE_SIZE_KHR`: what the structure takes, wherever it is put.
            _ => structure.size_bytes(),
        }
    }
}

/// `vkGetDeviceAccelerationStructureCompatibilityKHR`: whether serialized data can be deserialized here.
///
/// # Safety
/// `data` points to the two identifiers at the head of serialized data.
pub unsafe fn compatibility(data: *const u8) -> vk::AccelerationStructureCompatibilityKHR {
    // SAFETY: the caller's promise.
    let uuids = unsafe { std::ptr::read_unaligned(data.cast::<Uuids>()) };
    if uuids == limits::serialization_uuids() {
        vk::AccelerationStructureCompatibilityKHR::COMPATIBLE
    } else {
        vk::AccelerationStructureCompatibilityKHR::INCOMPATIBLE
    }
}
