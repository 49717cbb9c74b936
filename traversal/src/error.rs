//! Why builds, and structures that somebody gives, are refused.
#![forbid(unsafe_code)]

/// Why a build was refused. The destination's contents are undefined then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BuildError {
    /// The destination is smaller than [`build_sizes`](crate::build_sizes) says, or not aligned to
    /// 256 bytes.
    Destination,
    /// The scratch memory is smaller than [`build_sizes`](crate::build_sizes) says.
    Scratch,
    /// The source of an update is no structure of the same shape.
    Source,
    /// More than 2²⁴−1 geometries or instances, or 2²⁹−1 primitives.
    TooLarge,
    /// The heap gave no memory.
    OutOfMemory,
}

impl std::fmt::Display for BuildError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            BuildError::Destination => "the destination is too small or misaligned",
            BuildError::Scratch => "the scratch memory is too small or overlaps the destination",
            BuildError::Source => "the source does not fit the update",
            BuildError::TooLarge => "too many geometries or primitives",
            BuildError::OutOfMemory => "out of memory",
        })
    }
}

impl std::error::Error for BuildError {}

/// Why bytes are not a structure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StructureError {
    /// Shorter than what the header says, or than a header.
    Truncated,
    /// Not a structure of ours, or of another version.
    NotAStructure,
    /// A count, an offset or an index points outside, or backwards.
    Corrupt,
    /// The caller's destination is too small or not aligned to 256 bytes.
    Destination,
}

impl std::fmt::Display for StructureError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            StructureError::Truncated => "the structure is cut short",
            StructureError::NotAStructure => "not an acceleration structure of this version",
            StructureError::Corrupt => "the structure is corrupt",
            StructureError::Destination => "the destination is too small or misaligned",
        })
    }
}

impl std::error::Error for StructureError {}
