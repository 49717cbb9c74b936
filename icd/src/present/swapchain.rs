//! Swapchains: whose turn each image is.
//!
//! ```text
//! Free ──acquire──> Acquired ──vkQueuePresentKHR──> Queued ──shown, and read to the end──> Free
//! ```
//!
//! The image of a shared swapchain stays acquired: it is presented as often as the application
//! asks, or at each refresh.

#![forbid(unsafe_code)]

use std::collections::VecDeque;
use std::sync::Arc;
use std::thread::JoinHandle;

use ash::vk;
use parking_lot::Mutex;

use super::nowhere::Nowhere;
use super::offer::{MAX_IMAGES, MIN_IMAGES, is_shared};
use super::timing::{Refresh, Timing, Timings};
use super::{Bell, Pictures, Scaling, Screen, Window};
use crate::VkResult;
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
use crate::table::limits::MEMORY_ALIGNMENT;

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
    /// As it was made, and as it is presented where no other is named.
    pub mode: vk::PresentModeKHR,
    shared: Arc<Shared>,
}

/// A presentation, as `vkQueuePresentKHR` asks for it.
pub struct Request {
    pub index: u32,
    /// `VkPresentIdKHR`; 0 for none.
    pub id: u64,
    pub mode: vk::PresentModeKHR,
    /// `VkPresentRegionsKHR`; empty if all may have changed.
    pub damage: Vec<vk::Rect2D>,
    pub timing: Timing,
    /// Its place among the results; 0 for none.
    pub ticket: u64,
}

impl Request {
    /// Whether it takes the place of one that waits for its turn before it.
    fn replaces(&self) -> bool {
        self.mode == vk::PresentModeKHR::MAILBOX || self.mode == PRESENT_MODE_FIFO_LATEST_READY_KHR
    }
}

/// State that a swapchain shares with its thread and its surface.
pub struct Shared {
    state: Mutex<State>,
    /// Where there is a thread.
    pub(super) bell: Option<Arc<Bell>>,
    /// Until the thread has it.
    screen: Mutex<Option<Box<dyn Screen>>>,
    thread: Mutex<Option<JoinHandle<()>>>,
    pub(super) waiting: Arc<Waiting>,
    pub(super) extent: vk::Extent2D,
    pub(super) scaling: Scaling,
    is_shared: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    Free,
    Acquired,
    Queued,
}

struct State {
    places: Vec<Place>,
    /// Images that can be acquired, in the order in which they came back.
    free: VecDeque<u32>,
    ready: VecDeque<Request>,
    /// `VK_SUCCESS`, `VK_SUBOPTIMAL_KHR` or an error that stays.
    status: vk::Result,
    /// The largest id whose turn has come.
    shown_id: u64,
    timings: Timings,
    /// Replaced by another swapchain: no more images are handed out.
    is_retired: bool,
    is_closed: bool,
}

impl State {
    /// An image is not read any more.
    fn release(&mut self, index: u32) {
        if let Some(place @ Place::Queued) = self.places.get_mut(index as usize) {
            *place = Place::Free;
            self.free.push_back(index);
        }
    }
}

impl Swapchain {
    /// Images of one kind with memory, and a way to the surface.
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
        // A window's server reads the images where they are, if it can.
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
        let (bell, screen) = match window {
            None if !creation.is_timed => (None, None),
            window => {
                let bell = Arc::new(Bell::new(false).ok_or(vk::Result::ERROR_OUT_OF_HOST_MEMORY)?);
                let screen: Box<dyn Screen> = match window {
                    Some(window) => window.screen(pictures, &bell)?,
                    None => Box::new(Nowhere::new(&bell)),
                };
                (Some(bell), Some(screen))
            }
        };
        let state = State {
            places: vec![Place::Free; count as usize],
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
                bell,
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

    /// Takes the image that is free for longest, once there is one; whether the swapchain is
    /// suboptimal.
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

    /// An acquired image is to be presented: `vkQueuePresentKHR` has been called. The code may be
    /// `VK_SUBOPTIMAL_KHR`, or an error that the window has come to: the image is presented, or
    /// comes back, all the same.
    ///
    /// # Errors
    /// `VK_ERROR_PRESENT_TIMING_QUEUE_FULL_EXT`: the image stays acquired.
    pub fn queue(&self, request: &mut Request) -> VkResult<vk::Result> {
        let mut state = self.shared.state.lock();
        request.ticket = state.timings.reserve(request.id, &request.timing)?;
        if !self.shared.is_shared
            && let Some(place @ Place::Acquired) = state.places.get_mut(request.index as usize)
        {
            *place = Place::Queued;
        }
        Ok(state.status)
    }

    /// An image's turn in its queue has come: all that draws it is done. Who calls also
    /// [notifies](Waiting::notify).
    pub fn enqueue(&self, request: Request) {
        let mut state = self.shared.state.lock();
        let stage = PRESENT_STAGE_QUEUE_OPERATIONS_END_EXT;
        state.timings.reached(request.ticket, stage, timestamp_ns());
        let Some(bell) = &self.shared.bell else {
            return state.finish(&request);
        };
        if state.is_closed || state.status.as_raw() < 0 {
            return state.finish(&request);
        }
        // Of one that is replaced the image is free at once (`VK_PRESENT_MODE_MAILBOX_KHR`), not
        // only when the window has shown the one that is under way.
        let is_mailbox = request.mode == vk::PresentModeKHR::MAILBOX;
        state.ready.push_back(request);
        if is_mailbox {
            state.drop_replaced(|_| true);
        }
        drop(state);
        self.shared.start_thread();
        bell.signal();
    }

    /// Gives acquired images back (`vkReleaseSwapchainImagesKHR`).
    pub fn release(&self, indices: &[u32]) {
        let mut state = self.shared.state.lock();
        for &index in indices {
            if let Some(place @ Place::Acquired) = state.places.get_mut(index as usize) {
                *place = Place::Queued;
                state.release(index);
            }
        }
        drop(state);
        self.shared.waiting.notify();
    }

    /// Waits until the turn of a presentation with this id, or a later one, has come
    /// (`vkWaitForPresentKHR`).
    ///
    /// # Errors
    /// `VK_TIMEOUT`; what the window has come to; `VK_ERROR_DEVICE_LOST`.
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

    /// Asks or changes what is known of presentations' times.
    pub fn timings<R>(&self, question: impl FnOnce(&mut Timings) -> R) -> R {
        question(&mut self.shared.state.lock().timings)
    }

    /// `vkGetSwapchainStatusKHR`.
    ///
    /// # Errors
    /// `VK_SUBOPTIMAL_KHR`, or what the window has come to.
    pub fn status(&self) -> VkResult {
        let state = self.shared.state.lock();
        match state.status {
            vk::Result::SUCCESS if state.is_retired => Err(vk::Result::ERROR_OUT_OF_DATE_KHR),
            vk::Result::SUCCESS => Ok(()),
            code => Err(code),
        }
    }

    /// Another swapchain takes the surface over.
    pub fn retire(&self) {
        self.shared.state.lock().is_retired = true;
        self.shared.waiting.notify();
    }

    /// Ends the thread, after it has handed over what was presented last, and lets go of the
    /// window.
    pub fn close(&self) {
        self.shared.close();
    }
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        self.shared.close();
    }
}

impl State {
    /// Gives back what another presentation, if it is ready, takes the place of, or the end of the
    /// swapchain. Returns whether there was any.
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
            state.places[index as usize] = Place::Acquired;
            return Some(Ok((index, state.status == vk::Result::SUBOPTIMAL_KHR)));
        }
        // The application has all of them. Its other threads may not use the swapchain meanwhile
        // (chapter "WSI Swapchain": external synchronization), so none can come back.
        let all_acquired = state.places.iter().all(|&place| place == Place::Acquired);
        all_acquired.then_some(Err(vk::Result::TIMEOUT))
    }

    pub fn is_retired(&self) -> bool {
        self.state.lock().is_retired
    }

    pub fn is_closed(&self) -> bool {
        self.state.lock().is_closed
    }

    /// Starts the thread, unless it runs. If the system gives none, nothing can be shown.
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
        if let Some(bell) = &self.bell {
            bell.signal();
        }
        if self.waiting.lost.is_inherited() {
            // There is no such thread here. Its handle is of no use, and must not be waited for;
            // nor is its connection ours.
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

    /// The next request whose turn it is; those that it replaces come back. The one before was seen
    /// at `seen_ns`.
    pub(super) fn next(&self, seen_ns: Option<u64>, refresh: Option<Refresh>) -> Next {
        let due = |request: &Request| {
            let target = request.timing.target;
            target.map_or(0, |target| target.due_ns(seen_ns, refresh))
        };
        // A time relative to that of another image waits until that image has been seen.
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

    /// A presentation's first pixel has left for the display, and all is known of it.
    pub(super) fn out(&self, ticket: u64, at_ns: Option<u64>) {
        let mut state = self.state.lock();
        if let Some(at_ns) = at_ns {
            let stage = PRESENT_STAGE_IMAGE_FIRST_PIXEL_OUT_EXT;
            state.timings.reached(ticket, stage, at_ns);
        }
        state.timings.finish(ticket);
    }

    /// The display's period is this.
    pub(super) fn measured(&self, period_ns: u64) {
        self.state.lock().timings.measured(period_ns);
    }

    /// Whether the application waits for nothing more.
    pub(super) fn is_ending(&self) -> bool {
        self.state.lock().is_closed
    }

    /// The turn of an id has come.
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

    /// The window has this extent now.
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

    /// Nothing can be shown any more: everything comes back.
    pub(super) fn fail(&self, code: vk::Result) {
        let mut state = self.state.lock();
        state.status = code;
        state.ready.clear();
        state.timings.finish_all();
        for index in 0..state.places.len() as u32 {
            state.release(index);
        }
        drop(state);
        self.waiting.notify();
    }
}

/// The next action of a swapchain's thread.
pub(super) enum Next {
    Show(Request),
    /// There is one whose time comes in so many nanoseconds.
    At(u64),
    Wait,
    End,
}
