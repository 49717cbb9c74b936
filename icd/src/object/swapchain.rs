//! Surfaces without a window, and swapchains on them: images that are handed out and taken back in turn.

#![forbid(unsafe_code)]

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use ash::vk;
use parking_lot::Mutex;

use super::memory::{AddressWindow, Source};
use super::sync::Waiting;
use super::{DeviceMemory, Image};
use crate::VkResult;
use crate::handle::{self, Ref};
use crate::table::limits::{MAX_IMAGE_ARRAY_LAYERS, MAX_IMAGE_DIMENSION, MEMORY_ALIGNMENT};

/// `VkSurfaceKHR`: headless. What is presented to it is seen by nobody.
pub struct Surface;

/// `VkSwapchainKHR`.
pub struct Swapchain {
    pub images: Vec<Ref<Image>>,
    _memory: DeviceMemory,
    /// Images that can be acquired, in the order in which they came back.
    free: Mutex<VecDeque<u32>>,
    /// Replaced by another swapchain: no more images are handed out.
    retired: AtomicBool,
    waiting: Arc<Waiting>,
}

/// Images of a swapchain.
pub const MIN_IMAGES: u32 = 1;
pub const MAX_IMAGES: u32 = 16;

/// The formats that can be presented.
pub const FORMATS: [vk::Format; 5] = [
    vk::Format::B8G8R8A8_UNORM,
    vk::Format::B8G8R8A8_SRGB,
    vk::Format::R8G8B8A8_UNORM,
    vk::Format::R8G8B8A8_SRGB,
    vk::Format::A2B10G10R10_UNORM_PACK32,
];

/// The modes that can be asked for. Nothing is shown, so they are alike: each image comes back when its turn is over.
pub const PRESENT_MODES: [vk::PresentModeKHR; 3] = [
    vk::PresentModeKHR::FIFO,
    vk::PresentModeKHR::MAILBOX,
    vk::PresentModeKHR::IMMEDIATE,
];

/// What a headless surface can do. Its extent is the swapchain's.
pub fn capabilities() -> vk::SurfaceCapabilitiesKHR {
    let side = |side| vk::Extent2D {
        width: side,
        height: side,
    };
    vk::SurfaceCapabilitiesKHR {
        min_image_count: MIN_IMAGES,
        max_image_count: MAX_IMAGES,
        current_extent: side(u32::MAX),
        min_image_extent: side(1),
        max_image_extent: side(MAX_IMAGE_DIMENSION),
        max_image_array_layers: MAX_IMAGE_ARRAY_LAYERS,
        supported_transforms: vk::SurfaceTransformFlagsKHR::IDENTITY,
        current_transform: vk::SurfaceTransformFlagsKHR::IDENTITY,
        supported_composite_alpha: vk::CompositeAlphaFlagsKHR::OPAQUE
            | vk::CompositeAlphaFlagsKHR::INHERIT,
        supported_usage_flags: vk::ImageUsageFlags::TRANSFER_SRC
            | vk::ImageUsageFlags::TRANSFER_DST
            | vk::ImageUsageFlags::SAMPLED
            | vk::ImageUsageFlags::STORAGE
            | vk::ImageUsageFlags::COLOR_ATTACHMENT
            | vk::ImageUsageFlags::INPUT_ATTACHMENT,
    }
}

impl Swapchain {
    /// `count` images of one kind, with memory.
    ///
    /// # Errors
    /// As for images and memory.
    pub fn new(
        info: &vk::ImageCreateInfo<'_>,
        count: u32,
        window: &Arc<AddressWindow>,
        waiting: Arc<Waiting>,
    ) -> VkResult<Self> {
        let count = count.clamp(MIN_IMAGES, MAX_IMAGES);
        let images = (0..count).map(|_| Image::new(info).map(handle::new));
        let images: Vec<_> = images.collect::<VkResult<_>>()?;
        let stride = images[0].size_bytes.next_multiple_of(MEMORY_ALIGNMENT);
        let size_bytes = stride * u64::from(count);
        let memory = DeviceMemory::allocate(window, size_bytes, Source::Fresh, None)?;
        for (index, image) in (0..).zip(&images) {
            image.bind(memory.address + index * stride);
        }
        Ok(Self {
            images,
            _memory: memory,
            free: Mutex::new((0..count).collect()),
            retired: AtomicBool::new(false),
            waiting,
        })
    }

    /// Takes the image that is free for longest, once there is one.
    ///
    /// # Errors
    /// `VK_NOT_READY` or `VK_TIMEOUT`; `VK_ERROR_OUT_OF_DATE_KHR` once retired; `VK_ERROR_DEVICE_LOST`.
    pub fn acquire(&self, timeout_ns: u64) -> VkResult<u32> {
        if self.retired.load(Ordering::Acquire) {
            return Err(vk::Result::ERROR_OUT_OF_DATE_KHR);
        }
        let mut taken = None;
        let waited = self.waiting.wait_until(timeout_ns, || {
            taken = self.free.lock().pop_front();
            taken.is_some()
        });
        match (taken, waited) {
            (Some(index), _) => Ok(index),
            (None, Err(vk::Result::TIMEOUT)) if timeout_ns == 0 => Err(vk::Result::NOT_READY),
            (None, Err(code)) => Err(code),
            (None, Ok(())) => Err(vk::Result::TIMEOUT),
        }
    }

    /// Takes an image back. Who presents it also [notifies](Waiting::notify).
    pub fn give_back(&self, index: u32) {
        if (index as usize) < self.images.len() {
            self.free.lock().push_back(index);
        }
    }

    /// Another swapchain takes the surface over.
    pub fn retire(&self) {
        self.retired.store(true, Ordering::Release);
    }
}
