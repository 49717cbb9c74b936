//! Levels of half the size, as chains of mip levels are made: each texel the mean of the four that
//! it covers, which is what linear filtering gives in the middle between them.

use super::format::FormatInfo;
use super::format::layout::Codec;
use super::srgb;

/// Texels that are computed together.
const BLOCK: usize = 16;
/// Every other byte of a texel.
const BYTES: u32 = 0x00ff_00ff;

/// Halves rows of texels of a format.
#[derive(Clone, Copy)]
pub struct Halving {
    is_srgb: bool,
}

impl Halving {
    /// For formats of four components of 8 bits, unorm or sRGB.
    pub fn new(info: &FormatInfo) -> Option<Halving> {
        let is_srgb = match info.codec {
            Codec::Unorm8(4) | Codec::Bgra8 => false,
            Codec::Srgb8Rgba | Codec::Srgb8Bgra => true,
            _ => return None,
        };
        Some(Halving { is_srgb })
    }

    /// Texels `0..count` of `to` from twice as many of each of the two rows.
    ///
    /// # Safety
    /// All of them are in memory; `to` is apart from the rows.
    pub unsafe fn row(self, rows: [*const u8; 2], to: *mut u8, count: usize) {
        // SAFETY: the caller guarantees that all texels are in memory, and `to` is apart from the
        // rows.
        unsafe {
            match self.is_srgb {
                false => row::<false>(rows, to, count),
                true => row::<true>(rows, to, count),
            }
        }
    }
}

/// # Safety
/// As for [`Halving::row`].
#[inline(always)]
unsafe fn row<const IS_SRGB: bool>(rows: [*const u8; 2], to: *mut u8, count: usize) {
    let rows = rows.map(|row| row.cast::<[[u32; 2]; BLOCK]>());
    let to = to.cast::<[u32; BLOCK]>();
    // SAFETY: the caller guarantees that all texels are in memory, and `to` is apart from the rows.
    unsafe {
        for block in 0..count / BLOCK {
            let [upper, lower] = rows.map(|row| row.add(block).read_unaligned());
            // No closure: calls of it would not always be inlined.
            let mut means = [0; BLOCK];
            for i in 0..BLOCK {
                means[i] = mean_in::<IS_SRGB>([upper[i], lower[i]]);
            }
            to.add(block).write_unaligned(means);
        }
        for i in count / BLOCK * BLOCK..count {
            let four = rows.map(|row| row.cast::<[u32; 2]>().add(i).read_unaligned());
            to.cast::<u32>()
                .add(i)
                .write_unaligned(mean_in::<IS_SRGB>(four));
        }
    }
}

/// The mean of two by two texels, unorm or sRGB.
#[inline(always)]
fn mean_in<const IS_SRGB: bool>(texels: [[u32; 2]; 2]) -> u32 {
    match IS_SRGB {
        false => mean(texels),
        true => linear_mean(texels),
    }
}

/// The mean of two by two texels, from two rows of two each; numbers halfway between two codes
/// become the even one.
#[inline(always)]
fn mean([[a, b], [c, d]]: [[u32; 2]; 2]) -> u32 {
    // Two sums of bytes in each word.
    let quarter = |shift: u32| {
        let bytes = |texel: u32| texel >> shift & BYTES;
        let sum = bytes(a) + bytes(b) + bytes(c) + bytes(d);
        (sum + 0x0001_0001 + (sum >> 2 & 0x0001_0001)) >> 2 & BYTES
    };
    quarter(0) | quarter(8) << 8
}

/// [`mean`] of the linear values of R, G and B.
#[inline(always)]
fn linear_mean(texels: [[u32; 2]; 2]) -> u32 {
    let [[a, b], [c, d]] = texels;
    let linear = |texel: u32, shift: u32| srgb::decode((texel >> shift) as u8);
    let code = |shift: u32| {
        let sum = (linear(a, shift) + linear(b, shift)) + (linear(c, shift) + linear(d, shift));
        u32::from(srgb::encode(0.25 * sum)) << shift
    };
    code(0) | code(8) | code(16) | mean(texels) & 0xff00_0000
}
