//! Presentation: surfaces, and swapchains on them.
//!
//! ```text
//! vkQueuePresentKHR ──> queue's thread ──> Swapchain::enqueue ──> [ ready ]
//!                                                                     │
//!                              window <── Screen <── swapchain's thread
//!                                            │
//! vkAcquireNextImageKHR <── [ free ] <──── ScreenEvent
//! ```
//!
//! A [`Window`] is the window of a surface: it reports its extent and capabilities. A [`Screen`]
//! presents one swapchain's images to the window, on that swapchain's thread. Headless surfaces
//! have no window; their images are free again once they are presented.

mod conversion;
mod headless;
mod offer;
pub mod pixels;
mod placement;
mod surface;
mod swapchain;
mod thread;
pub mod timing;
#[cfg(unix)]
pub mod wayland;
#[cfg(windows)]
pub mod win32;
#[cfg(unix)]
pub mod x11;

use std::sync::Arc;
use std::time::Instant;

use ash::vk;

pub use offer::{DEEP_FORMATS, FORMATS, IMAGE_USAGE, MODES, SURFACELESS_MODES, compatible_modes};
pub use placement::Scaling;
pub use surface::Surface;
pub use swapchain::{Creation, Request, Swapchain};

use crate::VkResult;
use crate::handle::Ref;
use crate::object::{DeviceMemory, Image};
/// The wake-up of a swapchain's thread.
pub use crate::os::event::Event as WakeEvent;
use timing::Refresh;

crate::handle::handled!(Surface => SurfaceKHR, Swapchain => SwapchainKHR);

/// The window or the connection to it no longer exists: `VK_ERROR_SURFACE_LOST_KHR`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SurfaceLost;

/// The window of a surface.
pub trait Window: Send + Sync {
    /// The window's extent; `None` if the window takes the swapchain's extent.
    ///
    /// # Errors
    /// `VK_ERROR_SURFACE_LOST_KHR`.
    fn extent(&self) -> VkResult<Option<vk::Extent2D>>;

    /// Whether images can be presented to the window.
    fn is_presentable(&self) -> bool;

    /// The supported composite alpha modes.
    fn composite_alpha(&self) -> vk::CompositeAlphaFlagsKHR;

    /// Whether the window system reports when images were shown.
    fn reports_times(&self) -> bool;

    /// Creates the screen of a swapchain.
    ///
    /// # Errors
    /// `VK_ERROR_SURFACE_LOST_KHR`, or out of memory.
    fn screen(&self, pictures: Pictures, wake: &Arc<WakeEvent>) -> VkResult<Box<dyn Screen>>;
}

/// The images of a swapchain, and how they are to be shown.
#[derive(Clone)]
pub struct Pictures {
    pub images: Vec<Ref<Image>>,
    /// The memory that holds the images, one after the other.
    pub memory: Arc<DeviceMemory>,
    pub is_linear: bool,
    pub composite_alpha: vk::CompositeAlphaFlagsKHR,
    pub scaling: Scaling,
    /// The application asks when images were shown.
    pub is_timed: bool,
}

impl Pictures {
    pub fn extent(&self) -> vk::Extent2D {
        let vk::Extent3D { width, height, .. } = self.images[0].extent;
        vk::Extent2D { width, height }
    }

    pub fn format(&self) -> vk::Format {
        self.images[0].format
    }

    /// Offset of an image in the memory.
    pub fn offset_bytes(&self, index: u32) -> u64 {
        self.images[index as usize].data() as u64 - self.memory.address
    }

    /// The pixels of an image that presentation to a window reads.
    fn picture(&self, index: u32) -> pixels::Picture {
        let image = &self.images[index as usize];
        let level = &image.planes[0].levels[0];
        pixels::Picture {
            data: image.data().wrapping_add(level.offset_bytes as usize),
            row_stride_bytes: level.row_stride_bytes as usize,
            extent: self.extent(),
            format: image.format,
            is_linear: self.is_linear,
        }
    }
}

/// The time at which an image is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum When {
    NextRefresh,
    /// At the next refresh, or at once if one has passed since the last image.
    NextRefreshOrLate,
    /// At the next refresh, unless another image is presented before it.
    Replaceable,
    AtOnce,
}

/// An image to be shown.
pub struct Frame<'a> {
    pub index: u32,
    pub serial: u32,
    pub when: When,
    /// The region that changed since the last image; empty means all of it.
    pub damage: &'a [vk::Rect2D],
}

/// An event of a screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScreenEvent {
    /// A frame is on the screen, or a later one has replaced it.
    Shown { serial: u32 },
    /// The time at which a frame's first pixel left for the display, if it is known. Sent once for
    /// each frame of timed [`Pictures`].
    Out { serial: u32, at_ns: Option<u64> },
    /// An image is no longer read.
    Free { index: u32 },
    /// The window's extent, which may have changed.
    Extent(vk::Extent2D),
}

/// Presents a swapchain's images to a window.
pub trait Screen: Send {
    /// Presents an image.
    ///
    /// # Errors
    /// The window has gone.
    fn show(&mut self, frame: &Frame<'_>) -> Result<(), SurfaceLost>;

    /// Sleeps until there are events, the wake event is signaled or the deadline has passed, and
    /// appends the events.
    ///
    /// # Errors
    /// The window has gone.
    fn wait(
        &mut self,
        deadline: Option<Instant>,
        events: &mut Vec<ScreenEvent>,
    ) -> Result<(), SurfaceLost>;

    /// The display's refresh cycle, if it is known.
    fn refresh(&self) -> Option<Refresh> {
        None
    }

    /// Whether a shared image must be presented again at each refresh.
    fn is_watched(&self) -> bool {
        true
    }
}
