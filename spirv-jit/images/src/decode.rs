//! Texels' words to numbers, in vectors: which way a format goes, and the ways.
//!
//! Here, too, there are no closures over vectors: those would not be compiled for the vectors'
//! instruction set.

use lanes::vector::Vector;

use super::compressed::Scheme;
use super::format::block;
use super::format::layout::{Codec, FormatInfo, Numeric};
use super::srgb;

/// The way from the words of texels to words that are weighted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Decoder {
    /// Fields of fewer than 32 bits, fixed-point numbers and integers.
    Fields,
    /// 16-bit floats, and those of 11 and 10 bits without a sign.
    Halves,
    /// The words are the numbers.
    Words,
    /// Bytes, of which colours are looked up.
    Srgb,
    /// Becomes a word a component first ([`expand`]), as the two kinds of blocks.
    SharedExponent,
    /// BC1, BC2 and BC3.
    Colors,
    /// BC4 and BC5.
    Ramps,
    /// Lane by lane: other blocks, by a cache, and components of 64 bits.
    Each,
}

impl Decoder {
    /// Whether texels are decoded to a word a component before one is looked at.
    pub(super) fn is_expanded(self) -> bool {
        matches!(
            self,
            Decoder::SharedExponent | Decoder::Colors | Decoder::Ramps
        )
    }

    pub(super) fn of(info: &FormatInfo) -> Decoder {
        if let Codec::Blocks(blocks) = info.codec {
            return match blocks.scheme {
                Scheme::Bc1Rgb | Scheme::Bc1Rgba | Scheme::Bc2 | Scheme::Bc3 => Decoder::Colors,
                Scheme::Bc4 | Scheme::Bc4Signed | Scheme::Bc5 | Scheme::Bc5Signed => Decoder::Ramps,
                _ => Decoder::Each,
            };
        }
        let bits = info.channels.iter().map(|channel| channel.bits).max();
        match (info.numeric, bits) {
            (_, Some(64)) => Decoder::Each,
            (_, Some(32)) => Decoder::Words,
            (Numeric::Srgb, _) => Decoder::Srgb,
            (Numeric::Ufloat, Some(9)) => Decoder::SharedExponent,
            (Numeric::Ufloat | Numeric::Sfloat, _) => Decoder::Halves,
            _ => Decoder::Fields,
        }
    }
}

/// A divisor and the parts of its reciprocal, by which a quotient takes a product and a fused
/// multiply-add.
#[derive(Clone, Copy)]
struct Divisor {
    divisor: f32,
    high: f32,
    low: f32,
}

impl Divisor {
    const fn new(divisor: f32) -> Divisor {
        let high = 1.0 / divisor;
        Divisor {
            divisor,
            high,
            low: (1.0 / divisor as f64 - high as f64) as f32,
        }
    }

    #[inline(always)]
    fn quotient<V: Vector>(&self, v: V, a: V::F) -> V::F {
        let [divisor, high, low] = [v.splat(self.divisor), v.splat(self.high), v.splat(self.low)];
        v.quotient(a, divisor, high, low)
    }
}

/// By bits of a code: its greatest value. The quotients of all codes are rounded correctly.
static CODES: [Divisor; 25] = {
    let mut divisors = [Divisor::new(1.0); 25];
    let mut bits = 1;
    while bits < 25 {
        divisors[bits] = Divisor::new(((1u32 << bits) - 1) as f32);
        bits += 1;
    }
    divisors
};

/// A code of up to 24 bits over its greatest value; a code with a sign has one bit more.
#[inline(always)]
pub fn quotient_of_code<V: Vector>(v: V, code: V::F, bits: u8) -> V::F {
    CODES[usize::from(bits) % CODES.len()].quotient(v, code)
}

/// Sixteen divisors, of which a lane's index picks one.
struct Divisors {
    divisor: [f32; 16],
    high: [f32; 16],
    low: [f32; 16],
}

impl Divisors {
    const fn new(divisor: [f32; 16]) -> Divisors {
        let mut divisors = Divisors {
            divisor,
            high: [0.0; 16],
            low: [0.0; 16],
        };
        let mut index = 0;
        while index < 16 {
            let of_one = Divisor::new(divisor[index]);
            divisors.high[index] = of_one.high;
            divisors.low[index] = of_one.low;
            index += 1;
        }
        divisors
    }

    #[inline(always)]
    fn quotient<V: Vector>(&self, v: V, a: V::F, index: V::I) -> V::F {
        let divisor = v.table(&self.divisor, index);
        let high = v.table(&self.high, index);
        let low = v.table(&self.low, index);
        v.quotient(a, divisor, high, low)
    }
}

/// How a component is read from the word that it stands in. Small: it is found anew for each chunk.
#[derive(Clone, Copy)]
pub(super) struct Field {
    /// The number of the word.
    pub word: u8,
    shift: u8,
    bits: u8,
    /// The bits of the greatest code by which codes are divided; 0 if they are not.
    divided: u8,
    is_signed: bool,
    pub is_integer: bool,
}

impl Field {
    /// Of a component that the format has, of up to 24 bits: to its value, or to units (see
    /// [`block`]).
    pub(super) fn of(info: &FormatInfo, component: usize, is_value: bool) -> Field {
        let channel = info.channels[component];
        Field {
            word: channel.offset / 32,
            shift: channel.offset % 32,
            bits: channel.bits,
            divided: match info.numeric {
                Numeric::Unorm if is_value || block::unit_scale(info) == 1.0 => channel.bits,
                Numeric::Srgb if is_value => channel.bits,
                Numeric::Snorm => channel.bits - 1,
                _ => 0,
            },
            is_signed: matches!(
                info.numeric,
                Numeric::Snorm | Numeric::Sscaled | Numeric::Sint
            ),
            is_integer: info.numeric.is_integer(),
        }
    }

    /// The code, with zeros or with signs.
    #[inline(always)]
    pub(super) fn code<V: Vector>(&self, v: V, word: V::I) -> V::I {
        let (shift, down) = (u32::from(self.shift), 32 - u32::from(self.bits));
        match self.is_signed {
            true => v.right_i(v.left_i(word, down.wrapping_sub(shift) & 31), down & 31),
            false => v.and_i(
                v.right_u(word, shift),
                v.splat_i((u32::MAX >> (down & 31)) as i32),
            ),
        }
    }

    #[inline(always)]
    fn quotient<V: Vector>(&self, v: V, code: V::F) -> V::F {
        CODES[usize::from(self.divided) % CODES.len()].quotient(v, code)
    }

    /// Whether the number of [`Self::fixed`] is the code, which has no sign.
    #[inline(always)]
    pub(super) fn is_code(&self) -> bool {
        !self.is_integer && !self.is_signed && self.divided <= 1
    }

    /// Whether [`Self::unsigned`] serves.
    #[inline(always)]
    pub(super) fn is_unsigned(&self) -> bool {
        !self.is_integer && !self.is_signed
    }

    /// As [`Self::fixed`], of a code without a sign over its greatest value.
    #[inline(always)]
    pub(super) fn unsigned<V: Vector>(&self, v: V, word: V::I) -> V::F {
        self.quotient(v, v.to_f(self.code(v, word)))
    }

    /// For [`Decoder::Fields`].
    #[inline(always)]
    pub(super) fn fixed<V: Vector>(&self, v: V, word: V::I) -> V::F {
        let code = self.code(v, word);
        if self.is_integer {
            return v.bits_to_f(code);
        }
        let number = self.quotient(v, v.to_f(code));
        // The least code of SNORM is -1, too.
        let is_snorm = self.is_signed && self.divided != 0;
        v.max(number, v.splat(if is_snorm { -1.0 } else { f32::MIN }))
    }

    /// For [`Decoder::Halves`]; signalling NaNs stay so if numbers are taken as they are.
    #[inline(always)]
    pub(super) fn half<V: Vector>(&self, v: V, word: V::I, as_it_is: bool) -> V::F {
        let half = v.left_i(self.code(v, word), 15u32.saturating_sub(self.bits.into()));
        match as_it_is {
            true => v.half_to_f(half),
            false => v.quiet_half_to_f(half),
        }
    }
}

/// The words of a texel, and in a compressed format the texel's index in its block, to numbers' in
/// the order of the components; those that the format lacks are anything.
#[inline(always)]
pub(super) fn expand<V: Vector>(
    v: V,
    info: &FormatInfo,
    decoder: Decoder,
    words: [V::I; 4],
    index: V::I,
) -> [V::F; 4] {
    match decoder {
        Decoder::SharedExponent => {
            // The power of two is a normal number: products are exact.
            let exponent = v.add_i(v.right_u(words[0], 27), v.splat_i(127 - 15 - 9));
            let power = v.bits_to_f(v.left_i(exponent, 23));
            let low = v.splat_i(0x1ff);
            let red = v.to_f(v.and_i(words[0], low));
            let green = v.to_f(v.and_i(v.right_u(words[0], 9), low));
            let blue = v.to_f(v.and_i(v.right_u(words[0], 18), low));
            [
                v.mul(red, power),
                v.mul(green, power),
                v.mul(blue, power),
                power,
            ]
        }
        Decoder::Colors => colors(v, info, words, index),
        _ => {
            let is_signed = info.numeric == Numeric::Snorm;
            let red = ramp(v, [words[0], words[1]], index, is_signed);
            let green = match info.channels[1].bits {
                0 => red,
                _ => ramp(v, [words[2], words[3]], index, is_signed),
            };
            [red, green, red, red]
        }
    }
}

/// The parts of both ends, by the index of a texel's colour; with 8 on top in blocks of three
/// colours, the last of which is black.
static OF_COLORS: [[f32; 16]; 2] = [
    [
        1., 0., 2., 1., 0., 0., 0., 0., 1., 0., 1., 0., 0., 0., 0., 0.,
    ],
    [
        0., 1., 1., 2., 0., 0., 0., 0., 0., 1., 1., 0., 0., 0., 0., 0.,
    ],
];
/// Their sums, or 1.
static COLOR_PARTS: Divisors = Divisors::new([
    1., 1., 3., 3., 1., 1., 1., 1., 1., 1., 2., 1., 1., 1., 1., 1.,
]);

/// The same of the values between two bytes; with 8 on top where there are six. The last two of
/// eight are a least and a greatest value.
static OF_RAMPS: [[f32; 16]; 2] = [
    [
        1., 0., 6., 5., 4., 3., 2., 1., 1., 0., 4., 3., 2., 1., 0., 0.,
    ],
    [
        0., 1., 1., 2., 3., 4., 5., 6., 0., 1., 1., 2., 3., 4., 0., 0.,
    ],
];
static RAMP_PARTS: Divisors = Divisors::new([
    1., 1., 7., 7., 7., 7., 7., 7., 1., 1., 5., 5., 5., 5., 1., 1.,
]);
/// The addend of that, of signed and of other bytes.
static ENDS: [[f32; 16]; 2] = {
    let mut ends = [[0.0; 16]; 2];
    ends[0][15] = 1.0;
    ends[1][15] = 1.0;
    ends[1][14] = -1.0;
    ends
};

/// A texel of BC1, BC2 or BC3 by the block's words.
#[inline(always)]
fn colors<V: Vector>(v: V, info: &FormatInfo, words: [V::I; 4], index: V::I) -> [V::F; 4] {
    let scheme = info.blocks().map(|blocks| blocks.scheme);
    let has_alpha = matches!(scheme, Some(Scheme::Bc2 | Scheme::Bc3));
    let (ends, indices) = match has_alpha {
        true => (words[2], words[3]),
        false => (words[0], words[1]),
    };
    let shifted = v.right_each(indices, v.left_i(index, 1));
    let mut which = v.and_i(shifted, v.splat_i(3));
    let first = v.and_i(ends, v.splat_i(0xffff));
    let second = v.right_u(ends, 16);
    if !has_alpha {
        // Four colours if the first end is the greater code.
        let is_four = v.sign_i(v.sub_i(second, first));
        let three = v.and_i(v.xor_i(is_four, v.splat_i(-1)), v.splat_i(8));
        which = v.or_i(which, three);
    }
    let parts = [v.table(&OF_COLORS[0], which), v.table(&OF_COLORS[1], which)];
    let mut texel = [v.splat(1.0); 4];
    for (component, (shift, bits)) in [(11, 5), (5, 6), (0, 5)].into_iter().enumerate() {
        let low = v.splat_i((1 << bits) - 1);
        let codes = [
            v.and_i(v.right_u(first, shift), low),
            v.and_i(v.right_u(second, shift), low),
        ];
        let divisor = &CODES[bits as usize];
        let a = divisor.quotient(v, v.to_f(codes[0]));
        let b = divisor.quotient(v, v.to_f(codes[1]));
        let sum = v.add(v.mul(parts[0], a), v.mul(parts[1], b));
        let color = COLOR_PARTS.quotient(v, sum, which);
        texel[component] = match info.numeric {
            Numeric::Srgb => {
                let code = v.to_i(v.round_ties_even(v.mul(color, v.splat(255.0))));
                let at = v.left_i(code, 2);
                // SAFETY: the table has an entry for every byte.
                v.bits_to_f(unsafe { v.gather(srgb::LINEAR.words().as_ptr().cast(), at) })
            }
            _ => color,
        };
    }
    texel[3] = match scheme {
        Some(Scheme::Bc1Rgba) => {
            let opaque = v.ne_i(which, v.splat_i(8 + 3));
            v.bits_to_f(v.keep(v.bits_of(texel[3]), opaque))
        }
        Some(Scheme::Bc2) => {
            let is_upper = !v.lt_u(index, v.splat_i(8));
            let word = v.select(is_upper, words[1], words[0]);
            let shift = v.left_i(v.and_i(index, v.splat_i(7)), 2);
            let code = v.and_i(v.right_each(word, shift), v.splat_i(15));
            CODES[4].quotient(v, v.to_f(code))
        }
        Some(Scheme::Bc3) => ramp(v, [words[0], words[1]], index, false),
        _ => texel[3],
    };
    texel
}

/// A texel's value of a block of one component.
#[inline(always)]
fn ramp<V: Vector>(v: V, [low, high]: [V::I; 2], index: V::I, is_signed: bool) -> V::F {
    // Three bits from 16 + 3 index on, which may lie in both words.
    let triple = v.add_i(index, v.left_i(index, 1));
    let at = v.add_i(triple, v.splat_i(16));
    let behind = v.sub_i(at, v.splat_i(32));
    let ahead = v.sub_i(v.splat_i(32), at);
    let in_high = v.or_i(v.left_each(high, ahead), v.right_each(high, behind));
    let bits = v.or_i(v.right_each(low, at), in_high);
    let which = v.and_i(bits, v.splat_i(7));
    let (mut first, mut second) = (v.left_i(low, 24), v.left_i(low, 16));
    let divisor;
    if is_signed {
        (first, second) = (v.right_i(first, 24), v.right_i(second, 24));
        divisor = &CODES[7];
    } else {
        (first, second) = (v.right_u(first, 24), v.right_u(second, 24));
        divisor = &CODES[8];
    }
    let is_eight = v.sign_i(v.sub_i(second, first));
    let six = v.and_i(v.xor_i(is_eight, v.splat_i(-1)), v.splat_i(8));
    let which = v.or_i(which, six);
    // -128 is -1, too.
    let least = v.splat_i(-127);
    let a = divisor.quotient(v, v.to_f(v.max_i(first, least)));
    let b = divisor.quotient(v, v.to_f(v.max_i(second, least)));
    let parts = [v.table(&OF_RAMPS[0], which), v.table(&OF_RAMPS[1], which)];
    let sum = v.add(v.mul(parts[0], a), v.mul(parts[1], b));
    let between = RAMP_PARTS.quotient(v, sum, which);
    v.add(between, v.table(&ENDS[is_signed as usize], which))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The quotient as tiers with fused multiply-adds compute it.
    fn fused(a: f32, high: f32, low: f32) -> f32 {
        a.mul_add(high, a * low)
    }

    #[test]
    fn quotients_of_all_codes_are_rounded_correctly() {
        for (bits, by) in CODES.iter().enumerate() {
            // All numbers of up to 16 bits; of more, one in a prime.
            let step = if bits > 16 { 61 } else { 1 };
            for code in (0..1u32 << bits).step_by(step) {
                let code = code as f32;
                let quotient = fused(code, by.high, by.low);
                assert_eq!(quotient, code / by.divisor, "{code} of {bits} bits");
            }
        }
    }

    fn all_between(parts: &[[f32; 16]; 2], by: &Divisors, a: f32, b: f32) {
        for index in 0..16 {
            let sum = parts[0][index] * a + parts[1][index] * b;
            let quotient = fused(sum, by.high[index], by.low[index]);
            assert_eq!(quotient, sum / by.divisor[index], "{index} of {a} and {b}");
        }
    }

    #[test]
    fn quotients_of_blocks_are_rounded_correctly() {
        for most in [31, 63] {
            for (a, b) in (0..=most).flat_map(|a| (0..=most).map(move |b| (a, b))) {
                let of = |code: i32| code as f32 / most as f32;
                all_between(&OF_COLORS, &COLOR_PARTS, of(a), of(b));
            }
        }
        for (least, most) in [(0, 255), (-127, 127)] {
            for (a, b) in (least..=most).flat_map(|a| (least..=most).map(move |b| (a, b))) {
                let of = |code: i32| code as f32 / most as f32;
                all_between(&OF_RAMPS, &RAMP_PARTS, of(a), of(b));
            }
        }
    }
}
