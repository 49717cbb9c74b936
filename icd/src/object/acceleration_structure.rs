//! `VkAccelerationStructureKHR`: a handle of a range of memory. The structure itself is the bytes
//! there.

#![forbid(unsafe_code)]

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ash::vk;
use spirv_jit::views::{Key, Views};

use super::Buffer;
use super::view_entry::store_failure;
use crate::VkResult;
use crate::handle::Ref;

/// The memory of an acceleration structure object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Storage {
    pub address: u64,
    pub size_bytes: u64,
}

/// An acceleration structure object.
pub struct AccelerationStructure {
    pub ty: vk::AccelerationStructureTypeKHR,
    pub location: Location,
    pub size_bytes: u64,
    pub replayable: Option<ReplayableStructure>,
}

/// A structure's entry in the device's view table, which gives it the same descriptors at any
/// address.
pub struct ReplayableStructure {
    views: Arc<Views>,
    address: u64,
    key: Key,
}

impl ReplayableStructure {
    /// Stores the address of a structure, under the key `wanted` if it was captured.
    ///
    /// # Errors
    /// `VK_ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS` if something else has the key,
    /// `VK_ERROR_OUT_OF_HOST_MEMORY`.
    pub fn new(views: &Arc<Views>, address: u64, wanted: Option<Key>) -> VkResult<Self> {
        let key = views.store_structure(address, wanted);
        Ok(Self {
            views: Arc::clone(views),
            address,
            key: key.map_err(store_failure)?,
        })
    }
}

impl Drop for ReplayableStructure {
    fn drop(&mut self) {
        self.views.remove_structure(self.address, self.key);
    }
}

/// The location of the structure.
pub enum Location {
    /// A buffer, and the offset in it: a multiple of 256.
    Buffer(Ref<Buffer>, u64),
    Address(u64),
    /// Memory that is bound to the structure itself; 0 until then.
    Memory(AtomicU64),
}

impl AccelerationStructure {
    /// Device address, which is also the host address of the structure; 0 while it has no memory.
    pub fn address(&self) -> u64 {
        match &self.location {
            Location::Buffer(buffer, offset) => match buffer.address() {
                0 => 0,
                address => address + offset,
            },
            Location::Address(address) => *address,
            Location::Memory(address) => address.load(Ordering::Relaxed),
        }
    }

    /// The object's range of memory.
    pub fn storage(&self) -> Storage {
        Storage {
            address: self.address(),
            size_bytes: self.size_bytes,
        }
    }
}

/// `VkAccelerationStructureNV`, which is bound to memory itself and reports the sizes of its build.
pub struct AccelerationStructureNv {
    pub structure: Ref<AccelerationStructure>,
    pub build_scratch_bytes: u64,
    pub update_scratch_bytes: u64,
}

impl AccelerationStructureNv {
    /// Binds the structure to memory.
    pub fn bind(&self, address: u64) {
        if let Location::Memory(bound) = &self.structure.location {
            bound.store(address, Ordering::Relaxed);
        }
    }
}
