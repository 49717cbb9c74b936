//! Command pools and buffers, and the commands that bind, dispatch and order.

use ash::vk::{self, Handle};
use smallvec::SmallVec;

use super::descriptor_heap::inherit_heaps;
use super::push_descriptor::bind_points;
use super::record::record;
use crate::VkResult;
use crate::command::{
    BindDescriptorSets, Command, CommandBuffer, CommandPool, GraphicsCommand, Mark, Recording,
    copied,
};
use crate::decode::graphics::color_locations;
use crate::ffi;
use crate::guard::{guard, guard_result};
use crate::handle;
use crate::object::setting::Setting;
use crate::object::{Buffer, DescriptorSet, Event};
use crate::timeline;

/// Records a barrier for shaders of draws. Inside a pass, vertex stages and reads of indirect
/// parameters run before the fragments of earlier draws, and fragment shaders keep values that they
/// read from uniform blocks.
fn barrier(commands: &mut Recording, destination: vk::PipelineStageFlags2) -> VkResult {
    use vk::PipelineStageFlags2 as Stage;
    let stages = Stage::DRAW_INDIRECT
        | Stage::VERTEX_INPUT
        | Stage::INDEX_INPUT
        | Stage::VERTEX_ATTRIBUTE_INPUT
        | Stage::VERTEX_SHADER
        | Stage::TESSELLATION_CONTROL_SHADER
        | Stage::TESSELLATION_EVALUATION_SHADER
        | Stage::GEOMETRY_SHADER
        | Stage::TASK_SHADER_EXT
        | Stage::MESH_SHADER_EXT
        | Stage::TRANSFORM_FEEDBACK_EXT
        | Stage::PRE_RASTERIZATION_SHADERS
        | Stage::ALL_GRAPHICS
        | Stage::ALL_COMMANDS;
    if destination.intersects(stages) {
        return commands.push(Command::Graphics(GraphicsCommand::VertexBarrier));
    }
    if destination.contains(Stage::FRAGMENT_SHADER) {
        return commands.push(Command::Graphics(GraphicsCommand::FragmentBarrier));
    }
    Ok(())
}

/// Starts a secondary command buffer with the heaps and color attachment locations that it
/// inherits. The driver needs no other inheritance information: lists are shared by count, and a
/// secondary command buffer inherits no other state.
///
/// # Safety `info` is valid usage of `vkBeginCommandBuffer` for a secondary command buffer.
unsafe fn inherit(commands: &mut Recording, info: &vk::CommandBufferBeginInfo<'_>) -> VkResult {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkBeginCommandBuffer` for a
    // secondary command buffer.
    unsafe {
        let inherited = info.p_inheritance_info.as_ref();
        if let Some(inherited) = inherited {
            inherit_heaps(commands, inherited.p_next)?;
        }
        let chained = inherited.and_then(|inherited| {
            ffi::chain::find::<vk::RenderingAttachmentLocationInfoKHR<'_>>(inherited.p_next)
        });
        let Some(locations) = chained else {
            return Ok(());
        };
        let setting = Setting::ColorLocations(color_locations(locations));
        commands.push(Command::Graphics(GraphicsCommand::Set(setting)))
    }
}

/// Records a mark, if there is a timeline.
fn mark(commands: &mut Recording, mark: impl FnOnce() -> Mark) -> VkResult {
    match timeline::is_on() {
        true => commands.push(Command::Mark(mark())),
        false => Ok(()),
    }
}

/// # Safety
/// `label` is valid.
unsafe fn label_text(label: *const vk::DebugUtilsLabelEXT<'_>) -> Box<str> {
    // SAFETY: the caller guarantees that `label` is valid.
    let text = unsafe { (*label).p_label_name };
    match text.is_null() {
        true => Box::default(),
        // SAFETY: as for the label.
        false => unsafe { ffi::string(text) }.to_string_lossy().into(),
    }
}

pub(crate) unsafe extern "system" fn vkCreateCommandPool(
    _device: vk::Device,
    _info: *const vk::CommandPoolCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::CommandPool,
) -> vk::Result {
    guard_result("vkCreateCommandPool", move || {
        *out = handle::create(CommandPool::default());
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkDestroyCommandPool(
    _device: vk::Device,
    pool: vk::CommandPool,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyCommandPool", move || {
        drop(handle::take::<CommandPool>(pool));
    })
}

pub(crate) unsafe extern "system" fn vkResetCommandPool(
    _device: vk::Device,
    pool: vk::CommandPool,
    flags: vk::CommandPoolResetFlags,
) -> vk::Result {
    guard_result("vkResetCommandPool", move || {
        let keep_memory = !flags.contains(vk::CommandPoolResetFlags::RELEASE_RESOURCES);
        handle::from_handle::<CommandPool>(pool).reset(keep_memory);
        Ok(())
    })
}

/// Memory belongs to the command buffers, which may still be used, so there is nothing to trim.
pub(crate) unsafe extern "system" fn vkTrimCommandPool(
    _device: vk::Device,
    _pool: vk::CommandPool,
    _flags: vk::CommandPoolTrimFlags,
) {
}

pub(crate) unsafe extern "system" fn vkAllocateCommandBuffers(
    _device: vk::Device,
    info: *const vk::CommandBufferAllocateInfo,
    out: *mut vk::CommandBuffer,
) -> vk::Result {
    guard_result("vkAllocateCommandBuffers", move || {
        let pool = handle::from_handle::<CommandPool>((*info).command_pool);
        for index in 0..(*info).command_buffer_count {
            out.add(index as usize).write(pool.allocate((*info).level));
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkFreeCommandBuffers(
    _device: vk::Device,
    pool: vk::CommandPool,
    count: u32,
    buffers: *const vk::CommandBuffer,
) {
    guard("vkFreeCommandBuffers", move || {
        let pool = handle::from_handle::<CommandPool>(pool);
        for &buffer in ffi::slice(buffers, count) {
            pool.free(buffer);
        }
    })
}

pub(crate) unsafe extern "system" fn vkBeginCommandBuffer(
    buffer: vk::CommandBuffer,
    info: *const vk::CommandBufferBeginInfo,
) -> vk::Result {
    guard_result("vkBeginCommandBuffer", move || {
        let name = buffer.as_raw();
        let buffer = handle::from_handle::<CommandBuffer>(buffer);
        let mut recording = buffer.recording.lock();
        recording.reset(true);
        mark(&mut recording, || Mark::CommandBuffer(name))?;
        match buffer.level {
            vk::CommandBufferLevel::SECONDARY => inherit(&mut recording, &*info),
            _ => Ok(()),
        }
    })
}

pub(crate) unsafe extern "system" fn vkEndCommandBuffer(buffer: vk::CommandBuffer) -> vk::Result {
    guard_result("vkEndCommandBuffer", move || {
        handle::from_handle::<CommandBuffer>(buffer)
            .recording
            .lock()
            .finish()
    })
}

pub(crate) unsafe extern "system" fn vkResetCommandBuffer(
    buffer: vk::CommandBuffer,
    flags: vk::CommandBufferResetFlags,
) -> vk::Result {
    guard_result("vkResetCommandBuffer", move || {
        let keep_memory = !flags.contains(vk::CommandBufferResetFlags::RELEASE_RESOURCES);
        handle::from_handle::<CommandBuffer>(buffer)
            .recording
            .lock()
            .reset(keep_memory);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCmdBindPipeline(
    commands: vk::CommandBuffer,
    _bind_point: vk::PipelineBindPoint,
    pipeline: vk::Pipeline,
) {
    record("vkCmdBindPipeline", commands, move |commands| {
        commands.push(Command::BindPipeline(handle::retain(pipeline)))
    })
}

pub(crate) unsafe extern "system" fn vkCmdBindDescriptorSets(
    commands: vk::CommandBuffer,
    bind_point: vk::PipelineBindPoint,
    _layout: vk::PipelineLayout,
    first_set: u32,
    set_count: u32,
    sets: *const vk::DescriptorSet,
    offset_count: u32,
    offsets: *const u32,
) {
    record("vkCmdBindDescriptorSets", commands, move |commands| {
        let sets = ffi::slice(sets, set_count)
            .iter()
            .map(|&set| handle::optional::<DescriptorSet>(set).map(|_| handle::retain(set)));
        commands.push(Command::BindDescriptorSets(BindDescriptorSets {
            bind_point,
            first_set,
            sets: sets.collect(),
            dynamic_offsets: SmallVec::from_slice(ffi::slice(offsets, offset_count)),
        }))
    })
}

pub(crate) unsafe extern "system" fn vkCmdPushConstants(
    commands: vk::CommandBuffer,
    _layout: vk::PipelineLayout,
    _stages: vk::ShaderStageFlags,
    offset: u32,
    size_bytes: u32,
    values: *const std::ffi::c_void,
) {
    record("vkCmdPushConstants", commands, move |commands| {
        let bytes = SmallVec::from_slice(ffi::slice(values.cast(), size_bytes));
        commands.push(Command::PushConstants { offset, bytes })
    })
}

pub(crate) unsafe extern "system" fn vkCmdBindDescriptorSets2KHR(
    commands: vk::CommandBuffer,
    info: *const vk::BindDescriptorSetsInfoKHR<'_>,
) {
    record("vkCmdBindDescriptorSets2KHR", commands, move |commands| {
        let info = &*info;
        let offsets = ffi::slice(info.p_dynamic_offsets, info.dynamic_offset_count);
        for bind_point in bind_points(info.stage_flags) {
            let sets = ffi::slice(info.p_descriptor_sets, info.descriptor_set_count).iter();
            let sets = sets
                .map(|&set| handle::optional::<DescriptorSet>(set).map(|_| handle::retain(set)));
            commands.push(Command::BindDescriptorSets(BindDescriptorSets {
                bind_point,
                first_set: info.first_set,
                sets: sets.collect(),
                dynamic_offsets: SmallVec::from_slice(offsets),
            }))?;
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCmdPushConstants2KHR(
    commands: vk::CommandBuffer,
    info: *const vk::PushConstantsInfoKHR<'_>,
) {
    record("vkCmdPushConstants2KHR", commands, move |commands| {
        let info = &*info;
        let bytes = SmallVec::from_slice(ffi::slice(info.p_values.cast(), info.size));
        commands.push(Command::PushConstants {
            offset: info.offset,
            bytes,
        })
    })
}

pub(crate) unsafe extern "system" fn vkCmdDispatch(
    commands: vk::CommandBuffer,
    x: u32,
    y: u32,
    z: u32,
) {
    record("vkCmdDispatch", commands, move |commands| {
        commands.push(Command::Dispatch {
            base: [0; 3],
            count: [x, y, z],
        })
    })
}

pub(crate) unsafe extern "system" fn vkCmdDispatchBase(
    commands: vk::CommandBuffer,
    base_x: u32,
    base_y: u32,
    base_z: u32,
    x: u32,
    y: u32,
    z: u32,
) {
    record("vkCmdDispatchBase", commands, move |commands| {
        commands.push(Command::Dispatch {
            base: [base_x, base_y, base_z],
            count: [x, y, z],
        })
    })
}

pub(crate) unsafe extern "system" fn vkCmdDispatchIndirect(
    commands: vk::CommandBuffer,
    buffer: vk::Buffer,
    offset: vk::DeviceSize,
) {
    record("vkCmdDispatchIndirect", commands, move |commands| {
        let size_bytes = size_of::<vk::DispatchIndirectCommand>() as u64;
        let (address, _) = handle::from_handle::<Buffer>(buffer).range(offset, size_bytes)?;
        commands.push(Command::DispatchIndirect {
            address: address as u64,
        })
    })
}

pub(crate) unsafe extern "system" fn vkCmdExecuteCommands(
    commands: vk::CommandBuffer,
    count: u32,
    buffers: *const vk::CommandBuffer,
) {
    record("vkCmdExecuteCommands", commands, move |commands| {
        let lists = ffi::slice(buffers, count).iter().map(|&buffer| {
            let secondary = handle::from_handle::<CommandBuffer>(buffer);
            // The buffer itself is being recorded: its lock is held, and its list is not finished.
            if std::ptr::eq(secondary.recording.data_ptr(), commands) {
                return Err(vk::Result::ERROR_UNKNOWN);
            }
            secondary.recording.lock().executable()
        });
        commands.push(Command::ExecuteCommands(lists.collect::<Result<_, _>>()?))
    })
}

/// A device has one physical device.
pub(crate) unsafe extern "system" fn vkCmdSetDeviceMask(commands: vk::CommandBuffer, _mask: u32) {
    record("vkCmdSetDeviceMask", commands, move |_| Ok(()))
}

/// Barriers do nothing outside of passes; see [`execute`](crate::execute).
pub(crate) unsafe extern "system" fn vkCmdPipelineBarrier(
    commands: vk::CommandBuffer,
    _source_stages: vk::PipelineStageFlags,
    destination_stages: vk::PipelineStageFlags,
    _flags: vk::DependencyFlags,
    _memory_count: u32,
    _memory: *const vk::MemoryBarrier,
    _buffer_count: u32,
    _buffers: *const vk::BufferMemoryBarrier,
    _image_count: u32,
    _images: *const vk::ImageMemoryBarrier,
) {
    record("vkCmdPipelineBarrier", commands, move |commands| {
        let stages = vk::PipelineStageFlags2::from_raw(u64::from(destination_stages.as_raw()));
        barrier(commands, stages)
    })
}

/// Like `vkCmdPipelineBarrier`.
pub(crate) unsafe extern "system" fn vkCmdPipelineBarrier2(
    commands: vk::CommandBuffer,
    info: *const vk::DependencyInfo,
) {
    record("vkCmdPipelineBarrier2", commands, move |commands| {
        let info = &*info;
        let memory = ffi::slice(info.p_memory_barriers, info.memory_barrier_count);
        let buffers = ffi::slice(
            info.p_buffer_memory_barriers,
            info.buffer_memory_barrier_count,
        );
        let images = ffi::slice(
            info.p_image_memory_barriers,
            info.image_memory_barrier_count,
        );
        let stages = (memory.iter().map(|it| it.dst_stage_mask))
            .chain(buffers.iter().map(|it| it.dst_stage_mask))
            .chain(images.iter().map(|it| it.dst_stage_mask));
        // Barriers of address ranges are in the chain.
        let chained = match info.p_next.is_null() {
            true => vk::PipelineStageFlags2::NONE,
            false => vk::PipelineStageFlags2::ALL_COMMANDS,
        };
        barrier(commands, stages.fold(chained, |all, it| all | it))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetEvent(
    commands: vk::CommandBuffer,
    event: vk::Event,
    _stages: vk::PipelineStageFlags,
) {
    record("vkCmdSetEvent", commands, move |commands| {
        commands.push(Command::SetEvent(handle::retain(event)))
    })
}

pub(crate) unsafe extern "system" fn vkCmdSetEvent2(
    commands: vk::CommandBuffer,
    event: vk::Event,
    _info: *const vk::DependencyInfo,
) {
    record("vkCmdSetEvent2", commands, move |commands| {
        commands.push(Command::SetEvent(handle::retain(event)))
    })
}

pub(crate) unsafe extern "system" fn vkCmdResetEvent(
    commands: vk::CommandBuffer,
    event: vk::Event,
    _stages: vk::PipelineStageFlags,
) {
    record("vkCmdResetEvent", commands, move |commands| {
        commands.push(Command::ResetEvent(handle::retain(event)))
    })
}

pub(crate) unsafe extern "system" fn vkCmdResetEvent2(
    commands: vk::CommandBuffer,
    event: vk::Event,
    _stages: vk::PipelineStageFlags2,
) {
    record("vkCmdResetEvent2", commands, move |commands| {
        commands.push(Command::ResetEvent(handle::retain(event)))
    })
}

pub(crate) unsafe extern "system" fn vkCmdWaitEvents(
    commands: vk::CommandBuffer,
    event_count: u32,
    events: *const vk::Event,
    _source_stages: vk::PipelineStageFlags,
    _destination_stages: vk::PipelineStageFlags,
    _memory_count: u32,
    _memory: *const vk::MemoryBarrier,
    _buffer_count: u32,
    _buffers: *const vk::BufferMemoryBarrier,
    _image_count: u32,
    _images: *const vk::ImageMemoryBarrier,
) {
    record("vkCmdWaitEvents", commands, move |commands| {
        let events = copied(ffi::slice(events, event_count), |&event| {
            handle::retain::<Event>(event)
        })?;
        commands.push(Command::WaitEvents(events))?;
        barrier(commands, vk::PipelineStageFlags2::ALL_COMMANDS)
    })
}

pub(crate) unsafe extern "system" fn vkCmdWaitEvents2(
    commands: vk::CommandBuffer,
    event_count: u32,
    events: *const vk::Event,
    _infos: *const vk::DependencyInfo,
) {
    record("vkCmdWaitEvents2", commands, move |commands| {
        let events = copied(ffi::slice(events, event_count), |&event| {
            handle::retain::<Event>(event)
        })?;
        commands.push(Command::WaitEvents(events))?;
        barrier(commands, vk::PipelineStageFlags2::ALL_COMMANDS)
    })
}

/// Labels are for tools between the application and the driver, and for the timeline.
pub(crate) unsafe extern "system" fn vkCmdBeginDebugUtilsLabelEXT(
    commands: vk::CommandBuffer,
    label: *const vk::DebugUtilsLabelEXT,
) {
    record("vkCmdBeginDebugUtilsLabelEXT", commands, move |commands| {
        mark(commands, || Mark::Begin(label_text(label)))
    })
}

pub(crate) unsafe extern "system" fn vkCmdEndDebugUtilsLabelEXT(commands: vk::CommandBuffer) {
    record("vkCmdEndDebugUtilsLabelEXT", commands, move |commands| {
        mark(commands, || Mark::End)
    })
}

pub(crate) unsafe extern "system" fn vkCmdInsertDebugUtilsLabelEXT(
    commands: vk::CommandBuffer,
    label: *const vk::DebugUtilsLabelEXT,
) {
    record("vkCmdInsertDebugUtilsLabelEXT", commands, move |commands| {
        mark(commands, || Mark::Insert(label_text(label)))
    })
}
