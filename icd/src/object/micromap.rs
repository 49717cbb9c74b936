//! `VkMicromapEXT`: a handle of a range of a buffer. The micromap itself is the bytes there.

#![forbid(unsafe_code)]

use super::Buffer;
use crate::handle::Ref;
use crate::object::acceleration_structure::Storage;

/// A micromap object.
pub struct Micromap {
    pub buffer: Ref<Buffer>,
    /// Offset in the buffer: a multiple of 256.
    pub offset: u64,
    pub size_bytes: u64,
}

impl Micromap {
    /// The object's range of memory; at address 0 while the buffer is unbound.
    pub fn storage(&self) -> Storage {
        let address = match self.buffer.address() {
            0 => 0,
            address => address + self.offset,
        };
        Storage {
            address,
            size_bytes: self.size_bytes,
        }
    }
}
