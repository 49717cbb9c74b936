//! Swapchains: `VK_KHR_swapchain` and its extensions.

use std::ffi::c_void;
use std::sync::Arc;

use super::address_report::report;
use super::present_timing;
use crate::VkResult;
use crate::decode::image::swapchain_usage;
use crate::device::Device;
use crate::ffi::enumerate::enumerate;
use crate::ffi::{array, chain, slice, vk};
use crate::guard::{guard, guard_result};
use crate::handle::{self, from_handle, optional, retain};
use crate::object::addressed::AddressEvent;
use crate::object::{Fence, Image, Semaphore};
use crate::present::timing::Timing;
use crate::present::{Creation, Request, Scaling, Surface, Swapchain};
use crate::queue::{Queue, Submission};

/// The images of a swapchain.
///
/// # Safety
/// `info` is valid usage of `vkCreateSwapchainKHR`.
unsafe fn image_info<'a>(info: &vk::SwapchainCreateInfoKHR<'_>) -> vk::ImageCreateInfo<'a> {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkCreateSwapchainKHR`.
    let usage = unsafe { swapchain_usage(info) };
    let mutable = info
        .flags
        .contains(vk::SwapchainCreateFlagsKHR::MUTABLE_FORMAT);
    vk::ImageCreateInfo::default()
        .flags(if mutable {
            vk::ImageCreateFlags::MUTABLE_FORMAT | vk::ImageCreateFlags::EXTENDED_USAGE
        } else {
            vk::ImageCreateFlags::empty()
        })
        .image_type(vk::ImageType::TYPE_2D)
        .format(info.image_format)
        .extent(vk::Extent3D {
            width: info.image_extent.width,
            height: info.image_extent.height,
            depth: 1,
        })
        .mip_levels(1)
        .array_layers(info.image_array_layers)
        .samples(vk::SampleCountFlags::TYPE_1)
        .tiling(vk::ImageTiling::OPTIMAL)
        .usage(usage)
}

/// The creation parameters of a swapchain.
///
/// # Safety
/// `info` is valid usage of `vkCreateSwapchainKHR`.
unsafe fn creation<'a>(info: &vk::SwapchainCreateInfoKHR<'a>) -> Creation<'a> {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkCreateSwapchainKHR`.
    let (images, scaling) = unsafe {
        (
            image_info(info),
            chain::find::<vk::SwapchainPresentScalingCreateInfoEXT>(info.p_next),
        )
    };
    let scaling = scaling.map_or_else(Scaling::default, |scaling| Scaling {
        behavior: scaling.scaling_behavior,
        gravity: [scaling.present_gravity_x, scaling.present_gravity_y],
    });
    Creation {
        images,
        count: info.min_image_count,
        mode: info.present_mode,
        color_space: info.image_color_space,
        composite_alpha: info.composite_alpha,
        scaling,
        is_timed: (info.flags).contains(vk::SWAPCHAIN_CREATE_PRESENT_TIMING_EXT),
    }
}

/// Element `index` of an array in the chain of `VkPresentInfoKHR`, if the array exists.
///
/// # Safety
/// `data` is null or has `count` elements.
unsafe fn element<T: Copy>(data: *const T, count: u32, index: usize) -> Option<T> {
    // SAFETY: the caller guarantees that `data` is null or has `count` elements.
    unsafe { slice(data, count) }.get(index).copied()
}

/// The request of a presentation for one swapchain.
///
/// # Safety
/// `info` is valid usage of `vkQueuePresentKHR`, and has a swapchain `index`.
unsafe fn request(
    info: &vk::PresentInfoKHR<'_>,
    swapchain: &Swapchain,
    index: usize,
    image: u32,
) -> Request {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkQueuePresentKHR`, and has a
    // swapchain `index`.
    unsafe {
        let next = info.p_next;
        let id = chain::find::<vk::PresentIdKHR>(next)
            .and_then(|ids| element(ids.p_present_ids, ids.swapchain_count, index));
        let id2 = chain::find::<vk::PresentId2KHR>(next)
            .and_then(|ids| element(ids.p_present_ids, ids.swapchain_count, index));
        let mode = chain::find::<vk::SwapchainPresentModeInfoEXT>(next)
            .and_then(|modes| element(modes.p_present_modes, modes.swapchain_count, index));
        let regions = chain::find::<vk::PresentRegionsKHR>(next)
            .and_then(|regions| element(regions.p_regions, regions.swapchain_count, index));
        let timing = chain::find::<vk::PresentTimingsInfoEXT>(next)
            .and_then(|infos| element(infos.p_timing_infos, infos.swapchain_count, index));
        let damage = regions.map(|region| slice(region.p_rectangles, region.rectangle_count));
        let rectangle = |rectangle: &vk::RectLayerKHR| vk::Rect2D {
            offset: rectangle.offset,
            extent: rectangle.extent,
        };
        Request {
            index: image,
            id: id.or(id2).unwrap_or(0),
            mode: mode.unwrap_or(swapchain.mode),
            damage: damage.unwrap_or_default().iter().map(rectangle).collect(),
            timing: timing
                .as_ref()
                .map_or_else(Timing::default, present_timing::timing),
            ticket: 0,
        }
    }
}

/// Fences of presentations.
///
/// # Safety
/// `next` is the chain of valid usage of `vkQueuePresentKHR`.
unsafe fn present_fences(next: *const c_void) -> Vec<handle::Ref<Fence>> {
    // SAFETY: the caller guarantees that `next` is the chain of valid usage of `vkQueuePresentKHR`.
    unsafe {
        let Some(info) = chain::find::<vk::SwapchainPresentFenceInfoEXT>(next) else {
            return Vec::new();
        };
        let fences = slice(info.p_fences, info.swapchain_count).iter();
        let fences = fences.filter(|&&fence| fence != vk::Fence::null());
        fences.map(|&fence| retain::<Fence>(fence)).collect()
    }
}

/// Acquires an image and signals at once, since a free image is no longer read.
///
/// # Safety
/// The handles are alive, or null where that is allowed.
unsafe fn acquire(
    device: vk::Device,
    swapchain: vk::SwapchainKHR,
    timeout_ns: u64,
    semaphore: vk::Semaphore,
    fence: vk::Fence,
) -> VkResult<(u32, bool)> {
    // SAFETY: the caller guarantees that the handles are alive, or null where that is allowed.
    unsafe {
        let acquired = from_handle::<Swapchain>(swapchain).acquire(timeout_ns)?;
        if let Some(semaphore) = optional::<Semaphore>(semaphore) {
            semaphore.signal(1);
        }
        if let Some(fence) = optional::<Fence>(fence) {
            fence.set(true);
            from_handle::<Device>(device).engine.waiting.notify();
        }
        Ok(acquired)
    }
}

fn suboptimal(is_suboptimal: bool) -> VkResult {
    match is_suboptimal {
        true => Err(vk::Result::SUBOPTIMAL_KHR),
        false => Ok(()),
    }
}

pub(crate) unsafe extern "system" fn vkGetDeviceGroupPresentCapabilitiesKHR(
    _device: vk::Device,
    out: *mut vk::DeviceGroupPresentCapabilitiesKHR,
) -> vk::Result {
    guard_result("vkGetDeviceGroupPresentCapabilitiesKHR", move || {
        (*out).present_mask = [0; vk::MAX_DEVICE_GROUP_SIZE];
        (*out).present_mask[0] = 1;
        (*out).modes = vk::DeviceGroupPresentModeFlagsKHR::LOCAL;
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetDeviceGroupSurfacePresentModesKHR(
    _device: vk::Device,
    _surface: vk::SurfaceKHR,
    out: *mut vk::DeviceGroupPresentModeFlagsKHR,
) -> vk::Result {
    guard_result("vkGetDeviceGroupSurfacePresentModesKHR", move || {
        *out = vk::DeviceGroupPresentModeFlagsKHR::LOCAL;
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCreateSwapchainKHR(
    device: vk::Device,
    info: *const vk::SwapchainCreateInfoKHR,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::SwapchainKHR,
) -> vk::Result {
    guard_result("vkCreateSwapchainKHR", move || {
        let owner = from_handle::<Device>(device);
        let info = &*info;
        let surface = from_handle::<Surface>(info.surface);
        surface.take_over(optional::<Swapchain>(info.old_swapchain))?;
        let waiting = Arc::clone(&owner.engine.waiting);
        let (creation, window) = (creation(info), surface.window()?);
        let swapchain = Swapchain::new(&creation, window, &owner.window, waiting)?;
        let swapchain = handle::new(swapchain);
        for image in &swapchain.images {
            report::<Image>(device, handle::handle_of(image), AddressEvent::Created);
        }
        surface.add(&swapchain);
        *out = handle::into_handle(swapchain);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkDestroySwapchainKHR(
    device: vk::Device,
    swapchain: vk::SwapchainKHR,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroySwapchainKHR", move || {
        if let Some(swapchain) = handle::take::<Swapchain>(swapchain) {
            for image in &swapchain.images {
                report::<Image>(device, handle::handle_of(image), AddressEvent::Unbound);
            }
            // A queue may hold the swapchain longer, but not its window.
            swapchain.close();
        }
    })
}

pub(crate) unsafe extern "system" fn vkGetSwapchainImagesKHR(
    _device: vk::Device,
    swapchain: vk::SwapchainKHR,
    count: *mut u32,
    out: *mut vk::Image,
) -> vk::Result {
    guard_result("vkGetSwapchainImagesKHR", move || {
        let images = &from_handle::<Swapchain>(swapchain).images;
        enumerate(count, out, images.iter().map(handle::handle_of))
    })
}

pub(crate) unsafe extern "system" fn vkAcquireNextImageKHR(
    device: vk::Device,
    swapchain: vk::SwapchainKHR,
    timeout_ns: u64,
    semaphore: vk::Semaphore,
    fence: vk::Fence,
    out: *mut u32,
) -> vk::Result {
    guard_result("vkAcquireNextImageKHR", move || {
        let (index, is_suboptimal) = acquire(device, swapchain, timeout_ns, semaphore, fence)?;
        *out = index;
        suboptimal(is_suboptimal)
    })
}

pub(crate) unsafe extern "system" fn vkAcquireNextImage2KHR(
    device: vk::Device,
    info: *const vk::AcquireNextImageInfoKHR,
    out: *mut u32,
) -> vk::Result {
    guard_result("vkAcquireNextImage2KHR", move || {
        let info = &*info;
        let (index, is_suboptimal) = acquire(
            device,
            info.swapchain,
            info.timeout,
            info.semaphore,
            info.fence,
        )?;
        *out = index;
        suboptimal(is_suboptimal)
    })
}

pub(crate) unsafe extern "system" fn vkQueuePresentKHR(
    queue: vk::Queue,
    info: *const vk::PresentInfoKHR,
) -> vk::Result {
    guard_result("vkQueuePresentKHR", move || {
        let info = &*info;
        let semaphores = slice(info.p_wait_semaphores, info.wait_semaphore_count);
        let swapchains = slice(info.p_swapchains, info.swapchain_count);
        let images = slice(info.p_image_indices, info.swapchain_count);
        let mut presents = Vec::with_capacity(swapchains.len());
        let mut codes = Vec::with_capacity(swapchains.len());
        for (index, (&swapchain, &image)) in swapchains.iter().zip(images).enumerate() {
            let swapchain = retain::<Swapchain>(swapchain);
            let mut request = request(info, &swapchain, index, image);
            match swapchain.queue(&mut request) {
                Ok(code) => {
                    codes.push(code);
                    presents.push((swapchain, request));
                }
                Err(code) => codes.push(code),
            }
        }
        let submitted = from_handle::<Queue>(queue).submit([Submission {
            waits: semaphores
                .iter()
                .map(|&semaphore| (retain::<Semaphore>(semaphore), 1))
                .collect(),
            presents,
            present_fences: present_fences(info.p_next),
            ..Submission::default()
        }]);
        if let Err(code) = submitted {
            codes.fill(code);
        }
        for (out, &code) in array::slice_mut(info.p_results, info.swapchain_count)
            .iter_mut()
            .zip(&codes)
        {
            *out = code;
        }
        // The worst result: errors are negative, `VK_SUBOPTIMAL_KHR` is positive.
        let errors = codes.iter().copied().filter(|code| code.as_raw() < 0);
        let others = codes.iter().copied().filter(|code| code.as_raw() > 0);
        errors.chain(others).next().map_or(Ok(()), Err)
    })
}

/// HDR metadata has no effect: no surface shows more than its color space.
pub(crate) unsafe extern "system" fn vkSetHdrMetadataEXT(
    _device: vk::Device,
    _count: u32,
    _swapchains: *const vk::SwapchainKHR,
    _metadata: *const vk::HdrMetadataEXT<'_>,
) {
}

pub(crate) unsafe extern "system" fn vkReleaseSwapchainImagesEXT(
    _device: vk::Device,
    info: *const vk::ReleaseSwapchainImagesInfoEXT,
) -> vk::Result {
    guard_result("vkReleaseSwapchainImagesEXT", move || {
        let info = &*info;
        let images = slice(info.p_image_indices, info.image_index_count);
        from_handle::<Swapchain>(info.swapchain).release(images);
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetSwapchainStatusKHR(
    _device: vk::Device,
    swapchain: vk::SwapchainKHR,
) -> vk::Result {
    guard_result("vkGetSwapchainStatusKHR", move || {
        from_handle::<Swapchain>(swapchain).status()
    })
}

pub(crate) unsafe extern "system" fn vkWaitForPresentKHR(
    _device: vk::Device,
    swapchain: vk::SwapchainKHR,
    id: u64,
    timeout_ns: u64,
) -> vk::Result {
    guard_result("vkWaitForPresentKHR", move || {
        from_handle::<Swapchain>(swapchain).wait_for_present(id, timeout_ns)
    })
}

pub(crate) unsafe extern "system" fn vkWaitForPresent2KHR(
    _device: vk::Device,
    swapchain: vk::SwapchainKHR,
    info: *const vk::PresentWait2InfoKHR,
) -> vk::Result {
    guard_result("vkWaitForPresent2KHR", move || {
        from_handle::<Swapchain>(swapchain).wait_for_present((*info).present_id, (*info).timeout)
    })
}
