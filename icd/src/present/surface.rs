//! Surfaces and their capabilities.

#![forbid(unsafe_code)]

use std::sync::{Arc, Weak};

use ash::vk;
use parking_lot::Mutex;

use super::offer::{IMAGE_USAGE, MAX_IMAGES, MIN_IMAGES, is_shared};
use super::swapchain::Shared;
use super::timing::OWN_STAGES;
use super::{Swapchain, Window};
use crate::VkResult;
use crate::capabilities::limits::{MAX_IMAGE_ARRAY_LAYERS, MAX_IMAGE_DIMENSION};
use crate::ffi::vk::{PRESENT_STAGE_IMAGE_FIRST_PIXEL_OUT_EXT, PresentStageFlagsEXT};
use crate::handle::{Object, Ref};

/// `VkSurfaceKHR`.
pub struct Surface {
    /// `None` for a headless surface, which shows nothing.
    window: Mutex<Option<Arc<dyn Window>>>,
    is_headless: bool,
    /// The swapchains made for this surface that are still alive.
    swapchains: Mutex<Vec<Weak<Shared>>>,
}

impl Surface {
    /// A surface without a window.
    pub fn headless() -> Self {
        Self {
            window: Mutex::new(None),
            is_headless: true,
            swapchains: Mutex::default(),
        }
    }

    pub fn of(window: Arc<dyn Window>) -> Self {
        Self {
            window: Mutex::new(Some(window)),
            is_headless: false,
            swapchains: Mutex::default(),
        }
    }

    /// The window; `None` for a headless surface.
    ///
    /// # Errors
    /// `VK_ERROR_SURFACE_LOST_KHR` once the surface is closed.
    pub fn window(&self) -> VkResult<Option<Arc<dyn Window>>> {
        let window = self.window.lock().clone();
        if window.is_none() && !self.is_headless {
            return Err(vk::Result::ERROR_SURFACE_LOST_KHR);
        }
        Ok(window)
    }

    /// Ends every use of the window. After this returns, the application may close its connection.
    pub fn close(&self) {
        for swapchain in self.swapchains.lock().drain(..) {
            if let Some(swapchain) = swapchain.upgrade() {
                swapchain.close();
            }
        }
        self.window.lock().take();
    }

    /// Whether images can be presented.
    pub fn is_presentable(&self) -> VkResult<bool> {
        Ok(self.window()?.is_none_or(|window| window.is_presentable()))
    }

    /// The presentation stages that have times.
    ///
    /// # Errors
    /// `VK_ERROR_SURFACE_LOST_KHR`.
    pub fn timed_stages(&self) -> VkResult<PresentStageFlagsEXT> {
        let tells = self.window()?.is_some_and(|window| window.reports_times());
        Ok(match tells {
            true => OWN_STAGES | PRESENT_STAGE_IMAGE_FIRST_PIXEL_OUT_EXT,
            false => OWN_STAGES,
        })
    }

    /// `VkSurfaceCapabilitiesKHR`.
    ///
    /// # Errors
    /// `VK_ERROR_SURFACE_LOST_KHR`.
    pub fn capabilities(
        &self,
        mode: Option<vk::PresentModeKHR>,
    ) -> VkResult<vk::SurfaceCapabilitiesKHR> {
        let side = |side| vk::Extent2D {
            width: side,
            height: side,
        };
        let window = self.window()?;
        let extent = window.as_ref().map_or(Ok(None), |window| window.extent())?;
        let shared = mode.is_some_and(is_shared);
        Ok(vk::SurfaceCapabilitiesKHR {
            min_image_count: if shared { 1 } else { MIN_IMAGES },
            max_image_count: if shared { 1 } else { MAX_IMAGES },
            current_extent: extent.unwrap_or(side(u32::MAX)),
            min_image_extent: extent.unwrap_or(side(1)),
            max_image_extent: extent.unwrap_or(side(MAX_IMAGE_DIMENSION)),
            max_image_array_layers: MAX_IMAGE_ARRAY_LAYERS,
            supported_transforms: vk::SurfaceTransformFlagsKHR::IDENTITY,
            current_transform: vk::SurfaceTransformFlagsKHR::IDENTITY,
            supported_composite_alpha: window.map_or(
                vk::CompositeAlphaFlagsKHR::OPAQUE | vk::CompositeAlphaFlagsKHR::INHERIT,
                |window| window.composite_alpha(),
            ),
            supported_usage_flags: IMAGE_USAGE,
        })
    }

    /// Retires `old`, and checks that a new swapchain can take the surface.
    ///
    /// # Errors
    /// `VK_ERROR_NATIVE_WINDOW_IN_USE_KHR` if another swapchain that is not retired uses the
    /// window.
    pub fn take_over(&self, old: Option<&Object<Swapchain>>) -> VkResult {
        let mut swapchains = self.swapchains.lock();
        swapchains.retain(|swapchain| {
            (swapchain.upgrade()).is_some_and(|swapchain| !swapchain.is_closed())
        });
        if let Some(old) = old {
            old.retire();
        }
        let others = swapchains.iter().filter_map(Weak::upgrade);
        if !self.is_headless && others.into_iter().any(|other| !other.is_retired()) {
            return Err(vk::Result::ERROR_NATIVE_WINDOW_IN_USE_KHR);
        }
        Ok(())
    }

    /// Adds a swapchain that was made for this surface.
    pub fn add(&self, swapchain: &Ref<Swapchain>) {
        self.swapchains
            .lock()
            .push(Arc::downgrade(swapchain.shared()));
    }
}
