//! Presentation: surfaces, and swapchains on them.
//!
//! ```text
//! vkQueuePresentKHR ──> queue's thread ──> Swapchain::enqueue ──> [ ready ]
//!                                                                     │
//!                              window <── Screen <── swapchain's thread
//!                                            │
//! vkAcquireNextImageKHR <── [ free ] <──── Event
//! ```
//!
//! A [`Window`] is what a surface stands for: it knows its extent and what it can show. A
//! [`Screen`] is the way of one swapchain's images to it, used by that swapchain's thread alone.
//! Surfaces without a window need neither: an image comes back when its turn is over.

mod conversion;
mod nowhere;
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
pub use crate::os::event::Event as Bell;
use timing::Refresh;

crate::handle::handled!(Surface => SurfaceKHR, Swapchain => SwapchainKHR);

/// The window has gone, or the connection to it: `VK_ERROR_SURFACE_LOST_KHR`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gone;

/// The window of a surface.
pub trait Window: Send + Sync {
    /// The window's extent, unless it takes that of the swapchain.
    ///
    /// # Errors
    /// `VK_ERROR_SURFACE_LOST_KHR`.
    fn extent(&self) -> VkResult<Option<vk::Extent2D>>;

    /// Whether pictures can be shown there.
    fn is_presentable(&self) -> bool;

    /// How alpha can be taken.
    fn composite_alpha(&self) -> vk::CompositeAlphaFlagsKHR;

    /// Whether it is told when pictures were shown.
    fn tells_times(&self) -> bool;

    /// A way for a swapchain's images to the window.
    ///
    /// # Errors
    /// `VK_ERROR_SURFACE_LOST_KHR`, and memory that there is not.
    fn screen(&self, pictures: Pictures, bell: &Arc<Bell>) -> VkResult<Box<dyn Screen>>;
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
    /// Somebody wants to know when each was seen.
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

    /// Bytes from the start of the memory to an image.
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

/// How soon an image is to be on the screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum When {
    NextRefresh,
    /// At the next refresh, or at once if one has passed since the last image.
    NextRefreshOrLate,
    /// At the next refresh, unless another one is handed over before.
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
pub enum Event {
    /// A frame's turn has come: it is on the screen, or another one instead.
    Shown { serial: u32 },
    /// When a frame's first pixel left for the display, where that is known: once for each frame of
    /// timed [`Pictures`].
    Out { serial: u32, at_ns: Option<u64> },
    /// An image is not read any more.
    Free { index: u32 },
    /// The window's extent, where it may have changed.
    Extent(vk::Extent2D),
}

/// The way of a swapchain's images to a window.
pub trait Screen: Send {
    /// Hands an image over.
    ///
    /// # Errors
    /// The window has gone.
    fn show(&mut self, frame: &Frame<'_>) -> Result<(), Gone>;

    /// Sleeps until there is something to tell, the bell is rung or the deadline is over, and
    /// tells.
    ///
    /// # Errors
    /// The window has gone.
    fn wait(&mut self, deadline: Option<Instant>, events: &mut Vec<Event>) -> Result<(), Gone>;

    /// The display's refreshes, as far as they are known.
    fn refresh(&self) -> Option<Refresh> {
        None
    }

    /// Whether a shared image is to be shown again and again.
    fn is_watched(&self) -> bool {
        true
    }
}
