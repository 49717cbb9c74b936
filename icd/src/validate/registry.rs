//! The live buffers and acceleration structures, and the usage of the buffers.
#![forbid(unsafe_code)]

use std::collections::{BTreeMap, HashSet};
use std::sync::Arc;

use ash::vk;
use parking_lot::Mutex;
use spirv_jit::reach::{Range, Reach};

use crate::handle::Ref;
use crate::object::AccelerationStructure;

/// The live objects of a device.
#[derive(Default)]
pub struct Registry {
    /// Buffers by address and handle, since several buffers may have one address.
    buffers: Mutex<BTreeMap<(u64, u64), Buffer>>,
    /// Structures by handle. Their buffers may be bound to memory after their creation.
    structures: Mutex<BTreeMap<u64, Ref<AccelerationStructure>>>,
}

#[derive(Clone, Copy)]
struct Buffer {
    size_bytes: u64,
    usage: vk::BufferUsageFlags,
}

/// The state of a range of addresses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BufferCoverage {
    /// The whole range is in a buffer; the usages are those of all such buffers.
    Inside(vk::BufferUsageFlags),
    Outside,
}

impl Registry {
    /// Adds a buffer that has memory.
    pub fn add_buffer(
        &self,
        handle: u64,
        address: u64,
        size_bytes: u64,
        usage: vk::BufferUsageFlags,
    ) {
        let buffer = Buffer { size_bytes, usage };
        self.buffers.lock().insert((address, handle), buffer);
    }

    /// Removes a buffer.
    pub fn remove_buffer(&self, handle: u64, address: u64) {
        self.buffers.lock().remove(&(address, handle));
    }

    /// Adds a structure.
    pub fn add_structure(&self, handle: u64, structure: Ref<AccelerationStructure>) {
        self.structures.lock().insert(handle, structure);
    }

    /// Removes a structure.
    pub fn remove_structure(&self, handle: u64) {
        self.structures.lock().remove(&handle);
    }

    /// Whether a structure with this handle is alive.
    pub fn has_structure(&self, handle: u64) -> bool {
        self.structures.lock().contains_key(&handle)
    }

    /// Addresses of the live structures.
    pub fn structures(&self) -> HashSet<u64> {
        let structures = self.structures.lock();
        structures
            .values()
            .map(|structure| structure.address())
            .collect()
    }

    /// The state of a range of addresses.
    pub fn find(&self, address: u64, size_bytes: u64) -> BufferCoverage {
        let last = address.saturating_add(size_bytes.max(1));
        let buffers = self.buffers.lock();
        let below = buffers.range(..=(address, u64::MAX));
        let mut known = BufferCoverage::Outside;
        for (&(start, _), buffer) in below {
            if last > start.saturating_add(buffer.size_bytes) {
                continue;
            }
            known = BufferCoverage::Inside(match known {
                BufferCoverage::Inside(usage) => usage | buffer.usage,
                BufferCoverage::Outside => buffer.usage,
            });
        }
        known
    }

    /// The memory for physical pointers: buffers of that usage. `unbound` are the parts of sparse
    /// resources without memory.
    pub fn reach(&self, unbound: Arc<[Range]>) -> Arc<Reach> {
        let usage = vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS;
        let buffers = self.buffers.lock();
        let ranges = buffers
            .iter()
            .filter(|(_, buffer)| buffer.usage.contains(usage))
            .map(|(&(start, _), buffer)| Range {
                start,
                size_bytes: buffer.size_bytes,
            });
        Arc::new(Reach::new(ranges.collect()).with_unbound(unbound))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::handle;
    use crate::object::acceleration_structure::Location;

    #[test]
    fn ranges_are_found_in_the_buffers_that_hold_all_of_them() {
        const TABLE: vk::BufferUsageFlags = vk::BufferUsageFlags::SHADER_BINDING_TABLE_KHR;
        const ADDRESS: vk::BufferUsageFlags = vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS;
        let registry = Registry::default();
        registry.add_buffer(1, 0x1000, 0x100, TABLE);
        registry.add_buffer(2, 0x1000, 0x80, ADDRESS);
        registry.add_buffer(3, 0x2000, 0x10, ADDRESS);
        assert_eq!(
            registry.find(0x1000, 0x80),
            BufferCoverage::Inside(TABLE | ADDRESS)
        );
        assert_eq!(registry.find(0x1000, 0x81), BufferCoverage::Inside(TABLE));
        assert_eq!(registry.find(0x10F0, 0x11), BufferCoverage::Outside);
        assert!(registry.reach(Arc::default()).contains(0x2000, 0x10));
        assert!(!registry.reach(Arc::default()).contains(0x1080, 1));
        registry.remove_buffer(1, 0x1000);
        assert_eq!(registry.find(0x1080, 1), BufferCoverage::Outside);
    }

    #[test]
    fn structures_are_known_until_they_are_gone() {
        let registry = Registry::default();
        let structure = AccelerationStructure {
            ty: vk::AccelerationStructureTypeKHR::GENERIC,
            location: Location::Address(0x100),
            size_bytes: 0,
            replayable: None,
        };
        registry.add_structure(7, handle::new(structure));
        assert!(registry.structures().contains(&0x100));
        registry.remove_structure(7);
        assert!(registry.structures().is_empty());
    }
}
