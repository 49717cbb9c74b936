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

use super::offer::{MAX_IMAGES, MIN_IMAGES, is_shared};
use super::{Bell, Pictures, Scaling, Screen, Window};
use crate::VkResult;
use crate::ffi::vk::PRESENT_MODE_FIFO_LATEST_READY_KHR;
use crate::handle::{self, Ref};
use crate::object::memory::{AddressWindow, Source};
use crate::object::sync::Waiting;
use crate::object::{DeviceMemory, Image};
use crate::table::limits::MEMORY_ALIGNMENT;

/// What a swapchain is made of.
pub struct Creation<'a> {
    pub images: vk::ImageCreateInfo<'a>,
    pub count: u32,
    pub mode: vk::PresentModeKHR,
    pub color_space: vk::ColorSpaceKHR,
    pub composite_alpha: vk::CompositeAlphaFlagsKHR,
    pub scaling: Scaling,
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
}

impl Request {
    /// Whether it takes the place of one that waits for its turn before it.
    fn replaces(&self) -> bool {
        self.mode == vk::PresentModeKHR::MAILBOX || self.mode == PRESENT_MODE_FIFO_LATEST_READY_KHR
    }
}

/// What a swapchain, its thread and its surface have in common.
pub struct Shared {
    state: Mutex<State>,
    /// Where there is a window.
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
        // A window's server reads the images where they are, if it can.
        let shareable = window
            .is_some()
            .then(|| DeviceMemory::allocate(addresses, size_bytes, Source::Exportable, None));
        let memory = match shareable {
            Some(Ok(memory)) => memory,
            _ => DeviceMemory::allocate(addresses, size_bytes, Source::Fresh, None)?,
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
        };
        let extent = pictures.extent();
        let (bell, screen) = match window {
            None => (None, None),
            Some(window) => {
                let bell = Arc::new(Bell::new()?);
                let screen = window.screen(pictures, &bell)?;
                (Some(bell), Some(screen))
            }
        };
        let state = State {
            places: vec![Place::Free; count as usize],
            free: (0..count).collect(),
            ready: VecDeque::new(),
            status: vk::Result::SUCCESS,
            shown_id: 0,
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
        match (taken, waited) {
            (Some(taken), _) => taken,
            (None, Err(vk::Result::TIMEOUT)) if timeout_ns == 0 => Err(vk::Result::NOT_READY),
            (None, Err(code)) => Err(code),
            (None, Ok(())) => Err(vk::Result::TIMEOUT),
        }
    }

    /// An acquired image is to be presented: `vkQueuePresentKHR` has been called.
    ///
    /// # Errors
    /// `VK_SUBOPTIMAL_KHR`, or an error that the window has come to. The image is presented, or
    /// comes back, all the same.
    pub fn queue(&self, index: u32) -> VkResult {
        let mut state = self.shared.state.lock();
        if !self.shared.is_shared
            && let Some(place @ Place::Acquired) = state.places.get_mut(index as usize)
        {
            *place = Place::Queued;
        }
        match state.status {
            vk::Result::SUCCESS => Ok(()),
            code => Err(code),
        }
    }

    /// An image's turn in its queue has come: all that draws it is done. Who calls also
    /// [notifies](Waiting::notify).
    pub fn enqueue(&self, request: Request) {
        let mut state = self.shared.state.lock();
        let Some(bell) = &self.shared.bell else {
            return state.finish(&request);
        };
        if state.is_closed || state.status.as_raw() < 0 {
            return state.finish(&request);
        }
        // Of one that is replaced the image is free at once (`VK_PRESENT_MODE_MAILBOX_KHR`), not only
        // when the window has shown the one that is under way.
        let is_mailbox = request.mode == vk::PresentModeKHR::MAILBOX;
        state.ready.push_back(request);
        if is_mailbox {
            state.drop_replaced();
        }
        drop(state);
        self.shared.start_thread();
        bell.ring();
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
    /// Gives back what another presentation takes the place of, or the end of the swapchain. Returns whether there was any.
    fn drop_replaced(&mut self) -> bool {
        let before = self.ready.len();
        while self.ready.len() > 1 && (self.is_closed || self.ready[1].replaces()) {
            if let Some(replaced) = self.ready.pop_front() {
                self.release(replaced.index);
            }
        }
        self.ready.len() < before
    }

    /// Nobody shows this.
    fn finish(&mut self, request: &Request) {
        self.shown_id = self.shown_id.max(request.id);
        self.release(request.index);
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

    /// What [`Swapchain::close`] does.
    pub fn close(&self) {
        self.state.lock().is_closed = true;
        if let Some(bell) = &self.bell {
            bell.ring();
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

    /// The next request whose turn it is; those that it replaces come back.
    pub(super) fn next(&self) -> Next {
        let mut state = self.state.lock();
        let is_last = state.is_closed;
        let has_freed = state.drop_replaced();
        let request = state.ready.pop_front();
        drop(state);
        if has_freed {
            self.waiting.notify();
        }
        match request {
            Some(request) => Next::Show(request),
            None if is_last => Next::End,
            None => Next::Wait,
        }
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
        for index in 0..state.places.len() as u32 {
            state.release(index);
        }
        drop(state);
        self.waiting.notify();
    }
}

/// What a swapchain's thread does next.
pub(super) enum Next {
    Show(Request),
    Wait,
    End,
}
