//! `VkAccelerationStructureKHR`: a name for a range of a buffer; the structure itself is the bytes there.

#![forbid(unsafe_code)]

use ash::vk;

use super::Buffer;
use crate::execute::acceleration_structure::Storage;
use crate::handle::Ref;

/// An acceleration structure object.
pub struct AccelerationStructure {
    pub ty: vk::AccelerationStructureTypeKHR,
    pub buffer: Ref<Buffer>,
    /// Of the structure in the buffer: a multiple of 256.
    pub offset: u64,
    pub size_bytes: u64,
}

impl AccelerationStructure {
    /// Device address, which is also the host address of the structure; 0 while the buffer is unbound.
    pub fn address(&self) -> u64 {
        match self.buffer.address() {
            0 => 0,
            address => address + self.offset,
        }
    }

    /// The range of memory that it names.
    pub fn storage(&self) -> Storage {
        Storage {
            address: self.address(),
            size_bytes: self.size_bytes,
        }
    }
}
