//! Moving structures: copies, compaction, serialization.

use crate::layout::{Header, Parts};
use crate::structure::{Kind, Structure, StructureError, validate};

/// Bytes that [`compact_into`] writes.
///
/// # Errors
/// `source` is no structure.
pub fn compacted_size(source: &[u8]) -> Result<u64, StructureError> {
    Ok(Structure::of(source)?.size_bytes())
}

/// Copies a structure into memory of at least [`compacted_size`] bytes; returns the bytes used.
///
/// # Errors
/// `source` is no structure, or `destination` is too small or not aligned.
pub fn compact_into(source: &[u8], destination: &mut [u8]) -> Result<u64, StructureError> {
    let size = compacted_size(source)? as usize;
    place(destination, size)?.copy_from_slice(&source[..size]);
    Ok(size as u64)
}

/// Copies a structure (the `CLONE` mode); returns the bytes used.
///
/// # Errors
/// As for [`compact_into`].
pub fn copy_into(source: &[u8], destination: &mut [u8]) -> Result<u64, StructureError> {
    compact_into(source, destination)
}

/// The first `size` bytes of memory for a structure.
fn place(destination: &mut [u8], size: usize) -> Result<&mut [u8], StructureError> {
    if !(destination.as_ptr() as usize).is_multiple_of(crate::layout::ALIGNMENT as usize) {
        return Err(StructureError::Destination);
    }
    destination
        .get_mut(..size)
        .ok_or(StructureError::Destination)
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
        let head = data
            .get(..Self::HEAD_BYTES)
            .ok_or(StructureError::Truncated)?;
        let word = |i: usize| u64::from_le_bytes(head[8 * i..8 * i + 8].try_into().unwrap());
        Ok(Serialized {
            uuids: [
                head[..16].try_into().unwrap(),
                head[16..32].try_into().unwrap(),
            ],
            serialized_bytes: word(4),
            deserialized_bytes: word(5),
            reference_count: word(6),
        })
    }
}

/// What serialized data of a structure consists of, after the head: the references, then the blob
/// without its reference table.
struct Split {
    size: usize,
    references_start: usize,
    references_bytes: usize,
}

impl Split {
    fn of(structure: &Structure) -> Split {
        Split {
            size: structure.size_bytes() as usize,
            references_start: structure.header().references_offset as usize,
            references_bytes: 8 * structure.reference_count() as usize,
        }
    }

    fn serialized_bytes(&self) -> usize {
        Serialized::HEAD_BYTES + self.size
    }
}

/// Bytes that [`serialize`] writes.
///
/// # Errors
/// `source` is no structure.
pub fn serialized_size(source: &[u8]) -> Result<u64, StructureError> {
    Ok(Split::of(&Structure::of(source)?).serialized_bytes() as u64)
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
    let structure = Structure::of(source)?;
    let split = Split::of(&structure);
    let bytes = split.serialized_bytes();
    let out = destination
        .get_mut(..bytes)
        .ok_or(StructureError::Destination)?;
    let (head, rest) = out.split_at_mut(Serialized::HEAD_BYTES);
    head[..16].copy_from_slice(&uuids[0]);
    head[16..32].copy_from_slice(&uuids[1]);
    let words = [bytes as u64, split.size as u64, structure.reference_count()];
    for (place, word) in head[32..].chunks_exact_mut(8).zip(words) {
        place.copy_from_slice(&word.to_le_bytes());
    }
    let references_end = split.references_start + split.references_bytes;
    let (references, body) = rest.split_at_mut(split.references_bytes);
    references.copy_from_slice(&source[split.references_start..references_end]);
    let (before, after) = body.split_at_mut(split.references_start);
    before.copy_from_slice(&source[..split.references_start]);
    after.copy_from_slice(&source[references_end..split.size]);
    Ok(bytes as u64)
}

/// Makes a structure from serialized data, with the references as they stand in it now; returns
/// the bytes used. The data is validated; the identifiers are the caller's to check.
///
/// # Errors
/// `data` holds no valid structure, or `destination` is too small or not aligned.
pub fn deserialize(data: &[u8], destination: &mut [u8]) -> Result<u64, StructureError> {
    let head = Serialized::read(data)?;
    let size = usize::try_from(head.deserialized_bytes).map_err(|_| StructureError::Corrupt)?;
    let references_bytes = usize::try_from(head.reference_count)
        .ok()
        .and_then(|count| count.checked_mul(8))
        .ok_or(StructureError::Corrupt)?;
    let data = data
        .get(Serialized::HEAD_BYTES..)
        .and_then(|data| data.get(..size))
        .ok_or(StructureError::Truncated)?;
    let (references, body) = data
        .split_at_checked(references_bytes)
        .ok_or(StructureError::Truncated)?;
    // The geometry count fixes where the references were taken out; the header has it, and comes
    // before them.
    let header = body
        .get(..size_of::<Header>())
        .ok_or(StructureError::Truncated)?;
    // SAFETY: as long as a header, which is plain numbers.
    let header = unsafe { header.as_ptr().cast::<Header>().read_unaligned() };
    let kind = if references_bytes == 0 {
        // Where a table of no bytes is does not matter.
        Kind::Triangles
    } else {
        Kind::Instances
    };
    let parts = Parts::new(kind, header.geometry_count.into(), 0, 0);
    let (before, after) = body
        .split_at_checked(parts.references_offset as usize)
        .ok_or(StructureError::Truncated)?;

    let out = place(destination, size)?;
    let (out_before, out_rest) = out.split_at_mut(before.len());
    let (out_references, out_after) = out_rest.split_at_mut(references_bytes);
    out_before.copy_from_slice(before);
    out_references.copy_from_slice(references);
    out_after.copy_from_slice(after);
    let checked = validate(out).and_then(|()| {
        let structure = Structure::of(out)?;
        let same = structure.reference_count() == head.reference_count
            && structure.size_bytes() == head.deserialized_bytes;
        same.then_some(()).ok_or(StructureError::Corrupt)
    });
    if let Err(error) = checked {
        // What is not sound must not be walked.
        out[..size_of::<Header>().min(size)].fill(0);
        return Err(error);
    }
    Ok(size as u64)
}
