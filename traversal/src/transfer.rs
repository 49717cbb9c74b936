//! Moving structures: copies, compaction, serialization.

use crate::structure::StructureError;

/// Bytes that [`compact_into`] writes.
///
/// # Errors
/// `source` is no structure.
pub fn compacted_size(source: &[u8]) -> Result<u64, StructureError> {
    unimplemented!("{}", source.len())
}

/// Copies a structure into memory of at least [`compacted_size`] bytes; returns the bytes used.
///
/// # Errors
/// `source` is no structure, or `destination` is too small or not aligned.
pub fn compact_into(source: &[u8], destination: &mut [u8]) -> Result<u64, StructureError> {
    unimplemented!("{} {}", source.len(), destination.len())
}

/// Copies a structure (the `CLONE` mode); returns the bytes used.
///
/// # Errors
/// As for [`compact_into`].
pub fn copy_into(source: &[u8], destination: &mut [u8]) -> Result<u64, StructureError> {
    unimplemented!("{} {}", source.len(), destination.len())
}

/// The two identifiers at the head of serialized data: driver, then compatibility.
pub type Uuids = [[u8; 16]; 2];

/// The head of serialized data, as the Vulkan specification lays it out
/// (`vkCopyAccelerationStructureToMemoryKHR`): the identifiers, then three 64-bit words, then the
/// table of references, then the structure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Serialized {
    /// Driver and compatibility identifiers.
    pub uuids: Uuids,
    /// Bytes of all the serialized data.
    pub serialized_bytes: u64,
    /// Bytes that deserialization needs.
    pub deserialized_bytes: u64,
    /// Number of bottom-level references that follow the head.
    pub reference_count: u64,
}

impl Serialized {
    /// Bytes of the head, before the references.
    pub const HEAD_BYTES: usize = 56;

    /// Reads the head of serialized data.
    ///
    /// # Errors
    /// [`StructureError::Truncated`] if `data` is shorter than a head.
    pub fn read(data: &[u8]) -> Result<Serialized, StructureError> {
        unimplemented!("{}", data.len())
    }
}

/// Bytes that [`serialize`] writes.
///
/// # Errors
/// `source` is no structure.
pub fn serialized_size(source: &[u8]) -> Result<u64, StructureError> {
    unimplemented!("{}", source.len())
}

/// Writes a structure for storage; returns the bytes written.
///
/// # Errors
/// `source` is no structure, or `destination` is too small.
pub fn serialize(
    source: &[u8],
    uuids: &Uuids,
    destination: &mut [u8],
) -> Result<u64, StructureError> {
    unimplemented!("{} {uuids:?} {}", source.len(), destination.len())
}

/// Makes a structure from serialized data, with the references as they stand in it now; returns
/// the bytes used. The data is validated; the identifiers are the caller's to check.
///
/// # Errors
/// `data` holds no valid structure, or `destination` is too small or not aligned.
pub fn deserialize(data: &[u8], destination: &mut [u8]) -> Result<u64, StructureError> {
    unimplemented!("{} {}", data.len(), destination.len())
}
