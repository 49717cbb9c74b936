//! Submission.

use std::sync::Arc;

use ash::vk;

use crate::VkResult;
use crate::command::CommandBuffer;
use crate::ffi::{self, chain, entry};
use crate::handle::{from_handle, retain};
use crate::object::{Fence, Semaphore};
use crate::queue::{Queue, Submission};

/// Queues batches; the fence is signaled after the last one, or after what was there before if there are none.
///
/// # Safety
/// `fence` is alive or null.
unsafe fn submit(queue: vk::Queue, mut batches: Vec<Submission>, fence: vk::Fence) -> VkResult {
    // SAFETY: the caller's promise.
    unsafe {
        if fence != vk::Fence::null() {
            if batches.is_empty() {
                batches.push(Submission::default());
            }
            if let Some(last) = batches.last_mut() {
                last.fence = Some(retain::<Fence>(fence));
            }
        }
        from_handle::<Queue>(queue).submit(batches)
    }
}

/// Semaphores with their values; binary ones have none.
///
/// # Safety
/// The semaphores are alive.
unsafe fn with_values(
    semaphores: &[vk::Semaphore],
    values: &[u64],
) -> Vec<(crate::handle::Ref<Semaphore>, u64)> {
    let value = |index: usize| values.get(index).copied().unwrap_or(0);
    // SAFETY: the caller's promise.
    let retained = semaphores
        .iter()
        .map(|&semaphore| unsafe { retain::<Semaphore>(semaphore) });
    retained
        .enumerate()
        .map(|(index, semaphore)| (semaphore, value(index)))
        .collect()
}

entry! {
    fn vkQueueSubmit(queue: vk::Queue, count: u32, infos: *const vk::SubmitInfo, fence: vk::Fence) -> vk::Result {
        let mut batches = Vec::with_capacity(count as usize);
        for info in ffi::slice(infos, count) {
            let timeline = chain::find::<vk::TimelineSemaphoreSubmitInfo>(info.p_next);
            let waits = timeline.map_or(&[][..], |t| ffi::slice(t.p_wait_semaphore_values, t.wait_semaphore_value_count));
            let signals =
                timeline.map_or(&[][..], |t| ffi::slice(t.p_signal_semaphore_values, t.signal_semaphore_value_count));
            let buffers = ffi::slice(info.p_command_buffers, info.command_buffer_count);
            batches.push(Submission {
                waits: with_values(ffi::slice(info.p_wait_semaphores, info.wait_semaphore_count), waits),
                command_buffers: buffers.iter().map(|&buffer| commands(buffer)).collect(),
                signals: with_values(ffi::slice(info.p_signal_semaphores, info.signal_semaphore_count), signals),
                fence: None,
            });
        }
        submit(queue, batches, fence)
    }

    fn vkQueueSubmit2(queue: vk::Queue, count: u32, infos: *const vk::SubmitInfo2, fence: vk::Fence) -> vk::Result {
        let semaphores = |infos: &[vk::SemaphoreSubmitInfo<'_>]| {
            infos.iter().map(|info| (retain::<Semaphore>(info.semaphore), info.value)).collect()
        };
        let mut batches = Vec::with_capacity(count as usize);
        for info in ffi::slice(infos, count) {
            let buffers = ffi::slice(info.p_command_buffer_infos, info.command_buffer_info_count);
            batches.push(Submission {
                waits: semaphores(ffi::slice(info.p_wait_semaphore_infos, info.wait_semaphore_info_count)),
                command_buffers: buffers.iter().map(|info| commands(info.command_buffer)).collect(),
                signals: semaphores(ffi::slice(info.p_signal_semaphore_infos, info.signal_semaphore_info_count)),
                fence: None,
            });
        }
        submit(queue, batches, fence)
    }

    fn vkQueueWaitIdle(queue: vk::Queue) -> vk::Result {
        from_handle::<Queue>(queue).wait_idle()
    }
}

/// What a command buffer holds now.
///
/// # Safety
/// The command buffer is alive.
unsafe fn commands(buffer: vk::CommandBuffer) -> Arc<Vec<crate::command::Command>> {
    // SAFETY: the caller's promise.
    Arc::clone(
        &unsafe { from_handle::<CommandBuffer>(buffer) }
            .recording
            .lock()
            .commands,
    )
}
