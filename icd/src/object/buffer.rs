//! Buffers and texel buffer views.

#![forbid(unsafe_code)]

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ash::vk;
use images::ImageDescriptor;

use super::sparse::Reservation;
use super::view_entry::ViewEntry;
use crate::VkResult;

/// A buffer: a size, and an address once memory is bound.
pub struct Buffer {
    pub size_bytes: u64,
    pub usage: vk::BufferUsageFlags,
    pub flags: vk::BufferCreateFlags,
    address: AtomicU64,
    /// The address space of a sparse buffer.
    pub reservation: Option<Arc<Reservation>>,
}

impl Buffer {
    /// Creates an unbound buffer.
    pub fn new(size_bytes: u64, usage: vk::BufferUsageFlags, flags: vk::BufferCreateFlags) -> Self {
        Self {
            size_bytes,
            usage,
            flags,
            address: AtomicU64::new(0),
            reservation: None,
        }
    }

    /// Creates a sparse buffer, which has its address from the start.
    pub fn reserved(self, reservation: Arc<Reservation>) -> Self {
        self.bind(reservation.address());
        Self {
            reservation: Some(reservation),
            ..self
        }
    }

    /// The device and host address of the buffer; 0 while unbound.
    pub fn address(&self) -> u64 {
        self.address.load(Ordering::Relaxed)
    }

    /// A range of the buffer as (host address, size in bytes), with `VK_WHOLE_SIZE` resolved.
    ///
    /// # Errors
    /// `VK_ERROR_UNKNOWN` if the buffer is unbound or the range is not inside it.
    pub fn range(&self, offset: u64, size_bytes: u64) -> VkResult<(*mut u8, u64)> {
        let size_bytes = match size_bytes {
            vk::WHOLE_SIZE => self
                .size_bytes
                .checked_sub(offset)
                .ok_or(vk::Result::ERROR_UNKNOWN)?,
            size => size,
        };
        let inside = offset
            .checked_add(size_bytes)
            .is_some_and(|end| end <= self.size_bytes);
        if self.address() == 0 || !inside {
            return Err(vk::Result::ERROR_UNKNOWN);
        }
        Ok(((self.address() + offset) as *mut u8, size_bytes))
    }

    /// Binds the buffer to an address.
    pub fn bind(&self, address: u64) {
        self.address.store(address, Ordering::Relaxed);
    }
}

/// A texel buffer view, as the descriptor that shaders read.
pub struct BufferView {
    pub descriptor: ViewEntry<ImageDescriptor>,
}
