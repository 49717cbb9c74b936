//! Timestamps, and query results written by the device.

use crate::command::CopyQueryPoolResults;
use crate::object::QueryPool;
use crate::os::clock::Clock;
use crate::raster::Counters;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ash::vk;
use smallvec::SmallVec;
use spirv_jit::reach::Reach;

/// The current time in nanoseconds of `CLOCK_MONOTONIC`: `timestampPeriod` is 1, and the device
/// uses the host's time domain.
pub fn timestamp_ns() -> u64 {
    Clock::Monotonic.now_ns()
}

/// A query that has begun and not ended.
pub struct ActiveQuery<'a> {
    pub pool: &'a QueryPool,
    pub query: u32,
    /// The counters of draws.
    pub counters: Arc<Counters>,
    pub compute_invocations: u64,
}

fn read(counter: &AtomicU64) -> u64 {
    counter.load(Ordering::Relaxed)
}

impl<'a> ActiveQuery<'a> {
    /// `stream` is the vertex stream of a query that counts primitives.
    pub fn new(pool: &'a QueryPool, query: u32, stream: u32) -> Self {
        Self {
            pool,
            query,
            counters: Arc::new(Counters {
                stream,
                ..Counters::default()
            }),
            compute_invocations: 0,
        }
    }

    /// All pipeline statistics, in the order of their bits.
    fn statistics(&self) -> [(vk::QueryPipelineStatisticFlags, u64); 13] {
        use vk::QueryPipelineStatisticFlags as Statistic;
        let counters = &*self.counters;
        [
            (
                Statistic::INPUT_ASSEMBLY_VERTICES,
                read(&counters.input_vertices),
            ),
            (
                Statistic::INPUT_ASSEMBLY_PRIMITIVES,
                read(&counters.input_primitives),
            ),
            (
                Statistic::VERTEX_SHADER_INVOCATIONS,
                read(&counters.vertex_invocations),
            ),
            (
                Statistic::GEOMETRY_SHADER_INVOCATIONS,
                read(&counters.geometry_invocations),
            ),
            (
                Statistic::GEOMETRY_SHADER_PRIMITIVES,
                read(&counters.geometry_primitives),
            ),
            (
                Statistic::CLIPPING_INVOCATIONS,
                read(&counters.clipping_invocations),
            ),
            (
                Statistic::CLIPPING_PRIMITIVES,
                read(&counters.clipping_primitives),
            ),
            (
                Statistic::FRAGMENT_SHADER_INVOCATIONS,
                read(&counters.fragment_invocations),
            ),
            (
                Statistic::TESSELLATION_CONTROL_SHADER_PATCHES,
                read(&counters.control_patches),
            ),
            (
                Statistic::TESSELLATION_EVALUATION_SHADER_INVOCATIONS,
                read(&counters.evaluation_invocations),
            ),
            (
                Statistic::COMPUTE_SHADER_INVOCATIONS,
                self.compute_invocations,
            ),
            (
                Statistic::TASK_SHADER_INVOCATIONS_EXT,
                read(&counters.task_invocations),
            ),
            (
                Statistic::MESH_SHADER_INVOCATIONS_EXT,
                read(&counters.mesh_invocations),
            ),
        ]
    }

    /// Makes the result available. In a pass with views it fills one query for each view: the first
    /// with the sum, the others with zeros (chapter Queries, "Query Operation").
    pub fn end(&self, views: u32) {
        let counters = &*self.counters;
        let values: SmallVec<[u64; 13]> = match self.pool.ty {
            vk::QueryType::PIPELINE_STATISTICS => self
                .statistics()
                .iter()
                .filter(|(bit, _)| self.pool.statistics.contains(*bit))
                .map(|&(_, value)| value)
                .collect(),
            vk::QueryType::TRANSFORM_FEEDBACK_STREAM_EXT => {
                SmallVec::from_slice(&[read(&counters.written), read(&counters.needed)])
            }
            vk::QueryType::PRIMITIVES_GENERATED_EXT => {
                SmallVec::from_slice(&[read(&counters.generated)])
            }
            vk::QueryType::MESH_PRIMITIVES_GENERATED_EXT => {
                SmallVec::from_slice(&[read(&counters.mesh_primitives)])
            }
            _ => SmallVec::from_slice(&[read(&counters.samples)]),
        };
        self.pool.write_all(self.query, &values);
        for view in 1..views {
            let zeros = SmallVec::<[u64; 13]>::from_elem(0, values.len());
            self.pool.write_all(self.query.saturating_add(view), &zeros);
        }
    }
}

/// `vkCmdCopyQueryPoolResults`, once it has waited.
pub fn copy_results(copy: &CopyQueryPoolResults, reach: &Reach) {
    let last = u64::from(copy.count.saturating_sub(1)).saturating_mul(copy.stride_bytes);
    let word = match copy.flags.contains(vk::QueryResultFlags::TYPE_64) {
        true => 8,
        false => 4,
    };
    let size_bytes = last.saturating_add(word * copy.pool.result_columns(copy.flags));
    if !reach.contains(copy.address, size_bytes) {
        return;
    }
    // SAFETY: the range is in reach, and the application keeps its memory during execution.
    unsafe {
        write_results(
            &copy.pool,
            copy.first
                ..copy
                    .first
                    .saturating_add(copy.count)
                    .min(copy.pool.len())
                    .max(copy.first),
            (copy.address as *mut u8, size_bytes),
            copy.stride_bytes,
            copy.flags,
        );
    }
}

/// Writes as many query results as there is room for, in the form that the flags select. Returns
/// whether all were available.
///
/// # Safety
/// `out` has room for `size_bytes`.
pub unsafe fn write_results(
    pool: &QueryPool,
    queries: std::ops::Range<u32>,
    (out, size_bytes): (*mut u8, u64),
    stride_bytes: u64,
    flags: vk::QueryResultFlags,
) -> bool {
    let mut all_available = true;
    let wide = flags.contains(vk::QueryResultFlags::TYPE_64);
    for (place, index) in queries.enumerate() {
        all_available &= pool.value(index).is_some();
        for (column, word) in pool.result_words(index, flags).into_iter().enumerate() {
            let Some(word) = word else { continue };
            let word_bytes = if wide { 8 } else { 4 };
            let offset = stride_bytes.checked_mul(place as u64);
            let offset = offset.and_then(|it| it.checked_add(word_bytes * column as u64));
            let end = offset.and_then(|it| it.checked_add(word_bytes));
            let (Some(offset), true) = (offset, end.is_some_and(|end| end <= size_bytes)) else {
                continue;
            };
            // SAFETY: the check before keeps the write inside the caller's `size_bytes`.
            unsafe {
                let out = out.add(offset as usize);
                if wide {
                    out.cast::<u64>().write_unaligned(word);
                } else {
                    out.cast::<u32>().write_unaligned(word as u32);
                }
            }
        }
    }
    all_available
}
