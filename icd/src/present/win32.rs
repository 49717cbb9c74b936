//! Windows of Win32 (`VK_KHR_win32_surface`): images are copied to a bitmap of the system's, and
//! that is copied to the window. This side keeps the time.

use std::sync::Arc;
use std::time::{Duration, Instant};

use ash::vk;

use super::conversion::Layout;
use super::pixels::{self, Canvas};
use super::{Bell, Event, Frame, Gone, Pictures, Screen, When, Window};
use crate::VkResult;
use crate::os::window::{self, Bitmap};

const LOST: vk::Result = vk::Result::ERROR_SURFACE_LOST_KHR;

/// Between refreshes, where the system does not say how many there are.
const REFRESH: Duration = Duration::from_nanos(16_666_667);

/// A window.
pub struct Win32Window(window::Window);

impl Win32Window {
    /// The window of an `HWND`. A number that is none makes a surface that is lost.
    pub fn new(window: isize) -> Self {
        Self(window::Window::new(window))
    }
}

/// A window's extent; `None` once it has gone.
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

    fn tells_times(&self) -> bool {
        false
    }

    fn screen(&self, pictures: Pictures, bell: &Arc<Bell>) -> VkResult<Box<dyn Screen>> {
        if !self.is_presentable() {
            return Err(LOST);
        }
        let rate = self.0.refreshes_per_second();
        Ok(Box::new(Win32Screen {
            window: self.0,
            pictures,
            bell: Arc::clone(bell),
            bitmap: None,
            period: rate.map_or(REFRESH, |rate| Duration::from_secs(1) / rate),
            next: Instant::now(),
            shown: None,
            news: Vec::new(),
        }))
    }
}

struct Win32Screen {
    window: window::Window,
    pictures: Pictures,
    bell: Arc<Bell>,
    /// Made by the thread that uses it.
    bitmap: Option<Bitmap>,
    period: Duration,
    /// When the next refresh would be, and whose turn it is then.
    next: Instant,
    shown: Option<u32>,
    /// To be told by the next wait.
    news: Vec<Event>,
}

impl Win32Screen {
    /// Draws an image to a window of some extent.
    fn draw(&mut self, index: u32, window: vk::Extent2D) -> Result<(), Gone> {
        // Without scaling the images lie in the upper left corner.
        let extent = match self.pictures.scaling.is_asked_for() {
            true => window,
            false => self.pictures.extent(),
        };
        let is_as_large = |it: &Bitmap| (it.width, it.height) == (extent.width, extent.height);
        let bitmap = match self.bitmap.take().filter(is_as_large) {
            Some(bitmap) => bitmap,
            None => Bitmap::new(extent.width, extent.height).ok_or(Gone)?,
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
        // A window that is there takes its pixels, unless it is on no screen.
        if !bitmap.show(self.window) {
            return self.window.extent().map(drop).ok_or(Gone);
        }
        Ok(())
    }
}

impl Screen for Win32Screen {
    fn show(&mut self, frame: &Frame<'_>) -> Result<(), Gone> {
        let extent = extent_of(self.window).ok_or(Gone)?;
        if extent.width != 0 {
            self.draw(frame.index, extent)?;
        }
        let now = Instant::now();
        self.next = match frame.when {
            When::AtOnce => now,
            // Refreshes that nothing was shown in are past.
            _ => (self.next + self.period).max(now),
        };
        self.shown = Some(frame.serial);
        let index = frame.index;
        (self.news).extend([Event::Extent(extent), Event::Free { index }]);
        Ok(())
    }

    fn wait(&mut self, deadline: Option<Instant>, events: &mut Vec<Event>) -> Result<(), Gone> {
        if self.news.is_empty() {
            let own = self.shown.map(|_| self.next);
            self.bell.wait(deadline.into_iter().chain(own).min(), None);
        }
        let next = self.next;
        if let Some(serial) = self.shown.take_if(|_| Instant::now() >= next) {
            let at_ns = None;
            let out = Event::Out { serial, at_ns };
            self.news.extend([out, Event::Shown { serial }]);
        }
        events.append(&mut self.news);
        Ok(())
    }
}
