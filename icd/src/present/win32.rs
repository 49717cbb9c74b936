//! Windows of Win32 (`VK_KHR_win32_surface`). Images are copied to a system bitmap, and the bitmap
//! to the window. The driver's clock decides the refreshes.

use std::sync::Arc;
use std::time::{Duration, Instant};

use ash::vk;

use super::conversion::Layout;
use super::pixels::{self, Canvas};
use super::{Frame, Pictures, Screen, ScreenEvent, SurfaceLost, WakeEvent, When, Window};
use crate::VkResult;
use crate::os::window::{self, Bitmap};

const LOST: vk::Result = vk::Result::ERROR_SURFACE_LOST_KHR;

/// The refresh period where the system reports none.
const REFRESH: Duration = Duration::from_nanos(16_666_667);

/// A window.
pub struct Win32Window(window::Window);

impl Win32Window {
    /// The window of an `HWND`. An invalid handle makes a lost surface.
    pub fn new(window: isize) -> Self {
        Self(window::Window::new(window))
    }
}

/// A window's extent; `None` once the window is destroyed.
fn extent_of(window: window::Window) -> Option<vk::Extent2D> {
    let (width, height) = window.extent()?;
    Some(vk::Extent2D { width, height })
}

impl Window for Win32Window {
    fn extent(&self) -> VkResult<Option<vk::Extent2D>> {
        extent_of(self.0).map(Some).ok_or(LOST)
    }

    fn is_presentable(&self) -> bool {
        extent_of(self.0).is_some()
    }

    fn composite_alpha(&self) -> vk::CompositeAlphaFlagsKHR {
        vk::CompositeAlphaFlagsKHR::OPAQUE | vk::CompositeAlphaFlagsKHR::INHERIT
    }

    fn reports_times(&self) -> bool {
        false
    }

    fn screen(&self, pictures: Pictures, wake: &Arc<WakeEvent>) -> VkResult<Box<dyn Screen>> {
        if !self.is_presentable() {
            return Err(LOST);
        }
        let rate = self.0.refreshes_per_second();
        Ok(Box::new(Win32Screen {
            window: self.0,
            pictures,
            wake: Arc::clone(wake),
            bitmap: None,
            period: rate.map_or(REFRESH, |rate| Duration::from_secs(1) / rate),
            next: Instant::now(),
            shown: None,
            pending: Vec::new(),
        }))
    }
}

struct Win32Screen {
    window: window::Window,
    pictures: Pictures,
    wake: Arc<WakeEvent>,
    /// Created by the thread that uses it.
    bitmap: Option<Bitmap>,
    period: Duration,
    /// The time of the next refresh, and the frame that is shown at it.
    next: Instant,
    shown: Option<u32>,
    /// Events for the next wait.
    pending: Vec<ScreenEvent>,
}

impl Win32Screen {
    /// Draws an image to a window of this extent.
    fn draw(&mut self, index: u32, window: vk::Extent2D) -> Result<(), SurfaceLost> {
        // Without scaling the images lie in the upper left corner.
        let extent = match self.pictures.scaling.is_asked_for() {
            true => window,
            false => self.pictures.extent(),
        };
        let is_as_large = |it: &Bitmap| (it.width, it.height) == (extent.width, extent.height);
        let bitmap = match self.bitmap.take().filter(is_as_large) {
            Some(bitmap) => bitmap,
            None => Bitmap::new(extent.width, extent.height).ok_or(SurfaceLost)?,
        };
        let bitmap = self.bitmap.insert(bitmap);
        let placement = (self.pictures.scaling).placement(self.pictures.extent(), extent);
        let mut canvas = Canvas {
            pixels: bitmap.pixels(),
            row_stride_bytes: extent.width as usize * Bitmap::PIXEL_BYTES,
            extent,
            layout: Layout::Argb8888,
            is_opaque: self.pictures.composite_alpha == vk::CompositeAlphaFlagsKHR::OPAQUE,
        };
        let picture = self.pictures.picture(index);
        // SAFETY: the images' memory lives as long as `pictures`.
        unsafe { pixels::draw(&picture, &placement, &mut canvas) };
        // Showing fails for a window that is on no screen, which is no error.
        if !bitmap.show(self.window) {
            return self.window.extent().map(drop).ok_or(SurfaceLost);
        }
        Ok(())
    }
}

impl Screen for Win32Screen {
    fn show(&mut self, frame: &Frame<'_>) -> Result<(), SurfaceLost> {
        let extent = extent_of(self.window).ok_or(SurfaceLost)?;
        if extent.width != 0 {
            self.draw(frame.index, extent)?;
        }
        let now = Instant::now();
        self.next = match frame.when {
            When::AtOnce => now,
            // Unused refreshes have passed.
            _ => (self.next + self.period).max(now),
        };
        self.shown = Some(frame.serial);
        let index = frame.index;
        (self.pending).extend([ScreenEvent::Extent(extent), ScreenEvent::Free { index }]);
        Ok(())
    }

    fn wait(
        &mut self,
        deadline: Option<Instant>,
        events: &mut Vec<ScreenEvent>,
    ) -> Result<(), SurfaceLost> {
        if self.pending.is_empty() {
            let own = self.shown.map(|_| self.next);
            self.wake.wait(deadline.into_iter().chain(own).min(), None);
        }
        let next = self.next;
        if let Some(serial) = self.shown.take_if(|_| Instant::now() >= next) {
            let at_ns = None;
            let out = ScreenEvent::Out { serial, at_ns };
            self.pending.extend([out, ScreenEvent::Shown { serial }]);
        }
        events.append(&mut self.pending);
        Ok(())
    }
}
