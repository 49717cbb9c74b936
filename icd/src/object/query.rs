//! Query pools.

#![forbid(unsafe_code)]

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use ash::vk;
use smallvec::SmallVec;

use super::sync::Waiting;
use crate::VkResult;

/// A query pool: the 64-bit values of each query and their availability.
pub struct QueryPool {
    pub ty: vk::QueryType,
    /// Pipeline statistics: one counter for each bit, in the order of the bits.
    pub statistics: vk::QueryPipelineStatisticFlags,
    /// The values of all queries, one query after the other.
    values: Vec<AtomicU64>,
    available: Vec<AtomicBool>,
    waiting: Arc<Waiting>,
}

fn columns(ty: vk::QueryType, statistics: vk::QueryPipelineStatisticFlags) -> usize {
    match ty {
        vk::QueryType::TRANSFORM_FEEDBACK_STREAM_EXT => 2,
        _ => statistics.as_raw().count_ones().max(1) as usize,
    }
}

impl QueryPool {
    /// Creates a pool of reset queries.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY`.
    pub fn new(
        ty: vk::QueryType,
        statistics: vk::QueryPipelineStatisticFlags,
        count: u32,
        waiting: Arc<Waiting>,
    ) -> VkResult<Self> {
        let statistics = match ty {
            vk::QueryType::PIPELINE_STATISTICS => statistics,
            _ => vk::QueryPipelineStatisticFlags::empty(),
        };
        let columns = columns(ty, statistics);
        let (mut values, mut available) = (Vec::new(), Vec::new());
        let too_many = |_| vk::Result::ERROR_OUT_OF_HOST_MEMORY;
        let total = (count as usize).saturating_mul(columns);
        values.try_reserve_exact(total).map_err(too_many)?;
        available
            .try_reserve_exact(count as usize)
            .map_err(too_many)?;
        values.resize_with(total, AtomicU64::default);
        available.resize_with(count as usize, AtomicBool::default);
        Ok(Self {
            ty,
            statistics,
            values,
            available,
            waiting,
        })
    }

    /// The number of queries.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> u32 {
        self.available.len() as u32
    }

    /// The number of values of a query.
    pub fn columns(&self) -> usize {
        columns(self.ty, self.statistics)
    }

    /// The first value of a query, if it is available.
    pub fn value(&self, index: u32) -> Option<u64> {
        self.column(index, 0)
    }

    /// A value of a query, if it is available.
    fn column(&self, index: u32, column: usize) -> Option<u64> {
        let available = self.available.get(index as usize)?.load(Ordering::Acquire);
        let value = self.values.get(index as usize * self.columns() + column)?;
        available.then(|| value.load(Ordering::Relaxed))
    }

    /// Stores a result of one value and makes it available.
    pub fn write(&self, index: u32, value: u64) {
        self.write_all(index, &[value]);
    }

    /// Stores the values of a result and makes it available.
    pub fn write_all(&self, index: u32, values: &[u64]) {
        if let Some(available) = self.available.get(index as usize) {
            let columns = self.values.chunks(self.columns()).nth(index as usize);
            for (place, &value) in columns.into_iter().flatten().zip(values) {
                place.store(value, Ordering::Relaxed);
            }
            available.store(true, Ordering::Release);
            self.waiting.notify();
        }
    }

    /// Makes queries unavailable.
    pub fn reset(&self, first: u32, count: u32) {
        let queries = self.available.iter().skip(first as usize);
        for available in queries.take(count as usize) {
            available.store(false, Ordering::Release);
        }
    }

    /// Waits until the queries are available. Queries past the end are ignored.
    ///
    /// # Errors
    /// `VK_ERROR_DEVICE_LOST`.
    pub fn wait(&self, first: u32, count: u32) -> VkResult {
        (self.waiting).wait_until(u64::MAX, || self.is_available(first, count))
    }

    /// Whether the existing queries of a range are available.
    pub fn is_available(&self, first: u32, count: u32) -> bool {
        let end = first.saturating_add(count).min(self.len());
        (first..end).all(|index| self.value(index).is_some())
    }

    /// The words that `vkGetQueryPoolResults` and `vkCmdCopyQueryPoolResults` write for a query:
    /// its values, if they are available or partial values are allowed, then its availability if
    /// requested. `None` means that the memory is not written.
    pub fn result_words(
        &self,
        index: u32,
        flags: vk::QueryResultFlags,
    ) -> SmallVec<[Option<u64>; 2]> {
        let result = |column| match self.column(index, column) {
            None if flags.contains(vk::QueryResultFlags::PARTIAL) => Some(0),
            value => value,
        };
        let mut words: SmallVec<[Option<u64>; 2]> = (0..self.columns()).map(result).collect();
        if flags.contains(vk::QueryResultFlags::WITH_AVAILABILITY) {
            words.push(Some(u64::from(self.value(index).is_some())));
        }
        words
    }

    /// The number of words of a query's result, with its availability if requested.
    pub fn result_columns(&self, flags: vk::QueryResultFlags) -> u64 {
        let availability = flags.contains(vk::QueryResultFlags::WITH_AVAILABILITY);
        self.columns() as u64 + u64::from(availability)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vk::QueryResultFlags as Flags;

    #[test]
    fn results_follow_the_flags() {
        let pool = QueryPool::new(
            vk::QueryType::TIMESTAMP,
            Default::default(),
            2,
            Arc::default(),
        )
        .ok()
        .unwrap();
        pool.write(1, 77);
        pool.write(9, 1);
        assert_eq!(pool.result_words(0, Flags::empty()).to_vec(), [None]);
        assert_eq!(pool.result_words(0, Flags::PARTIAL).to_vec(), [Some(0)]);
        assert_eq!(
            pool.result_words(0, Flags::WITH_AVAILABILITY).to_vec(),
            [None, Some(0)]
        );
        assert_eq!(
            pool.result_words(1, Flags::WITH_AVAILABILITY).to_vec(),
            [Some(77), Some(1)]
        );
        assert!(pool.wait(1, 1).is_ok());
        pool.reset(1, 1);
        assert_eq!(pool.value(1), None);
    }

    #[test]
    fn statistics_have_a_value_each() {
        use vk::QueryPipelineStatisticFlags as Statistic;
        let both = Statistic::VERTEX_SHADER_INVOCATIONS | Statistic::FRAGMENT_SHADER_INVOCATIONS;
        let pool = QueryPool::new(vk::QueryType::PIPELINE_STATISTICS, both, 2, Arc::default());
        let pool = pool.ok().unwrap();
        pool.write_all(1, &[5, 6]);
        assert_eq!(
            pool.result_words(1, Flags::empty()).to_vec(),
            [Some(5), Some(6)]
        );
        assert_eq!(pool.result_words(0, Flags::empty()).to_vec(), [None, None]);
        assert_eq!(pool.result_columns(Flags::WITH_AVAILABILITY), 3);
    }
}
