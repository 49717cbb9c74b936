//! Swapchains and the states of their images.
//!
//! ```text
//! Free ──acquire──> Acquired ──vkQueuePresentKHR──> Queued ──shown, and read to the end──> Free
//! ```
//!
//! The image of a shared swapchain stays acquired. It is presented each time the application asks,
//! or at each refresh.

#![forbid(unsafe_code)]

use std::collections::VecDeque;
use std::sync::Arc;
use std::thread::JoinHandle;

use ash::vk;
use parking_lot::Mutex;

use super::headless::HeadlessScreen;
use super::offer::{MAX_IMAGES, MIN_IMAGES, is_shared};
use super::timing::{Refresh, Timing, Timings};
use super::{Pictures, Scaling, Screen, WakeEvent, Window};
use crate::VkResult;
use crate::capabilities::limits::MEMORY_ALIGNMENT;
use crate::execute::query::timestamp_ns;
use crate::ffi::vk::{
    PRESENT_MODE_FIFO_LATEST_READY_KHR, PRESENT_STAGE_IMAGE_FIRST_PIXEL_OUT_EXT,
    PRESENT_STAGE_QUEUE_OPERATIONS_END_EXT, PRESENT_STAGE_REQUEST_DEQUEUED_EXT,
};
use crate::handle::{self, Ref};
use crate::object::address_space::Placement;
use crate::object::memory::{AddressWindow, Source};
use crate::object::sync::Waiting;
use crate::object::{DeviceMemory, Image};
use crate::os::handle::Sharing;

/// The creation parameters of a swapchain.
pub struct Creation<'a> {
    pub images: vk::ImageCreateInfo<'a>,
    pub count: u32,
    pub mode: vk::PresentModeKHR,
    pub color_space: vk::ColorSpaceKHR,
    pub composite_alpha: vk::CompositeAlphaFlagsKHR,
    pub scaling: Scaling,
    /// `VK_SWAPCHAIN_CREATE_PRESENT_TIMING_BIT_EXT`.
    pub is_timed: bool,
}

/// `VkSwapchainKHR`.
pub struct Swapchain {
    pub images: Vec<Ref<Image>>,
    _memory: Arc<DeviceMemory>,
    /// The mode at creation, used by presentations that name no other.
    pub mode: vk::PresentModeKHR,
    shared: Arc<Shared>,
}

/// A presentation that `vkQueuePresentKHR` requests.
pub struct Request {
    pub index: u32,
    /// `VkPresentIdKHR`; 0 for none.
    pub id: u64,
    pub mode: vk::PresentModeKHR,
    /// `VkPresentRegionsKHR`; empty if all may have changed.
    pub damage: Vec<vk::Rect2D>,
    pub timing: Timing,
    /// The request's ticket in [`Timings`]; 0 for none.
    pub ticket: u64,
}

impl Request {
    /// Whether the request replaces an earlier one that still waits.
    fn replaces(&self) -> bool {
        self.mode == vk::PresentModeKHR::MAILBOX || self.mode == PRESENT_MODE_FIFO_LATEST_READY_KHR
    }
}

/// State that a swapchain shares with its thread and its surface.
pub struct Shared {
    state: Mutex<SwapchainState>,
    /// Wakes the thread; `None` without a thread.
    pub(super) wake: Option<Arc<WakeEvent>>,
    /// The screen, until the thread takes it.
    screen: Mutex<Option<Box<dyn Screen>>>,
    thread: Mutex<Option<JoinHandle<()>>>,
    pub(super) waiting: Arc<Waiting>,
    pub(super) extent: vk::Extent2D,
    pub(super) scaling: Scaling,
    is_shared: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ImageState {
    Free,
    Acquired,
    Queued,
}

struct SwapchainState {
    image_states: Vec<ImageState>,
    /// Images that can be acquired, in the order in which they became free.
    free: VecDeque<u32>,
    ready: VecDeque<Request>,
    /// `VK_SUCCESS`, `VK_SUBOPTIMAL_KHR` or a permanent error.
    status: vk::Result,
    /// The largest id that has been presented.
    shown_id: u64,
    timings: Timings,
    /// Another swapchain has replaced this one: no more images can be acquired.
    is_retired: bool,
    is_closed: bool,
}

impl SwapchainState {
    /// An image is not read any more.
    fn release(&mut self, index: u32) {
        if let Some(image @ ImageState::Queued) = self.image_states.get_mut(index as usize) {
            *image = ImageState::Free;
            self.free.push_back(index);
        }
    }
}

impl Swapchain {
    /// Creates the images, their memory and the screen on the surface.
    ///
    /// # Errors
    /// As for images and memory; `VK_ERROR_SURFACE_LOST_KHR`.
    pub fn new(
        creation: &Creation<'_>,
        window: Option<Arc<dyn Window>>,
        addresses: &Arc<AddressWindow>,
        waiting: Arc<Waiting>,
    ) -> VkResult<Self> {
        let is_shared = is_shared(creation.mode);
        let least = if is_shared { 1 } else { MIN_IMAGES };
        let count = creation.count.clamp(least, MAX_IMAGES);
        let images = (0..count).map(|_| Image::new(&creation.images).map(handle::new));
        let images: Vec<_> = images.collect::<VkResult<_>>()?;
        let stride = images[0].size_bytes.next_multiple_of(MEMORY_ALIGNMENT);
        let size_bytes = stride
            .checked_mul(u64::from(count))
            .ok_or(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY)?;
        let allocate =
            |source| DeviceMemory::allocate(addresses, size_bytes, source, Placement::Ordinary);
        // The memory can be shared, so that a window server can read the images in place.
        let exportable = Source::Exportable(Sharing::default());
        let shareable = window.is_some().then(|| allocate(exportable));
        let memory = match shareable {
            Some(Ok(memory)) => memory,
            _ => allocate(Source::Fresh)?,
        };
        for (index, image) in (0..).zip(&images) {
            image.bind(memory.address + index * stride);
        }
        let memory = Arc::new(memory);
        let pictures = Pictures {
            images: images.clone(),
            memory: Arc::clone(&memory),
            is_linear: creation.color_space == vk::ColorSpaceKHR::EXTENDED_SRGB_LINEAR_EXT,
            composite_alpha: creation.composite_alpha,
            scaling: creation.scaling,
            is_timed: creation.is_timed,
        };
        let extent = pictures.extent();
        let (wake, screen) = match window {
            None if !creation.is_timed => (None, None),
            window => {
                let wake =
                    Arc::new(WakeEvent::new(false).ok_or(vk::Result::ERROR_OUT_OF_HOST_MEMORY)?);
                let screen: Box<dyn Screen> = match window {
                    Some(window) => window.screen(pictures, &wake)?,
                    None => Box::new(HeadlessScreen::new(&wake)),
                };
                (Some(wake), Some(screen))
            }
        };
        let state = SwapchainState {
            image_states: vec![ImageState::Free; count as usize],
            free: (0..count).collect(),
            ready: VecDeque::new(),
            status: vk::Result::SUCCESS,
            shown_id: 0,
            timings: Timings::default(),
            is_retired: false,
            is_closed: false,
        };
        Ok(Self {
            images,
            _memory: memory,
            mode: creation.mode,
            shared: Arc::new(Shared {
                state: Mutex::new(state),
                wake,
                screen: Mutex::new(screen),
                thread: Mutex::default(),
                waiting,
                extent,
                scaling: creation.scaling,
                is_shared,
            }),
        })
    }

    pub(super) fn shared(&self) -> &Arc<Shared> {
        &self.shared
    }

    /// Waits for a free image and acquires the one that has been free for longest. Also returns
    /// whether the swapchain is suboptimal.
    ///
    /// # Errors
    /// `VK_NOT_READY` or `VK_TIMEOUT`; `VK_ERROR_OUT_OF_DATE_KHR` once retired;
    /// `VK_ERROR_SURFACE_LOST_KHR`; `VK_ERROR_DEVICE_LOST`.
    pub fn acquire(&self, timeout_ns: u64) -> VkResult<(u32, bool)> {
        let mut taken = None;
        let waited = self.shared.waiting.wait_until(timeout_ns, || {
            taken = self.shared.try_acquire();
            taken.is_some()
        });
        match taken.unwrap_or(Err(waited.err().unwrap_or(vk::Result::TIMEOUT))) {
            Err(vk::Result::TIMEOUT) if timeout_ns == 0 => Err(vk::Result::NOT_READY),
            taken => taken,
        }
    }

    /// Marks an acquired image as queued, for `vkQueuePresentKHR`. Returns the swapchain's status,
    /// `VK_SUBOPTIMAL_KHR` or an error of the window included. The image is presented or released
    /// in either case.
    ///
    /// # Errors
    /// `VK_ERROR_PRESENT_TIMING_QUEUE_FULL_EXT`: the image stays acquired.
    pub fn queue(&self, request: &mut Request) -> VkResult<vk::Result> {
        let mut state = self.shared.state.lock();
        request.ticket = state.timings.reserve(request.id, &request.timing)?;
        if !self.shared.is_shared
            && let Some(image @ ImageState::Acquired) =
                state.image_states.get_mut(request.index as usize)
        {
            *image = ImageState::Queued;
        }
        Ok(state.status)
    }

    /// Presents an image whose drawing is complete. The caller must [notify](Waiting::notify)
    /// afterwards.
    pub fn enqueue(&self, request: Request) {
        let mut state = self.shared.state.lock();
        let stage = PRESENT_STAGE_QUEUE_OPERATIONS_END_EXT;
        state.timings.reached(request.ticket, stage, timestamp_ns());
        let Some(wake) = &self.shared.wake else {
            return state.finish(&request);
        };
        if state.is_closed || state.status.as_raw() < 0 {
            return state.finish(&request);
        }
        // A mailbox request frees the image that it replaces at once
        // (`VK_PRESENT_MODE_MAILBOX_KHR`), not only when the window has shown the frame in flight.
        let is_mailbox = request.mode == vk::PresentModeKHR::MAILBOX;
        state.ready.push_back(request);
        if is_mailbox {
            state.drop_replaced(|_| true);
        }
        drop(state);
        self.shared.start_thread();
        wake.signal();
    }

    /// Releases acquired images (`vkReleaseSwapchainImagesKHR`).
    pub fn release(&self, indices: &[u32]) {
        let mut state = self.shared.state.lock();
        for &index in indices {
            if let Some(image @ ImageState::Acquired) = state.image_states.get_mut(index as usize) {
                *image = ImageState::Queued;
                state.release(index);
            }
        }
        drop(state);
        self.shared.waiting.notify();
    }

    /// Waits until the presentation with this id, or a later one, is complete
    /// (`vkWaitForPresentKHR`).
    ///
    /// # Errors
    /// `VK_TIMEOUT`; an error of the window; `VK_ERROR_DEVICE_LOST`.
    pub fn wait_for_present(&self, id: u64, timeout_ns: u64) -> VkResult {
        let mut status = Ok(());
        self.shared.waiting.wait_until(timeout_ns, || {
            let state = self.shared.state.lock();
            if state.shown_id >= id {
                return true;
            }
            if state.status.as_raw() < 0 || state.is_closed {
                status = Err(match state.status {
                    code if code.as_raw() < 0 => code,
                    _ => vk::Result::ERROR_OUT_OF_DATE_KHR,
                });
                return true;
            }
            false
        })?;
        status
    }

    /// Reads or changes the times of presentations.
    pub fn timings<R>(&self, question: impl FnOnce(&mut Timings) -> R) -> R {
        question(&mut self.shared.state.lock().timings)
    }

    /// `vkGetSwapchainStatusKHR`.
    ///
    /// # Errors
    /// `VK_SUBOPTIMAL_KHR`, or an error of the window.
    pub fn status(&self) -> VkResult {
        let state = self.shared.state.lock();
        match state.status {
            vk::Result::SUCCESS if state.is_retired => Err(vk::Result::ERROR_OUT_OF_DATE_KHR),
            vk::Result::SUCCESS => Ok(()),
            code => Err(code),
        }
    }

    /// Retires the swapchain, because another one takes the surface.
    pub fn retire(&self) {
        self.shared.state.lock().is_retired = true;
        self.shared.waiting.notify();
    }

    /// Ends the thread, after it has shown the last presented image, and releases the window.
    pub fn close(&self) {
        self.shared.close();
    }
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        self.shared.close();
    }
}

impl SwapchainState {
    /// Releases the images of requests that a later, ready request replaces; of a closed swapchain,
    /// all except the last. Returns whether any were released.
    fn drop_replaced(&mut self, is_ready: impl Fn(&Request) -> bool) -> bool {
        let before = self.ready.len();
        while let Some(next) = self.ready.get(1)
            && (self.is_closed || next.replaces() && is_ready(next))
        {
            // "The presentation engine dequeues all successive requests that are ready."
            let is_dequeued = next.mode == PRESENT_MODE_FIFO_LATEST_READY_KHR;
            if let Some(replaced) = self.ready.pop_front() {
                if is_dequeued {
                    self.dequeued(replaced.ticket);
                }
                self.release(replaced.index);
                self.timings.finish(replaced.ticket);
            }
        }
        self.ready.len() < before
    }

    fn dequeued(&mut self, ticket: u64) {
        let stage = PRESENT_STAGE_REQUEST_DEQUEUED_EXT;
        self.timings.reached(ticket, stage, timestamp_ns());
    }

    /// Finishes a request without showing it.
    fn finish(&mut self, request: &Request) {
        self.shown_id = self.shown_id.max(request.id);
        self.release(request.index);
        self.timings.finish(request.ticket);
    }
}

impl Shared {
    fn try_acquire(&self) -> Option<VkResult<(u32, bool)>> {
        let mut state = self.state.lock();
        if state.is_retired {
            return Some(Err(vk::Result::ERROR_OUT_OF_DATE_KHR));
        }
        if state.status.as_raw() < 0 {
            return Some(Err(state.status));
        }
        if let Some(index) = state.free.pop_front() {
            state.image_states[index as usize] = ImageState::Acquired;
            return Some(Ok((index, state.status == vk::Result::SUBOPTIMAL_KHR)));
        }
        // The application has acquired all images. Its other threads may not use the swapchain
        // meanwhile (chapter "WSI Swapchain": external synchronization), so none can become free.
        let all_acquired = state
            .image_states
            .iter()
            .all(|&image| image == ImageState::Acquired);
        all_acquired.then_some(Err(vk::Result::TIMEOUT))
    }

    pub fn is_retired(&self) -> bool {
        self.state.lock().is_retired
    }

    pub fn is_closed(&self) -> bool {
        self.state.lock().is_closed
    }

    /// Starts the thread, unless it runs. If no thread can be started, the swapchain fails.
    fn start_thread(self: &Arc<Self>) {
        let mut thread = self.thread.lock();
        let Some(screen) = self.screen.lock().take() else {
            return;
        };
        let shared = Arc::clone(self);
        let started = std::thread::Builder::new()
            .name("tuff-present".to_owned())
            .spawn(move || shared.run(screen));
        match started {
            Ok(handle) => *thread = Some(handle),
            Err(_) => self.fail(vk::Result::ERROR_SURFACE_LOST_KHR),
        }
    }

    /// Implements [`Swapchain::close`].
    pub fn close(&self) {
        self.state.lock().is_closed = true;
        if let Some(wake) = &self.wake {
            wake.signal();
        }
        if self.waiting.lost.is_inherited() {
            // This is a forked child: the thread does not exist here and must not be joined, and
            // the connection belongs to the parent.
            std::mem::forget(self.thread.try_lock().and_then(|mut thread| thread.take()));
            std::mem::forget(self.screen.try_lock().and_then(|mut screen| screen.take()));
            return;
        }
        drop(self.screen.lock().take());
        if let Some(thread) = self.thread.lock().take()
            && thread.thread().id() != std::thread::current().id()
        {
            // A panic on the thread was logged when it happened.
            let _ = thread.join();
        }
        self.waiting.notify();
    }

    /// The thread's next action. Requests that the next one replaces are released. The frame before
    /// was shown at `seen_ns`.
    pub(super) fn next(&self, seen_ns: Option<u64>, refresh: Option<Refresh>) -> Next {
        let due = |request: &Request| {
            let target = request.timing.target;
            target.map_or(0, |target| target.due_ns(seen_ns, refresh))
        };
        // A relative target time waits until the image before has been shown.
        let is_free = |request: &Request| request.timing.target.is_none_or(|it| !it.is_relative);
        let now = timestamp_ns();
        let mut state = self.state.lock();
        let has_freed = state.drop_replaced(|next| is_free(next) && due(next) <= now);
        let due = state.ready.front().map_or(0, due);
        let next = if due > now && !state.is_closed {
            Next::At(due - now)
        } else if let Some(request) = state.ready.pop_front() {
            state.dequeued(request.ticket);
            Next::Show(request)
        } else if state.is_closed {
            Next::End
        } else {
            Next::Wait
        };
        drop(state);
        if has_freed {
            self.waiting.notify();
        }
        next
    }

    /// Records the time at which a presentation's first pixel left for the display, and completes
    /// its report.
    pub(super) fn out(&self, ticket: u64, at_ns: Option<u64>) {
        let mut state = self.state.lock();
        if let Some(at_ns) = at_ns {
            let stage = PRESENT_STAGE_IMAGE_FIRST_PIXEL_OUT_EXT;
            state.timings.reached(ticket, stage, at_ns);
        }
        state.timings.finish(ticket);
    }

    /// Sets the display's measured period.
    pub(super) fn measured(&self, period_ns: u64) {
        self.state.lock().timings.measured(period_ns);
    }

    /// Whether the swapchain is closed.
    pub(super) fn is_ending(&self) -> bool {
        self.state.lock().is_closed
    }

    /// Marks an id as presented.
    pub(super) fn shown(&self, id: u64) {
        let mut state = self.state.lock();
        state.shown_id = state.shown_id.max(id);
        drop(state);
        self.waiting.notify();
    }

    /// An image is not read any more.
    pub(super) fn freed(&self, index: u32) {
        self.state.lock().release(index);
        self.waiting.notify();
    }

    /// Records the window's extent, which decides whether the swapchain is suboptimal.
    pub(super) fn resized(&self, extent: vk::Extent2D) {
        let fits = extent == self.extent || self.scaling.is_asked_for();
        let mut state = self.state.lock();
        if state.status.as_raw() >= 0 {
            state.status = match fits {
                true => vk::Result::SUCCESS,
                false => vk::Result::SUBOPTIMAL_KHR,
            };
        }
    }

    /// Fails the swapchain, and releases all images.
    pub(super) fn fail(&self, code: vk::Result) {
        let mut state = self.state.lock();
        state.status = code;
        state.ready.clear();
        state.timings.finish_all();
        for index in 0..state.image_states.len() as u32 {
            state.release(index);
        }
        drop(state);
        self.waiting.notify();
    }
}

/// The next action of a swapchain's thread.
pub(super) enum Next {
    Show(Request),
    /// A request is due in so many nanoseconds.
    At(u64),
    Wait,
    End,
}
