//! Query pools.

use std::ffi::c_void;

use ash::vk;

use super::destroy;
use crate::execute::query::write_results;
use crate::ffi::entry;
use crate::handle::{self, from_handle};
use crate::object::{Device, QueryPool};

destroy! {
    vkDestroyQueryPool: QueryPool, QueryPool;
}

entry! {
    fn vkCreateQueryPool(
        _device: vk::Device,
        info: *const vk::QueryPoolCreateInfo,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::QueryPool,
    ) -> vk::Result {
        *out = handle::create(QueryPool::new((*info).query_type, (*info).query_count));
        Ok(())
    }

    fn vkGetQueryPoolResults(
        device: vk::Device,
        pool: vk::QueryPool,
        first: u32,
        count: u32,
        _size: usize,
        data: *mut c_void,
        stride: vk::DeviceSize,
        flags: vk::QueryResultFlags,
    ) -> vk::Result {
        let device = from_handle::<Device>(device);
        let pool = from_handle::<QueryPool>(pool);
        let complete = write_results(pool, &device.waiting, first, count, data.cast(), stride, flags);
        device.waiting.lost.check()?;
        if complete { Ok(()) } else { Err(vk::Result::NOT_READY) }
    }

    fn vkResetQueryPool(_device: vk::Device, pool: vk::QueryPool, first: u32, count: u32) {
        from_handle::<QueryPool>(pool).reset(first, count);
    }
}
