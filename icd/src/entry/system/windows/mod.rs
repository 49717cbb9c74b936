//! Windows: handles of its objects, windows of Win32, the performance counter.

mod handles;
mod surfaces;

pub use handles::{
    FENCE_HANDLES, MEMORY_HANDLES, SEMAPHORE_HANDLES, exported_fence, exported_memory,
    exported_semaphore, imported_memory,
};

use crate::entry::row::command_table;
use crate::ffi::vk;
use crate::os::clock::{Clock, ticks};

/// The system's time domains for calibrated timestamps.
pub const TIME_DOMAINS: [vk::TimeDomainKHR; 1] = [vk::TimeDomainKHR::QUERY_PERFORMANCE_COUNTER];

/// The time in a domain: one of [`TIME_DOMAINS`], or the device's.
pub fn time(domain: vk::TimeDomainKHR) -> u64 {
    match domain {
        vk::TimeDomainKHR::QUERY_PERFORMANCE_COUNTER => ticks(),
        _ => Clock::Monotonic.now_ns(),
    }
}

command_table! {
    Device KHR_EXTERNAL_FENCE_WIN32 PFN_vkGetFenceWin32HandleKHR handles::vkGetFenceWin32HandleKHR;
    Device KHR_EXTERNAL_FENCE_WIN32 PFN_vkImportFenceWin32HandleKHR handles::vkImportFenceWin32HandleKHR;
    Device KHR_EXTERNAL_SEMAPHORE_WIN32 PFN_vkGetSemaphoreWin32HandleKHR handles::vkGetSemaphoreWin32HandleKHR;
    Device KHR_EXTERNAL_SEMAPHORE_WIN32 PFN_vkImportSemaphoreWin32HandleKHR handles::vkImportSemaphoreWin32HandleKHR;
    Device KHR_EXTERNAL_MEMORY_WIN32 PFN_vkGetMemoryWin32HandleKHR handles::vkGetMemoryWin32HandleKHR;
    Device KHR_EXTERNAL_MEMORY_WIN32 PFN_vkGetMemoryWin32HandlePropertiesKHR handles::vkGetMemoryWin32HandlePropertiesKHR;
    Instance KHR_WIN32_SURFACE PFN_vkCreateWin32SurfaceKHR surfaces::vkCreateWin32SurfaceKHR;
    PhysicalDevice KHR_WIN32_SURFACE PFN_vkGetPhysicalDeviceWin32PresentationSupportKHR surfaces::vkGetPhysicalDeviceWin32PresentationSupportKHR;
}
