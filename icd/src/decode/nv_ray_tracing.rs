//! The structures of `VK_NV_ray_tracing`, which become those of the KHR extensions.

use ash::vk;
use traversal::{BuildFlags, GeometryFlags, InstanceArray, Kind, VertexFormat};

use super::index_type::index_type;
use super::pipeline::{create_flags, decode_stage, pipeline_layout};
use super::ray_tracing::{create_pipeline, group};
use crate::VkResult;
use crate::command::build::{Aabbs, Build, BuildGeometries, Triangles};
use crate::command::instances::Instances;
use crate::device::Device;
use crate::ffi::{find, slice};
use crate::format::structure::vertex_format;
use crate::handle::{self, Ref, from_handle};
use crate::object::acceleration_structure::Storage;
use crate::object::captured::Captured;
use crate::object::deferred_pipeline::DeferredPipeline;
use crate::object::pipeline::PipelineKind;
use crate::object::{AccelerationStructureNv, Buffer, Pipeline, PipelineCache};
use crate::wave::binding_table::Region;

/// The memory of a structure.
///
/// # Safety
/// The handle is alive.
pub unsafe fn storage(handle: vk::AccelerationStructureNV) -> Storage {
    // SAFETY: the caller guarantees that the handle is alive.
    let structure = unsafe { from_handle::<AccelerationStructureNv>(handle) };
    structure.structure.storage()
}

/// Device address of an offset in a buffer; 0 without a buffer or its memory.
///
/// # Safety
/// The handle is null or alive.
pub unsafe fn place(buffer: vk::Buffer, offset: u64) -> u64 {
    // SAFETY: the caller guarantees that the handle is null or alive.
    match unsafe { handle::optional::<Buffer>(buffer) }.map_or(0, |buffer| buffer.address()) {
        0 => 0,
        address => address.wrapping_add(offset),
    }
}

/// A binding table: from an offset in a buffer to its end. A buffer without memory gives a size but
/// no address.
///
/// # Safety
/// The handle is null or alive.
pub unsafe fn region(buffer: vk::Buffer, offset: u64, stride_bytes: u64) -> Region {
    // SAFETY: the caller guarantees that the handle is null or alive.
    unsafe {
        handle::optional::<Buffer>(buffer).map_or_else(Region::default, |object| Region {
            address: place(buffer, offset),
            stride_bytes,
            size_bytes: object.size_bytes.saturating_sub(offset),
        })
    }
}

/// The kind of structure and its counts. Only the counts of the geometries are read.
///
/// # Safety
/// The info is valid, except for the buffers that it names.
pub unsafe fn kind_and_counts(info: &vk::AccelerationStructureInfoNV<'_>) -> (Kind, Vec<u32>) {
    if is_top(info) {
        return (Kind::Instances, vec![info.instance_count]);
    }
    // SAFETY: the caller guarantees that the info is valid, except for the buffers that it names.
    let geometries = unsafe { slice(info.p_geometries, info.geometry_count) };
    match holds_boxes(geometries) {
        true => {
            let count = |it: &vk::GeometryNV<'_>| it.geometry.aabbs.num_aab_bs;
            (Kind::Aabbs, geometries.iter().map(count).collect())
        }
        false => {
            let count = |it: &vk::GeometryNV<'_>| triangle_count(&it.geometry.triangles);
            (Kind::Triangles, geometries.iter().map(count).collect())
        }
    }
}

fn is_top(info: &vk::AccelerationStructureInfoNV<'_>) -> bool {
    info.ty == vk::AccelerationStructureTypeKHR::TOP_LEVEL
}

/// Geometries of a structure are all of one type.
fn holds_boxes(geometries: &[vk::GeometryNV<'_>]) -> bool {
    let first = geometries.first().map(|first| first.geometry_type);
    first == Some(vk::GeometryTypeKHR::AABBS)
}

/// Without indices, each vertex is a corner.
fn triangle_count(triangles: &vk::GeometryTrianglesNV<'_>) -> u32 {
    match triangles.index_type {
        vk::IndexType::NONE_KHR => triangles.vertex_count / 3,
        _ => triangles.index_count / 3,
    }
}

/// Copies a build. `instances` is the address of a top level's instances.
///
/// # Safety
/// The info is valid and its handles are alive.
pub unsafe fn decode_build(
    info: &vk::AccelerationStructureInfoNV<'_>,
    instances: u64,
    destination: Storage,
    update_from: Option<Storage>,
    scratch: u64,
) -> Build {
    // SAFETY: the caller guarantees that the info is valid and its handles are alive.
    let geometries = unsafe { slice(info.p_geometries, info.geometry_count) };
    let geometries = if is_top(info) {
        BuildGeometries::Instances(Instances {
            flags: GeometryFlags(0),
            array: InstanceArray::Records,
            address: instances,
            count: info.instance_count,
        })
    } else if holds_boxes(geometries) {
        // SAFETY: the caller guarantees that the info is valid and its handles are alive.
        let aabbs = |it| unsafe { aabbs(it) };
        BuildGeometries::Aabbs(geometries.iter().map(aabbs).collect())
    } else {
        // SAFETY: the caller guarantees that the info is valid and its handles are alive.
        let triangles = |it| unsafe { triangles(it) };
        BuildGeometries::Triangles(geometries.iter().map(triangles).collect())
    };
    Build {
        flags: BuildFlags(info.flags.as_raw()),
        update_from,
        destination,
        geometries,
        scratch,
    }
}

/// # Safety
/// The geometry is valid and its handles are alive.
unsafe fn triangles(geometry: &vk::GeometryNV<'_>) -> Triangles {
    let data = &geometry.geometry.triangles;
    // SAFETY: the caller guarantees that the geometry is valid and its handles are alive.
    unsafe {
        Triangles {
            flags: GeometryFlags(geometry.flags.as_raw()),
            vertex_format: vertex_format(data.vertex_format).unwrap_or(VertexFormat::F32x3),
            vertices: place(data.vertex_data, data.vertex_offset),
            vertex_stride_bytes: data.vertex_stride,
            max_vertex: data.vertex_count.saturating_sub(1),
            first_vertex: 0,
            index_type: index_type(data.index_type),
            indices: place(data.index_data, data.index_offset),
            transform: place(data.transform_data, data.transform_offset),
            primitive_count: triangle_count(data),
            micromap: None,
        }
    }
}

/// # Safety
/// The geometry is valid and its handles are alive.
unsafe fn aabbs(geometry: &vk::GeometryNV<'_>) -> Aabbs {
    let data = &geometry.geometry.aabbs;
    Aabbs {
        flags: GeometryFlags(geometry.flags.as_raw()),
        // SAFETY: the caller guarantees that the geometry is valid and its handles are alive.
        boxes: unsafe { place(data.aabb_data, data.offset) },
        stride_bytes: data.stride.into(),
        primitive_count: data.num_aab_bs,
    }
}

/// Creates a pipeline: compiled and linked, or deferred.
///
/// # Errors
/// As [`create_pipeline`].
///
/// # Safety
/// The info is valid and its handles are alive.
pub unsafe fn create_pipeline_nv(
    device: &Device,
    cache: Option<&Ref<PipelineCache>>,
    info: &vk::RayTracingPipelineCreateInfoNV<'_>,
) -> VkResult<Pipeline> {
    // SAFETY: the caller guarantees that the info is valid and its handles are alive.
    unsafe {
        let groups: Vec<_> = slice(info.p_groups, info.group_count)
            .iter()
            .map(|group| vk::RayTracingShaderGroupCreateInfoKHR {
                ty: group.ty,
                general_shader: group.general_shader,
                closest_hit_shader: group.closest_hit_shader,
                any_hit_shader: group.any_hit_shader,
                intersection_shader: group.intersection_shader,
                ..Default::default()
            })
            .collect();
        let flags = create_flags(info.flags, info.p_next);
        if !flags.contains(vk::PipelineCreateFlags::DEFER_COMPILE_NV) {
            let info = vk::RayTracingPipelineCreateInfoKHR {
                p_next: info.p_next,
                flags: info.flags,
                stage_count: info.stage_count,
                p_stages: info.p_stages,
                group_count: info.group_count,
                p_groups: groups.as_ptr(),
                max_pipeline_ray_recursion_depth: info.max_recursion_depth,
                layout: info.layout,
                ..Default::default()
            };
            return create_pipeline(device, cache.map(|cache| &***cache), &info);
        }
        no_feedback(info.p_next);
        let layout = pipeline_layout(info.layout);
        let stages = slice(info.p_stages, info.stage_count);
        let deferred = DeferredPipeline::new(
            stages
                .iter()
                .map(|stage| decode_stage(stage, info.p_next))
                .collect::<VkResult<_>>()?,
            groups.iter().map(group).collect(),
            &layout,
            &device.compiler(),
            cache.cloned(),
            info.max_recursion_depth,
            flags,
        );
        Ok(Pipeline {
            layout,
            kind: PipelineKind::Deferred(deferred),
            captured: Captured::default(),
        })
    }
}

/// Marks the creation feedback as invalid, for a creation that compiles nothing.
///
/// # Safety
/// The chain is valid.
unsafe fn no_feedback(next: *const std::ffi::c_void) {
    // SAFETY: the caller guarantees that the chain is valid; the structure's pointers are valid
    // outputs.
    unsafe {
        let Some(feedback) = find::<vk::PipelineCreationFeedbackCreateInfo<'_>>(next) else {
            return;
        };
        let stages = feedback.p_pipeline_stage_creation_feedbacks;
        let count = feedback.pipeline_stage_creation_feedback_count;
        crate::ffi::array::slice_mut(stages, count).fill(vk::PipelineCreationFeedback::default());
        feedback
            .p_pipeline_creation_feedback
            .write(vk::PipelineCreationFeedback::default());
    }
}
