//! Query pools.

use std::sync::Arc;

use ash::vk;

use super::record::record;
use crate::command::{Command, CopyQueryPoolResults};
use crate::device::Device;
use crate::execute::write_results;
use crate::guard::{guard, guard_result};
use crate::handle;
use crate::object::{Buffer, QueryPool};

pub(crate) unsafe extern "system" fn vkCreateQueryPool(
    device: vk::Device,
    info: *const vk::QueryPoolCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::QueryPool,
) -> vk::Result {
    guard_result("vkCreateQueryPool", move || {
        let waiting = Arc::clone(&handle::from_handle::<Device>(device).engine.waiting);
        let info = &*info;
        *out = handle::create(QueryPool::new(
            info.query_type,
            info.pipeline_statistics,
            info.query_count,
            waiting,
        )?);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkDestroyQueryPool(
    _device: vk::Device,
    pool: vk::QueryPool,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyQueryPool", move || {
        drop(handle::take::<QueryPool>(pool));
    })
}

pub(crate) unsafe extern "system" fn vkResetQueryPool(
    _device: vk::Device,
    pool: vk::QueryPool,
    first: u32,
    count: u32,
) {
    guard("vkResetQueryPool", move || {
        handle::from_handle::<QueryPool>(pool).reset(first, count);
    })
}

pub(crate) unsafe extern "system" fn vkGetQueryPoolResults(
    _device: vk::Device,
    pool: vk::QueryPool,
    first: u32,
    count: u32,
    size_bytes: usize,
    out: *mut std::ffi::c_void,
    stride_bytes: vk::DeviceSize,
    flags: vk::QueryResultFlags,
) -> vk::Result {
    guard_result("vkGetQueryPoolResults", move || {
        let pool = handle::from_handle::<QueryPool>(pool);
        if flags.contains(vk::QueryResultFlags::WAIT) {
            pool.wait(first, count)?;
        }
        let queries = first..first.saturating_add(count).min(pool.len()).max(first);
        let all_available = write_results(
            pool,
            queries,
            (out.cast(), size_bytes as u64),
            stride_bytes,
            flags,
        );
        if all_available {
            Ok(())
        } else {
            Err(vk::Result::NOT_READY)
        }
    })
}

pub(crate) unsafe extern "system" fn vkCmdResetQueryPool(
    commands: vk::CommandBuffer,
    pool: vk::QueryPool,
    first: u32,
    count: u32,
) {
    record("vkCmdResetQueryPool", commands, move |commands| {
        let pool = handle::retain::<QueryPool>(pool);
        commands.push(Command::ResetQueryPool { pool, first, count })
    })
}

/// Commands of a queue run one after the other, so the stage does not matter for a timestamp.
pub(crate) unsafe extern "system" fn vkCmdWriteTimestamp(
    commands: vk::CommandBuffer,
    _stage: vk::PipelineStageFlags,
    pool: vk::QueryPool,
    query: u32,
) {
    record("vkCmdWriteTimestamp", commands, move |commands| {
        let pool = handle::retain::<QueryPool>(pool);
        commands.push(Command::WriteTimestamp { pool, query })
    })
}

pub(crate) unsafe extern "system" fn vkCmdWriteTimestamp2(
    commands: vk::CommandBuffer,
    _stage: vk::PipelineStageFlags2,
    pool: vk::QueryPool,
    query: u32,
) {
    record("vkCmdWriteTimestamp2", commands, move |commands| {
        let pool = handle::retain::<QueryPool>(pool);
        commands.push(Command::WriteTimestamp { pool, query })
    })
}

pub(crate) unsafe extern "system" fn vkCmdCopyQueryPoolResults(
    commands: vk::CommandBuffer,
    pool: vk::QueryPool,
    first: u32,
    count: u32,
    buffer: vk::Buffer,
    offset: vk::DeviceSize,
    stride_bytes: vk::DeviceSize,
    flags: vk::QueryResultFlags,
) {
    record("vkCmdCopyQueryPoolResults", commands, move |commands| {
        let word_bytes = if flags.contains(vk::QueryResultFlags::TYPE_64) {
            8
        } else {
            4
        };
        let words = handle::from_handle::<QueryPool>(pool).result_columns(flags);
        let size_bytes = u64::from(count.saturating_sub(1))
            .saturating_mul(stride_bytes)
            .saturating_add(words * word_bytes);
        let (address, _) = handle::from_handle::<Buffer>(buffer).range(offset, size_bytes)?;
        commands.push(Command::CopyQueryPoolResults(CopyQueryPoolResults {
            pool: handle::retain(pool),
            first,
            count,
            address: address as u64,
            stride_bytes,
            flags,
        }))
    })
}
