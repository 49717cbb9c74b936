//! Surfaces, and what can be presented to them.

#![forbid(unsafe_code)]

use std::sync::{Arc, Weak};

use ash::vk;
use parking_lot::Mutex;

use super::swapchain::Shared;
use super::{Swapchain, Window};
use crate::VkResult;
use crate::ffi::vk::PRESENT_MODE_FIFO_LATEST_READY_KHR;
use crate::handle::{Object, Ref};
use crate::table::limits::{MAX_IMAGE_ARRAY_LAYERS, MAX_IMAGE_DIMENSION};

/// Images of a swapchain. One is handed to the window while another is drawn.
pub const MIN_IMAGES: u32 = 2;
pub const MAX_IMAGES: u32 = 16;

/// The formats that can be presented; windows get them converted where they show another one.
pub const FORMATS: [vk::Format; 6] = [
    vk::Format::B8G8R8A8_UNORM,
    vk::Format::B8G8R8A8_SRGB,
    vk::Format::R8G8B8A8_UNORM,
    vk::Format::R8G8B8A8_SRGB,
    vk::Format::A2B10G10R10_UNORM_PACK32,
    vk::Format::R16G16B16A16_SFLOAT,
];

/// The color spaces of `VK_EXT_swapchain_colorspace` that a format can be presented in.
pub const COLOR_SPACES: [(vk::Format, vk::ColorSpaceKHR); 1] = [(
    vk::Format::R16G16B16A16_SFLOAT,
    vk::ColorSpaceKHR::EXTENDED_SRGB_LINEAR_EXT,
)];

/// The modes that can be asked for, and whether an extension has to be enabled for one.
pub const MODES: [vk::PresentModeKHR; 7] = [
    vk::PresentModeKHR::FIFO,
    vk::PresentModeKHR::FIFO_RELAXED,
    vk::PresentModeKHR::MAILBOX,
    vk::PresentModeKHR::IMMEDIATE,
    PRESENT_MODE_FIFO_LATEST_READY_KHR,
    vk::PresentModeKHR::SHARED_DEMAND_REFRESH,
    vk::PresentModeKHR::SHARED_CONTINUOUS_REFRESH,
];

/// Whether a mode presents one image that the application goes on drawing to.
pub fn is_shared(mode: vk::PresentModeKHR) -> bool {
    mode == vk::PresentModeKHR::SHARED_DEMAND_REFRESH
        || mode == vk::PresentModeKHR::SHARED_CONTINUOUS_REFRESH
}

/// The modes that a swapchain made for `mode` can change to, itself among them.
pub fn compatible_modes(mode: vk::PresentModeKHR) -> impl Iterator<Item = vk::PresentModeKHR> {
    MODES
        .into_iter()
        .filter(move |&other| is_shared(other) == is_shared(mode))
}

/// `VkSurfaceKHR`.
pub struct Surface {
    /// None is a headless surface: what is presented to it is seen by nobody.
    window: Mutex<Option<Arc<dyn Window>>>,
    is_headless: bool,
    /// Made for it, and not yet gone.
    swapchains: Mutex<Vec<Weak<Shared>>>,
}

impl Surface {
    /// Without a window.
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

    /// The window, where there is one.
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

    /// Ends everything that uses the window: when this returns, the application may close its
    /// connection.
    pub fn close(&self) {
        for swapchain in self.swapchains.lock().drain(..) {
            if let Some(swapchain) = swapchain.upgrade() {
                swapchain.close();
            }
        }
        self.window.lock().take();
    }

    /// Whether pictures can be presented.
    pub fn is_presentable(&self) -> VkResult<bool> {
        Ok(self.window()?.is_none_or(|window| window.is_presentable()))
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

    /// A new swapchain takes the surface, `old` with it.
    ///
    /// # Errors
    /// `VK_ERROR_NATIVE_WINDOW_IN_USE_KHR` if another one that is not retired has the window.
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

    /// Remembers a swapchain that was made for it.
    pub fn add(&self, swapchain: &Ref<Swapchain>) {
        self.swapchains
            .lock()
            .push(Arc::downgrade(swapchain.shared()));
    }
}

/// What images of swapchains can be used for.
pub const IMAGE_USAGE: vk::ImageUsageFlags = vk::ImageUsageFlags::from_raw(
    vk::ImageUsageFlags::TRANSFER_SRC.as_raw()
        | vk::ImageUsageFlags::TRANSFER_DST.as_raw()
        | vk::ImageUsageFlags::SAMPLED.as_raw()
        | vk::ImageUsageFlags::STORAGE.as_raw()
        | vk::ImageUsageFlags::COLOR_ATTACHMENT.as_raw()
        | vk::ImageUsageFlags::INPUT_ATTACHMENT.as_raw(),
);
