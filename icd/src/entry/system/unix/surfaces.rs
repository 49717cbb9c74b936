//! Surfaces of windows: X11 and Wayland.

use std::sync::Arc;

use crate::ffi::vk;
use crate::guard::{guard, guard_result};
use crate::handle;
use crate::present::Surface;
use crate::present::wayland::WaylandWindow;
use crate::present::x11::{self, X11Window};

pub(crate) unsafe extern "system" fn vkCreateXcbSurfaceKHR(
    _instance: vk::Instance,
    info: *const vk::XcbSurfaceCreateInfoKHR,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::SurfaceKHR,
) -> vk::Result {
    guard_result("vkCreateXcbSurfaceKHR", move || {
        let window = X11Window::new((*info).connection.cast(), (*info).window)?;
        *out = handle::create(Surface::of(Arc::new(window)));
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCreateXlibSurfaceKHR(
    _instance: vk::Instance,
    info: *const vk::XlibSurfaceCreateInfoKHR,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::SurfaceKHR,
) -> vk::Result {
    guard_result("vkCreateXlibSurfaceKHR", move || {
        let connection = x11::connection_of((*info).dpy.cast())
            .ok_or(vk::Result::ERROR_INITIALIZATION_FAILED)?;
        // A window id has 32 bits, although Xlib's type is wider.
        let window = X11Window::new(connection, (*info).window as u32)?;
        *out = handle::create(Surface::of(Arc::new(window)));
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkCreateWaylandSurfaceKHR(
    _instance: vk::Instance,
    info: *const vk::WaylandSurfaceCreateInfoKHR,
    _allocator: *const vk::AllocationCallbacks,
    out: *mut vk::SurfaceKHR,
) -> vk::Result {
    guard_result("vkCreateWaylandSurfaceKHR", move || {
        let window = WaylandWindow::new((*info).display.cast(), (*info).surface.cast());
        *out = handle::create(Surface::of(Arc::new(window)));
        Ok(())
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceXcbPresentationSupportKHR(
    _device: vk::PhysicalDevice,
    _family: u32,
    connection: *mut vk::xcb_connection_t,
    visual: vk::xcb_visualid_t,
) -> vk::Bool32 {
    guard("vkGetPhysicalDeviceXcbPresentationSupportKHR", move || {
        x11::presents_visual(connection.cast(), visual).into()
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceXlibPresentationSupportKHR(
    _device: vk::PhysicalDevice,
    _family: u32,
    display: *mut vk::Display,
    visual: vk::VisualID,
) -> vk::Bool32 {
    guard("vkGetPhysicalDeviceXlibPresentationSupportKHR", move || {
        let connection = x11::connection_of(display.cast());
        connection
            .is_some_and(|connection| x11::presents_visual(connection, visual as u32))
            .into()
    })
}

pub(crate) unsafe extern "system" fn vkGetPhysicalDeviceWaylandPresentationSupportKHR(
    _device: vk::PhysicalDevice,
    _family: u32,
    _display: *mut vk::wl_display,
) -> vk::Bool32 {
    guard(
        "vkGetPhysicalDeviceWaylandPresentationSupportKHR",
        move || {
            // Every compositor has `wl_shm` and the two required formats.
            vk::TRUE
        },
    )
}
