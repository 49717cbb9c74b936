//! Surfaces of windows, by what the system calls a window.

use std::ffi::CStr;

use anyhow::{Result, bail};
use ash::{khr, vk};
use demo::vulkan::Context;
use winit::raw_window_handle::{
    HasDisplayHandle, HasWindowHandle, RawDisplayHandle, RawWindowHandle,
};
use winit::window::Window;

/// The instance extensions for windows of a display.
///
/// # Errors
/// The display is of a kind that is unknown here.
pub fn extensions(display: &impl HasDisplayHandle) -> Result<[&'static CStr; 2]> {
    let own = match display.display_handle()?.as_raw() {
        RawDisplayHandle::Xlib(_) => khr::xlib_surface::NAME,
        RawDisplayHandle::Xcb(_) => khr::xcb_surface::NAME,
        RawDisplayHandle::Wayland(_) => khr::wayland_surface::NAME,
        RawDisplayHandle::Windows(_) => khr::win32_surface::NAME,
        other => bail!("windows of {other:?} are unknown here"),
    };
    Ok([khr::surface::NAME, own])
}

/// A window's surface, which the context can present to.
pub struct Surface<'a> {
    context: &'a Context,
    pub functions: khr::surface::Instance,
    pub handle: vk::SurfaceKHR,
}

impl<'a> Surface<'a> {
    /// The window must outlive the surface.
    pub fn new(context: &'a Context, window: &Window) -> Result<Surface<'a>> {
        let (entry, instance) = (&context.entry, &context.instance);
        let display = window.display_handle()?.as_raw();
        // SAFETY: the handles are the window's, which outlives the surface, and the extension was
        // enabled for this display.
        let handle = unsafe {
            match (display, window.window_handle()?.as_raw()) {
                (RawDisplayHandle::Xlib(display), RawWindowHandle::Xlib(window)) => {
                    let display = display.display.map_or(std::ptr::null_mut(), |d| d.as_ptr());
                    let info = vk::XlibSurfaceCreateInfoKHR::default()
                        .dpy(display.cast())
                        .window(window.window);
                    khr::xlib_surface::Instance::new(entry, instance)
                        .create_xlib_surface(&info, None)?
                }
                (RawDisplayHandle::Xcb(display), RawWindowHandle::Xcb(window)) => {
                    let connection = display.connection;
                    let connection = connection.map_or(std::ptr::null_mut(), |c| c.as_ptr());
                    let info = vk::XcbSurfaceCreateInfoKHR::default()
                        .connection(connection)
                        .window(window.window.get());
                    khr::xcb_surface::Instance::new(entry, instance)
                        .create_xcb_surface(&info, None)?
                }
                (RawDisplayHandle::Wayland(display), RawWindowHandle::Wayland(window)) => {
                    let info = vk::WaylandSurfaceCreateInfoKHR::default()
                        .display(display.display.as_ptr())
                        .surface(window.surface.as_ptr());
                    khr::wayland_surface::Instance::new(entry, instance)
                        .create_wayland_surface(&info, None)?
                }
                (RawDisplayHandle::Windows(_), RawWindowHandle::Win32(window)) => {
                    let info = vk::Win32SurfaceCreateInfoKHR::default()
                        .hinstance(window.hinstance.map_or(0, |module| module.get()))
                        .hwnd(window.hwnd.get());
                    khr::win32_surface::Instance::new(entry, instance)
                        .create_win32_surface(&info, None)?
                }
                (display, _) => bail!("windows of {display:?} are unknown here"),
            }
        };
        let surface = Surface {
            context,
            functions: khr::surface::Instance::new(entry, instance),
            handle,
        };
        // SAFETY: the handles are of this instance, and the family is one of the device's.
        let presents = unsafe {
            surface.functions.get_physical_device_surface_support(
                context.physical,
                context.family,
                handle,
            )
        };
        match presents? {
            true => Ok(surface),
            false => bail!("{} cannot present to this window", context.name),
        }
    }
}

impl Drop for Surface<'_> {
    fn drop(&mut self) {
        let device = &self.context.device;
        // SAFETY: its swapchain is gone, and nothing is in flight once the device is idle.
        unsafe {
            let _ = device.device_wait_idle();
            self.functions.destroy_surface(self.handle, None);
        }
    }
}
