//! Queues: queries, submissions and waits.

use std::sync::Arc;

use ash::vk;
use ash::vk::Handle;

use crate::VkResult;
use crate::command::CommandBuffer;
use crate::device::Device;
use crate::ffi;
use crate::guard::{guard, guard_result};
use crate::handle;
use crate::object::address_space::GRANULE;
use crate::object::page_binds::pages;
use crate::object::sparse::{Reservation, SparseBind};
use crate::object::{Buffer, DeviceMemory, Fence, Image, Semaphore};
use crate::queue::{Queue, Submission};

pub(crate) unsafe extern "system" fn vkGetDeviceQueue(
    device: vk::Device,
    _family: u32,
    index: u32,
    out: *mut vk::Queue,
) {
    guard("vkGetDeviceQueue", move || {
        *out = queue(device, index);
    })
}

pub(crate) unsafe extern "system" fn vkGetDeviceQueue2(
    device: vk::Device,
    info: *const vk::DeviceQueueInfo2,
    out: *mut vk::Queue,
) {
    guard("vkGetDeviceQueue2", move || {
        // Flags other than those of the creation match no queue.
        *out = match (*info).flags == handle::from_handle::<Device>(device).queue_flags {
            true => queue(device, (*info).queue_index),
            false => vk::Queue::null(),
        };
    })
}

pub(crate) unsafe extern "system" fn vkQueueSubmit(
    queue: vk::Queue,
    count: u32,
    infos: *const vk::SubmitInfo,
    fence: vk::Fence,
) -> vk::Result {
    guard_result("vkQueueSubmit", move || {
        let submissions = ffi::slice(infos, count).iter().map(|info| submission(info));
        submit(queue, submissions.collect::<VkResult<_>>()?, fence)
    })
}

pub(crate) unsafe extern "system" fn vkQueueSubmit2(
    queue: vk::Queue,
    count: u32,
    infos: *const vk::SubmitInfo2,
    fence: vk::Fence,
) -> vk::Result {
    guard_result("vkQueueSubmit2", move || {
        let submissions = ffi::slice(infos, count)
            .iter()
            .map(|info| submission2(info));
        submit(queue, submissions.collect::<VkResult<_>>()?, fence)
    })
}

pub(crate) unsafe extern "system" fn vkQueueBindSparse(
    queue: vk::Queue,
    count: u32,
    infos: *const vk::BindSparseInfo,
    fence: vk::Fence,
) -> vk::Result {
    guard_result("vkQueueBindSparse", move || {
        let submissions = ffi::slice(infos, count).iter().map(|info| {
            let timeline = ffi::find::<vk::TimelineSemaphoreSubmitInfo>(info.p_next);
            Submission {
                waits: semaphores(
                    info.p_wait_semaphores,
                    info.wait_semaphore_count,
                    timeline.map(|info| wait_values(info)),
                ),
                signals: semaphores(
                    info.p_signal_semaphores,
                    info.signal_semaphore_count,
                    timeline.map(|info| signal_values(info)),
                ),
                binds: sparse_binds(info),
                ..Submission::default()
            }
        });
        submit(queue, submissions.collect(), fence)
    })
}

pub(crate) unsafe extern "system" fn vkQueueWaitIdle(queue: vk::Queue) -> vk::Result {
    guard_result("vkQueueWaitIdle", move || {
        handle::from_handle::<Queue>(queue).wait_idle()
    })
}

pub(crate) unsafe extern "system" fn vkDeviceWaitIdle(device: vk::Device) -> vk::Result {
    guard_result("vkDeviceWaitIdle", move || {
        let device = handle::from_handle::<Device>(device);
        device
            .queues
            .iter()
            .try_for_each(|queue| queue.wait_idle())?;
        device.engine.waiting.lost.check()
    })
}

/// Labels are for tools between the application and the driver; the driver keeps none.
pub(crate) unsafe extern "system" fn vkQueueBeginDebugUtilsLabelEXT(
    _queue: vk::Queue,
    _label: *const vk::DebugUtilsLabelEXT,
) {
}

pub(crate) unsafe extern "system" fn vkQueueEndDebugUtilsLabelEXT(_queue: vk::Queue) {}

pub(crate) unsafe extern "system" fn vkQueueInsertDebugUtilsLabelEXT(
    _queue: vk::Queue,
    _label: *const vk::DebugUtilsLabelEXT,
) {
}

fn queue(device: vk::Device, index: u32) -> vk::Queue {
    // SAFETY: the entry point's caller keeps the handle alive.
    let device = unsafe { handle::from_handle::<Device>(device) };
    device
        .queues
        .iter()
        .find(|queue| queue.index == index)
        .map_or(vk::Queue::null(), handle::handle_of)
}

/// Enqueues submissions, the fence with the last one.
///
/// # Safety
/// The handles are alive.
unsafe fn submit(queue: vk::Queue, mut submissions: Vec<Submission>, fence: vk::Fence) -> VkResult {
    // SAFETY: the caller guarantees that the handles are alive.
    let fence = (!fence.is_null()).then(|| unsafe { handle::retain::<Fence>(fence) });
    match submissions.last_mut() {
        Some(last) => last.fence = fence,
        None if fence.is_none() => return Ok(()),
        None => submissions.push(Submission {
            fence,
            ..Submission::default()
        }),
    }
    // SAFETY: the caller guarantees that the handles are alive.
    unsafe { handle::from_handle::<Queue>(queue) }.submit(submissions)
}

/// Binds of buffers and of opaque images. Binds of resources that are not sparse are ignored.
///
/// # Safety
/// A valid structure of live handles.
unsafe fn sparse_binds(info: &vk::BindSparseInfo<'_>) -> Vec<SparseBind> {
    // SAFETY: the caller guarantees a valid structure of live handles.
    unsafe {
        let decode =
            |resource: &Arc<Reservation>, unit: u64, bind: &vk::SparseMemoryBind| SparseBind {
                resource: Arc::clone(resource),
                resource_offset: bind.resource_offset,
                // A resource may end inside its last block.
                size_bytes: bind.size.next_multiple_of(unit),
                memory: (!bind.memory.is_null()).then(|| {
                    (
                        handle::retain::<DeviceMemory>(bind.memory),
                        bind.memory_offset,
                    )
                }),
            };
        let mut binds = Vec::new();
        for one in ffi::slice(info.p_buffer_binds, info.buffer_bind_count) {
            let buffer = handle::from_handle::<Buffer>(one.buffer);
            if let Some(resource) = &buffer.reservation {
                let list = ffi::slice(one.p_binds, one.bind_count);
                binds.extend(list.iter().map(|bind| decode(resource, GRANULE, bind)));
            }
        }
        for one in ffi::slice(info.p_image_opaque_binds, info.image_opaque_bind_count) {
            let image = handle::from_handle::<Image>(one.image);
            if let Some(resource) = &image.reservation {
                let list = ffi::slice(one.p_binds, one.bind_count);
                let unit = Image::alignment(image.flags);
                binds.extend(list.iter().map(|bind| decode(resource, unit, bind)));
            }
        }
        for one in ffi::slice(info.p_image_binds, info.image_bind_count) {
            let image = handle::from_handle::<Image>(one.image);
            let Some(resource) = &image.reservation else {
                continue;
            };
            for bind in ffi::slice(one.p_binds, one.bind_count) {
                for pages in pages(image, bind) {
                    let memory_offset = bind.memory_offset.saturating_add(pages.memory_offset);
                    binds.push(SparseBind {
                        resource: Arc::clone(resource),
                        resource_offset: pages.image_offset,
                        size_bytes: pages.size_bytes,
                        memory: (!bind.memory.is_null())
                            .then(|| (handle::retain::<DeviceMemory>(bind.memory), memory_offset)),
                    });
                }
            }
        }
        binds
    }
}

/// # Safety
/// A valid structure of live handles.
unsafe fn submission(info: &vk::SubmitInfo<'_>) -> VkResult<Submission> {
    // SAFETY: the caller guarantees a valid structure of live handles.
    unsafe {
        let timeline = ffi::find::<vk::TimelineSemaphoreSubmitInfo>(info.p_next);
        let buffers = ffi::slice(info.p_command_buffers, info.command_buffer_count);
        Ok(Submission {
            waits: semaphores(
                info.p_wait_semaphores,
                info.wait_semaphore_count,
                timeline.map(|info| wait_values(info)),
            ),
            commands: buffers
                .iter()
                .map(|&buffer| executable(buffer))
                .collect::<VkResult<_>>()?,
            signals: semaphores(
                info.p_signal_semaphores,
                info.signal_semaphore_count,
                timeline.map(|info| signal_values(info)),
            ),
            ..Submission::default()
        })
    }
}

/// # Safety
/// As [`submission`].
unsafe fn submission2(info: &vk::SubmitInfo2<'_>) -> VkResult<Submission> {
    // SAFETY: the caller keeps the promises of `submission`.
    unsafe {
        let semaphore = |info: &vk::SemaphoreSubmitInfo| {
            (handle::retain::<Semaphore>(info.semaphore), info.value)
        };
        let waits = ffi::slice(info.p_wait_semaphore_infos, info.wait_semaphore_info_count);
        let signals = ffi::slice(
            info.p_signal_semaphore_infos,
            info.signal_semaphore_info_count,
        );
        let buffers = ffi::slice(info.p_command_buffer_infos, info.command_buffer_info_count);
        Ok(Submission {
            waits: waits.iter().map(semaphore).collect(),
            commands: buffers
                .iter()
                .map(|info| executable(info.command_buffer))
                .collect::<VkResult<_>>()?,
            signals: signals.iter().map(semaphore).collect(),
            ..Submission::default()
        })
    }
}

/// # Safety
/// The handle is alive.
unsafe fn executable(buffer: vk::CommandBuffer) -> VkResult<Arc<Vec<crate::command::Command>>> {
    // SAFETY: the caller guarantees that the handle is alive.
    let buffer = unsafe { handle::from_handle::<CommandBuffer>(buffer) };
    buffer.recording.lock().executable()
}

/// # Safety
/// As [`submission`].
unsafe fn wait_values<'a>(info: &vk::TimelineSemaphoreSubmitInfo<'a>) -> &'a [u64] {
    // SAFETY: the caller keeps the promises of `submission`.
    unsafe {
        ffi::slice(
            info.p_wait_semaphore_values,
            info.wait_semaphore_value_count,
        )
    }
}

/// # Safety
/// As [`submission`].
unsafe fn signal_values<'a>(info: &vk::TimelineSemaphoreSubmitInfo<'a>) -> &'a [u64] {
    // SAFETY: the caller keeps the promises of `submission`.
    unsafe {
        ffi::slice(
            info.p_signal_semaphore_values,
            info.signal_semaphore_value_count,
        )
    }
}

/// Semaphores with their values, which binary ones may lack.
///
/// # Safety
/// As [`submission`].
unsafe fn semaphores(
    semaphores: *const vk::Semaphore,
    count: u32,
    values: Option<&[u64]>,
) -> Vec<(handle::Ref<Semaphore>, u64)> {
    // SAFETY: the caller keeps the promises of `submission`.
    let semaphores = unsafe { ffi::slice(semaphores, count) };
    semaphores
        .iter()
        .enumerate()
        .map(|(index, &semaphore)| {
            let value = values
                .and_then(|values| values.get(index))
                .copied()
                .unwrap_or(0);
            // SAFETY: the caller keeps the promises of `submission`.
            (unsafe { handle::retain::<Semaphore>(semaphore) }, value)
        })
        .collect()
}
