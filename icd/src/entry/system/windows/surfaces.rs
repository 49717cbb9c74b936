//! Surfaces of windows of Win32.

use std::sync::Arc;

use crate::ffi::vk;
use crate::guard::{guard, guard_result};
use crate::handle;
use crate::present::Surface;
use crate::present::win32::Win32Window;

pub(crate) unsafe extern "system" fn vkCreateWin32SurfaceKHR(
    _instance: vk::Instance,
    info: *const vk::Win32SurfaceCreateInfoKHR,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::SurfaceKHR,
) -> vk::Result {
    guard_result("vkCreateWin32SurfaceKHR", move || {
        let window = Win32Window::new((*info).hwnd);
        *out = handle::create(Surface::of(Arc::new(window)));
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceWin32PresentationSupportKHR(
    _device: vk::PhysicalDevice,
    _family: u32,
) -> vk::Bool32 {
    guard(
        "vkGetPhysicalDeviceWin32PresentationSupportKHR",
        move || vk::TRUE,
    )
}
