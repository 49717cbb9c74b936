//! `VK_KHR_ray_tracing_pipeline`: pipelines, group handles, traces.

use std::ffi::c_void;

use ash::vk;

use super::deferred::defer;
use super::pipeline::create_each;
use super::record::record;
use crate::VkResult;
use crate::command::{Command, RayTracingCommand};
use crate::decode::pipeline::create_flags;
use crate::decode::ray_tracing::{create_pipeline, region};
use crate::device::Device;
use crate::ffi::array::slice_mut;
use crate::ffi::slice;
use crate::guard::{guard, guard_result};
use crate::handle::{self, Ref, from_handle, retain};
use crate::object::ImageView;
use crate::object::{Pipeline, PipelineCache};
use crate::wave::binding_table::{HANDLE_SIZE, Tables};

/// Writes the handles of `count` groups from `first` on.
///
/// # Safety
/// The pipeline is alive and `data` has room for `data_bytes`.
unsafe fn write_handles(
    handle: vk::Pipeline,
    first: u32,
    count: u32,
    data_bytes: usize,
    data: *mut c_void,
) -> VkResult {
    // SAFETY: the caller guarantees that the pipeline is alive and `data` has room for
    // `data_bytes`.
    unsafe {
        let groups = from_handle::<Pipeline>(handle).groups();
        let room = data_bytes / HANDLE_SIZE;
        for index in 0..(count as usize).min(room) {
            let group = groups
                .get(first as usize + index)
                .ok_or(vk::Result::ERROR_UNKNOWN)?;
            data.byte_add(index * HANDLE_SIZE)
                .cast::<[u8; HANDLE_SIZE]>()
                .write_unaligned(group.handle);
        }
        if room < count as usize {
            Err(vk::Result::ERROR_UNKNOWN)
        } else {
            Ok(())
        }
    }
}

/// `vkCreateRayTracingPipelinesKHR`, immediate or deferred.
struct Creation {
    device: Ref<Device>,
    cache: Option<Ref<PipelineCache>>,
    infos: &'static [vk::RayTracingPipelineCreateInfoKHR<'static>],
    pipelines: &'static mut [vk::Pipeline],
}

impl Creation {
    /// The number of useful threads, since stages are compiled in parallel.
    fn concurrency(&self) -> usize {
        let stages: usize = self
            .infos
            .iter()
            .map(|info| info.stage_count as usize)
            .sum();
        stages.clamp(1, self.device.engine.workers.current_num_threads())
    }

    /// Creates the pipelines in order, with `create_each`.
    ///
    /// # Safety
    /// Valid usage of the command; its arguments still exist.
    unsafe fn run(self) -> VkResult {
        let Self {
            device,
            cache,
            infos,
            pipelines,
        } = self;
        let cache = cache.as_ref().map(|cache| &***cache);
        // SAFETY: the caller guarantees valid usage of the command; what was passed to it is still
        // there.
        unsafe {
            create_each(
                infos,
                pipelines.as_mut_ptr(),
                |info| create_flags(info.flags, info.p_next),
                |info| create_pipeline(&device, cache, info).map(handle::create),
            )
        }
    }
}

pub(crate) unsafe extern "system" fn vkCreateRayTracingPipelinesKHR(
    device: vk::Device,
    operation: vk::DeferredOperationKHR,
    cache: vk::PipelineCache,
    count: u32,
    infos: *const vk::RayTracingPipelineCreateInfoKHR<'_>,
    _allocator: *const vk::AllocationCallbacks<'_>,
    pipelines: *mut vk::Pipeline,
) -> vk::Result {
    guard_result("vkCreateRayTracingPipelinesKHR", move || {
        let creation = Creation {
            device: retain(device),
            cache: (cache != vk::PipelineCache::null()).then(|| retain(cache)),
            infos: slice(infos.cast(), count),
            pipelines: slice_mut(pipelines, count),
        };
        let threads = creation.concurrency();
        // The data that the arguments point to stays valid until the operation is complete.
        defer(operation, threads, move || creation.run())
    })
}

pub(crate) unsafe extern "system" fn vkGetRayTracingShaderGroupHandlesKHR(
    _device: vk::Device,
    pipeline: vk::Pipeline,
    first: u32,
    count: u32,
    data_bytes: usize,
    data: *mut c_void,
) -> vk::Result {
    guard_result("vkGetRayTracingShaderGroupHandlesKHR", move || {
        write_handles(pipeline, first, count, data_bytes, data)
    })
}

pub(crate) unsafe extern "system" fn vkGetRayTracingCaptureReplayShaderGroupHandlesKHR(
    _device: vk::Device,
    pipeline: vk::Pipeline,
    first: u32,
    count: u32,
    data_bytes: usize,
    data: *mut c_void,
) -> vk::Result {
    guard_result(
        "vkGetRayTracingCaptureReplayShaderGroupHandlesKHR",
        move || write_handles(pipeline, first, count, data_bytes, data),
    )
}

pub(crate) unsafe extern "system" fn vkGetRayTracingShaderGroupStackSizeKHR(
    _device: vk::Device,
    handle: vk::Pipeline,
    group: u32,
    shader: vk::ShaderGroupShaderKHR,
) -> vk::DeviceSize {
    guard("vkGetRayTracingShaderGroupStackSizeKHR", move || {
        let pipeline = from_handle::<Pipeline>(handle).ray_tracing();
        pipeline.map_or(0, |pipeline| pipeline.stack_size_bytes(group, shader))
    })
}

/// # Safety
/// The pointers are to valid regions.
unsafe fn tables(
    raygen: *const vk::StridedDeviceAddressRegionKHR,
    miss: *const vk::StridedDeviceAddressRegionKHR,
    hit: *const vk::StridedDeviceAddressRegionKHR,
    callable: *const vk::StridedDeviceAddressRegionKHR,
) -> Tables {
    // SAFETY: the caller guarantees that the pointers are to valid regions.
    unsafe {
        Tables {
            raygen: region(raygen),
            miss: region(miss),
            hit: region(hit),
            callable: region(callable),
        }
    }
}

pub(crate) unsafe extern "system" fn vkCmdTraceRaysKHR(
    commands: vk::CommandBuffer,
    raygen: *const vk::StridedDeviceAddressRegionKHR,
    miss: *const vk::StridedDeviceAddressRegionKHR,
    hit: *const vk::StridedDeviceAddressRegionKHR,
    callable: *const vk::StridedDeviceAddressRegionKHR,
    width: u32,
    height: u32,
    depth: u32,
) {
    record("vkCmdTraceRaysKHR", commands, move |commands| {
        let tables = tables(raygen, miss, hit, callable);
        let extent = [width, height, depth];
        commands.push(Command::RayTracing(RayTracingCommand::TraceRays {
            tables,
            extent,
        }))
    })
}

pub(crate) unsafe extern "system" fn vkCmdTraceRaysIndirectKHR(
    commands: vk::CommandBuffer,
    raygen: *const vk::StridedDeviceAddressRegionKHR,
    miss: *const vk::StridedDeviceAddressRegionKHR,
    hit: *const vk::StridedDeviceAddressRegionKHR,
    callable: *const vk::StridedDeviceAddressRegionKHR,
    address: vk::DeviceAddress,
) {
    record("vkCmdTraceRaysIndirectKHR", commands, move |commands| {
        let tables = tables(raygen, miss, hit, callable);
        commands.push(Command::RayTracing(RayTracingCommand::TraceRaysIndirect {
            tables,
            address,
        }))
    })
}

pub(crate) unsafe extern "system" fn vkCmdTraceRaysIndirect2KHR(
    commands: vk::CommandBuffer,
    address: vk::DeviceAddress,
) {
    record("vkCmdTraceRaysIndirect2KHR", commands, move |commands| {
        commands.push(Command::RayTracing(RayTracingCommand::TraceRaysIndirect2 {
            address,
        }))
    })
}

pub(crate) unsafe extern "system" fn vkCmdBindInvocationMaskHUAWEI(
    commands: vk::CommandBuffer,
    view: vk::ImageView,
    _layout: vk::ImageLayout,
) {
    record("vkCmdBindInvocationMaskHUAWEI", commands, move |commands| {
        let mask = handle::optional::<ImageView>(view).map(|view| view.invocation_mask());
        commands.push(Command::BindInvocationMask(mask))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetRayTracingPipelineStackSizeKHR(
    commands: vk::CommandBuffer,
    size_bytes: u32,
) {
    record(
        "vkCmdSetRayTracingPipelineStackSizeKHR",
        commands,
        move |commands| {
            // Suspended invocations live on the heap and continue even if the declared stack is too
            // small. Only validation uses the stack size.
            commands.push(Command::SetRayTracingStackSize(size_bytes))
        },
    )
}
