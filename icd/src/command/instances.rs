//! The instances of a build, as recorded.
#![forbid(unsafe_code)]

use traversal::{GeometryFlags, InstanceArray};

/// `VkAccelerationStructureGeometryInstancesDataKHR`, restricted to its range.
#[derive(Clone, Copy, Debug)]
pub struct Instances {
    pub flags: GeometryFlags,
    pub array: InstanceArray,
    pub address: u64,
    pub count: u32,
}
