//! One texel to four words and back (spec, "Fixed-Point Data Conversions" and "Texel Output Format
//! Conversion").

use lanes::halves;

use super::layout::{Channel, Codec, FormatInfo, Numeric};
use super::{MAX_TEXEL_BYTES, small_float};
use crate::compressed::MAX_BLOCK_BYTES;
use crate::srgb;

/// A block of at most 16 bytes, as a little-endian number.
pub(super) fn block_bits(block: &[u8]) -> u128 {
    let mut bytes = [0; MAX_BLOCK_BYTES];
    bytes[..block.len()].copy_from_slice(block);
    u128::from_le_bytes(bytes)
}

/// Bits of 1.0.
const ONE: u32 = 0x3f80_0000;

impl FormatInfo {
    /// The word of a component that the format lacks: (0, 0, 0, 1).
    #[inline(always)]
    pub const fn missing(&self, component: usize) -> u32 {
        match (component, self.numeric.is_integer()) {
            (3, true) => 1,
            (3, false) => ONE,
            _ => 0,
        }
    }

    /// Texels with a 64-bit component: the words are those of its bits, (r low, r high, g low, g
    /// high).
    pub const fn is_wide(&self) -> bool {
        self.channels[0].bits == 64
    }

    /// A texel as four words, components that the format lacks filled with (0, 0, 0, 1).
    ///
    /// f32 bits or, for integer formats, sign- or zero-extended integers. 64-bit integers are (r
    /// low, r high, g low, g high), 64-bit floats are rounded. `texel` has at least the format's
    /// size. Of a compressed format it is a block, and the texel its first.
    pub fn decode(&self, texel: &[u8]) -> [u32; 4] {
        match self.codec {
            Codec::Blocks(blocks) => {
                blocks.texel(block_bits(&texel[..self.size_bytes as usize]), 0)
            }
            Codec::Unorm8(4) => std::array::from_fn(|i| unorm(texel[i] as u32, 8)),
            Codec::Words(count) => std::array::from_fn(|i| {
                if i < count as usize {
                    u32_at(texel, 4 * i)
                } else {
                    self.missing(i)
                }
            }),
            Codec::Half(count) => std::array::from_fn(|i| {
                if i < count as usize {
                    let half = u16::from_le_bytes([texel[2 * i], texel[2 * i + 1]]);
                    halves::half_to_f32(half).to_bits()
                } else {
                    self.missing(i)
                }
            }),
            _ => self.decode_generic(texel),
        }
    }

    /// [`decode`](Self::decode) from the channels alone.
    pub(super) fn decode_generic(&self, texel: &[u8]) -> [u32; 4] {
        let mut bytes = [0; MAX_TEXEL_BYTES];
        bytes[..self.size_bytes as usize].copy_from_slice(&texel[..self.size_bytes as usize]);
        if self.is_wide() && self.numeric.is_integer() {
            let low_words = std::array::from_fn(|i| u32_at(&bytes, 4 * i));
            return low_words;
        }
        if self.numeric == Numeric::Ufloat && self.channels[0].bits == 9 {
            let [r, g, b] = small_float::shared_exponent_to_f32(u32_at(&bytes, 0));
            return [r.to_bits(), g.to_bits(), b.to_bits(), ONE];
        }
        std::array::from_fn(|i| match self.channels[i] {
            Channel { bits: 0, .. } => self.missing(i),
            channel => decode_channel(
                extract(&bytes, channel),
                channel.bits as u32,
                self.numeric,
                i,
            ),
        })
    }

    /// Four words as a texel; components that the format lacks are ignored. Normalised
    /// values are clamped and rounded to nearest even with NaN giving 0, integers saturate.
    /// Unused bits become 0. `texel` has at least the format's size. Nothing encodes
    /// compressed formats: their blocks become zeros.
    pub fn encode(&self, words: [u32; 4], texel: &mut [u8]) {
        let size = self.size_bytes as usize;
        match self.codec {
            Codec::Words(count) => {
                for (i, word) in words[..count as usize].iter().enumerate() {
                    texel[4 * i..4 * i + 4].copy_from_slice(&word.to_le_bytes());
                }
            }
            Codec::Blocks(_) => texel[..size].fill(0),
            Codec::Unorm8(count) => {
                for i in 0..count as usize {
                    texel[i] = encode_unorm(words[i], 8) as u8;
                }
            }
            Codec::Half(count) => {
                for i in 0..count as usize {
                    let half = halves::f32_to_half(f32::from_bits(words[i]));
                    texel[2 * i..2 * i + 2].copy_from_slice(&half.to_le_bytes());
                }
            }
            _ => texel[..size].copy_from_slice(&self.encode_generic(words)[..size]),
        }
    }

    /// [`encode`](Self::encode) from the channels alone.
    pub(super) fn encode_generic(&self, words: [u32; 4]) -> [u8; MAX_TEXEL_BYTES] {
        let mut bytes = [0; MAX_TEXEL_BYTES];
        if self.is_wide() && self.numeric.is_integer() {
            for (i, word) in words.iter().enumerate() {
                bytes[4 * i..4 * i + 4].copy_from_slice(&word.to_le_bytes());
            }
            // Components that the format lacks lie past its size.
            return bytes;
        }
        if self.numeric == Numeric::Ufloat && self.channels[0].bits == 9 {
            let rgb = [0, 1, 2].map(|i| f32::from_bits(words[i]));
            let word = small_float::f32_to_shared_exponent(rgb);
            bytes[..4].copy_from_slice(&word.to_le_bytes());
            return bytes;
        }
        for (i, channel) in self.channels.iter().enumerate() {
            if channel.bits != 0 {
                let bits = encode_channel(words[i], channel.bits as u32, self.numeric, i);
                insert(&mut bytes, *channel, bits);
            }
        }
        bytes
    }
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

/// The bits of a channel; wider than 32 bits only in whole 64-bit words.
fn extract(bytes: &[u8; MAX_TEXEL_BYTES], channel: Channel) -> u64 {
    let first = channel.offset as usize / 8;
    let mut word = [0; 8];
    let available = (MAX_TEXEL_BYTES - first).min(8);
    word[..available].copy_from_slice(&bytes[first..first + available]);
    let mask = u64::MAX >> (64 - channel.bits as u32);
    u64::from_le_bytes(word) >> (channel.offset % 8) & mask
}

fn insert(bytes: &mut [u8; MAX_TEXEL_BYTES], channel: Channel, bits: u64) {
    let first = channel.offset as usize / 8;
    let shifted = bits << (channel.offset % 8);
    for (byte, part) in bytes[first..].iter_mut().zip(shifted.to_le_bytes()) {
        *byte |= part;
    }
}

/// c / (2^bits - 1), correctly rounded: both are exact in f32 up to 24 bits.
#[inline(always)]
fn unorm(c: u32, bits: u32) -> u32 {
    (c as f32 / ((1u32 << bits) - 1) as f32).to_bits()
}

fn sign_extend(c: u64, bits: u32) -> i64 {
    (c << (64 - bits)) as i64 >> (64 - bits)
}

fn decode_channel(c: u64, bits: u32, numeric: Numeric, component: usize) -> u32 {
    match numeric {
        Numeric::Unorm => unorm(c as u32, bits),
        Numeric::Srgb if component == 3 => unorm(c as u32, bits),
        Numeric::Srgb => srgb::decode(c as u8).to_bits(),
        Numeric::Snorm => {
            let scale = ((1u32 << (bits - 1)) - 1) as f32;
            (sign_extend(c, bits) as f32 / scale).max(-1.0).to_bits()
        }
        Numeric::Uscaled => (c as f32).to_bits(),
        Numeric::Sscaled => (sign_extend(c, bits) as f32).to_bits(),
        Numeric::Uint => c as u32,
        Numeric::Sint => sign_extend(c, bits) as u32,
        Numeric::Ufloat => small_float::ufloat_to_f32(c as u32, bits - 5).to_bits(),
        Numeric::Sfloat => match bits {
            16 => halves::half_to_f32(c as u16).to_bits(),
            32 => c as u32,
            _ => (f64::from_bits(c) as f32).to_bits(),
        },
    }
}

/// Products of an f32 and a scale of up to 24 bits are exact in f64, so there is one rounding.
#[inline(always)]
fn round_scaled(word: u32, low: f64, scale: f64) -> i64 {
    let value = f32::from_bits(word) as f64;
    // A NaN fails both comparisons, and the cast turns it into 0.
    let clamped = if value < low {
        low
    } else if value > 1.0 {
        1.0
    } else {
        value
    };
    (clamped * scale).round_ties_even() as i64
}

#[inline(always)]
pub(super) fn encode_unorm(word: u32, bits: u32) -> u32 {
    round_scaled(word, 0.0, ((1u64 << bits) - 1) as f64) as u32
}

fn encode_channel(word: u32, bits: u32, numeric: Numeric, component: usize) -> u64 {
    let mask = u64::MAX >> (64 - bits);
    match numeric {
        Numeric::Unorm => encode_unorm(word, bits) as u64,
        Numeric::Srgb if component == 3 => encode_unorm(word, bits) as u64,
        Numeric::Srgb => srgb::encode(f32::from_bits(word)) as u64,
        Numeric::Snorm => round_scaled(word, -1.0, ((1u64 << (bits - 1)) - 1) as f64) as u64 & mask,
        Numeric::Uscaled => (f32::from_bits(word).round_ties_even() as u64).min(mask),
        Numeric::Sscaled => {
            let limit = (mask >> 1) as i64;
            (f32::from_bits(word).round_ties_even() as i64).clamp(-limit - 1, limit) as u64 & mask
        }
        Numeric::Uint => (word as u64).min(mask),
        Numeric::Sint => {
            let limit = (mask >> 1) as i64;
            (word as i32 as i64).clamp(-limit - 1, limit) as u64 & mask
        }
        Numeric::Ufloat => small_float::f32_to_ufloat(f32::from_bits(word), bits - 5) as u64,
        Numeric::Sfloat => match bits {
            16 => halves::f32_to_half(f32::from_bits(word)) as u64,
            32 => word as u64,
            _ => (f32::from_bits(word) as f64).to_bits(),
        },
    }
}
