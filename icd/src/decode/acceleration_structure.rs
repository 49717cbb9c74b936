//! `VkAccelerationStructureBuildGeometryInfoKHR` to an owned [`Build`].

use spirv_jit::reach::Reach;
use traversal::{
    BuildFlags, EndCaps, GeometryFlags, Indexing, InstanceArray, RadiusFormat, VertexFormat,
};

use super::geometries::{geometries, storage};
use super::index_type::index_type;
use super::micromap::is_micromap;
use crate::VkResult;
use crate::command::build::{Aabbs, Build, BuildGeometries, MotionTriangles, Triangles};
use crate::command::instances::Instances;
use crate::command::range::Range;
use crate::command::swept_sphere::Swept;
use crate::ffi::vk::Handle as _;
use crate::ffi::{find, slice, vk};
use crate::format::structure::radius_format;
use crate::format::structure::vertex_format;
use crate::validate::Checks;

/// The kind of structure for these geometries. Without geometries it is triangles, or instances for
/// a top level.
///
/// # Safety
/// The info and its geometries are valid.
pub unsafe fn kind(
    info: &vk::AccelerationStructureBuildGeometryInfoKHR<'_>,
    geometries: &[&vk::AccelerationStructureGeometryKHR<'_>],
) -> traversal::Kind {
    // SAFETY: the caller guarantees that the info and its geometries are valid.
    let in_motion = |geometry: &&_| unsafe { end_vertices(geometry) }.is_some();
    let is_top = info.ty == vk::AccelerationStructureTypeKHR::TOP_LEVEL;
    let moves = info
        .flags
        .contains(vk::BuildAccelerationStructureFlagsKHR::MOTION_NV);
    match geometries.first().map(|geometry| geometry.geometry_type) {
        Some(vk::GeometryTypeKHR::INSTANCES) if moves => traversal::Kind::MotionInstances,
        Some(vk::GeometryTypeKHR::INSTANCES) => traversal::Kind::Instances,
        Some(vk::GeometryTypeKHR::AABBS) => traversal::Kind::Aabbs,
        Some(vk::GEOMETRY_TYPE_SPHERES_NV | vk::GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV) => {
            traversal::Kind::Swept
        }
        Some(_) if geometries.iter().any(in_motion) => traversal::Kind::Motion,
        Some(_) => traversal::Kind::Triangles,
        None if is_top && moves => traversal::Kind::MotionInstances,
        None if is_top => traversal::Kind::Instances,
        None => traversal::Kind::Triangles,
    }
}

/// Copies a build, without its ranges. Each union is read as `deviceAddress`, which has the bits of
/// `hostAddress`.
///
/// # Safety
/// The info is valid and its handles are alive.
pub unsafe fn decode_build(info: &vk::AccelerationStructureBuildGeometryInfoKHR<'_>) -> Build {
    // SAFETY: the caller guarantees that the info is valid and its handles are alive.
    unsafe {
        let geometries = geometries(info);
        let kind = kind(info, &geometries);
        let mut geometries = geometries.into_iter();
        let update = info.mode == vk::BuildAccelerationStructureModeKHR::UPDATE;
        Build {
            flags: BuildFlags(info.flags.as_raw()),
            update_from: update.then(|| storage(info.src_acceleration_structure)),
            destination: storage(info.dst_acceleration_structure),
            geometries: match kind {
                traversal::Kind::Triangles => {
                    BuildGeometries::Triangles(geometries.map(|g| triangles(g)).collect())
                }
                traversal::Kind::Aabbs => {
                    BuildGeometries::Aabbs(geometries.map(|g| aabbs(g)).collect())
                }
                traversal::Kind::Swept => {
                    BuildGeometries::Swept(geometries.map(|g| swept(g)).collect())
                }
                traversal::Kind::Motion => {
                    let motion = |g| MotionTriangles {
                        start: triangles(g),
                        end_vertices: end_vertices(g)
                            .unwrap_or(g.geometry.triangles.vertex_data.device_address),
                    };
                    BuildGeometries::Motion(geometries.map(motion).collect())
                }
                traversal::Kind::Instances | traversal::Kind::MotionInstances => {
                    let mut all = geometries.next().map_or(NO_INSTANCES, |g| instances(g));
                    if kind == traversal::Kind::MotionInstances {
                        all.array = match all.array {
                            InstanceArray::Pointers => InstanceArray::MotionPointers,
                            _ => InstanceArray::MotionRecords,
                        };
                    }
                    BuildGeometries::Instances(all)
                }
            },
            scratch: info.scratch_data.device_address,
        }
    }
}

/// Copies builds with their ranges, except builds of micromaps, which have none.
///
/// # Safety
/// The infos are valid, their handles are alive, and each has as many ranges as geometries.
pub unsafe fn decode_builds(
    count: u32,
    infos: *const vk::AccelerationStructureBuildGeometryInfoKHR<'_>,
    ranges: *const *const vk::AccelerationStructureBuildRangeInfoKHR,
) -> Vec<Build> {
    // SAFETY: the caller guarantees that the infos are valid, their handles are alive, and each has
    // as many ranges as geometries.
    unsafe {
        let ranges = slice(ranges, count);
        let decode = |(info, &ranges): (
            &vk::AccelerationStructureBuildGeometryInfoKHR<'_>,
            &*const _,
        )| {
            let mut build = decode_build(info);
            for (index, range) in slice(ranges, info.geometry_count).iter().enumerate() {
                build.geometries.apply_range(index, &decode_range(range));
            }
            build
        };
        let builds = slice(infos, count).iter().zip(ranges);
        let of_structures = |(info, _): &(&_, _)| !is_micromap(info);
        builds.filter(of_structures).map(decode).collect()
    }
}

fn decode_range(range: &vk::AccelerationStructureBuildRangeInfoKHR) -> Range {
    Range {
        primitive_count: range.primitive_count,
        primitive_offset: range.primitive_offset,
        first_vertex: range.first_vertex,
        transform_offset: range.transform_offset,
    }
}

const NO_INSTANCES: Instances = Instances {
    flags: GeometryFlags(0),
    array: InstanceArray::Records,
    address: 0,
    count: 0,
};

/// The address of the vertices at time 1 of a geometry of triangles, if they move.
///
/// # Safety
/// The geometry is valid.
unsafe fn end_vertices(geometry: &vk::AccelerationStructureGeometryKHR<'_>) -> Option<u64> {
    type Data = vk::AccelerationStructureGeometryMotionTrianglesDataNV<'static>;
    if geometry.geometry_type != vk::GeometryTypeKHR::TRIANGLES {
        return None;
    }
    // SAFETY: the caller guarantees that the geometry is valid; triangles are read only of what is
    // one of triangles.
    unsafe {
        let data = find::<Data>(geometry.geometry.triangles.p_next)?;
        Some(data.vertex_data.device_address)
    }
}

/// Whether a geometry has a micromap.
///
/// # Safety
/// The geometry is valid.
pub unsafe fn has_micromap(geometry: &vk::AccelerationStructureGeometryKHR<'_>) -> bool {
    type Ext = vk::AccelerationStructureTrianglesOpacityMicromapEXT<'static>;
    type Khr = vk::AccelerationStructureTrianglesOpacityMicromapKHR<'static>;
    if geometry.geometry_type != vk::GeometryTypeKHR::TRIANGLES {
        return false;
    }
    // SAFETY: the caller guarantees that the geometry is valid; triangles are read only of what is
    // one of triangles.
    unsafe {
        let next = geometry.geometry.triangles.p_next;
        find::<Ext>(next).is_some() || find::<Khr>(next).is_some()
    }
}

/// # Safety
/// The geometry is one of triangles.
unsafe fn triangles(geometry: &vk::AccelerationStructureGeometryKHR<'_>) -> Triangles {
    // SAFETY: the caller guarantees that the geometry is one of triangles; both members of an
    // address union are 64 bits.
    unsafe {
        let data = geometry.geometry.triangles;
        Triangles {
            flags: GeometryFlags(geometry.flags.as_raw()),
            vertex_format: vertex_format(data.vertex_format).unwrap_or(VertexFormat::F32x3),
            vertices: data.vertex_data.device_address,
            vertex_stride_bytes: data.vertex_stride,
            max_vertex: data.max_vertex,
            first_vertex: 0,
            index_type: index_type(data.index_type),
            indices: data.index_data.device_address,
            transform: data.transform_data.device_address,
            primitive_count: 0,
            micromap: super::micromap::of_geometry(data.p_next),
        }
    }
}

/// Spheres and linear swept spheres are in the chain; without their structure there are none.
///
/// # Safety
/// The geometry is one of spheres or linear swept spheres.
unsafe fn swept(geometry: &vk::AccelerationStructureGeometryKHR<'_>) -> Swept {
    let flags = GeometryFlags(geometry.flags.as_raw());
    macro_rules! decode {
        ($data:ident, $indexing:expr, $end_caps:expr) => {
            Swept {
                flags,
                vertex_format: vertex_format($data.vertex_format).unwrap_or(VertexFormat::F32x3),
                vertices: $data.vertex_data.device_address,
                vertex_stride_bytes: $data.vertex_stride,
                radius_format: radius_format($data.radius_format).unwrap_or(RadiusFormat::F32),
                radii: $data.radius_data.device_address,
                radius_stride_bytes: $data.radius_stride,
                index_type: index_type($data.index_type),
                indices: $data.index_data.device_address,
                index_stride_bytes: $data.index_stride,
                indexing: $indexing,
                end_caps: $end_caps,
                first_vertex: 0,
                primitive_count: 0,
            }
        };
    }
    // SAFETY: as for `triangles`.
    unsafe {
        if let Some(data) =
            find::<vk::AccelerationStructureGeometrySpheresDataNV<'_>>(geometry.p_next)
        {
            return decode!(data, Indexing::Spheres, EndCaps::None);
        }
        let data =
            find::<vk::AccelerationStructureGeometryLinearSweptSpheresDataNV<'_>>(geometry.p_next);
        let Some(data) = data else {
            return Swept::NONE;
        };
        let indexing = match data.indexing_mode {
            vk::RayTracingLssIndexingModeNV::SUCCESSIVE => Indexing::Successive,
            _ => Indexing::Pairs,
        };
        let end_caps = match data.end_caps_mode {
            vk::RayTracingLssPrimitiveEndCapsModeNV::CHAINED => EndCaps::Chained,
            _ => EndCaps::None,
        };
        decode!(data, indexing, end_caps)
    }
}

/// # Safety
/// The geometry is one of boxes.
unsafe fn aabbs(geometry: &vk::AccelerationStructureGeometryKHR<'_>) -> Aabbs {
    // SAFETY: as for `triangles`.
    unsafe {
        let data = geometry.geometry.aabbs;
        Aabbs {
            flags: GeometryFlags(geometry.flags.as_raw()),
            boxes: data.data.device_address,
            stride_bytes: data.stride,
            primitive_count: 0,
        }
    }
}

/// # Safety
/// The geometry is one of instances.
unsafe fn instances(geometry: &vk::AccelerationStructureGeometryKHR<'_>) -> Instances {
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
            address: data.data.device_address,
            count: 0,
        }
    }
}

/// Copies the instance records of a host build, with each handle replaced by an address. The build
/// reads the copy, which must outlive it. Validation reports invalid handles, which then count as
/// null.
///
/// # Errors
/// `VK_ERROR_OUT_OF_HOST_MEMORY`.
///
/// # Safety
/// The build's instances are readable, and each reference is 0 or a live
/// `VkAccelerationStructureKHR`.
pub unsafe fn resolve_host_instances(
    build: &mut Build,
    checks: Option<&Checks>,
) -> VkResult<Vec<u64>> {
    let destination = build.destination.address;
    let BuildGeometries::Instances(instances) = &mut build.geometries else {
        return Ok(Vec::new());
    };
    // The build refuses more instances than a structure can have.
    if u64::from(instances.count) > traversal::MAX_GEOMETRIES {
        return Ok(Vec::new());
    }
    let address = |reference| match vk::AccelerationStructureKHR::from_raw(reference) {
        handle if handle == vk::AccelerationStructureKHR::null() => 0,
        _ if checks.is_some_and(|checks| !checks.host_reference(reference, destination)) => 0,
        // SAFETY: the caller guarantees that the build's instances are readable, and each reference
        // is 0 or a live `VkAccelerationStructureKHR`.
        handle => unsafe { storage(handle) }.address,
    };
    // SAFETY: the caller guarantees that the build's instances are readable, and each reference is
    // 0 or a live `VkAccelerationStructureKHR`.
    let copied = unsafe { instances.copied(&Reach::everywhere(), address) };
    let (copy, records) = copied.map_err(|_| vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
    *instances = copy;
    Ok(records)
}
