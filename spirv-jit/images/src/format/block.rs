//! Texels of 16 lanes at once, component by component.
//!
//! Normalised formats are loaded in *units*, that is, before the division by 2^bits − 1, so that
//! filtering divides once per result and not once per texel: [`finish`] turns units into values.

use lanes::halves::half_to_f32;
use lanes::{LANES, map};

use super::codec::encode_unorm;
use super::layout::{BLOCK_INDEX_SHIFT, Codec, FormatInfo};
use crate::compressed::Blocks;
use crate::srgb;

/// A word per lane.
pub type LaneWords = [u32; LANES];
/// Four components of a texel per lane.
pub type Texels = [LaneWords; 4];
/// A byte offset per lane.
pub type Offsets = [u64; LANES];

/// An offset in bytes: 32 bits where the image is small enough, which halves the vectors.
pub trait Offset: Copy {
    fn bytes(self) -> usize;
}

impl Offset for u32 {
    #[inline(always)]
    fn bytes(self) -> usize {
        self as usize
    }
}

impl Offset for u64 {
    #[inline(always)]
    fn bytes(self) -> usize {
        self as usize
    }
}

/// Loads a plain value per lane.
///
/// # Safety
/// `base + offsets[lane]` is readable for the size of `T`, in every lane.
#[inline(always)]
pub(crate) unsafe fn gather<T: Copy + Default, O: Offset>(
    base: *const u8,
    offsets: &[O; 16],
    at: usize,
) -> [T; 16] {
    let mut values = [T::default(); LANES];
    for lane in 0..LANES {
        // SAFETY: the caller guarantees that `base + offsets[lane]` is readable for the size of
        // `T`, in every lane.
        values[lane] = unsafe {
            base.add(offsets[lane].bytes() + at)
                .cast::<T>()
                .read_unaligned()
        };
    }
    values
}

/// Units of a byte of each lane's word.
#[inline(always)]
fn byte_units(words: &LaneWords, shift: u32) -> LaneWords {
    map(words, |word| {
        (((word >> shift) & 0xff) as i32 as f32).to_bits()
    })
}

/// The value of one unit of `component`: 1 unless the format is loaded in units of 1/scale.
#[inline(always)]
pub(crate) fn unit_scale(info: &FormatInfo) -> f32 {
    match info.codec {
        Codec::Unorm8(_) | Codec::Bgra8 => 255.0,
        Codec::Unorm16(_) => 65535.0,
        _ => 1.0,
    }
}

/// Loads a texel per lane, in units; components that the format lacks are left zero (see
/// [`finish`]). In compressed formats, offsets are those of [`FormatInfo::texel_offset`].
///
/// # Safety
/// `base + offsets[lane]` is readable for the format's size, in every lane.
#[inline(always)]
pub unsafe fn load<O: Offset>(info: &FormatInfo, base: *const u8, offsets: &[O; 16]) -> Texels {
    let mut texels = [[0; LANES]; 4];
    // SAFETY: each access lies inside the texel that the caller vouches for.
    unsafe {
        match info.codec {
            Codec::Unorm8(4) | Codec::Bgra8 => {
                let words = gather::<u32, O>(base, offsets, 0);
                for (row, channel) in texels.iter_mut().zip(&info.channels) {
                    *row = byte_units(&words, channel.offset as u32);
                }
            }
            Codec::Srgb8Rgba | Codec::Srgb8Bgra => {
                let words = gather::<u32, O>(base, offsets, 0);
                for component in 0..3 {
                    let shift = info.channels[component].offset as u32;
                    texels[component] = map(&words, |word| {
                        srgb::LINEAR.words()[(word >> shift & 0xff) as usize]
                    });
                }
                texels[3] = map(&words, |word| {
                    ((word >> 24) as i32 as f32 / 255.0).to_bits()
                });
            }
            Codec::Words(count) => {
                for component in 0..count as usize {
                    texels[component] = gather::<u32, O>(base, offsets, 4 * component);
                }
            }
            Codec::Half(count) => {
                for component in 0..count as usize {
                    let halves = gather::<u16, O>(base, offsets, 2 * component);
                    texels[component] = map(&halves, |half| half_to_f32(half).to_bits());
                }
            }
            Codec::Unorm16(count) => {
                for component in 0..count as usize {
                    let codes = gather::<u16, O>(base, offsets, 2 * component);
                    texels[component] = map(&codes, |code| (code as i32 as f32).to_bits());
                }
            }
            Codec::Unorm8(count) => {
                for component in 0..count as usize {
                    let codes = gather::<u8, O>(base, offsets, component);
                    texels[component] = map(&codes, |code| (code as i32 as f32).to_bits());
                }
            }
            Codec::Blocks(blocks) => texels = load_blocks(info, blocks, base, offsets),
            Codec::Generic => texels = load_generic(info, base, offsets),
        }
    }
    texels
}

/// # Safety
/// As [`load`].
#[inline(never)]
unsafe fn load_generic<O: Offset>(info: &FormatInfo, base: *const u8, offsets: &[O; 16]) -> Texels {
    let mut texels = [[0; LANES]; 4];
    for lane in 0..LANES {
        // SAFETY: the caller guarantees that `base + offsets[lane]` is readable for the format's
        // size, in every lane.
        let bytes = unsafe {
            std::slice::from_raw_parts(base.add(offsets[lane].bytes()), info.size_bytes as usize)
        };
        let words = info.decode_generic(bytes);
        for (row, word) in texels.iter_mut().zip(words) {
            row[lane] = word;
        }
    }
    texels
}

/// # Safety
/// As [`load`].
#[inline(never)]
unsafe fn load_blocks<O: Offset>(
    info: &FormatInfo,
    blocks: Blocks,
    base: *const u8,
    offsets: &[O; 16],
) -> Texels {
    let mut texels = [[0; LANES]; 4];
    for lane in 0..LANES {
        let (offset, index) = parts(offsets[lane].bytes() as u64);
        // SAFETY: the caller guarantees that `base + offsets[lane]` is readable for the format's
        // size, in every lane.
        let bits = unsafe {
            let block = base.add(offset);
            match info.size_bytes {
                8 => block.cast::<u64>().read_unaligned() as u128,
                _ => block.cast::<u128>().read_unaligned(),
            }
        };
        let words = blocks.texel(bits, index);
        for (row, word) in texels.iter_mut().zip(words) {
            row[lane] = word;
        }
    }
    texels
}

/// A block's offset and a texel's index in it.
fn parts(offset: u64) -> (usize, usize) {
    let index = offset >> BLOCK_INDEX_SHIFT;
    (
        (offset & ((1 << BLOCK_INDEX_SHIFT) - 1)) as usize,
        index as usize,
    )
}

/// Turns units into values and fills components that the format lacks with (0, 0, 0, 1). Not for
/// 64-bit integers.
#[inline(always)]
pub fn finish(info: &FormatInfo, texels: &mut Texels) {
    let scale = unit_scale(info);
    for (component, row) in texels.iter_mut().enumerate() {
        if info.channels[component].bits == 0 {
            *row = [info.missing(component); LANES];
        } else if scale != 1.0 {
            *row = map(row, |units| (f32::from_bits(units) / scale).to_bits());
        }
    }
}

/// Stores a texel in each lane of `mask`, in lane order. Nothing is stored in compressed formats.
///
/// # Safety
/// `base + offsets[lane]` is writable for the format's size, in every lane of `mask`.
pub unsafe fn store(
    info: &FormatInfo,
    base: *mut u8,
    offsets: &Offsets,
    mask: u16,
    texels: &Texels,
) {
    if info.blocks().is_some() {
        return;
    }
    let size = info.size_bytes as usize;
    let store_lane = |lane: usize, bytes: &[u8]| {
        // SAFETY: called for lanes of the mask and with the format's size, for which the caller
        // vouches.
        unsafe {
            let texel = base.add(offsets[lane] as usize);
            std::ptr::copy_nonoverlapping(bytes.as_ptr(), texel, bytes.len());
        }
    };
    match info.codec {
        Codec::Unorm8(4) => {
            let mut words = [0; LANES];
            for (component, row) in texels.iter().enumerate() {
                for lane in 0..LANES {
                    words[lane] |= encode_unorm(row[lane], 8) << (8 * component);
                }
            }
            each_lane(mask, |lane| store_lane(lane, &words[lane].to_le_bytes()));
        }
        Codec::Words(4) => each_lane(mask, |lane| {
            let mut bytes = [0; 16];
            for (component, row) in texels.iter().enumerate() {
                bytes[4 * component..4 * component + 4].copy_from_slice(&row[lane].to_le_bytes());
            }
            store_lane(lane, &bytes);
        }),
        _ => each_lane(mask, |lane| {
            let mut bytes = [0; super::MAX_TEXEL_BYTES];
            info.encode(texels.map(|row| row[lane]), &mut bytes);
            store_lane(lane, &bytes[..size]);
        }),
    }
}

/// Calls `f` with each lane of a mask, lowest first.
#[inline(always)]
pub fn each_lane(mask: u16, mut f: impl FnMut(usize)) {
    let mut rest = mask;
    while rest != 0 {
        f(rest.trailing_zeros() as usize);
        rest &= rest - 1;
    }
}
