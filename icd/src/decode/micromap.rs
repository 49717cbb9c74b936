//! `VkMicromapBuildInfoEXT` to an owned [`MicromapBuild`], and micromaps of geometries.

use ash::vk;
use traversal::{GeometryMicromap, IndexType, MicromapFormat, MicromapUsage};

use super::index_type::index_type;
use crate::command::micromap::MicromapBuild;
use crate::ffi::{find, slice};
use crate::handle;
use crate::object::Micromap;
use crate::object::acceleration_structure::Storage;

/// Where a micromap lies.
///
/// # Safety
/// The handle is alive.
pub unsafe fn storage(handle: vk::MicromapEXT) -> Storage {
    // SAFETY: the caller's promise.
    unsafe { handle::from_handle::<Micromap>(handle) }.storage()
}

/// The usage counts of a build, through whichever of its two arrays is set. Formats that there are
/// not are left out.
///
/// # Safety
/// The info's arrays have `usageCountsCount` elements.
pub unsafe fn usages(info: &vk::MicromapBuildInfoEXT<'_>) -> Vec<MicromapUsage> {
    let count = info.usage_counts_count;
    let usage = |usage: &vk::MicromapUsageEXT| {
        Some(MicromapUsage {
            count: usage.count,
            level: usage.subdivision_level,
            format: MicromapFormat::of(usage.format)?,
        })
    };
    // SAFETY: the caller's promise; at most one of the arrays is not null
    // (VUID-VkMicromapBuildInfoEXT-pUsageCounts-07516).
    unsafe {
        if info.p_usage_counts.is_null() && !info.pp_usage_counts.is_null() {
            let pointers = slice(info.pp_usage_counts, count);
            pointers.iter().filter_map(|&one| usage(&*one)).collect()
        } else {
            let usages = slice(info.p_usage_counts, count);
            usages.iter().filter_map(usage).collect()
        }
    }
}

/// Copies a build.
///
/// # Safety
/// The info is valid and its handle is alive.
pub unsafe fn decode_build(info: &vk::MicromapBuildInfoEXT<'_>) -> MicromapBuild {
    // SAFETY: the caller's promise; both members of an address union are 64 bits.
    unsafe {
        MicromapBuild {
            destination: storage(info.dst_micromap),
            data: info.data.device_address,
            triangles: info.triangle_array.device_address,
            stride_bytes: info.triangle_array_stride,
            usages: usages(info),
        }
    }
}

/// The micromap of a geometry, for its range's triangles.
///
/// # Safety
/// `next` is the chain of a valid `VkAccelerationStructureGeometryTrianglesDataKHR` whose handles
/// are alive.
pub unsafe fn of_geometry(next: *const std::ffi::c_void) -> Option<GeometryMicromap> {
    // SAFETY: the caller's promise; both members of an address union are 64 bits.
    unsafe {
        let info = find::<vk::AccelerationStructureTrianglesOpacityMicromapEXT<'_>>(next)?;
        let index_type = index_type(info.index_type);
        let indices = match index_type {
            IndexType::None => 0,
            _ => info.index_buffer.device_address,
        };
        let micromap = match info.micromap == vk::MicromapEXT::null() {
            true => 0,
            false => storage(info.micromap).address,
        };
        Some(GeometryMicromap {
            index_type,
            // The range says for how many triangles.
            indices: traversal::Memory {
                base: indices as *const u8,
                bytes: 0,
            },
            index_stride_bytes: info.index_stride,
            base_triangle: info.base_triangle,
            micromap,
        })
    }
}
