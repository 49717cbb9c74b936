//! Deferred host operations. Nothing defers yet: an operation given to a command is complete when the command returns
//! `VK_OPERATION_NOT_DEFERRED_KHR`.

use ash::vk;

use super::destroy;
use crate::ffi::entry;
use crate::handle;
use crate::object::DeferredOperation;

destroy! {
    vkDestroyDeferredOperationKHR: DeferredOperation, DeferredOperationKHR;
}

entry! {
    fn vkCreateDeferredOperationKHR(
        _device: vk::Device,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::DeferredOperationKHR,
    ) -> vk::Result {
        *out = handle::create(DeferredOperation);
        Ok(())
    }

    fn vkGetDeferredOperationMaxConcurrencyKHR(_device: vk::Device, _operation: vk::DeferredOperationKHR) -> u32 {
        // Of an operation that is complete.
        0
    }

    fn vkGetDeferredOperationResultKHR(_device: vk::Device, _operation: vk::DeferredOperationKHR) -> vk::Result {
        Ok(())
    }

    fn vkDeferredOperationJoinKHR(_device: vk::Device, _operation: vk::DeferredOperationKHR) -> vk::Result {
        Ok(())
    }
}
