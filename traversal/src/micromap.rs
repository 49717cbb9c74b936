//! Opacity micromaps: opacity of the parts of a triangle, looked up instead of asking a shader.
//!
//! A micromap triangle is divided `level` times into four, and each of the 4ᴸ parts has a state:
//! one bit, or two. A micromap is one relocatable blob, like a structure:
//!
//! ```text
//! MicromapHeader      64 bytes
//! TriangleEntry       16 bytes each
//! states              each triangle's own bytes, one after the other
//! ```
//!
//! A geometry with a micromap has an entry for each of its triangles ([`GeometryMicromap`]): one of
//! the micromap's triangles, or one state for all of it. A bottom level holds these and the address
//! of the micromap, which must therefore live as long; see [`crate::transfer`] for what
//! serialization does.

mod curve;
mod geometry;

use crate::error::BuildError;
use crate::error::StructureError;
use crate::live::Live;
use crate::memory::Memory;
use curve::part_index;
pub use geometry::GeometryMicromap;

/// The first word of a micromap.
pub const MAGIC: u64 = u64::from_le_bytes(*b"TuffOMv\0");
const VERSION: u32 = 1;
/// Alignment of a micromap in memory, in bytes.
pub(crate) const ALIGNMENT: u64 = 256;

/// Subdivision levels, at most: coordinates of parts have this many bits.
pub const MAX_LEVEL: u32 = 15;

/// The opacity of a part of a triangle; the values of the four-state format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Opacity {
    /// No candidate.
    Transparent = 0,
    /// No any-hit shader runs.
    Opaque = 1,
    /// An any-hit shader decides; transparent where two states are forced.
    UnknownTransparent = 2,
    /// An any-hit shader decides; opaque where two states are forced.
    UnknownOpaque = 3,
}

impl Opacity {
    fn of(state: u32) -> Opacity {
        match state & 3 {
            0 => Opacity::Transparent,
            1 => Opacity::Opaque,
            2 => Opacity::UnknownTransparent,
            _ => Opacity::UnknownOpaque,
        }
    }

    /// With two states only (`ForceOpacityMicromap2State`).
    pub fn in_two_states(self) -> Opacity {
        match self {
            Opacity::Transparent | Opacity::UnknownTransparent => Opacity::Transparent,
            Opacity::Opaque | Opacity::UnknownOpaque => Opacity::Opaque,
        }
    }
}

/// `VkOpacityMicromapFormatEXT`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum MicromapFormat {
    /// A bit a part: transparent or opaque.
    TwoStates = 1,
    /// Two bits a part.
    FourStates = 2,
}

impl MicromapFormat {
    /// The format of Vulkan's value.
    pub fn of(value: u32) -> Option<MicromapFormat> {
        match value {
            1 => Some(MicromapFormat::TwoStates),
            2 => Some(MicromapFormat::FourStates),
            _ => None,
        }
    }

    const fn bits(self) -> u32 {
        self as u32
    }

    /// Bytes of one triangle's states; `level` is at most [`MAX_LEVEL`].
    pub const fn triangle_bytes(self, level: u32) -> u64 {
        ((1u64 << (2 * level)) * self.bits() as u64).div_ceil(8)
    }
}

/// So many triangles of a micromap have this format and level (`VkMicromapUsageEXT`).
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "the names say it")]
pub struct MicromapUsage {
    pub count: u32,
    pub level: u32,
    pub format: MicromapFormat,
}

/// The input of a micromap build.
#[derive(Clone, Copy, Debug)]
pub struct MicromapInput {
    /// `VkMicromapTriangleEXT`s: offset into `data` (32 bits), level and format (16 bits each).
    pub triangles: Memory,
    /// Bytes from one of them to the next.
    pub stride_bytes: u64,
    /// Number of triangles.
    pub count: u32,
    /// States, from the lowest bit of a byte to the highest.
    pub data: Memory,
}

/// Indices from here up stand for one [`Opacity`] of the whole triangle: `!index`.
const FIRST_SPECIAL: u32 = !3;

/// First bytes of a micromap. It can be read where serialized data is, which applications align to
/// 16 bytes.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(16))]
struct MicromapHeader {
    magic: u64,
    version: u32,
    triangle_count: u32,
    size_bytes: u64,
    states_offset: u64,
    reserved: [u64; 4],
}

/// A triangle of a micromap.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
struct TriangleEntry {
    /// Where its states start, from the start of the micromap.
    offset: u64,
    level: u16,
    /// A [`MicromapFormat`]; anything else stands for a triangle that could not be read.
    format: u16,
    reserved: u32,
}

const _: () = assert!(size_of::<MicromapHeader>() == 64);
const _: () = assert!(size_of::<TriangleEntry>() == 16);

/// Bytes of a micromap with these triangles, as [`build_micromap`] writes it; `None` if no memory
/// can have so many.
pub fn micromap_size(usages: impl IntoIterator<Item = MicromapUsage>) -> Option<u64> {
    let each = |usage: MicromapUsage| {
        let states = usage.format.triangle_bytes(usage.level.min(MAX_LEVEL));
        u64::from(usage.count).checked_mul(size_of::<TriangleEntry>() as u64 + states)
    };
    usages
        .into_iter()
        .try_fold(size_of::<MicromapHeader>() as u64, |sum, usage| {
            sum.checked_add(each(usage)?)
        })?
        .checked_next_multiple_of(ALIGNMENT)
}

/// Builds a micromap into `destination` (256-byte aligned); returns how many of its bytes it uses.
/// A triangle whose level or format there is not, or whose states lie outside the memory, asks a
/// shader everywhere.
///
/// # Safety
/// The memory that `input` names is readable and unchanged, and does not overlap `destination`.
///
/// # Errors
/// [`BuildError::Destination`] if the destination is too small or not aligned.
pub unsafe fn build_micromap(
    input: &MicromapInput,
    destination: &mut [u8],
) -> Result<u64, BuildError> {
    if !(destination.as_ptr() as usize).is_multiple_of(ALIGNMENT as usize) {
        return Err(BuildError::Destination);
    }
    let triangles_offset = size_of::<MicromapHeader>();
    let states_offset =
        triangles_offset as u64 + u64::from(input.count) * size_of::<TriangleEntry>() as u64;
    let mut end = states_offset;
    for index in 0..input.count {
        // SAFETY: the caller guarantees that the memory that `input` names is readable and
        // unchanged, and does not overlap `destination`.
        let source = unsafe { read_triangle(input, index) };
        let states = source.map_or(&[][..], |(_, _, states)| states);
        let entry = TriangleEntry {
            offset: end,
            level: source.map_or(0, |(level, _, _)| level as u16),
            format: source.map_or(0, |(_, format, _)| format as u16),
            reserved: 0,
        };
        let place = triangles_offset + index as usize * size_of::<TriangleEntry>();
        put(destination, place as u64, entry)?;
        let after = end + states.len() as u64;
        destination
            .get_mut(end as usize..after as usize)
            .ok_or(BuildError::Destination)?
            .copy_from_slice(states);
        end = after;
    }
    let size_bytes = end.next_multiple_of(ALIGNMENT);
    destination
        .get_mut(end as usize..size_bytes as usize)
        .ok_or(BuildError::Destination)?
        .fill(0);
    let header = MicromapHeader {
        magic: MAGIC,
        version: VERSION,
        triangle_count: input.count,
        size_bytes,
        states_offset,
        reserved: [0; 4],
    };
    put(destination, 0, header)?;
    Ok(size_bytes)
}

/// Level, format and states of a triangle of the input.
///
/// # Safety
/// As for [`build_micromap`].
unsafe fn read_triangle(
    input: &MicromapInput,
    index: u32,
) -> Option<(u32, MicromapFormat, &'static [u8])> {
    let place = u64::from(index).checked_mul(input.stride_bytes)?;
    // SAFETY: the caller keeps the promises of `build_micromap`.
    let bytes: [u8; 8] = unsafe { input.triangles.read(place) }?;
    let offset = u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    let level = u32::from(u16::from_le_bytes([bytes[4], bytes[5]]));
    let format = MicromapFormat::of(u16::from_le_bytes([bytes[6], bytes[7]]).into())?;
    if level > MAX_LEVEL {
        return None;
    }
    let length = format.triangle_bytes(level);
    if u64::from(offset) + length > input.data.bytes as u64 {
        return None;
    }
    // SAFETY: inside the memory, which is readable by the caller's promise for as long as the
    // caller needs it.
    let states = unsafe {
        std::slice::from_raw_parts(input.data.base.add(offset as usize), length as usize)
    };
    Some((level, format, states))
}

/// Writes a plain value at an offset.
fn put<T: Copy>(destination: &mut [u8], offset: u64, value: T) -> Result<(), BuildError> {
    let place = destination
        .get_mut(offset as usize..)
        .filter(|place| place.len() >= size_of::<T>())
        .ok_or(BuildError::Destination)?;
    // SAFETY: there is room for it.
    unsafe { place.as_mut_ptr().cast::<T>().write_unaligned(value) };
    Ok(())
}

/// A micromap at an address, to be read: by a copy of its header, as a
/// [`Structure`](crate::Structure) is.
#[derive(Clone, Copy, Debug)]
pub struct Micromap {
    base: *const u8,
    triangle_count: u32,
    size_bytes: u64,
}

impl Micromap {
    /// Bytes of the head that every micromap has.
    pub const HEADER_BYTES: u64 = size_of::<MicromapHeader>() as u64;

    /// The micromap at `address`; `None` if that is 0, not aligned or not live, or no micromap lies
    /// there that ends in live memory.
    ///
    /// # Safety
    /// `live` is there as long as the value is in use. In [`EVERYWHERE`](crate::EVERYWHERE), an
    /// address other than 0 must be that of a micromap.
    pub unsafe fn at(address: u64, live: &Live) -> Option<Micromap> {
        // SAFETY: the caller guarantees that `live` is there as long as the value is in use.
        unsafe { Micromap::inside(address, live.bytes_from(address)) }
    }

    /// The micromap at `address`, of which so many bytes are there.
    ///
    /// # Safety
    /// The bytes are there as long as the value is in use.
    unsafe fn inside(address: u64, bytes: u64) -> Option<Micromap> {
        let is_aligned = address.is_multiple_of(align_of::<MicromapHeader>() as u64);
        if bytes < Micromap::HEADER_BYTES || !is_aligned {
            return None;
        }
        let base = std::ptr::with_exposed_provenance::<u8>(address as usize);
        // SAFETY: aligned, and readable by the caller's promise; a header is plain numbers.
        let header = unsafe { base.cast::<MicromapHeader>().read_volatile() };
        let states_offset = size_of::<MicromapHeader>() as u64
            + u64::from(header.triangle_count) * size_of::<TriangleEntry>() as u64;
        (header.magic == MAGIC
            && header.version == VERSION
            && header.states_offset == states_offset
            && states_offset <= header.size_bytes
            && header.size_bytes <= bytes)
            .then_some(Micromap {
                base,
                triangle_count: header.triangle_count,
                size_bytes: header.size_bytes,
            })
    }

    /// How many triangles it has.
    pub fn triangle_count(&self) -> u32 {
        self.triangle_count
    }

    /// Bytes in use: its size after compaction.
    pub fn size_bytes(&self) -> u64 {
        self.size_bytes
    }

    /// Its bytes.
    ///
    /// # Safety
    /// As for [`Self::at`], for as long as `'a`, and nothing writes them.
    pub unsafe fn bytes<'a>(&self) -> &'a [u8] {
        // SAFETY: the caller keeps the promises of `Self::at` for as long as `'a`, and nothing
        // writes them.
        unsafe { std::slice::from_raw_parts(self.base, self.size_bytes as usize) }
    }

    /// A triangle's states; `None` where the micromap says nothing of it.
    fn triangle(&self, triangle: u32) -> Option<TriangleStates> {
        if triangle >= self.triangle_count {
            return None;
        }
        let offset = size_of::<MicromapHeader>() + triangle as usize * size_of::<TriangleEntry>();
        // SAFETY: below the count, so inside the size that `at` checked.
        let entry = unsafe {
            self.base
                .add(offset)
                .cast::<TriangleEntry>()
                .read_volatile()
        };
        let format = MicromapFormat::of(entry.format.into())?;
        let level = u32::from(entry.level);
        (level <= MAX_LEVEL).then_some(TriangleStates {
            micromap: *self,
            offset: entry.offset,
            level,
            bits: format.bits(),
        })
    }
}

/// The states of a triangle of a micromap, to be read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TriangleStates {
    micromap: Micromap,
    offset: u64,
    level: u32,
    /// Of one state.
    bits: u32,
}

impl TriangleStates {
    /// The opacity at a point. Where the micromap ends before it, a shader is asked.
    #[inline(always)]
    pub fn opacity(&self, barycentrics: [f32; 2]) -> Opacity {
        let bit = part_index(barycentrics, self.level) * self.bits;
        let place = self.offset.checked_add(u64::from(bit / 8));
        let Some(place) = place.filter(|&place| place < self.micromap.size_bytes) else {
            return Opacity::UnknownOpaque;
        };
        // SAFETY: inside the size.
        let byte = unsafe { self.micromap.base.add(place as usize).read_volatile() };
        Opacity::of(u32::from(byte) >> (bit % 8) & ((1 << self.bits) - 1))
    }
}

/// Where a triangle finds its opacity.
#[derive(Clone, Copy, Debug)]
pub(crate) enum TriangleOpacity {
    Everywhere(Opacity),
    ByParts(TriangleStates),
}

impl TriangleOpacity {
    /// Where nothing says more: a shader is asked.
    pub const UNKNOWN: TriangleOpacity = TriangleOpacity::Everywhere(Opacity::UnknownOpaque);

    /// By a word of a bottom level: special, or a triangle of the micromap at `address`.
    ///
    /// # Safety
    /// As for [`Micromap::at`].
    pub unsafe fn of_word(address: u64, word: u32, live: &Live) -> TriangleOpacity {
        if word >= FIRST_SPECIAL {
            return TriangleOpacity::Everywhere(Opacity::of(!word));
        }
        // SAFETY: the caller keeps the promises of `Micromap::at`.
        unsafe { Micromap::at(address, live) }
            .and_then(|micromap| micromap.triangle(word))
            .map_or(TriangleOpacity::UNKNOWN, TriangleOpacity::ByParts)
    }

    /// The opacity at a point.
    #[inline(always)]
    pub fn at(&self, barycentrics: [f32; 2]) -> Opacity {
        match self {
            TriangleOpacity::Everywhere(opacity) => *opacity,
            TriangleOpacity::ByParts(states) => states.opacity(barycentrics),
        }
    }
}

/// Checks everything that a lookup relies on.
///
/// # Errors
/// The error in a micromap.
pub fn validate_micromap(blob: &[u8]) -> Result<u64, StructureError> {
    if blob.len() < size_of::<MicromapHeader>() {
        return Err(StructureError::Truncated);
    }
    let address = blob.as_ptr().expose_provenance() as u64;
    // SAFETY: the blob is there.
    let micromap = unsafe { Micromap::inside(address, blob.len() as u64) };
    Ok(micromap.ok_or(StructureError::NotAStructure)?.size_bytes)
}

/// Copies a micromap into memory of at least its size, 256-byte aligned; returns the bytes used.
///
/// # Errors
/// `source` is no micromap, or `destination` is too small or not aligned.
pub fn copy_micromap(source: &[u8], destination: &mut [u8]) -> Result<u64, StructureError> {
    let size = validate_micromap(source)? as usize;
    if !(destination.as_ptr() as usize).is_multiple_of(ALIGNMENT as usize) {
        return Err(StructureError::Destination);
    }
    destination
        .get_mut(..size)
        .ok_or(StructureError::Destination)?
        .copy_from_slice(&source[..size]);
    Ok(size as u64)
}
