//! Deferred host operations.

use ash::vk;

use super::define::entry;
use super::destroy;
use crate::VkResult;
use crate::device::Device;
use crate::handle::{self, from_handle, retain};
use crate::object::DeferredOperation;

destroy! {
    vkDestroyDeferredOperationKHR: DeferredOperation, DeferredOperationKHR;
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

entry! {
    fn vkCreateDeferredOperationKHR(
        _device: vk::Device,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::DeferredOperationKHR,
    ) -> vk::Result {
        *out = handle::create(DeferredOperation::default());
        Ok(())
    }

    fn vkGetDeferredOperationMaxConcurrencyKHR(_device: vk::Device, operation: vk::DeferredOperationKHR) -> u32 {
        from_handle::<DeferredOperation>(operation).max_concurrency()
    }

    fn vkGetDeferredOperationResultKHR(_device: vk::Device, operation: vk::DeferredOperationKHR) -> vk::Result {
        from_handle::<DeferredOperation>(operation).result()
    }

    fn vkDeferredOperationJoinKHR(_device: vk::Device, operation: vk::DeferredOperationKHR) -> vk::Result {
        from_handle::<DeferredOperation>(operation).join()
    }
}
