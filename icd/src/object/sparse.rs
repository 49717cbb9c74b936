//! Sparse binding: a resource is address space into which memory is mapped.
//!
//! Only shared mappings allow a page of memory at several addresses, so devices with the feature
//! `sparseBinding` allocate memory that way. Unbound addresses read as zeros.

use std::sync::Arc;

use ash::vk;

use super::DeviceMemory;
use super::address_space::{GRANULE, Placement};
use super::memory::AddressWindow;
use crate::VkResult;
use crate::handle::Ref;
use crate::os::address_space::{page_bytes, replace_by_zeros};

/// Address space of a sparse resource.
pub struct Reservation {
    window: Arc<AddressWindow>,
    address: u64,
    size_bytes: u64,
}

impl Reservation {
    /// Reserves address space.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_DEVICE_MEMORY` if there is too little;
    /// `VK_ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS` if a requested address is taken.
    pub fn new(
        window: &Arc<AddressWindow>,
        size_bytes: u64,
        placement: Placement,
    ) -> VkResult<Arc<Self>> {
        let size_bytes = size_bytes
            .max(1)
            .checked_next_multiple_of(GRANULE)
            .ok_or(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY)?;
        let address = window.take_range(size_bytes, placement)?;
        window.live.unbind(address, size_bytes);
        Ok(Arc::new(Self {
            address,
            window: Arc::clone(window),
            size_bytes,
        }))
    }

    /// The resource's address.
    pub fn address(&self) -> u64 {
        self.address
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        self.window.live.bind(self.address, self.size_bytes);
        self.window.give_back_range(self.address, self.size_bytes);
    }
}

/// `VkSparseMemoryBind` of a resource.
pub struct SparseBind {
    pub resource: Arc<Reservation>,
    pub resource_offset: u64,
    pub size_bytes: u64,
    /// Memory and an offset into it; `None` unbinds.
    pub memory: Option<(Ref<DeviceMemory>, u64)>,
}

impl SparseBind {
    /// Performs the bind.
    ///
    /// # Errors
    /// Describes the mistake: a range outside the resource, or memory that cannot be bound.
    pub fn perform(&self) -> Result<(), &'static str> {
        let inside = |offset: u64, whole: u64| {
            (offset.checked_add(self.size_bytes)).is_some_and(|end| end <= whole)
        };
        if !self.resource_offset.is_multiple_of(page_bytes())
            || !self.size_bytes.is_multiple_of(page_bytes())
            || !inside(self.resource_offset, self.resource.size_bytes)
        {
            return Err("a sparse binding outside of its resource");
        }
        let address = self.resource.address + self.resource_offset;
        let live = &self.resource.window.live;
        let is_mapped = match &self.memory {
            None => {
                live.unbind(address, self.size_bytes);
                // SAFETY: the range is part of this resource's reservation, whose contents are
                // undefined during the bind.
                unsafe { replace_by_zeros(address, self.size_bytes) }
            }
            Some((memory, offset)) => {
                if !offset.is_multiple_of(page_bytes()) || !inside(*offset, memory.shared_bytes()) {
                    return Err("a sparse binding to memory that cannot be bound");
                }
                live.bind(address, self.size_bytes);
                // SAFETY: the range is part of this resource's reservation, whose contents are
                // undefined during the bind.
                unsafe { memory.alias(*offset, self.size_bytes, address) }
            }
        };
        match is_mapped {
            true => Ok(()),
            false => Err("the system refuses a sparse binding"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::memory::Source;
    use super::*;
    use crate::handle;

    fn read(address: u64) -> u64 {
        // SAFETY: the test's own mapping.
        unsafe { *(address as *const u64) }
    }

    #[test]
    fn memory_shows_up_where_it_is_bound() {
        let window = AddressWindow::reserve(1 << 30).ok().unwrap();
        let allocate =
            |source| DeviceMemory::allocate(&window, 4 * GRANULE, source, Placement::Ordinary);
        let memory = handle::new(allocate(Source::Shared).ok().unwrap());
        let resource = Reservation::new(&window, 3 * GRANULE, Placement::Ordinary);
        let resource = resource.ok().unwrap();
        let bind = |offset: u64, size_bytes: u64, memory: Option<(Ref<DeviceMemory>, u64)>| {
            SparseBind {
                resource: Arc::clone(&resource),
                resource_offset: offset,
                size_bytes,
                memory,
            }
            .perform()
        };
        // SAFETY: inside the allocation.
        unsafe { *((memory.address + 2 * GRANULE) as *mut u64) = 7 };
        let place = resource.address() + GRANULE;
        assert_eq!(read(place), 0);
        bind(GRANULE, GRANULE, Some((Arc::clone(&memory), 2 * GRANULE))).unwrap();
        assert_eq!(read(place), 7);
        // SAFETY: inside the resource.
        unsafe { *(place as *mut u64) = 8 };
        assert_eq!(read(memory.address + 2 * GRANULE), 8);
        bind(GRANULE, GRANULE, None).unwrap();
        assert_eq!(read(place), 0);

        assert!(bind(3 * GRANULE, GRANULE, None).is_err());
        assert!(bind(0, 2 * GRANULE, Some((Arc::clone(&memory), 3 * GRANULE))).is_err());
        let own = handle::new(allocate(Source::Fresh).ok().unwrap());
        assert!(bind(0, GRANULE, Some((own, 0))).is_err());
        let address = resource.address();
        drop(resource);
        assert_eq!(read(address), 0);
    }
}
