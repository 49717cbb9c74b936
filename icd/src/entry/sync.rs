//! Fences, semaphores and events.

use std::sync::Arc;

use ash::vk;
use parking_lot::Mutex;

use super::destroy;
use crate::ffi::{self, chain, entry};
use crate::handle::{self, from_handle};
use crate::object::{Device, Event, Fence, Semaphore};

destroy! {
    vkDestroyFence: Fence, Fence;
    vkDestroySemaphore: Semaphore, Semaphore;
    vkDestroyEvent: Event, Event;
}

entry! {
    fn vkCreateFence(
        _device: vk::Device,
        info: *const vk::FenceCreateInfo,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::Fence,
    ) -> vk::Result {
        *out = handle::create(Fence::new((*info).flags.contains(vk::FenceCreateFlags::SIGNALED)));
        Ok(())
    }

    fn vkResetFences(_device: vk::Device, count: u32, fences: *const vk::Fence) -> vk::Result {
        for &fence in ffi::slice(fences, count) {
            from_handle::<Fence>(fence).set(false);
        }
        Ok(())
    }

    fn vkGetFenceStatus(device: vk::Device, fence: vk::Fence) -> vk::Result {
        if from_handle::<Fence>(fence).is_signaled() {
            return Ok(());
        }
        from_handle::<Device>(device).waiting.lost.check()?;
        Err(vk::Result::NOT_READY)
    }

    fn vkWaitForFences(
        device: vk::Device,
        count: u32,
        fences: *const vk::Fence,
        wait_all: vk::Bool32,
        timeout: u64,
    ) -> vk::Result {
        let device = from_handle::<Device>(device);
        let fences: Vec<_> = ffi::slice(fences, count).iter().map(|&fence| from_handle::<Fence>(fence)).collect();
        device.waiting.wait_until(timeout, || {
            if wait_all == vk::TRUE {
                fences.iter().all(|fence| fence.is_signaled())
            } else {
                fences.iter().any(|fence| fence.is_signaled())
            }
        })
    }

    fn vkCreateSemaphore(
        device: vk::Device,
        info: *const vk::SemaphoreCreateInfo,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::Semaphore,
    ) -> vk::Result {
        let device = from_handle::<Device>(device);
        let (ty, initial) = chain::find::<vk::SemaphoreTypeCreateInfo>((*info).p_next)
            .map_or((vk::SemaphoreType::BINARY, 0), |ty| (ty.semaphore_type, ty.initial_value));
        *out = handle::create(Semaphore {
            ty,
            value: Mutex::new(initial),
            waiting: Arc::clone(&device.waiting),
        });
        Ok(())
    }

    fn vkGetSemaphoreCounterValue(device: vk::Device, semaphore: vk::Semaphore, out: *mut u64) -> vk::Result {
        from_handle::<Device>(device).waiting.lost.check()?;
        *out = from_handle::<Semaphore>(semaphore).value();
        Ok(())
    }

    fn vkSignalSemaphore(_device: vk::Device, info: *const vk::SemaphoreSignalInfo) -> vk::Result {
        from_handle::<Semaphore>((*info).semaphore).signal((*info).value);
        Ok(())
    }

    fn vkWaitSemaphores(device: vk::Device, info: *const vk::SemaphoreWaitInfo, timeout: u64) -> vk::Result {
        let device = from_handle::<Device>(device);
        let info = &*info;
        let semaphores = ffi::slice(info.p_semaphores, info.semaphore_count);
        let values = ffi::slice(info.p_values, info.semaphore_count);
        let waits: Vec<_> = semaphores.iter().zip(values).map(|(&s, &value)| (from_handle::<Semaphore>(s), value)).collect();
        device.waiting.wait_until(timeout, || {
            if info.flags.contains(vk::SemaphoreWaitFlags::ANY) {
                waits.iter().any(|(semaphore, value)| semaphore.has_reached(*value))
            } else {
                waits.iter().all(|(semaphore, value)| semaphore.has_reached(*value))
            }
        })
    }

    fn vkCreateEvent(
        _device: vk::Device,
        _info: *const vk::EventCreateInfo,
        _allocator: *const vk::AllocationCallbacks,
        out: *mut vk::Event,
    ) -> vk::Result {
        *out = handle::create(Event::default());
        Ok(())
    }

    fn vkGetEventStatus(device: vk::Device, event: vk::Event) -> vk::Result {
        from_handle::<Device>(device).waiting.lost.check()?;
        // Both answers are success codes of their own.
        Err(if from_handle::<Event>(event).is_set() {
            vk::Result::EVENT_SET
        } else {
            vk::Result::EVENT_RESET
        })
    }

    fn vkSetEvent(device: vk::Device, event: vk::Event) -> vk::Result {
        from_handle::<Event>(event).set(true);
        from_handle::<Device>(device).waiting.notify();
        Ok(())
    }

    fn vkResetEvent(_device: vk::Device, event: vk::Event) -> vk::Result {
        from_handle::<Event>(event).set(false);
        Ok(())
    }
}
