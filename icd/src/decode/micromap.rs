//! `VkMicromapBuildInfoEXT`, and builds of structures that are micromaps, to an owned
//! [`MicromapBuild`]; micromaps of geometries.

use traversal::{GeometryMicromap, IndexType, MicromapFormat, MicromapUsage};

use super::geometries::{self, geometries};
use super::index_type::index_type;
use crate::command::micromap::MicromapBuild;
use crate::ffi::{find, slice, vk};
use crate::handle;
use crate::object::Micromap;
use crate::object::acceleration_structure::Storage;

/// The memory of a micromap.
///
/// # Safety
/// The handle is alive.
pub unsafe fn storage(handle: vk::MicromapEXT) -> Storage {
    // SAFETY: the caller guarantees that the handle is alive.
    unsafe { handle::from_handle::<Micromap>(handle) }.storage()
}

/// The usage counts of a build, from the array that is set. Unknown formats are left out.
///
/// # Safety
/// The set array has `count` elements.
unsafe fn read_usages(
    count: u32,
    usages: *const vk::MicromapUsageEXT,
    pointers: *const *const vk::MicromapUsageEXT,
) -> Vec<MicromapUsage> {
    let usage = |usage: &vk::MicromapUsageEXT| {
        Some(MicromapUsage {
            count: usage.count,
            level: usage.subdivision_level,
            format: MicromapFormat::of(usage.format)?,
        })
    };
    // SAFETY: the caller guarantees that the array has so many elements; at most one of the arrays
    // is not null (VUID-VkMicromapBuildInfoEXT-pUsageCounts-07516).
    unsafe {
        if usages.is_null() && !pointers.is_null() {
            let pointers = slice(pointers, count);
            pointers.iter().filter_map(|&one| usage(&*one)).collect()
        } else {
            slice(usages, count).iter().filter_map(usage).collect()
        }
    }
}

/// The usage counts of a build.
///
/// # Safety
/// The info's arrays have `usageCountsCount` elements.
pub unsafe fn usages(info: &vk::MicromapBuildInfoEXT<'_>) -> Vec<MicromapUsage> {
    // SAFETY: the caller guarantees that the info's arrays have `usageCountsCount` elements.
    unsafe {
        read_usages(
            info.usage_counts_count,
            info.p_usage_counts,
            info.pp_usage_counts,
        )
    }
}

/// Whether a build is one of a micromap.
///
/// # Safety
/// The info is valid.
pub unsafe fn is_micromap(info: &vk::AccelerationStructureBuildGeometryInfoKHR<'_>) -> bool {
    // SAFETY: the caller guarantees that the info is valid.
    let geometries = unsafe { geometries(info) };
    info.ty == vk::ACCELERATION_STRUCTURE_TYPE_OPACITY_MICROMAP_KHR
        || (geometries.iter()).any(|it| it.geometry_type == vk::GEOMETRY_TYPE_MICROMAP_KHR)
}

/// The micromap data of a structure's build, if it is one; without triangles if they are missing.
///
/// # Safety
/// The info is valid; its handles are not used.
unsafe fn data_of(
    info: &vk::AccelerationStructureBuildGeometryInfoKHR<'_>,
) -> Option<vk::AccelerationStructureGeometryMicromapDataKHR<'static>> {
    type Data = vk::AccelerationStructureGeometryMicromapDataKHR<'static>;
    // SAFETY: the caller guarantees that the info is valid; its handles are not looked at.
    unsafe {
        if !is_micromap(info) {
            return None;
        }
        let geometries = geometries(info);
        let data = (geometries.first()).and_then(|geometry| find::<Data>(geometry.p_next));
        Some(data.copied().unwrap_or_default())
    }
}

/// The usage counts of a structure's build, if it is a micromap's.
///
/// # Safety
/// The info is valid; its handles are not used.
pub unsafe fn structure_usages(
    info: &vk::AccelerationStructureBuildGeometryInfoKHR<'_>,
) -> Option<Vec<MicromapUsage>> {
    // SAFETY: the caller guarantees that the info is valid; its handles are not looked at.
    unsafe {
        let data = data_of(info)?;
        Some(read_usages(
            data.usage_counts_count,
            data.p_usage_counts,
            data.pp_usage_counts,
        ))
    }
}

/// Copies a structure's build, if it is a micromap's.
///
/// # Safety
/// The info is valid and its handles are alive.
pub unsafe fn decode_structure(
    info: &vk::AccelerationStructureBuildGeometryInfoKHR<'_>,
) -> Option<MicromapBuild> {
    // SAFETY: the caller guarantees that the info is valid and its handles are alive.
    unsafe {
        let data = data_of(info)?;
        Some(MicromapBuild {
            destination: geometries::storage(info.dst_acceleration_structure),
            data: data.data,
            triangles: data.triangle_array,
            stride_bytes: data.triangle_array_stride,
            usages: structure_usages(info)?,
        })
    }
}

/// Copies a build.
///
/// # Safety
/// The info is valid and its handle is alive.
pub unsafe fn decode_build(info: &vk::MicromapBuildInfoEXT<'_>) -> MicromapBuild {
    // SAFETY: the caller guarantees that the info is valid and its handle is alive; both members of
    // an address union are 64 bits.
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
    // SAFETY: the caller guarantees that `next` is the chain of a valid
    // `VkAccelerationStructureGeometryTrianglesDataKHR` whose handles are alive; both members of an
    // address union are 64 bits.
    unsafe {
        let ext = find::<vk::AccelerationStructureTrianglesOpacityMicromapEXT<'_>>(next);
        let khr = find::<vk::AccelerationStructureTrianglesOpacityMicromapKHR<'_>>(next);
        let (ty, indices, stride, base_triangle, micromap) = match (khr, ext) {
            (Some(it), _) => (
                it.index_type,
                it.index_buffer,
                it.index_stride,
                it.base_triangle,
                (it.micromap != vk::AccelerationStructureKHR::null())
                    .then(|| geometries::storage(it.micromap)),
            ),
            (None, Some(it)) => (
                it.index_type,
                it.index_buffer.device_address,
                it.index_stride,
                it.base_triangle,
                (it.micromap != vk::MicromapEXT::null()).then(|| storage(it.micromap)),
            ),
            (None, None) => return None,
        };
        let index_type = index_type(ty);
        let indices = match index_type {
            IndexType::None => 0,
            _ => indices,
        };
        Some(GeometryMicromap {
            index_type,
            // The range decides the number of triangles.
            indices: traversal::Memory {
                base: indices as *const u8,
                bytes: 0,
            },
            index_stride_bytes: stride,
            base_triangle,
            micromap: micromap.map_or(0, |storage| storage.address),
            listed: khr.is_some(),
        })
    }
}
