//! Building and moving micromaps: from addresses in recorded commands to the `traversal` crate.
//! Host and device commands use the same functions.

use ash::vk;
use rayon::prelude::*;
use spirv_jit::reach::Reach;
use traversal::transfer::Uuids;
use traversal::{BuildError, Live, Micromap, MicromapFormat, MicromapInput};

use super::acceleration_structure::{report, storage_bytes};
use crate::command::micromap::MicromapBuild;
use crate::object::acceleration_structure::Storage;
use crate::validate::Checks;
use crate::wave::reachable::{around, read, readable, writable};

/// The largest data of a micromap: offsets have 32 bits, and the longest states of a triangle
/// follow the last.
const MAX_DATA_BYTES: u64 =
    (1 << 32) + MicromapFormat::FourStates.triangle_bytes(traversal::micromap::MAX_LEVEL);

/// The identifiers at the head of serialized data.
const HEAD_BYTES: u64 = 32;

/// The reported scratch size. Scratch memory is not used, but an application may create a buffer of
/// this size, which cannot be 0.
pub const SCRATCH_BYTES: u64 = 64;

impl MicromapBuild {
    /// # Safety
    /// Every address is readable or writable as the valid usage of `vkCmdBuildMicromapsEXT`
    /// requires, and nothing else writes it during the call.
    unsafe fn execute(&self, reach: &Reach, live: &Live) -> Result<u64, BuildError> {
        let count = self.count();
        let last = u64::from(count.saturating_sub(1)).saturating_mul(self.stride_bytes);
        let input = MicromapInput {
            triangles: readable(
                reach,
                self.triangles,
                last.saturating_add(size_of::<vk::MicromapTriangleEXT>() as u64),
            ),
            stride_bytes: self.stride_bytes,
            count,
            data: readable(reach, self.data, MAX_DATA_BYTES),
        };
        // SAFETY: the caller guarantees that every address is readable or writable as the valid
        // usage of `vkCmdBuildMicromapsEXT` requires, and nothing else writes it during the call.
        unsafe { traversal::build_micromap(&input, storage_bytes(live, self.destination)) }
    }
}

/// Performs builds in parallel: the specification forbids that builds of one command depend on each
/// other.
///
/// # Safety
/// The valid usage of `vkCmdBuildMicromapsEXT` holds.
pub unsafe fn build(builds: &[MicromapBuild], reach: &Reach, live: &Live, checks: Option<&Checks>) {
    builds.par_iter().for_each(|build| {
        if let Some(checks) = checks {
            // SAFETY: the caller guarantees that the valid usage of `vkCmdBuildMicromapsEXT` holds.
            unsafe { checks.micromap(build, reach) };
        }
        // SAFETY: the caller guarantees that the valid usage of `vkCmdBuildMicromapsEXT` holds.
        report(unsafe { build.execute(reach, live) }, "micromap build");
    });
}

/// Whether there is a micromap at an address.
///
/// # Safety
/// `live` is there during the call.
pub unsafe fn is_at(live: &Live, address: u64) -> bool {
    // SAFETY: the caller guarantees that `live` is there during the call.
    unsafe { Micromap::at(address, live) }.is_some()
}

/// Whether serialized data is that of a micromap. Data of acceleration structures has its size at
/// the same offset.
///
/// # Safety
/// Nothing writes the memory in `reach` during the call.
pub unsafe fn is_serialized_at(reach: &Reach, address: u64) -> bool {
    let address = address.wrapping_add(HEAD_BYTES);
    // SAFETY: the caller guarantees that nothing writes the memory in `reach` during the call.
    unsafe { read::<u64>(reach, address) == Some(traversal::micromap::MAGIC) }
}

/// The used bytes of the micromap at an address; `None` if none was built there.
///
/// # Safety
/// A micromap at the address is unchanged for `'a`.
unsafe fn bytes<'a>(live: &Live, address: u64) -> Option<&'a [u8]> {
    // SAFETY: a micromap that is found ends in live memory, and the caller keeps it unchanged.
    unsafe { Some(Micromap::at(address, live)?.bytes()) }
}

/// `VkCopyMicromapInfoEXT`. A built micromap is compact already, so both modes do the same.
///
/// # Safety
/// Both are the memory of micromap objects. The source is built and not written during the call;
/// the destination is not used elsewhere.
pub unsafe fn copy(source: Storage, destination: Storage, live: &Live) {
    // SAFETY: the caller guarantees that both are the memory of micromap objects.
    unsafe {
        let Some(source) = bytes(live, source.address) else {
            return;
        };
        let copied = traversal::copy_micromap(source, storage_bytes(live, destination));
        report(copied, "micromap copy");
    }
}

/// `VkCopyMicromapToMemoryInfoEXT`: the identifiers, then the micromap.
///
/// # Safety
/// As [`copy`], and `destination`, which lies in `reach`, is writable for the serialized size.
pub unsafe fn serialize(
    source: Storage,
    uuids: &Uuids,
    destination: u64,
    reach: &Reach,
    live: &Live,
) {
    // SAFETY: the caller keeps the promises of `copy`, and guarantees that `destination`, which
    // lies in `reach`, is writable for the serialized size.
    unsafe {
        let Some(source) = bytes(live, source.address) else {
            return;
        };
        let out = writable(reach, destination, HEAD_BYTES + source.len() as u64);
        let Some((head, body)) = out.split_at_mut_checked(HEAD_BYTES as usize) else {
            return;
        };
        head.copy_from_slice(uuids.as_flattened());
        body.copy_from_slice(source);
    }
}

/// `VkCopyMemoryToMicromapInfoEXT`.
///
/// # Safety
/// As [`copy`], and `source`, which lies in `reach`, is as long as the micromap's header says.
pub unsafe fn deserialize(source: u64, destination: Storage, reach: &Reach, live: &Live) {
    // SAFETY: reachable memory exists, and the caller keeps the source readable.
    unsafe {
        let source = source.wrapping_add(HEAD_BYTES);
        let Some(source) = bytes(&around(reach, source), source) else {
            log::error!("micromap deserialization: not a micromap");
            return;
        };
        let copied = traversal::copy_micromap(source, storage_bytes(live, destination));
        report(copied, "micromap deserialization");
    }
}

/// A property that `vkCmdWriteMicromapsPropertiesEXT` writes.
///
/// # Safety
/// `address` is the memory of a micromap object that is built.
pub unsafe fn property(address: u64, query_type: vk::QueryType, live: &Live) -> u64 {
    // SAFETY: the caller guarantees that `address` is the memory of a micromap object that is
    // built.
    let size_bytes = unsafe { bytes(live, address) }.map_or(0, |bytes| bytes.len() as u64);
    match query_type {
        vk::QueryType::MICROMAP_SERIALIZATION_SIZE_EXT
        | vk::QueryType::ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR => size_bytes + HEAD_BYTES,
        _ => size_bytes,
    }
}
