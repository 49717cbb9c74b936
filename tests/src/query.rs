//! Queries.

use ash::vk;

use crate::gpu::Made;
use crate::{Gpu, Structure};

impl Gpu {
    /// A query pool that is destroyed at the end.
    pub fn query_pool(&self, info: &vk::QueryPoolCreateInfo<'_>) -> vk::QueryPool {
        // SAFETY: the info outlives the call.
        let pool = unsafe { self.device.create_query_pool(info, None) };
        let pool = pool.expect("vkCreateQueryPool");
        self.keep(Made::QueryPool(pool));
        pool
    }

    /// The same of so many queries.
    pub fn queries(&self, ty: vk::QueryType, count: u32) -> vk::QueryPool {
        let info = vk::QueryPoolCreateInfo::default().query_type(ty);
        self.query_pool(&info.query_count(count))
    }

    /// Waits for results, from a query on.
    pub fn query_results<T: Copy + Default, const COUNT: usize>(
        &self,
        pool: vk::QueryPool,
        first: u32,
    ) -> [T; COUNT] {
        let mut results = [T::default(); COUNT];
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
        // SAFETY: the pool is of this device.
        let done =
            unsafe { (self.device).get_query_pool_results(pool, first, &mut results, flags) };
        done.expect("vkGetQueryPoolResults");
        results
    }

    /// Runs commands that write query 0 of a pool, and reads it.
    pub fn query(
        &self,
        ty: vk::QueryType,
        record: impl FnOnce(vk::CommandBuffer, vk::QueryPool),
    ) -> u64 {
        let pool = self.queries(ty, 1);
        self.run(|commands| {
            // SAFETY: the command buffer is being recorded.
            unsafe { self.device.cmd_reset_query_pool(commands, pool, 0, 1) };
            record(commands, pool);
        });
        let [result] = self.query_results(pool, 0);
        result
    }

    /// Records that a property of a structure is written to query 0 of a pool.
    pub fn record_property(
        &self,
        commands: vk::CommandBuffer,
        structure: Structure,
        ty: vk::QueryType,
        pool: vk::QueryPool,
    ) {
        let structures = [structure.handle];
        // SAFETY: the command buffer is being recorded, and the handles are of this device.
        unsafe {
            (self.acceleration).cmd_write_acceleration_structures_properties(
                commands,
                &structures,
                ty,
                pool,
                0,
            );
        }
    }

    /// A property of a structure, by a query on the device.
    pub fn property(&self, structure: Structure, ty: vk::QueryType) -> u64 {
        self.query(ty, |commands, pool| {
            self.record_property(commands, structure, ty, pool);
        })
    }
}
