//! Building and updating structures.

use crate::input::{BuildFlags, BuildInput};
use crate::structure::Kind;

/// Memory for a build, in bytes: upper bounds that hold for any input of that shape.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BuildSizes {
    /// The blob.
    pub structure_bytes: u64,
    /// Scratch for [`build`].
    pub build_scratch_bytes: u64,
    /// Scratch for [`update`]; 0 if the flags do not allow updates.
    pub update_scratch_bytes: u64,
}

/// Why a build was refused. The destination's contents are undefined then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BuildError {
    /// The destination is smaller than [`build_sizes`] says, or not aligned to 256 bytes.
    Destination,
    /// The scratch memory is smaller than [`build_sizes`] says.
    Scratch,
    /// The source of an update is no structure of the same shape.
    Source,
    /// More than 2²⁴−1 geometries or instances, or 2²⁹−1 primitives.
    TooLarge,
    /// The heap gave no memory.
    OutOfMemory,
}

/// How much memory a build of `kind` needs whose geometry `i` has at most
/// `max_primitive_counts[i]` primitives. For instances, there is one geometry.
pub fn build_sizes(kind: Kind, flags: BuildFlags, max_primitive_counts: &[u32]) -> BuildSizes {
    unimplemented!("{kind:?} {flags:?} {max_primitive_counts:?}")
}

/// Builds a structure into `destination` (256-byte aligned) and returns how many of its bytes it
/// uses: the compacted size.
///
/// # Safety
/// The memory that `input` names must be readable and unchanged during the call, must not overlap
/// `destination` and `scratch`, and references of instances must be 0 or addresses of built
/// bottom levels.
///
/// # Errors
/// See [`BuildError`].
pub unsafe fn build(
    input: &BuildInput<'_>,
    destination: &mut [u8],
    scratch: &mut [u8],
) -> Result<u64, BuildError> {
    unimplemented!("{input:?} {} {}", destination.len(), scratch.len())
}

/// Updates a structure: same geometries and primitive counts, new positions, transforms and
/// instances. `source` is the structure to start from; `None` updates `destination` in place.
///
/// # Safety
/// As for [`build`].
///
/// # Errors
/// See [`BuildError`]; [`BuildError::Source`] if `source` does not fit `input`.
pub unsafe fn update(
    input: &BuildInput<'_>,
    source: Option<&[u8]>,
    destination: &mut [u8],
    scratch: &mut [u8],
) -> Result<u64, BuildError> {
    unimplemented!(
        "{input:?} {} {} {}",
        source.is_some(),
        destination.len(),
        scratch.len()
    )
}
