//! Fences, semaphores and events.

use std::sync::Arc;

use ash::vk;

use super::system::{exported_fence, exported_semaphore};
use crate::device::Device;
use crate::ffi;
use crate::guard::{guard, guard_result};
use crate::handle;
use crate::object::external_sync::External;
use crate::object::{Event, Fence, Semaphore};

pub(crate) unsafe extern "system" fn vkCreateFence(
    _device: vk::Device,
    info: *const vk::FenceCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::Fence,
) -> vk::Result {
    guard_result("vkCreateFence", move || {
        let is_signaled = (*info).flags.contains(vk::FenceCreateFlags::SIGNALED);
        let external = External::new(exported_fence((*info).p_next), is_signaled)?;
        *out = handle::create(Fence::with(is_signaled, external));
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkDestroyFence(
    _device: vk::Device,
    fence: vk::Fence,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyFence", move || {
        drop(handle::take::<Fence>(fence));
    })
}

pub(crate) unsafe extern "system" fn vkResetFences(
    _device: vk::Device,
    count: u32,
    fences: *const vk::Fence,
) -> vk::Result {
    guard_result("vkResetFences", move || {
        for &fence in ffi::slice(fences, count) {
            handle::from_handle::<Fence>(fence).set(false);
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetFenceStatus(
    device: vk::Device,
    fence: vk::Fence,
) -> vk::Result {
    guard_result("vkGetFenceStatus", move || {
        if handle::from_handle::<Fence>(fence).is_signaled() {
            return Ok(());
        }
        handle::from_handle::<Device>(device)
            .engine
            .waiting
            .lost
            .check()?;
        Err(vk::Result::NOT_READY)
    })
}

pub(crate) unsafe extern "system" fn vkWaitForFences(
    device: vk::Device,
    count: u32,
    fences: *const vk::Fence,
    wait_all: vk::Bool32,
    timeout_ns: u64,
) -> vk::Result {
    guard_result("vkWaitForFences", move || {
        let fences = ffi::slice(fences, count);
        let signaled = |&fence: &vk::Fence| handle::from_handle::<Fence>(fence).is_signaled();
        let device = handle::from_handle::<Device>(device);
        let in_files = fences
            .iter()
            .any(|&fence| handle::from_handle::<Fence>(fence).external.is_there());
        device.engine.waiting.wait(timeout_ns, in_files, || {
            if wait_all != vk::FALSE {
                fences.iter().all(signaled)
            } else {
                fences.iter().any(signaled)
            }
        })
    })
}

pub(crate) unsafe extern "system" fn vkCreateSemaphore(
    device: vk::Device,
    info: *const vk::SemaphoreCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::Semaphore,
) -> vk::Result {
    guard_result("vkCreateSemaphore", move || {
        let device = handle::from_handle::<Device>(device);
        let (ty, value) = match ffi::find::<vk::SemaphoreTypeCreateInfo>((*info).p_next) {
            Some(info) => (info.semaphore_type, info.initial_value),
            None => (vk::SemaphoreType::BINARY, 0),
        };
        let sharing = exported_semaphore((*info).p_next);
        let external = External::new(sharing.filter(|_| ty == vk::SemaphoreType::BINARY), false)?;
        *out = handle::create(Semaphore::with(
            ty,
            value,
            Arc::clone(&device.engine.waiting),
            external,
        ));
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkDestroySemaphore(
    _device: vk::Device,
    semaphore: vk::Semaphore,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroySemaphore", move || {
        drop(handle::take::<Semaphore>(semaphore));
    })
}

pub(crate) unsafe extern "system" fn vkGetSemaphoreCounterValue(
    device: vk::Device,
    semaphore: vk::Semaphore,
    out: *mut u64,
) -> vk::Result {
    guard_result("vkGetSemaphoreCounterValue", move || {
        handle::from_handle::<Device>(device)
            .engine
            .waiting
            .lost
            .check()?;
        *out = handle::from_handle::<Semaphore>(semaphore).value();
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkSignalSemaphore(
    _device: vk::Device,
    info: *const vk::SemaphoreSignalInfo,
) -> vk::Result {
    guard_result("vkSignalSemaphore", move || {
        handle::from_handle::<Semaphore>((*info).semaphore).signal((*info).value);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkWaitSemaphores(
    device: vk::Device,
    info: *const vk::SemaphoreWaitInfo,
    timeout_ns: u64,
) -> vk::Result {
    guard_result("vkWaitSemaphores", move || {
        let info = &*info;
        let semaphores = ffi::slice(info.p_semaphores, info.semaphore_count);
        let values = ffi::slice(info.p_values, info.semaphore_count);
        let any = info.flags.contains(vk::SemaphoreWaitFlags::ANY);
        let device = handle::from_handle::<Device>(device);
        device.engine.waiting.wait_until(timeout_ns, || {
            let mut reached = semaphores.iter().zip(values).map(|(&semaphore, &value)| {
                handle::from_handle::<Semaphore>(semaphore).has_reached(value)
            });
            if any {
                reached.any(|reached| reached)
            } else {
                reached.all(|reached| reached)
            }
        })
    })
}

pub(crate) unsafe extern "system" fn vkCreateEvent(
    device: vk::Device,
    _info: *const vk::EventCreateInfo,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::Event,
) -> vk::Result {
    guard_result("vkCreateEvent", move || {
        let device = handle::from_handle::<Device>(device);
        *out = handle::create(Event::new(Arc::clone(&device.engine.waiting)));
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkDestroyEvent(
    _device: vk::Device,
    event: vk::Event,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroyEvent", move || {
        drop(handle::take::<Event>(event));
    })
}

pub(crate) unsafe extern "system" fn vkGetEventStatus(
    device: vk::Device,
    event: vk::Event,
) -> vk::Result {
    guard_result("vkGetEventStatus", move || {
        handle::from_handle::<Device>(device)
            .engine
            .waiting
            .lost
            .check()?;
        // Both results are success codes other than `VK_SUCCESS`, which `Ok` cannot express.
        Err(match handle::from_handle::<Event>(event).is_set() {
            true => vk::Result::EVENT_SET,
            false => vk::Result::EVENT_RESET,
        })
    })
}

pub(crate) unsafe extern "system" fn vkSetEvent(
    _device: vk::Device,
    event: vk::Event,
) -> vk::Result {
    guard_result("vkSetEvent", move || {
        handle::from_handle::<Event>(event).set();
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkResetEvent(
    _device: vk::Device,
    event: vk::Event,
) -> vk::Result {
    guard_result("vkResetEvent", move || {
        handle::from_handle::<Event>(event).reset();
        Ok(())
    })
}
