//! Moving structures: copies, compaction, serialization.

use std::mem::offset_of;

use crate::error::StructureError;
use crate::layout::{ALIGNMENT, Form, HEADER_BYTES, Header, Parts, micromap_reference};
use crate::live::Live;
use crate::micromap::Micromap;
use crate::structure::{Kind, Structure, validate};

/// Bytes that [`compact_into`] writes.
///
/// # Errors
/// `source` is no structure.
pub fn compacted_size(source: &[u8]) -> Result<u64, StructureError> {
    Ok(Structure::of(source)?.0.size_bytes())
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
    if !(destination.as_ptr() as usize).is_multiple_of(ALIGNMENT as usize) {
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
    /// Number of bottom-level references that follow the head; of a bottom level in blocks,
    /// [`LISTS`] and the number of blocks of addresses.
    pub reference_count: u64,
}

/// In the upper half of the word for references: blocks of addresses follow
/// (`VK_KHR_opacity_micromap`).
const LISTS: u64 = 0xFFFF_FFFF << 32;

/// Bytes of a block before its addresses: its type, which is that of opacity micromaps
/// (`VkAccelerationStructureSerializedBlockTypeKHR`, 0), and their number.
const BLOCK_HEAD: usize = 16;

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

/// The parts of a structure's serialized data after the head: the references, the blob without its
/// reference table, and the micromaps that it refers to. Deserialization needs no other live
/// object, unless micromaps are listed.
struct Split {
    size: usize,
    references_start: usize,
    references_bytes: usize,
    /// Of the block of micromaps' addresses, which has one for each geometry; 0 without.
    block_bytes: usize,
    micromaps: Vec<Enclosed>,
}

/// A micromap that is put into serialized data.
struct Enclosed {
    address: u64,
    micromap: Micromap,
}

impl Split {
    /// # Safety
    /// As for [`outside_micromaps`].
    unsafe fn of(structure: &Structure, header: &Header, live: &Live) -> Split {
        let is_listed = |geometry| {
            let reference = structure.micromap_reference(geometry);
            reference.is_some_and(|reference| listed(reference) != 0)
        };
        let geometries = 0..structure.geometry_count();
        let has_micromaps = structure.micromap_bytes() > 0;
        let lists = has_micromaps && geometries.clone().any(is_listed);
        Split {
            size: structure.size_bytes() as usize,
            block_bytes: usize::from(lists) * (BLOCK_HEAD + 8 * geometries.len()),
            references_start: header.references_offset as usize,
            references_bytes: 8 * structure.reference_count() as usize,
            // SAFETY: the caller keeps the promises of `outside_micromaps`.
            micromaps: unsafe { outside_micromaps(structure, live) },
        }
    }

    /// Bytes of the structure after deserialization.
    fn deserialized_bytes(&self) -> usize {
        let sizes = (self.micromaps.iter()).map(|it| it.micromap.size_bytes() as usize);
        sizes.fold(self.size, usize::saturating_add)
    }

    fn serialized_bytes(&self) -> usize {
        self.deserialized_bytes()
            .saturating_add(Serialized::HEAD_BYTES + self.block_bytes)
    }
}

/// The address in a geometry's reference that serialized data lists; 0 if there is none.
fn listed(reference: u64) -> u64 {
    match reference & (micromap_reference::INSIDE | micromap_reference::LISTED) {
        micromap_reference::LISTED => reference & !micromap_reference::LISTED,
        _ => 0,
    }
}

/// The micromaps that a structure refers to, and neither holds itself nor lists, by address.
///
/// # Safety
/// `live` is there as long as they are in use; see [`Micromap::at`].
unsafe fn outside_micromaps(structure: &Structure, live: &Live) -> Vec<Enclosed> {
    if structure.micromap_bytes() == 0 {
        return Vec::new();
    }
    let inside = structure.addresses();
    let mut addresses: Vec<u64> = (0..structure.geometry_count())
        .filter(|&geometry| {
            structure
                .micromap_reference(geometry)
                .is_some_and(|it| listed(it) == 0)
        })
        .filter_map(|geometry| structure.micromap_address(geometry))
        .filter(|address| !inside.contains(address))
        .collect();
    addresses.sort_unstable();
    addresses.dedup();
    addresses
        .into_iter()
        .filter_map(|address| {
            // SAFETY: the caller guarantees that `live` is there as long as they are in use; see
            // [`Micromap::at`].
            let micromap = unsafe { Micromap::at(address, live) }?;
            Some(Enclosed { address, micromap })
        })
        .collect()
}

/// Bytes that [`serialize`] writes, with the micromaps in `live` that a bottom level refers to.
///
/// # Errors
/// `source` is no structure.
///
/// # Safety
/// `live` is there during the call; see [`Micromap::at`].
pub unsafe fn serialized_size(source: &[u8], live: &Live) -> Result<u64, StructureError> {
    let (structure, header) = Structure::of(source)?;
    // SAFETY: the caller guarantees that `live` is there during the call; see [`Micromap::at`].
    Ok(unsafe { Split::of(&structure, &header, live) }.serialized_bytes() as u64)
}

/// Writes a structure for storage; returns the bytes written. A bottom level's head counts blocks
/// of addresses with `in_blocks` or where micromaps are listed (`VK_KHR_opacity_micromap`); other
/// heads count bottom-level references.
///
/// # Errors
/// `source` is no structure, or `destination` is too small.
///
/// # Safety
/// As for [`serialized_size`].
pub unsafe fn serialize(
    source: &[u8],
    uuids: &Uuids,
    in_blocks: bool,
    destination: &mut [u8],
    live: &Live,
) -> Result<u64, StructureError> {
    let (structure, header) = Structure::of(source)?;
    // SAFETY: the caller keeps the promises of `serialized_size`.
    let split = unsafe { Split::of(&structure, &header, live) };
    let bytes = split.serialized_bytes();
    let out = destination
        .get_mut(..bytes)
        .ok_or(StructureError::Destination)?;
    let (head, rest) = out.split_at_mut(Serialized::HEAD_BYTES);
    head[..16].copy_from_slice(&uuids[0]);
    head[16..32].copy_from_slice(&uuids[1]);
    let words = [
        bytes as u64,
        split.deserialized_bytes() as u64,
        match split.block_bytes {
            0 if in_blocks && structure.kind() != Kind::Instances => LISTS,
            0 => structure.reference_count(),
            _ => LISTS | 1,
        },
    ];
    for (place, word) in head[32..].chunks_exact_mut(8).zip(words) {
        place.copy_from_slice(&word.to_le_bytes());
    }
    let (block, rest) = rest.split_at_mut(split.block_bytes);
    if let Some((head, addresses)) = block.split_at_mut_checked(BLOCK_HEAD) {
        head[..8].fill(0);
        head[8..].copy_from_slice(&(addresses.len() as u64 / 8).to_le_bytes());
        for (geometry, place) in (0..).zip(addresses.chunks_exact_mut(8)) {
            let address = structure.micromap_reference(geometry).map_or(0, listed);
            place.copy_from_slice(&address.to_le_bytes());
        }
    }
    let references_end = split.references_start + split.references_bytes;
    let (references, body) = rest.split_at_mut(split.references_bytes);
    references.copy_from_slice(&source[split.references_start..references_end]);
    let (before, after) = body.split_at_mut(split.references_start);
    before.copy_from_slice(&source[..split.references_start]);
    after[..split.size - references_end].copy_from_slice(&source[references_end..split.size]);
    if structure.micromap_bytes() > 0 {
        // A bottom level has no references: the body is the whole blob.
        // SAFETY: the caller keeps the promises of `serialized_size`.
        unsafe { enclose(&structure, &split, body) };
    }
    Ok(bytes as u64)
}

/// Puts micromaps after a blob and makes its references and its header say so.
///
/// # Safety
/// The micromaps are alive and unchanged.
unsafe fn enclose(structure: &Structure, split: &Split, blob: &mut [u8]) {
    let part_bytes = structure.micromap_bytes();
    let part = split.size - part_bytes as usize;
    let mut end = split.size;
    let mut offsets = Vec::with_capacity(split.micromaps.len());
    for enclosed in &split.micromaps {
        // SAFETY: the caller guarantees that the micromaps are alive and unchanged.
        let bytes = unsafe { enclosed.micromap.bytes() };
        blob[end..end + bytes.len()].copy_from_slice(bytes);
        offsets.push((end - part) as u64);
        end += bytes.len();
    }
    let mut put = |place: usize, word: u64| {
        blob[place..place + 8].copy_from_slice(&word.to_le_bytes());
    };
    for geometry in 0..structure.geometry_count() {
        let address = structure.micromap_address(geometry);
        let found =
            (split.micromaps).binary_search_by_key(&address, |enclosed| Some(enclosed.address));
        let outside = address.is_none_or(|address| !structure.addresses().contains(&address));
        let is_listed = structure
            .micromap_reference(geometry)
            .is_some_and(|it| listed(it) != 0);
        // Only micromaps are referred to elsewhere.
        let reference = match found {
            _ if is_listed => 0,
            Ok(index) => offsets[index] | micromap_reference::INSIDE,
            Err(_) if outside => 0,
            Err(_) => continue,
        };
        put(part + 8 * geometry as usize, reference);
    }
    let enclosed = (end - split.size) as u64;
    put(offset_of!(Header, size_bytes), end as u64);
    put(offset_of!(Header, micromap_bytes), part_bytes + enclosed);
}

/// Makes a structure from serialized data, with the references as they stand in it now; returns the
/// bytes used. The data is validated, and references that do not lead to where a structure may be
/// in `live` become 0, as in a build; the identifiers are the caller's to check.
///
/// # Errors
/// `data` holds no valid structure, or `destination` is too small or not aligned.
pub fn deserialize(
    data: &[u8],
    destination: &mut [u8],
    live: &Live,
) -> Result<u64, StructureError> {
    let head = Serialized::read(data)?;
    let size = usize::try_from(head.deserialized_bytes).map_err(|_| StructureError::Corrupt)?;
    let data = &data[Serialized::HEAD_BYTES..];
    let (reference_count, addresses, data) = match head.reference_count {
        blocks @ LISTS.. => {
            let (addresses, data) = read_block(blocks & !LISTS, data)?;
            (0, addresses, data)
        }
        count => (count, &[][..], data),
    };
    let references_bytes = usize::try_from(reference_count)
        .ok()
        .and_then(|count| count.checked_mul(8))
        .ok_or(StructureError::Corrupt)?;
    let data = data.get(..size).ok_or(StructureError::Truncated)?;
    let (references, body) = data
        .split_at_checked(references_bytes)
        .ok_or(StructureError::Truncated)?;
    let (before, after) = split_at_references(body, references_bytes)?;
    let out = place(destination, size)?;
    let (out_before, out_rest) = out.split_at_mut(before.len());
    let (out_references, out_after) = out_rest.split_at_mut(references_bytes);
    out_before.copy_from_slice(before);
    for (out, reference) in (out_references.chunks_exact_mut(8)).zip(references.chunks_exact(8)) {
        let reference = u64::from_le_bytes(reference.try_into().expect("eight bytes"));
        let leads_somewhere =
            reference.is_multiple_of(ALIGNMENT) && live.contains(reference, HEADER_BYTES);
        let reference = if leads_somewhere { reference } else { 0 };
        out.copy_from_slice(&reference.to_le_bytes());
    }
    out_after.copy_from_slice(after);
    let checked = check_deserialized(out, &head, reference_count, addresses.len());
    let part = match checked {
        Ok(part) => part,
        Err(error) => {
            // A corrupt structure must not be walked.
            out[..size_of::<Header>().min(size)].fill(0);
            return Err(error);
        }
    };
    let (own, _) = out[part..].as_chunks_mut::<8>();
    for (own, &address) in own.iter_mut().zip(addresses) {
        let address = u64::from_le_bytes(address);
        // References to micromaps that are not inside are 0 now.
        if u64::from_le_bytes(*own) == 0
            && address.is_multiple_of(ALIGNMENT)
            && live.contains(address, Micromap::HEADER_BYTES)
        {
            *own = (address | micromap_reference::LISTED).to_le_bytes();
        }
    }
    Ok(size as u64)
}

/// The bytes before and after the place of the references in a structure from which they were taken
/// out. The geometry count in the header fixes that place.
fn split_at_references(
    body: &[u8],
    references_bytes: usize,
) -> Result<(&[u8], &[u8]), StructureError> {
    let header = body
        .get(..size_of::<Header>())
        .ok_or(StructureError::Truncated)?;
    // SAFETY: the slice is as long as a header, whose members are plain numbers.
    let header = unsafe { header.as_ptr().cast::<Header>().read_unaligned() };
    let kind = if references_bytes == 0 {
        // The offset of an empty table does not matter.
        Kind::Triangles
    } else {
        Kind::Instances
    };
    let parts = Parts::new(kind, Form::Groups, header.geometry_count.into(), 0, 0);
    body.split_at_checked(parts.references_offset as usize)
        .ok_or(StructureError::Truncated)
}

/// Checks a structure against the data that it was made from; returns the offset of its part for
/// micromaps.
fn check_deserialized(
    out: &[u8],
    head: &Serialized,
    reference_count: u64,
    address_count: usize,
) -> Result<usize, StructureError> {
    validate(out)?;
    let (structure, _) = Structure::of(out)?;
    let geometries = structure.geometry_count() as usize;
    let same = structure.reference_count() == reference_count
        && structure.size_bytes() == head.deserialized_bytes
        && (address_count == 0 || address_count == geometries && structure.micromap_bytes() > 0);
    let holds_its_micromaps = (0..structure.geometry_count())
        .filter_map(|geometry| structure.micromap_address(geometry))
        .all(|address| address == 0 || structure.addresses().contains(&address));
    (same && holds_its_micromaps)
        .then_some(out.len() - structure.micromap_bytes() as usize)
        .ok_or(StructureError::Corrupt)
}

/// The addresses of the only block of serialized data, if it has one, and the data after it.
fn read_block(blocks: u64, data: &[u8]) -> Result<(&[[u8; 8]], &[u8]), StructureError> {
    if blocks == 0 {
        return Ok((&[], data));
    }
    let (head, rest) = (data.split_at_checked(BLOCK_HEAD)).ok_or(StructureError::Truncated)?;
    let (words, _) = head.as_chunks::<8>();
    // The upper half of the first word is reserved.
    if blocks > 1 || words[0][..4] != [0; 4] {
        return Err(StructureError::Corrupt);
    }
    let bytes = usize::try_from(u64::from_le_bytes(words[1])).ok();
    let bytes = (bytes.and_then(|count| count.checked_mul(8))).ok_or(StructureError::Corrupt)?;
    let (addresses, rest) = (rest.split_at_checked(bytes)).ok_or(StructureError::Truncated)?;
    Ok((addresses.as_chunks().0, rest))
}
