//! Query pools.

#![forbid(unsafe_code)]

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use ash::vk;

use super::sync::Waiting;
use crate::VkResult;

/// A query pool: one 64-bit value a query, and whether it is there.
pub struct QueryPool {
    pub ty: vk::QueryType,
    queries: Vec<Query>,
    waiting: Arc<Waiting>,
}

#[derive(Default)]
struct Query {
    value: AtomicU64,
    available: AtomicBool,
}

impl QueryPool {
    /// A pool of reset queries.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY`.
    pub fn new(ty: vk::QueryType, count: u32, waiting: Arc<Waiting>) -> VkResult<Self> {
        let mut queries = Vec::new();
        queries
            .try_reserve_exact(count as usize)
            .map_err(|_| vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
        queries.resize_with(count as usize, Query::default);
        Ok(Self {
            ty,
            queries,
            waiting,
        })
    }

    /// How many queries there are.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> u32 {
        self.queries.len() as u32
    }

    /// The value of a query, if it is available.
    pub fn value(&self, index: u32) -> Option<u64> {
        let query = self.queries.get(index as usize)?;
        query
            .available
            .load(Ordering::Acquire)
            .then(|| query.value.load(Ordering::Relaxed))
    }

    /// Stores a result and makes it available.
    pub fn write(&self, index: u32, value: u64) {
        if let Some(query) = self.queries.get(index as usize) {
            query.value.store(value, Ordering::Relaxed);
            query.available.store(true, Ordering::Release);
            self.waiting.notify();
        }
    }

    /// Makes queries unavailable.
    pub fn reset(&self, first: u32, count: u32) {
        let queries = self.queries.iter().skip(first as usize);
        for query in queries.take(count as usize) {
            query.available.store(false, Ordering::Release);
        }
    }

    /// Waits until the queries are available. Those past the end are not waited for.
    ///
    /// # Errors
    /// `VK_ERROR_DEVICE_LOST`.
    pub fn wait(&self, first: u32, count: u32) -> VkResult {
        let end = first.saturating_add(count).min(self.queries.len() as u32);
        self.waiting.wait_until(u64::MAX, || {
            (first..end).all(|index| self.value(index).is_some())
        })
    }

    /// The words that `vkGetQueryPoolResults` and `vkCmdCopyQueryPoolResults` write for a query: its value, where there is one or a
    /// partial one will do, then its availability if that is asked for. `None` stands for memory that is left alone.
    pub fn result_words(&self, index: u32, flags: vk::QueryResultFlags) -> [Option<u64>; 2] {
        let value = self.value(index);
        let result = match value {
            None if flags.contains(vk::QueryResultFlags::PARTIAL) => Some(0),
            value => value,
        };
        let availability = flags
            .contains(vk::QueryResultFlags::WITH_AVAILABILITY)
            .then_some(u64::from(value.is_some()));
        [result, availability]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vk::QueryResultFlags as Flags;

    #[test]
    fn results_follow_the_flags() {
        let pool = QueryPool::new(vk::QueryType::TIMESTAMP, 2, Arc::default())
            .ok()
            .unwrap();
        pool.write(1, 77);
        pool.write(9, 1);
        assert_eq!(pool.result_words(0, Flags::empty()), [None, None]);
        assert_eq!(pool.result_words(0, Flags::PARTIAL), [Some(0), None]);
        assert_eq!(
            pool.result_words(0, Flags::WITH_AVAILABILITY),
            [None, Some(0)]
        );
        assert_eq!(
            pool.result_words(1, Flags::WITH_AVAILABILITY),
            [Some(77), Some(1)]
        );
        assert!(pool.wait(1, 1).is_ok());
        pool.reset(1, 1);
        assert_eq!(pool.value(1), None);
    }
}
