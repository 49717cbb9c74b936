//! Linux: file descriptors, windows of X11 and Wayland, POSIX clocks.

mod descriptors;
mod surfaces;

pub use descriptors::{
    FENCE_HANDLES, MEMORY_HANDLES, SEMAPHORE_HANDLES, exported_fence, exported_memory,
    exported_semaphore, imported_memory,
};

use crate::entry::row::command_table;
use crate::ffi::vk;
use crate::os::clock::Clock;

/// The system's time domains for calibrated timestamps.
pub const TIME_DOMAINS: [vk::TimeDomainKHR; 2] = [
    vk::TimeDomainKHR::CLOCK_MONOTONIC,
    vk::TimeDomainKHR::CLOCK_MONOTONIC_RAW,
];

/// The time in a domain: one of [`TIME_DOMAINS`], or the device's.
pub fn time(domain: vk::TimeDomainKHR) -> u64 {
    match domain {
        vk::TimeDomainKHR::CLOCK_MONOTONIC_RAW => Clock::MonotonicRaw.now_ns(),
        _ => Clock::Monotonic.now_ns(),
    }
}

command_table! {
    Device KHR_EXTERNAL_FENCE_FD PFN_vkGetFenceFdKHR descriptors::vkGetFenceFdKHR;
    Device KHR_EXTERNAL_FENCE_FD PFN_vkImportFenceFdKHR descriptors::vkImportFenceFdKHR;
    Device KHR_EXTERNAL_SEMAPHORE_FD PFN_vkGetSemaphoreFdKHR descriptors::vkGetSemaphoreFdKHR;
    Device KHR_EXTERNAL_SEMAPHORE_FD PFN_vkImportSemaphoreFdKHR descriptors::vkImportSemaphoreFdKHR;
    Device KHR_EXTERNAL_MEMORY_FD PFN_vkGetMemoryFdKHR descriptors::vkGetMemoryFdKHR;
    Device KHR_EXTERNAL_MEMORY_FD PFN_vkGetMemoryFdPropertiesKHR descriptors::vkGetMemoryFdPropertiesKHR;
    Instance KHR_WAYLAND_SURFACE PFN_vkCreateWaylandSurfaceKHR surfaces::vkCreateWaylandSurfaceKHR;
    Instance KHR_XCB_SURFACE PFN_vkCreateXcbSurfaceKHR surfaces::vkCreateXcbSurfaceKHR;
    Instance KHR_XLIB_SURFACE PFN_vkCreateXlibSurfaceKHR surfaces::vkCreateXlibSurfaceKHR;
    PhysicalDevice KHR_WAYLAND_SURFACE PFN_vkGetPhysicalDeviceWaylandPresentationSupportKHR surfaces::vkGetPhysicalDeviceWaylandPresentationSupportKHR;
    PhysicalDevice KHR_XCB_SURFACE PFN_vkGetPhysicalDeviceXcbPresentationSupportKHR surfaces::vkGetPhysicalDeviceXcbPresentationSupportKHR;
    PhysicalDevice KHR_XLIB_SURFACE PFN_vkGetPhysicalDeviceXlibPresentationSupportKHR surfaces::vkGetPhysicalDeviceXlibPresentationSupportKHR;
}
