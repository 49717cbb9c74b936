//! `VkAccelerationStructureKHR`: a name for a range of a buffer; the structure itself is the bytes there.

use ash::vk;

/// An acceleration structure object.
pub struct AccelerationStructure {
    pub ty: vk::AccelerationStructureTypeKHR,
    /// Device address, which is also the host address of the blob.
    pub address: u64,
    pub size_bytes: u64,
}
