//! Command pools and buffers; commands on state, dispatches, synchronisation and queries.

use std::ffi::c_void;
use std::sync::Arc;

use ash::vk;
use smallvec::SmallVec;

use super::descriptor_set::{apply_template, apply_write};
use crate::VkResult;
use crate::command::{Command, CommandBuffer, CommandPool, Recording};
use crate::ffi::{self, array, commands, entry};
use crate::handle::{self, Ref, from_handle, retain};
use crate::object::{
    Buffer, DescriptorSet, DescriptorUpdateTemplate, Event, Pipeline, PipelineLayout, QueryPool,
};
use crate::table::limits::MAX_PUSH_CONSTANTS_BYTES;

entry! {
    fn vkCreateCommandPool(
        _device: vk::Device,
        _info: *const vk::CommandPoolCreateInfo,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::CommandPool,
    ) -> vk::Result {
        *out = handle::create(CommandPool::default());
        Ok(())
    }

    fn vkDestroyCommandPool(_device: vk::Device, pool: vk::CommandPool, _allocator: *const vk::AllocationCallbacks) {
        if let Some(pool) = handle::take::<CommandPool>(pool) {
            for buffer in pool.take_all() {
                drop(handle::take::<CommandBuffer>(buffer));
            }
        }
    }

    fn vkResetCommandPool(
        _device: vk::Device,
        pool: vk::CommandPool,
        _flags: vk::CommandPoolResetFlags,
    ) -> vk::Result {
        for buffer in from_handle::<CommandPool>(pool).all() {
            from_handle::<CommandBuffer>(buffer).recording.lock().reset();
        }
        Ok(())
    }

    fn vkTrimCommandPool(_device: vk::Device, _pool: vk::CommandPool, _flags: vk::CommandPoolTrimFlags) {
        // Command buffers own their memory; the pool holds none to give back.
    }

    fn vkAllocateCommandBuffers(
        _device: vk::Device,
        info: *const vk::CommandBufferAllocateInfo,
        out: *mut vk::CommandBuffer,
    ) -> vk::Result {
        let info = &*info;
        let pool = from_handle::<CommandPool>(info.command_pool);
        for out in array::slice_mut(out, info.command_buffer_count) {
            *out = handle::create(CommandBuffer::new(info.level));
            pool.insert(*out);
        }
        Ok(())
    }

    fn vkFreeCommandBuffers(
        _device: vk::Device,
        pool: vk::CommandPool,
        count: u32,
        buffers: *const vk::CommandBuffer,
    ) {
        let pool = from_handle::<CommandPool>(pool);
        for &buffer in ffi::slice(buffers, count) {
            if pool.remove(buffer) {
                drop(handle::take::<CommandBuffer>(buffer));
            }
        }
    }

    fn vkBeginCommandBuffer(buffer: vk::CommandBuffer, _info: *const vk::CommandBufferBeginInfo) -> vk::Result {
        from_handle::<CommandBuffer>(buffer).recording.lock().reset();
        Ok(())
    }

    fn vkEndCommandBuffer(buffer: vk::CommandBuffer) -> vk::Result {
        from_handle::<CommandBuffer>(buffer).recording.lock().result
    }

    fn vkResetCommandBuffer(buffer: vk::CommandBuffer, _flags: vk::CommandBufferResetFlags) -> vk::Result {
        from_handle::<CommandBuffer>(buffer).recording.lock().reset();
        Ok(())
    }
}

/// Records a push descriptor update: the set is a new one each time, so that commands recorded before keep theirs.
fn push_descriptors(
    recording: &mut Recording,
    bind_point: vk::PipelineBindPoint,
    layout: Ref<PipelineLayout>,
    set: u32,
    update: impl FnOnce(&DescriptorSet),
) -> VkResult {
    let set_layout = layout
        .sets
        .get(set as usize)
        .and_then(Option::as_ref)
        .ok_or(vk::Result::ERROR_UNKNOWN)?;
    let pushed = recording.pushed_set(bind_point, set, set_layout)?;
    update(&pushed);
    recording.push(Command::BindDescriptorSets {
        bind_point,
        layout,
        first_set: set,
        sets: SmallVec::from_elem(Some(pushed), 1),
        dynamic_offsets: SmallVec::new(),
    });
    Ok(())
}

commands! {
    fn vkCmdBindPipeline(recording, _bind_point: vk::PipelineBindPoint, pipeline: vk::Pipeline) {
        recording.push(Command::BindPipeline(retain::<Pipeline>(pipeline)));
        Ok(())
    }

    fn vkCmdBindDescriptorSets(
        recording,
        bind_point: vk::PipelineBindPoint,
        layout: vk::PipelineLayout,
        first_set: u32,
        count: u32,
        sets: *const vk::DescriptorSet,
        offset_count: u32,
        offsets: *const u32,
    ) {
        let sets = ffi::slice(sets, count).iter();
        recording.push(Command::BindDescriptorSets {
            bind_point,
            layout: retain::<PipelineLayout>(layout),
            first_set,
            sets: sets.map(|&set| (set != vk::DescriptorSet::null()).then(|| retain::<DescriptorSet>(set))).collect(),
            dynamic_offsets: SmallVec::from_slice(ffi::slice(offsets, offset_count)),
        });
        Ok(())
    }

    fn vkCmdPushConstants(
        recording,
        _layout: vk::PipelineLayout,
        _stages: vk::ShaderStageFlags,
        offset: u32,
        size: u32,
        values: *const c_void,
    ) {
        if offset.checked_add(size).is_none_or(|end| end > MAX_PUSH_CONSTANTS_BYTES) {
            return Err(vk::Result::ERROR_UNKNOWN);
        }
        let bytes = SmallVec::from_slice(ffi::slice(values.cast::<u8>(), size));
        recording.push(Command::PushConstants { offset, bytes });
        Ok(())
    }

    fn vkCmdPushDescriptorSetKHR(
        recording,
        bind_point: vk::PipelineBindPoint,
        layout: vk::PipelineLayout,
        set: u32,
        count: u32,
        writes: *const vk::WriteDescriptorSet,
    ) {
        push_descriptors(recording, bind_point, retain::<PipelineLayout>(layout), set, |pushed| {
            for write in ffi::slice(writes, count) {
                apply_write(pushed, write);
            }
        })
    }

    fn vkCmdPushDescriptorSetWithTemplateKHR(
        recording,
        template: vk::DescriptorUpdateTemplate,
        layout: vk::PipelineLayout,
        set: u32,
        data: *const c_void,
    ) {
        let template = from_handle::<DescriptorUpdateTemplate>(template);
        push_descriptors(recording, template.bind_point, retain::<PipelineLayout>(layout), set, |pushed| {
            apply_template(pushed, template, data);
        })
    }

    fn vkCmdDispatch(recording, x: u32, y: u32, z: u32) {
        recording.push(Command::Dispatch { base: [0; 3], count: [x, y, z] });
        Ok(())
    }

    fn vkCmdDispatchBase(recording, base_x: u32, base_y: u32, base_z: u32, x: u32, y: u32, z: u32) {
        recording.push(Command::Dispatch { base: [base_x, base_y, base_z], count: [x, y, z] });
        Ok(())
    }

    fn vkCmdDispatchIndirect(recording, buffer: vk::Buffer, offset: vk::DeviceSize) {
        let size_bytes = size_of::<vk::DispatchIndirectCommand>() as u64;
        let (address, _) = from_handle::<Buffer>(buffer).range(offset, size_bytes)?;
        recording.push(Command::DispatchIndirect { address: address as u64 });
        Ok(())
    }

    fn vkCmdSetDeviceMask(recording, _mask: u32) {
        // The device group has one device.
        let _ = recording;
        Ok(())
    }

    fn vkCmdPipelineBarrier(
        recording,
        _source: vk::PipelineStageFlags,
        _destination: vk::PipelineStageFlags,
        _flags: vk::DependencyFlags,
        _memory_count: u32,
        _memory: *const vk::MemoryBarrier,
        _buffer_count: u32,
        _buffers: *const vk::BufferMemoryBarrier,
        _image_count: u32,
        _images: *const vk::ImageMemoryBarrier,
    ) {
        // Commands run one after the other over coherent memory (see `execute`).
        let _ = recording;
        Ok(())
    }

    fn vkCmdPipelineBarrier2(recording, _info: *const vk::DependencyInfo) {
        let _ = recording;
        Ok(())
    }

    fn vkCmdSetEvent(recording, event: vk::Event, _stages: vk::PipelineStageFlags) {
        recording.push(Command::SetEvent(retain::<Event>(event)));
        Ok(())
    }

    fn vkCmdSetEvent2(recording, event: vk::Event, _info: *const vk::DependencyInfo) {
        recording.push(Command::SetEvent(retain::<Event>(event)));
        Ok(())
    }

    fn vkCmdResetEvent(recording, event: vk::Event, _stages: vk::PipelineStageFlags) {
        recording.push(Command::ResetEvent(retain::<Event>(event)));
        Ok(())
    }

    fn vkCmdResetEvent2(recording, event: vk::Event, _stages: vk::PipelineStageFlags2) {
        recording.push(Command::ResetEvent(retain::<Event>(event)));
        Ok(())
    }

    fn vkCmdWaitEvents(
        recording,
        count: u32,
        events: *const vk::Event,
        _source: vk::PipelineStageFlags,
        _destination: vk::PipelineStageFlags,
        _memory_count: u32,
        _memory: *const vk::MemoryBarrier,
        _buffer_count: u32,
        _buffers: *const vk::BufferMemoryBarrier,
        _image_count: u32,
        _images: *const vk::ImageMemoryBarrier,
    ) {
        let events = ffi::slice(events, count).iter().map(|&event| retain::<Event>(event)).collect();
        recording.push(Command::WaitEvents(events));
        Ok(())
    }

    fn vkCmdWaitEvents2(recording, count: u32, events: *const vk::Event, _infos: *const vk::DependencyInfo) {
        let events = ffi::slice(events, count).iter().map(|&event| retain::<Event>(event)).collect();
        recording.push(Command::WaitEvents(events));
        Ok(())
    }

    fn vkCmdResetQueryPool(recording, pool: vk::QueryPool, first: u32, count: u32) {
        recording.push(Command::ResetQueryPool { pool: retain::<QueryPool>(pool), first, count });
        Ok(())
    }

    fn vkCmdWriteTimestamp(recording, _stage: vk::PipelineStageFlags, pool: vk::QueryPool, query: u32) {
        recording.push(Command::WriteTimestamp { pool: retain::<QueryPool>(pool), query });
        Ok(())
    }

    fn vkCmdWriteTimestamp2(recording, _stage: vk::PipelineStageFlags2, pool: vk::QueryPool, query: u32) {
        recording.push(Command::WriteTimestamp { pool: retain::<QueryPool>(pool), query });
        Ok(())
    }

    fn vkCmdCopyQueryPoolResults(
        recording,
        pool: vk::QueryPool,
        first: u32,
        count: u32,
        buffer: vk::Buffer,
        offset: vk::DeviceSize,
        stride: vk::DeviceSize,
        flags: vk::QueryResultFlags,
    ) {
        let words = 1 + u64::from(flags.contains(vk::QueryResultFlags::WITH_AVAILABILITY));
        let word_bytes = if flags.contains(vk::QueryResultFlags::TYPE_64) { 8 } else { 4 };
        let size_bytes = u64::from(count.saturating_sub(1))
            .checked_mul(stride)
            .and_then(|bytes| bytes.checked_add(words * word_bytes))
            .ok_or(vk::Result::ERROR_UNKNOWN)?;
        let (address, _) = from_handle::<Buffer>(buffer).range(offset, size_bytes)?;
        recording.push(Command::CopyQueryPoolResults {
            pool: retain::<QueryPool>(pool),
            first,
            count,
            address: address as u64,
            stride_bytes: stride,
            flags,
        });
        Ok(())
    }

    fn vkCmdExecuteCommands(recording, count: u32, buffers: *const vk::CommandBuffer) {
        let buffers = ffi::slice(buffers, count).iter();
        recording.push(Command::ExecuteCommands(
            buffers.map(|&buffer| Arc::clone(&from_handle::<CommandBuffer>(buffer).recording.lock().commands)).collect(),
        ));
        Ok(())
    }
}
