//! `VkAccelerationStructureBuildGeometryInfoKHR` to an owned [`Build`].

use ash::vk;
use traversal::{BuildFlags, GeometryFlags, IndexType, InstanceArray, VertexFormat};

use crate::execute::acceleration_structure::{
    Aabbs, Build, BuildGeometries, Instances, Storage, Triangles, vertex_format,
};
use crate::handle;
use crate::object::AccelerationStructure;

/// The geometries of a build info, through whichever of its two arrays is set.
///
/// # Safety
/// The info's arrays have `geometryCount` elements.
pub unsafe fn geometries<'a>(
    info: &vk::AccelerationStructureBuildGeometryInfoKHR<'a>,
) -> Vec<&'a vk::AccelerationStructureGeometryKHR<'a>> {
    let count = info.geometry_count as usize;
    // SAFETY: the caller's promise; exactly one of the arrays is not null (VUID-VkAccelerationStructureBuildGeometryInfoKHR-pGeometries-03788).
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

/// What a structure of these geometries holds; an empty one is of triangles, or of instances if it is a top level.
pub fn kind(
    ty: vk::AccelerationStructureTypeKHR,
    geometries: &[&vk::AccelerationStructureGeometryKHR<'_>],
) -> traversal::Kind {
    match geometries.first().map(|geometry| geometry.geometry_type) {
        Some(vk::GeometryTypeKHR::INSTANCES) => traversal::Kind::Instances,
        Some(vk::GeometryTypeKHR::AABBS) => traversal::Kind::Aabbs,
        Some(_) => traversal::Kind::Triangles,
        None if ty == vk::AccelerationStructureTypeKHR::TOP_LEVEL => traversal::Kind::Instances,
        None => traversal::Kind::Triangles,
    }
}

/// Copies a build and its ranges. Addresses are taken from the `deviceAddress` of each union, which has the bits of `hostAddress`.
///
/// # Safety
/// The info is valid, its handles are alive, and there are as many ranges as geometries.
pub unsafe fn decode_build(
    info: &vk::AccelerationStructureBuildGeometryInfoKHR<'_>,
    ranges: &[vk::AccelerationStructureBuildRangeInfoKHR],
) -> Build {
    // SAFETY: the caller's promise.
    unsafe {
        let geometries = geometries(info);
        let kind = kind(info.ty, &geometries);
        let pairs = geometries.iter().copied().zip(ranges);
        let update = info.mode == vk::BuildAccelerationStructureModeKHR::UPDATE;
        Build {
            flags: BuildFlags(info.flags.as_raw()),
            update_from: update.then(|| storage(info.src_acceleration_structure)),
            destination: storage(info.dst_acceleration_structure),
            geometries: match kind {
                traversal::Kind::Triangles => {
                    BuildGeometries::Triangles(pairs.map(|(g, r)| triangles(g, r)).collect())
                }
                traversal::Kind::Aabbs => {
                    BuildGeometries::Aabbs(pairs.map(|(g, r)| aabbs(g, r)).collect())
                }
                traversal::Kind::Instances => {
                    let mut pairs = pairs;
                    BuildGeometries::Instances(
                        pairs.next().map_or(NO_INSTANCES, |(g, r)| instances(g, r)),
                    )
                }
            },
            scratch: info.scratch_data.device_address,
        }
    }
}

const NO_INSTANCES: Instances = Instances {
    flags: GeometryFlags(0),
    array: InstanceArray::Records,
    address: 0,
    count: 0,
};

/// Where an acceleration structure lies.
///
/// # Safety
/// The handle is alive.
pub unsafe fn storage(handle: vk::AccelerationStructureKHR) -> Storage {
    // SAFETY: the caller's promise.
    unsafe { handle::from_handle::<AccelerationStructure>(handle) }.storage()
}

/// # Safety
/// The geometry is one of triangles.
unsafe fn triangles(
    geometry: &vk::AccelerationStructureGeometryKHR<'_>,
    range: &vk::AccelerationStructureBuildRangeInfoKHR,
) -> Triangles {
    // SAFETY: the caller's promise; both members of an address union are 64 bits.
    unsafe {
        let data = geometry.geometry.triangles;
        let offset = range.primitive_offset as u64;
        let index_type = match data.index_type {
            vk::IndexType::UINT8_KHR => IndexType::U8,
            vk::IndexType::UINT16 => IndexType::U16,
            vk::IndexType::UINT32 => IndexType::U32,
            _ => IndexType::None,
        };
        let indexed = index_type != IndexType::None;
        let transform = data.transform_data.device_address;
        Triangles {
            flags: GeometryFlags(geometry.flags.as_raw()),
            vertex_format: vertex_format(data.vertex_format).unwrap_or(VertexFormat::F32x3),
            vertices: data.vertex_data.device_address + if indexed { 0 } else { offset },
            vertex_stride_bytes: data.vertex_stride,
            max_vertex: data.max_vertex,
            first_vertex: range.first_vertex,
            index_type,
            indices: data.index_data.device_address + if indexed { offset } else { 0 },
            transform: if transform == 0 {
                0
            } else {
                transform + range.transform_offset as u64
            },
            primitive_count: range.primitive_count,
        }
    }
}

/// # Safety
/// The geometry is one of boxes.
unsafe fn aabbs(
    geometry: &vk::AccelerationStructureGeometryKHR<'_>,
    range: &vk::AccelerationStructureBuildRangeInfoKHR,
) -> Aabbs {
    // SAFETY: as for `triangles`.
    unsafe {
        let data = geometry.geometry.aabbs;
        Aabbs {
            flags: GeometryFlags(geometry.flags.as_raw()),
            boxes: data.data.device_address + range.primitive_offset as u64,
            stride_bytes: data.stride,
            primitive_count: range.primitive_count,
        }
    }
}

/// # Safety
/// The geometry is one of instances.
unsafe fn instances(
    geometry: &vk::AccelerationStructureGeometryKHR<'_>,
    range: &vk::AccelerationStructureBuildRangeInfoKHR,
) -> Instances {
    // SAFETY: as for `triangles`.
    unsafe {
        let data = geometry.geometry.instances;
        let pointers = data.array_of_pointers == vk::TRUE;
        Instances {
            flags: GeometryFlags(geometry.flags.as_raw()),
            array: if pointers {
                InstanceArray::Pointers
            } else {
                InstanceArray::Records
            },
            address: data.data.device_address + range.primitive_offset as u64,
            count: range.primitive_count,
        }
    }
}
