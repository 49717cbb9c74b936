//! Deferred host operations.

use ash::vk;

use crate::VkResult;
use crate::device::Device;
use crate::guard::{guard, guard_result};
use crate::handle::{self, from_handle, retain};
use crate::object::DeferredOperation;

pub(crate) unsafe extern "system" fn vkDestroyDeferredOperationKHR(
    _device: vk::Device,
    handle: vk::DeferredOperationKHR,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyDeferredOperationKHR", move || {
        drop(handle::take::<DeferredOperation>(handle))
    })
}

/// Performs a command's work now, or defers it to the operation, if there is one, for up to
/// `concurrency` threads.
///
/// # Errors
/// The error of the work; `VK_OPERATION_DEFERRED_KHR`.
///
/// # Safety
/// The operation is null, or alive and complete.
pub unsafe fn defer(
    operation: vk::DeferredOperationKHR,
    concurrency: usize,
    work: impl FnOnce() -> VkResult + Send + 'static,
) -> VkResult {
    if operation == vk::DeferredOperationKHR::null() {
        return work();
    }
    // SAFETY: the caller guarantees that the operation is null, or alive and complete.
    let operation = unsafe { retain::<DeferredOperation>(operation) };
    DeferredOperation::defer(&operation, concurrency, work)?;
    Err(vk::Result::OPERATION_DEFERRED_KHR)
}

/// As [`defer`], for parallel work on the device's workers or on the threads that join.
///
/// # Errors
/// `VK_OPERATION_DEFERRED_KHR`, `VK_ERROR_DEVICE_LOST`.
///
/// # Safety
/// As [`defer`].
pub unsafe fn defer_parallel(
    device: &Device,
    operation: vk::DeferredOperationKHR,
    concurrency: usize,
    work: impl FnOnce() + Send + 'static,
) -> VkResult {
    let workers = &device.engine.workers;
    // Workers that cannot start, or a lost device, cannot do the work.
    device.engine.waiting.lost.check()?;
    if operation == vk::DeferredOperationKHR::null() {
        workers.install(work);
        return Ok(());
    }
    let threads = concurrency.min(workers.current_num_threads());
    // SAFETY: the caller keeps the promises of `defer`.
    unsafe {
        defer(operation, threads, move || {
            work();
            Ok(())
        })
    }
}

pub(crate) unsafe extern "system" fn vkCreateDeferredOperationKHR(
    _device: vk::Device,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::DeferredOperationKHR,
) -> vk::Result {
    guard_result("vkCreateDeferredOperationKHR", move || {
        *out = handle::create(DeferredOperation::default());
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetDeferredOperationMaxConcurrencyKHR(
    _device: vk::Device,
    operation: vk::DeferredOperationKHR,
) -> u32 {
    guard("vkGetDeferredOperationMaxConcurrencyKHR", move || {
        from_handle::<DeferredOperation>(operation).max_concurrency()
    })
}

pub(crate) unsafe extern "system" fn vkGetDeferredOperationResultKHR(
    _device: vk::Device,
    operation: vk::DeferredOperationKHR,
) -> vk::Result {
    guard_result("vkGetDeferredOperationResultKHR", move || {
        from_handle::<DeferredOperation>(operation).result()
    })
}

pub(crate) unsafe extern "system" fn vkDeferredOperationJoinKHR(
    _device: vk::Device,
    operation: vk::DeferredOperationKHR,
) -> vk::Result {
    guard_result("vkDeferredOperationJoinKHR", move || {
        from_handle::<DeferredOperation>(operation).join()
    })
}
