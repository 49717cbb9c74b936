//! Query pools.

#![forbid(unsafe_code)]

use std::sync::atomic::{AtomicU64, Ordering};

use ash::vk;

/// A query pool: one 64-bit value a query, and whether it is there.
pub struct QueryPool {
    pub ty: vk::QueryType,
    queries: Vec<Query>,
}

#[derive(Default)]
struct Query {
    value: AtomicU64,
    available: AtomicU64,
}

impl QueryPool {
    /// A pool of reset queries.
    pub fn new(ty: vk::QueryType, count: u32) -> Self {
        Self {
            ty,
            queries: (0..count).map(|_| Query::default()).collect(),
        }
    }

    /// The value of a query, if it is available.
    pub fn value(&self, index: u32) -> Option<u64> {
        let query = self.queries.get(index as usize)?;
        (query.available.load(Ordering::Acquire) != 0).then(|| query.value.load(Ordering::Relaxed))
    }

    /// Stores a result.
    pub fn write(&self, index: u32, value: u64) {
        if let Some(query) = self.queries.get(index as usize) {
            query.value.store(value, Ordering::Relaxed);
            query.available.store(1, Ordering::Release);
        }
    }

    /// Makes queries unavailable.
    pub fn reset(&self, first: u32, count: u32) {
        for query in self
            .queries
            .iter()
            .skip(first as usize)
            .take(count as usize)
        {
            query.available.store(0, Ordering::Release);
        }
    }
}
