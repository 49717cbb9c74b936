//! Surfaces: `VK_KHR_surface`, the window systems, and surface capabilities.

use std::ffi::c_void;

use ash::vk::Handle;

use crate::VkResult;
use crate::capabilities::extensions::Extension;
use crate::capabilities::limits::MAX_IMAGE_DIMENSION;
use crate::ffi::enumerate::enumerate_with;
use crate::ffi::{chain, enumerate, vk};
use crate::guard::{guard, guard_result};
use crate::handle::{self, from_handle, optional};
use crate::object::PhysicalDevice;
use crate::present::{
    DEEP_FORMATS, FORMATS, IMAGE_USAGE, MODES, SURFACELESS_MODES, Scaling, Surface,
    compatible_modes,
};

/// The formats of a surface.
fn formats(device: &PhysicalDevice) -> Vec<vk::SurfaceFormatKHR> {
    let plain = FORMATS.map(|format| (format, vk::ColorSpaceKHR::SRGB_NONLINEAR));
    let has_spaces = (device.instance_extensions).contains(Extension::EXT_SWAPCHAIN_COLORSPACE);
    let more = DEEP_FORMATS.into_iter().filter(|_| has_spaces);
    (plain.into_iter().chain(more))
        .map(|(format, color_space)| vk::SurfaceFormatKHR {
            format,
            color_space,
        })
        .collect()
}

/// Queries a surface, or a headless one for `VK_NULL_HANDLE` (`VK_GOOGLE_surfaceless_query`), whose
/// formats and modes are the same.
///
/// # Safety
/// The handle is alive or null.
unsafe fn ask<R>(
    surface: vk::SurfaceKHR,
    question: impl FnOnce(&Surface) -> VkResult<R>,
) -> VkResult<R> {
    // SAFETY: the caller guarantees that the handle is alive or null.
    match unsafe { optional::<Surface>(surface) } {
        Some(surface) => question(surface),
        None => question(&Surface::headless()),
    }
}

/// Fills the structures in the chain of `VkSurfaceCapabilities2KHR`.
///
/// # Safety
/// A valid chain of output structures.
unsafe fn fill_capabilities(
    next: *mut c_void,
    capabilities: &vk::SurfaceCapabilitiesKHR,
    mode: Option<vk::PresentModeKHR>,
) {
    // SAFETY: the caller guarantees a valid chain of output structures.
    unsafe {
        if let Some(out) = chain::find_mut::<vk::SurfaceProtectedCapabilitiesKHR>(next) {
            out.supports_protected = vk::FALSE;
        }
        if let Some(out) = chain::find_mut::<vk::SharedPresentSurfaceCapabilitiesKHR>(next) {
            out.shared_present_supported_usage_flags = IMAGE_USAGE;
        }
        if let Some(out) = chain::find_mut::<vk::SharedPresentSurfaceCapabilities2KHR<'_>>(next) {
            out.shared_present_supported_usage_flags = IMAGE_USAGE.as_raw().into();
        }
        if let Some(out) = chain::find_mut::<vk::ImageUsageFlags2CreateInfoKHR<'_>>(next) {
            out.usage = capabilities.supported_usage_flags.as_raw().into();
        }
        if let Some(out) = chain::find_mut::<vk::SurfaceCapabilitiesPresentId2KHR>(next) {
            out.present_id2_supported = vk::TRUE;
        }
        if let Some(out) = chain::find_mut::<vk::SurfaceCapabilitiesPresentWait2KHR>(next) {
            out.present_wait2_supported = vk::TRUE;
        }
        if let Some(out) = chain::find_mut::<vk::SurfacePresentScalingCapabilitiesEXT>(next) {
            let is_window = capabilities.current_extent.width != u32::MAX;
            let (behaviors, gravities) = (Scaling::BEHAVIORS, Scaling::GRAVITIES);
            out.supported_present_scaling = if is_window {
                behaviors
            } else {
                Default::default()
            };
            out.supported_present_gravity_x = if is_window {
                gravities
            } else {
                Default::default()
            };
            out.supported_present_gravity_y = out.supported_present_gravity_x;
            let side = |side| vk::Extent2D {
                width: side,
                height: side,
            };
            out.min_scaled_image_extent = side(1);
            out.max_scaled_image_extent = side(MAX_IMAGE_DIMENSION);
        }
        if let Some(out) = chain::find_mut::<vk::SurfacePresentModeCompatibilityEXT>(next) {
            let modes: Vec<_> =
                compatible_modes(mode.unwrap_or(vk::PresentModeKHR::FIFO)).collect();
            // The command cannot return `VK_INCOMPLETE`.
            let _ = enumerate(
                &mut out.present_mode_count,
                out.p_present_modes,
                modes.into_iter(),
            );
        }
    }
}

pub(crate) unsafe extern "system" fn vkCreateHeadlessSurfaceEXT(
    _instance: vk::Instance,
    _info: *const vk::HeadlessSurfaceCreateInfoEXT,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::SurfaceKHR,
) -> vk::Result {
    guard_result("vkCreateHeadlessSurfaceEXT", move || {
        *out = handle::create(Surface::headless());
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkDestroySurfaceKHR(
    _instance: vk::Instance,
    surface: vk::SurfaceKHR,
    _allocator: *const vk::AllocationCallbacks,
) {
    guard("vkDestroySurfaceKHR", move || {
        if let Some(surface) = handle::take::<Surface>(surface) {
            surface.close();
        }
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceSurfaceSupportKHR(
    _device: vk::PhysicalDevice,
    _family: u32,
    handle: vk::SurfaceKHR,
    out: *mut vk::Bool32,
) -> vk::Result {
    guard_result("vkGetPhysicalDeviceSurfaceSupportKHR", move || {
        *out = ask(handle, Surface::is_presentable)?.into();
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceSurfaceCapabilitiesKHR(
    _device: vk::PhysicalDevice,
    handle: vk::SurfaceKHR,
    out: *mut vk::SurfaceCapabilitiesKHR,
) -> vk::Result {
    guard_result("vkGetPhysicalDeviceSurfaceCapabilitiesKHR", move || {
        *out = ask(handle, |surface| surface.capabilities(None))?;
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceSurfaceCapabilities2KHR(
    _device: vk::PhysicalDevice,
    info: *const vk::PhysicalDeviceSurfaceInfo2KHR,
    out: *mut vk::SurfaceCapabilities2KHR,
) -> vk::Result {
    guard_result("vkGetPhysicalDeviceSurfaceCapabilities2KHR", move || {
        let mode =
            chain::find::<vk::SurfacePresentModeEXT>((*info).p_next).map(|info| info.present_mode);
        let capabilities = ask((*info).surface, |surface| surface.capabilities(mode))?;
        (*out).surface_capabilities = capabilities;
        fill_capabilities((*out).p_next, &capabilities, mode);
        if let Some(out) = chain::find_mut::<vk::PresentTimingSurfaceCapabilitiesEXT>((*out).p_next)
        {
            out.present_timing_supported = vk::TRUE;
            out.present_at_absolute_time_supported = vk::TRUE;
            out.present_at_relative_time_supported = vk::TRUE;
            out.present_stage_queries = ask((*info).surface, Surface::timed_stages)?;
        }
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceSurfaceFormatsKHR(
    device: vk::PhysicalDevice,
    handle: vk::SurfaceKHR,
    count: *mut u32,
    out: *mut vk::SurfaceFormatKHR,
) -> vk::Result {
    guard_result("vkGetPhysicalDeviceSurfaceFormatsKHR", move || {
        ask(handle, Surface::window)?;
        enumerate(
            count,
            out,
            formats(from_handle::<PhysicalDevice>(device)).into_iter(),
        )
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceSurfaceFormats2KHR(
    device: vk::PhysicalDevice,
    info: *const vk::PhysicalDeviceSurfaceInfo2KHR,
    count: *mut u32,
    out: *mut vk::SurfaceFormat2KHR,
) -> vk::Result {
    guard_result("vkGetPhysicalDeviceSurfaceFormats2KHR", move || {
        ask((*info).surface, Surface::window)?;
        let all = formats(from_handle::<PhysicalDevice>(device)).into_iter();
        enumerate_with(count, out, all, |out, format| out.surface_format = format)
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceSurfacePresentModesKHR(
    _device: vk::PhysicalDevice,
    handle: vk::SurfaceKHR,
    count: *mut u32,
    out: *mut vk::PresentModeKHR,
) -> vk::Result {
    guard_result("vkGetPhysicalDeviceSurfacePresentModesKHR", move || {
        ask(handle, Surface::window)?;
        let modes: &[_] = if handle.is_null() {
            &SURFACELESS_MODES
        } else {
            &MODES
        };
        enumerate(count, out, modes.iter().copied())
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDevicePresentRectanglesKHR(
    _device: vk::PhysicalDevice,
    handle: vk::SurfaceKHR,
    count: *mut u32,
    out: *mut vk::Rect2D,
) -> vk::Result {
    guard_result("vkGetPhysicalDevicePresentRectanglesKHR", move || {
        // The swapchain decides the size of a headless surface.
        let extent = ask(handle, |surface| surface.capabilities(None))?.current_extent;
        enumerate(
            count,
            out,
            [vk::Rect2D {
                extent,
                ..Default::default()
            }]
            .into_iter(),
        )
    })
}
