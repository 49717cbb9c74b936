//! Transform feedback while command buffers are performed.

use std::sync::atomic::{AtomicU64, Ordering};

use spirv_jit::program::MAX_FEEDBACK_BUFFERS;
use spirv_jit::reach::Reach;

use crate::command::graphics::{DrawByteCount, FeedbackBinding};
use crate::raster::TransformFeedback;
use crate::raster::transform_feedback::FeedbackTarget;
use crate::wave::reachable;

/// Bound buffers: their device addresses and sizes.
pub type FeedbackBuffers = [(u64, u64); MAX_FEEDBACK_BUFFERS];

/// `vkCmdBindTransformFeedbackBuffersEXT`.
pub fn bind(buffers: &mut FeedbackBuffers, binding: &FeedbackBinding) {
    let places = buffers.iter_mut().skip(binding.first as usize);
    for (place, buffer) in places.zip(&binding.buffers) {
        *place = *buffer;
    }
}

/// The address of a buffer's counter, if it has one.
fn counter(first: u32, counters: &[u64], buffer: usize) -> Option<u64> {
    let index = buffer.checked_sub(first as usize)?;
    counters.get(index).copied().filter(|&address| address != 0)
}

fn read(reach: &Reach, address: u64) -> Option<u32> {
    // SAFETY: any word is a valid counter, and the queue performs one command at a time.
    unsafe { reachable::read(reach, address) }
}

/// `vkCmdBeginTransformFeedbackEXT`: continues at the counters' offsets, or starts at 0 without
/// counters.
pub fn begin(
    reach: &Reach,
    buffers: &FeedbackBuffers,
    first: u32,
    counters: &[u64],
) -> TransformFeedback {
    TransformFeedback {
        targets: std::array::from_fn(|index| {
            let (address, size_bytes) = buffers[index];
            let next = counter(first, counters, index).and_then(|it| read(reach, it));
            FeedbackTarget {
                address,
                size_bytes,
                next_bytes: AtomicU64::new(next.unwrap_or(0).into()),
            }
        }),
    }
}

/// `vkCmdEndTransformFeedbackEXT`, once all has been written.
pub fn end(reach: &Reach, feedback: &TransformFeedback, first: u32, counters: &[u64]) {
    for (index, target) in feedback.targets.iter().enumerate() {
        if let Some(address) = counter(first, counters, index) {
            let next = target.next_bytes.load(Ordering::Relaxed);
            let next = u32::try_from(next).unwrap_or(u32::MAX);
            // SAFETY: the queue performs one command at a time, so nothing else uses the word now.
            let word = unsafe { reachable::writable(reach, address, 4) };
            if word.len() == 4 {
                word.copy_from_slice(&next.to_le_bytes());
            }
        }
    }
}

/// Vertices of `vkCmdDrawIndirectByteCountEXT`.
pub fn captured_vertices(reach: &Reach, draw: &DrawByteCount) -> u32 {
    let bytes = read(reach, draw.counter).unwrap_or(0);
    let bytes = bytes.saturating_sub(draw.offset_bytes);
    bytes.checked_div(draw.stride_bytes).unwrap_or(0)
}
