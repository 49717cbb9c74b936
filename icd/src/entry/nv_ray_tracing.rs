//! `VK_NV_ray_tracing`: the commands before the KHR extensions, on the same structures, pipelines
//! and dispatches.

use std::ffi::c_void;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use ash::vk::{self, Handle};
use traversal::BuildFlags;

use super::acceleration_structure::copy_mode;
use super::address_report::report;
use super::buffer::write_requirements;
use super::pipeline::create_each;
use super::record::record;
use crate::capabilities::limits::MEMORY_ALIGNMENT;
use crate::command::structures::{Built, BuiltCopy};
use crate::command::{Command, RayTracingCommand, StructureCommand};
use crate::decode::nv_ray_tracing::{
    create_pipeline_nv, decode_build, kind_and_counts, place, region, storage,
};
use crate::decode::pipeline::create_flags;
use crate::device::Device;
use crate::ffi::slice;
use crate::guard::{guard, guard_result};
use crate::handle::{self, from_handle, optional, retain};
use crate::object::acceleration_structure::Location;
use crate::object::addressed::AddressEvent;
use crate::object::pipeline::PipelineKind;
use crate::object::{
    AccelerationStructure, AccelerationStructureNv, DeviceMemory, Pipeline, PipelineCache,
    QueryPool,
};
use crate::wave::binding_table::Tables;

/// Creates a structure without memory.
///
/// # Safety
/// The info is valid, except for the buffers that it names.
unsafe fn create(info: &vk::AccelerationStructureCreateInfoNV<'_>) -> AccelerationStructureNv {
    // SAFETY: the caller guarantees that the info is valid, except for the buffers that it names.
    let (kind, counts) = unsafe { kind_and_counts(&info.info) };
    let sizes = traversal::build_sizes(kind, BuildFlags(info.info.flags.as_raw()), &counts);
    let size_bytes = match info.compacted_size {
        0 => sizes.structure_bytes,
        compacted => compacted,
    };
    AccelerationStructureNv {
        structure: handle::new(AccelerationStructure {
            ty: info.info.ty,
            location: Location::Memory(AtomicU64::new(0)),
            size_bytes,
            replayable: None,
        }),
        build_scratch_bytes: sizes.build_scratch_bytes,
        update_scratch_bytes: sizes.update_scratch_bytes,
    }
}

pub(crate) unsafe extern "system" fn vkCreateAccelerationStructureNV(
    device: vk::Device,
    info: *const vk::AccelerationStructureCreateInfoNV<'_>,
    _allocator: *const vk::AllocationCallbacks<'_>,
    out: *mut vk::AccelerationStructureNV,
) -> vk::Result {
    guard_result("vkCreateAccelerationStructureNV", move || {
        let created = create(&*info);
        let structure = Arc::clone(&created.structure);
        *out = handle::create(created);
        if let Some(validator) = from_handle::<Device>(device).validator() {
            validator.registry.add_structure((*out).as_raw(), structure);
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkDestroyAccelerationStructureNV(
    device: vk::Device,
    structure: vk::AccelerationStructureNV,
    _allocator: *const vk::AllocationCallbacks<'_>,
) {
    guard("vkDestroyAccelerationStructureNV", move || {
        if let Some(validator) = from_handle::<Device>(device).validator() {
            validator.registry.remove_structure(structure.as_raw());
        }
        report::<AccelerationStructureNv>(device, structure, AddressEvent::Unbound);
        drop(handle::take::<AccelerationStructureNv>(structure));
    })
}

pub(crate) unsafe extern "system" fn vkGetAccelerationStructureMemoryRequirementsNV(
    _device: vk::Device,
    info: *const vk::AccelerationStructureMemoryRequirementsInfoNV<'_>,
    out: *mut vk::MemoryRequirements2KHR<'_>,
) {
    guard(
        "vkGetAccelerationStructureMemoryRequirementsNV",
        move || {
            use vk::AccelerationStructureMemoryRequirementsTypeNV as Of;
            let of = from_handle::<AccelerationStructureNv>((*info).acceleration_structure);
            let scratch_bytes = match (*info).ty {
                Of::BUILD_SCRATCH => of.build_scratch_bytes,
                Of::UPDATE_SCRATCH => of.update_scratch_bytes,
                _ => return write_requirements(out, of.structure.size_bytes, MEMORY_ALIGNMENT),
            };
            // Scratch memory is a buffer with requirements of its own.
            (*out).memory_requirements = vk::MemoryRequirements {
                size: scratch_bytes,
                ..Default::default()
            };
        },
    )
}

pub(crate) unsafe extern "system" fn vkBindAccelerationStructureMemoryNV(
    device: vk::Device,
    count: u32,
    infos: *const vk::BindAccelerationStructureMemoryInfoNV<'_>,
) -> vk::Result {
    guard_result("vkBindAccelerationStructureMemoryNV", move || {
        for info in slice(infos, count) {
            let memory = from_handle::<DeviceMemory>(info.memory);
            let made = from_handle::<AccelerationStructureNv>(info.acceleration_structure);
            made.bind(memory.place(info.memory_offset, made.structure.size_bytes)?);
            let bound = info.acceleration_structure;
            report::<AccelerationStructureNv>(device, bound, AddressEvent::Bound);
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetAccelerationStructureHandleNV(
    _device: vk::Device,
    structure: vk::AccelerationStructureNV,
    size_bytes: usize,
    data: *mut c_void,
) -> vk::Result {
    guard_result("vkGetAccelerationStructureHandleNV", move || {
        if size_bytes < size_of::<u64>() {
            return Err(vk::Result::ERROR_UNKNOWN);
        }
        data.cast::<u64>()
            .write_unaligned(storage(structure).address);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCreateRayTracingPipelinesNV(
    device: vk::Device,
    cache: vk::PipelineCache,
    count: u32,
    infos: *const vk::RayTracingPipelineCreateInfoNV<'_>,
    _allocator: *const vk::AllocationCallbacks<'_>,
    pipelines: *mut vk::Pipeline,
) -> vk::Result {
    guard_result("vkCreateRayTracingPipelinesNV", move || {
        let device = from_handle::<Device>(device);
        let cache = (cache != vk::PipelineCache::null()).then(|| retain::<PipelineCache>(cache));
        create_each(
            slice(infos, count),
            pipelines,
            |info| create_flags(info.flags, info.p_next),
            |info| create_pipeline_nv(device, cache.as_ref(), info).map(handle::create),
        )
    })
}

pub(crate) unsafe extern "system" fn vkCompileDeferredNV(
    device: vk::Device,
    pipeline: vk::Pipeline,
    shader: u32,
) -> vk::Result {
    guard_result("vkCompileDeferredNV", move || {
        let pipeline = from_handle::<Pipeline>(pipeline);
        match &pipeline.kind {
            PipelineKind::Deferred(deferred) => {
                let device = from_handle::<Device>(device);
                deferred.compile(
                    &device.compiler(),
                    &pipeline.layout,
                    &pipeline.captured,
                    shader,
                )
            }
            _ => Err(vk::Result::ERROR_UNKNOWN),
        }
    })
}

pub(crate) unsafe extern "system" fn vkCmdBuildAccelerationStructureNV(
    commands: vk::CommandBuffer,
    info: *const vk::AccelerationStructureInfoNV<'_>,
    instance_data: vk::Buffer,
    instance_offset: vk::DeviceSize,
    update: vk::Bool32,
    destination: vk::AccelerationStructureNV,
    source: vk::AccelerationStructureNV,
    scratch: vk::Buffer,
    scratch_offset: vk::DeviceSize,
) {
    record(
        "vkCmdBuildAccelerationStructureNV",
        commands,
        move |commands| {
            let source = match update {
                vk::FALSE => None,
                _ => optional::<AccelerationStructureNv>(source),
            };
            let build = decode_build(
                &*info,
                place(instance_data, instance_offset),
                storage(destination),
                source.map(|source| source.structure.storage()),
                place(scratch, scratch_offset),
            );
            commands.push(Command::Structure(StructureCommand::Build(vec![build])))
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdCopyAccelerationStructureNV(
    commands: vk::CommandBuffer,
    destination: vk::AccelerationStructureNV,
    source: vk::AccelerationStructureNV,
    mode: vk::CopyAccelerationStructureModeKHR,
) {
    record(
        "vkCmdCopyAccelerationStructureNV",
        commands,
        move |commands| {
            commands.push(Command::Structure(StructureCommand::Copy(
                Built::Structure,
                BuiltCopy::Whole {
                    source: storage(source),
                    destination: storage(destination),
                    mode: copy_mode(mode),
                },
            )))
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdWriteAccelerationStructuresPropertiesNV(
    commands: vk::CommandBuffer,
    count: u32,
    structures: *const vk::AccelerationStructureNV,
    query_type: vk::QueryType,
    pool: vk::QueryPool,
    first: u32,
) {
    record(
        "vkCmdWriteAccelerationStructuresPropertiesNV",
        commands,
        move |commands| {
            let structures = slice(structures, count);
            commands.push(Command::Structure(StructureCommand::WriteProperties {
                of: Built::Structure,
                addresses: structures
                    .iter()
                    .map(|&structure| storage(structure).address)
                    .collect(),
                query_type,
                pool: retain::<QueryPool>(pool),
                first,
            }))
        },
    )
}

pub(crate) unsafe extern "system" fn vkCmdTraceRaysNV(
    commands: vk::CommandBuffer,
    raygen: vk::Buffer,
    raygen_offset: vk::DeviceSize,
    miss: vk::Buffer,
    miss_offset: vk::DeviceSize,
    miss_stride: vk::DeviceSize,
    hit: vk::Buffer,
    hit_offset: vk::DeviceSize,
    hit_stride: vk::DeviceSize,
    callable: vk::Buffer,
    callable_offset: vk::DeviceSize,
    callable_stride: vk::DeviceSize,
    width: u32,
    height: u32,
    depth: u32,
) {
    record("vkCmdTraceRaysNV", commands, move |commands| {
        let tables = Tables {
            raygen: region(raygen, raygen_offset, 0),
            miss: region(miss, miss_offset, miss_stride),
            hit: region(hit, hit_offset, hit_stride),
            callable: region(callable, callable_offset, callable_stride),
        };
        let extent = [width, height, depth];
        commands.push(Command::RayTracing(RayTracingCommand::TraceRaysNv {
            tables,
            extent,
        }))
    })
}
