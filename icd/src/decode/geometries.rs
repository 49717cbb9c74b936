//! Geometries of builds, of structures and of micromaps, and the structures that builds name.

use crate::ffi::vk;
use crate::handle;
use crate::object::AccelerationStructure;
use crate::object::acceleration_structure::Storage;

/// The geometries of a build info, through whichever of its two arrays is set.
///
/// # Safety
/// The info's arrays have `geometryCount` elements.
pub unsafe fn geometries<'a>(
    info: &vk::AccelerationStructureBuildGeometryInfoKHR<'a>,
) -> Vec<&'a vk::AccelerationStructureGeometryKHR<'a>> {
    let count = info.geometry_count as usize;
    // SAFETY: the caller guarantees that the info's arrays have `geometryCount` elements; exactly
    // one of the arrays is not null
    // (VUID-VkAccelerationStructureBuildGeometryInfoKHR-pGeometries-03788).
    unsafe {
        if count == 0 {
            Vec::new()
        } else if !info.p_geometries.is_null() {
            std::slice::from_raw_parts(info.p_geometries, count)
                .iter()
                .collect()
        } else if !info.pp_geometries.is_null() {
            std::slice::from_raw_parts(info.pp_geometries, count)
                .iter()
                .map(|&geometry| &*geometry)
                .collect()
        } else {
            Vec::new()
        }
    }
}

/// The memory of an acceleration structure.
///
/// # Safety
/// The handle is alive.
pub unsafe fn storage(handle: vk::AccelerationStructureKHR) -> Storage {
    // SAFETY: the caller guarantees that the handle is alive.
    unsafe { handle::from_handle::<AccelerationStructure>(handle) }.storage()
}
