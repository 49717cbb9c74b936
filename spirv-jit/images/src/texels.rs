//! Texels of sixteen lanes in vectors of the machine: encoded and stored, loaded and decoded.
//! Produces the same bits as [`FormatInfo::encode`] and [`FormatInfo::decode`], which define them.
//!
//! Here, too, there are no closures over vectors: those would not be compiled for the vectors'
//! instruction set.

use lanes::vector::{QUADS, Vector};
use lanes::{LANES, Tier, map};

pub use super::decode::quotient_of_code;
use super::format::block::{self, Texels};
use super::format::layout::{Channel, Codec, FormatInfo, Numeric};
use super::srgb;

/// From the exponent of E5B9G9R9, whose bias is 15 and whose mantissas are integers of 9 bits, to
/// that of a 32-bit float.
const SHARED_EXPONENT_BIAS: i32 = 127 - 15 - 9;

/// The bits of a component whose lowest bit is the word's.
#[inline(always)]
fn all_ones(bits: u8) -> i32 {
    (u32::MAX >> (32 - bits as u32)) as i32
}

/// The texels' 32-bit words; what lies behind the format's size is zero.
#[inline(always)]
fn encode<V: Vector>(v: V, info: &FormatInfo, texels: &[V::I; 4]) -> [V::I; 4] {
    let none = v.splat_i(0);
    let [r, g, b, a] = *texels;
    match info.codec {
        Codec::Unorm8(4) => [bytes(v, [r, g, b, a]), none, none, none],
        Codec::Bgra8 => [bytes(v, [b, g, r, a]), none, none, none],
        Codec::Half(4) => [halves(v, r, g), halves(v, b, a), none, none],
        Codec::Half(2) => [halves(v, r, g), none, none, none],
        Codec::Words(4) => [r, g, b, a],
        Codec::Words(2) => [r, g, none, none],
        Codec::Words(1) => [r, none, none, none],
        _ => encode_channels(v, info, texels),
    }
}

/// Four numbers as bytes, the first one lowest.
#[inline(always)]
fn bytes<V: Vector>(v: V, components: [V::I; 4]) -> V::I {
    let low = v.or_i(byte(v, components[0], 0), byte(v, components[1], 8));
    let high = v.or_i(byte(v, components[2], 16), byte(v, components[3], 24));
    v.or_i(low, high)
}

/// A number as a byte, at a place in its word.
#[inline(always)]
fn byte<V: Vector>(v: V, component: V::I, shift: u32) -> V::I {
    let number = v.max(v.bits_to_f(component), v.splat(0.0));
    v.left_i(v.scaled(v.min(number, v.splat(1.0)), 255.0), shift)
}

/// Two numbers as 16-bit floats, the first one lowest.
#[inline(always)]
fn halves<V: Vector>(v: V, low: V::I, high: V::I) -> V::I {
    let high = v.left_i(v.to_half(v.bits_to_f(high)), 16);
    v.or_i(v.to_half(v.bits_to_f(low)), high)
}

/// [`encode`] of any format for vectors, channel by channel.
#[inline(always)]
fn encode_channels<V: Vector>(v: V, info: &FormatInfo, texels: &[V::I; 4]) -> [V::I; 4] {
    let mut words = [v.splat_i(0); 4];
    for (component, channel) in info.channels.iter().enumerate() {
        if channel.bits == 0 {
            continue;
        }
        let (word, shift) = (channel.offset / 32, channel.offset % 32);
        let code = encode_component(v, info.numeric, *channel, component, texels[component]);
        let code = v.left_i(code, shift as u32);
        // By constant indices: words stay in registers.
        match word {
            0 => words[0] = v.or_i(words[0], code),
            1 => words[1] = v.or_i(words[1], code),
            2 => words[2] = v.or_i(words[2], code),
            _ => words[3] = v.or_i(words[3], code),
        }
    }
    words
}

#[inline(always)]
fn encode_component<V: Vector>(
    v: V,
    numeric: Numeric,
    channel: Channel,
    component: usize,
    word: V::I,
) -> V::I {
    let bits = channel.bits;
    let ones = all_ones(bits);
    if bits == 32 {
        return word;
    }
    let number = v.bits_to_f(word);
    let limit = v.splat_i(ones >> 1);
    match numeric {
        Numeric::Srgb if component != 3 => encode_srgb(v, number),
        Numeric::Unorm | Numeric::Srgb => {
            let number = v.min(v.max(number, v.splat(0.0)), v.splat(1.0));
            v.scaled(number, ones as f32)
        }
        Numeric::Snorm => {
            let number = v.min(v.max(or_zero(v, number), v.splat(-1.0)), v.splat(1.0));
            v.and_i(v.scaled(number, (ones >> 1) as f32), v.splat_i(ones))
        }
        Numeric::Uscaled => {
            let number = v.min(v.max(number, v.splat(0.0)), v.splat(ones as f32));
            v.scaled(number, 1.0)
        }
        Numeric::Sscaled => {
            let (low, high) = (-(ones >> 1) - 1, ones >> 1);
            let number = v.max(or_zero(v, number), v.splat(low as f32));
            let code = v.scaled(v.min(number, v.splat(high as f32)), 1.0);
            v.and_i(code, v.splat_i(ones))
        }
        Numeric::Uint => v.min_u(word, v.splat_i(ones)),
        Numeric::Sint => {
            let least = v.splat_i(-(ones >> 1) - 1);
            v.and_i(v.max_i(v.min_i(word, limit), least), v.splat_i(ones))
        }
        Numeric::Sfloat => v.to_half(number),
        Numeric::Ufloat => encode_ufloat(v, number, bits as u32 - 5),
    }
}

/// A NaN becomes zero.
#[inline(always)]
fn or_zero<V: Vector>(v: V, number: V::F) -> V::F {
    let bits = v.bits_of(number);
    let magnitude = v.and_i(bits, v.splat_i(i32::MAX));
    // Negative where the magnitude is more than infinity's.
    let is_nan = v.sign_i(v.sub_i(v.splat_i(f32::INFINITY.to_bits() as i32), magnitude));
    v.bits_to_f(v.and_i(bits, v.xor_i(is_nan, v.splat_i(-1))))
}

/// sRGB codes, by [`srgb::PIECE`].
#[inline(always)]
fn encode_srgb<V: Vector>(v: V, number: V::F) -> V::I {
    let least = v.splat(f32::from_bits(srgb::FIRST));
    let bits = v.bits_of(v.min(v.max(number, least), v.splat(1.0)));
    let piece = v.right_u(
        v.sub_i(bits, v.splat_i(srgb::FIRST as i32)),
        srgb::REST_BITS,
    );
    // SAFETY: the numbers between the bounds have pieces.
    let entry = unsafe { v.gather(srgb::PIECE.as_ptr().cast(), v.left_i(piece, 2)) };
    let open = (1 << srgb::REST_BITS) - 1;
    let threshold = v.and_i(entry, v.splat_i(2 * open + 1));
    let rest = v.and_i(bits, v.splat_i(open));
    // -1 below the threshold.
    let below = v.sign_i(v.sub_i(rest, threshold));
    let code = v.right_u(entry, srgb::REST_BITS + 1);
    v.add_i(code, v.add_i(below, v.splat_i(1)))
}

/// Floats of 5 exponent bits without a sign.
#[inline(always)]
fn encode_ufloat<V: Vector>(v: V, number: V::F, mantissa: u32) -> V::I {
    let infinity = 31 << mantissa;
    // Negative numbers become zero, NaN too.
    let positive = v.max(number, v.splat(0.0));
    let bits = v.bits_of(positive);
    // Subnormals are multiples of 2^(-14 - mantissa); the least normal number comes out of rounding
    // as itself.
    let least = f32::from_bits(113 << 23);
    let step = f32::from_bits((127 + 14 + mantissa) << 23);
    let small = v.scaled(v.min(positive, v.splat(least)), step);
    // A normal number's exponent loses its bias, its mantissa is rounded to even; what carries
    // moves on to the next exponent.
    let dropped = 23 - mantissa;
    let even = v.and_i(v.right_u(bits, dropped), v.splat_i(1));
    let rebiased = v.sub_i(bits, v.splat_i(112 << 23));
    let half = v.add_i(v.splat_i((1 << (dropped - 1)) - 1), even);
    let large = v.right_u(v.add_i(rebiased, half), dropped);
    let large = v.min_u(large, v.splat_i(infinity - 1));
    let is_small = v.sign_i(v.sub_i(bits, v.splat_i(113 << 23)));
    let code = v.xor_i(large, v.and_i(v.xor_i(large, small), is_small));
    // Infinity and NaN are all there is from infinity's bits on.
    let top = v.splat_i(f32::INFINITY.to_bits() as i32);
    let magnitude = v.and_i(v.bits_of(number), v.splat_i(i32::MAX));
    let is_nan = v.sign_i(v.sub_i(top, magnitude));
    let is_infinite = v.xor_i(v.sign_i(v.sub_i(bits, top)), v.splat_i(-1));
    let code = v.xor_i(
        code,
        v.and_i(v.xor_i(code, v.splat_i(infinity)), is_infinite),
    );
    v.xor_i(
        code,
        v.and_i(v.xor_i(code, v.splat_i(infinity | 1)), is_nan),
    )
}

/// Components from the texels' words. With `units`, those of normalised formats are left as they
/// are before the division, where [`block::unit_scale`] is not 1. Components that the format lacks
/// are left zero.
#[inline(always)]
pub(super) fn decode<V: Vector>(v: V, info: &FormatInfo, words: &[V::I; 4]) -> [V::I; 4] {
    let mut texels = [v.splat_i(0); 4];
    for (component, channel) in info.channels.iter().enumerate() {
        if channel.bits == 0 {
            continue;
        }
        let word = match channel.offset / 32 {
            0 => words[0],
            1 => words[1],
            2 => words[2],
            _ => words[3],
        };
        texels[component] = match channel.bits {
            32 => word,
            bits => {
                // To the top of the word, and down again with zeros or with signs.
                let up = v.left_i(word, 32 - (channel.offset as u32 % 32) - bits as u32);
                let down = 32 - bits as u32;
                let codes = [v.right_u(up, down), v.right_i(up, down)];
                decode_component(v, info, component, word, codes)
            }
        };
    }
    texels
}

#[inline(always)]
fn decode_component<V: Vector>(
    v: V,
    info: &FormatInfo,
    component: usize,
    word: V::I,
    [code, signed]: [V::I; 2],
) -> V::I {
    let bits = info.channels[component].bits;
    let number = match info.numeric {
        Numeric::Uint => return code,
        Numeric::Sint => return signed,
        // SAFETY: the table has an entry for every byte.
        Numeric::Srgb if component != 3 => unsafe {
            return v.gather(srgb::LINEAR.words().as_ptr().cast(), v.left_i(code, 2));
        },
        Numeric::Unorm if block::unit_scale(info) != 1.0 => v.to_f(code),
        Numeric::Unorm | Numeric::Srgb => quotient_of_code(v, v.to_f(code), bits),
        Numeric::Snorm => {
            let number = quotient_of_code(v, v.to_f(signed), bits - 1);
            v.max(number, v.splat(-1.0))
        }
        Numeric::Uscaled => v.to_f(code),
        Numeric::Sscaled => v.to_f(signed),
        Numeric::Sfloat => v.half_to_f(code),
        Numeric::Ufloat if bits == 9 => {
            // The shared exponent's power of two is a normal number: products are exact.
            let exponent = v.add_i(v.right_u(word, 27), v.splat_i(SHARED_EXPONENT_BIAS));
            v.mul(v.to_f(code), v.bits_to_f(v.left_i(exponent, 23)))
        }
        Numeric::Ufloat => v.half_to_f(v.left_i(code, 15 - bits as u32)),
    };
    v.bits_of(number)
}

/// Whether the lanes' texels lie one behind the other.
#[inline(always)]
fn is_row<V: Vector>(v: V, offsets: V::I, first: u32, size_bytes: u32) -> bool {
    let steps = v.load_i(&std::array::from_fn(|lane| lane as u32 * size_bytes));
    v.ne_i(v.sub_i(offsets, steps), v.splat_i(first as i32)) == 0
}

/// The stride between the rows of a 4×4 block of texels of `SIZE` bytes, if the lanes' texels are
/// one, as [`QUADS`] has it.
#[inline(always)]
fn block_stride<V: Vector, const SIZE: u32>(
    v: V,
    offsets: V::I,
    places: &[u32; LANES],
) -> Option<usize> {
    let stride = places[2].wrapping_sub(places[0]);
    // Rows that overlap are not stored in the order of lanes; offsets are less than 2^31.
    if !(4 * SIZE..1 << 31).contains(&stride) {
        return None;
    }
    let columns = v.left_i(v.load_i(&QUADS[0]), SIZE.trailing_zeros());
    let rows = v.mul_i(v.load_i(&QUADS[1]), v.splat_i(stride as i32));
    let block = v.add_i(v.add_i(columns, rows), v.splat_i(places[0] as i32));
    (v.ne_i(offsets, block) == 0).then_some(stride as usize)
}

/// Stores the texels of a 4×4 block, if the lanes' texels of `SIZE` bytes are one.
///
/// # Safety
/// As [`store`], of all lanes.
#[inline(always)]
unsafe fn store_block_of<V: Vector, const SIZE: u32>(
    v: V,
    base: *mut u8,
    offsets: V::I,
    places: &[u32; LANES],
    words: &[V::I; 4],
) -> bool {
    let Some(stride) = block_stride::<V, SIZE>(v, offsets, places) else {
        return false;
    };
    // SAFETY: the caller keeps the contract of `store`, of all lanes; the bytes are those of the
    // lanes' texels, which are distinct. Each offset is less than 2^31 and so is the stride, so
    // offsets of rows do not wrap.
    unsafe {
        let at = base.add(places[0] as usize);
        match SIZE {
            2 => v.store_quads_of_shorts(words[0], at, stride),
            4 => v.store_quads(words[0], at, stride),
            8 => v.store_quads_of_pairs(words[0], words[1], at, stride),
            _ => {
                let quads = [0, 4, 8, 12].map(|lane: usize| base.add(places[lane] as usize));
                v.put_each_quad::<4>(*words, u16::MAX, quads, stride);
            }
        }
    }
    true
}

/// Stores a texel in each lane of `mask`, in lane order; the format is one for vectors.
///
/// # Safety
/// `base + offsets` is writable for the format's size, in every lane of `mask`; offsets are less
/// than 2^31.
#[inline(always)]
pub(crate) unsafe fn store<V: Vector>(
    v: V,
    info: &FormatInfo,
    base: *mut u8,
    offsets: V::I,
    mask: u16,
    texels: &[V::I; 4],
) {
    let words = encode(v, info, texels);
    let mut places = [0; LANES];
    v.store_i(offsets, &mut places);
    if mask == u16::MAX {
        // SAFETY: the caller guarantees that `base + offsets` is writable for the format's size, in
        // every lane of `mask`; offsets are less than 2^31.
        let is_stored = unsafe {
            match info.size_bytes {
                2 => store_block_of::<V, 2>(v, base, offsets, &places, &words),
                4 => store_block_of::<V, 4>(v, base, offsets, &places, &words),
                8 => store_block_of::<V, 8>(v, base, offsets, &places, &words),
                16 => store_block_of::<V, 16>(v, base, offsets, &places, &words),
                _ => false,
            }
        };
        if is_stored {
            return;
        }
    }
    let mut rows = [[0; LANES]; 4];
    let count = (info.size_bytes as usize).div_ceil(4);
    for (word, row) in words.iter().zip(&mut rows[..count]) {
        v.store_i(*word, row);
    }
    let is_row = mask == u16::MAX && is_row(v, offsets, places[0], info.size_bytes as u32);
    // SAFETY: the caller guarantees that `base + offsets` is writable for the format's size, in
    // every lane of `mask`; offsets are less than 2^31.
    unsafe {
        match info.size_bytes {
            1 => put(
                base,
                &places,
                mask,
                is_row,
                &map(&rows[0], |word| word as u8),
            ),
            2 => put(
                base,
                &places,
                mask,
                is_row,
                &map(&rows[0], |word| word as u16),
            ),
            4 => put(base, &places, mask, is_row, &rows[0]),
            8 => {
                let mut texels = [0u64; LANES];
                for lane in 0..LANES {
                    texels[lane] = rows[0][lane] as u64 | (rows[1][lane] as u64) << 32;
                }
                put(base, &places, mask, is_row, &texels);
            }
            16 => {
                let mut texels = [[0u32; 4]; LANES];
                for lane in 0..LANES {
                    for word in 0..4 {
                        texels[lane][word] = rows[word][lane];
                    }
                }
                put(base, &places, mask, is_row, &texels);
            }
            size => put_odd(base, &places, mask, &rows, size as usize),
        }
    }
}

/// Copies texels to their places: all at once where they are a row, else pairs of neighbours
/// together.
///
/// # Safety
/// As [`store`].
#[inline(always)]
unsafe fn put<T: Copy>(
    base: *mut u8,
    places: &[u32; LANES],
    mask: u16,
    is_row: bool,
    texels: &[T; LANES],
) {
    // SAFETY: the caller keeps the contract of `store`.
    unsafe {
        if is_row {
            let row = base.add(places[0] as usize).cast::<[T; LANES]>();
            return row.write_unaligned(*texels);
        }
        let size = size_of::<T>() as u32;
        for lane in (0..LANES).step_by(2) {
            let at = base.add(places[lane] as usize).cast::<T>();
            match mask >> lane & 3 {
                3 if places[lane + 1] == places[lane].wrapping_add(size) => {
                    at.cast::<[T; 2]>()
                        .write_unaligned([texels[lane], texels[lane + 1]]);
                }
                bits => {
                    if bits & 1 != 0 {
                        at.write_unaligned(texels[lane]);
                    }
                    if bits & 2 != 0 {
                        let at = base.add(places[lane + 1] as usize).cast::<T>();
                        at.write_unaligned(texels[lane + 1]);
                    }
                }
            }
        }
    }
}

/// Texels of three components.
///
/// # Safety
/// As [`store`].
#[inline(never)]
unsafe fn put_odd(base: *mut u8, places: &[u32; LANES], mask: u16, rows: &Texels, size: usize) {
    block::each_lane(mask, |lane| {
        let mut texel = [0; 16];
        for (word, row) in rows.iter().enumerate() {
            texel[4 * word..4 * word + 4].copy_from_slice(&row[lane].to_le_bytes());
        }
        // SAFETY: the caller keeps the contract of `store`.
        unsafe {
            let at = base.add(places[lane] as usize);
            std::ptr::copy_nonoverlapping(texel.as_ptr(), at, size);
        }
    });
}

lanes::vectors! {
    /// Stores texels one behind the other: sixteen of each of `texels`, the last ones perhaps in
    /// part. The format is one for vectors.
    ///
    /// # Safety
    /// So many texels are writable.
    pub(super) unsafe fn store_row_in_vectors<V>(
        v,
        info: &FormatInfo,
        to: *mut u8,
        texels: &[Texels],
        count: usize,
    ) {
        let size = info.size_bytes as usize;
        for (index, texels) in texels.iter().enumerate() {
            let first = LANES * index;
            if first >= count {
                return;
            }
            let texels = load_rows(v, texels);
            // SAFETY: the caller guarantees that so many texels are writable.
            unsafe {
                let to = to.add(first * size);
                if count - first >= LANES {
                    let words = encode(v, info, &texels);
                    if store_sixteen(v, size, to, words) {
                        continue;
                    }
                }
                let mask = (u32::from(u16::MAX) >> (LANES - (count - first).min(LANES))) as u16;
                let offsets: [u32; LANES] = std::array::from_fn(|lane| (lane * size) as u32);
                store(v, info, to, v.load_i(&offsets), mask, &texels);
            }
        }
    }
}

/// Stores sixteen texels one behind the other, if they have a usual size.
///
/// # Safety
/// They are writable.
#[inline(always)]
unsafe fn store_sixteen<V: Vector>(v: V, size: usize, to: *mut u8, words: [V::I; 4]) -> bool {
    // Four texels in a row go to a quad: its second line is the next two texels.
    let quads = [0, 4, 8, 12].map(|lane: usize| to.wrapping_add(lane * size));
    let [a, b, ..] = words;
    // SAFETY: the caller guarantees that the texels are writable.
    unsafe {
        match size {
            1 => to.cast::<[u64; 2]>().write_unaligned(v.to_bytes(a)),
            4 => v.put_each_quad([a], u16::MAX, quads, 2 * size),
            8 => v.put_each_quad([a, b], u16::MAX, quads, 2 * size),
            16 => v.put_each_quad(words, u16::MAX, quads, 2 * size),
            _ => return false,
        }
    }
    true
}

/// Stores texels one behind the other: `count` of them, sixteen in each of `texels`.
///
/// # Safety
/// So many texels are writable.
pub unsafe fn store_row(info: &FormatInfo, to: *mut u8, texels: &[Texels], count: usize) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        if info.in_vectors {
            return store_row_in_vectors(Tier::best(), info, to, texels, count);
        }
        let size = info.size_bytes as usize;
        let offsets = std::array::from_fn(|lane| (lane * size) as u64);
        for (texels, first) in texels.iter().zip((0..count).step_by(LANES)) {
            let mask = (u32::from(u16::MAX) >> (LANES - (count - first).min(LANES))) as u16;
            block::store(info, to.add(first * size), &offsets, mask, texels);
        }
    }
}

/// The little-endian words of sixteen texels, first word first; what lies behind the format's size
/// is zero. The same bits as [`FormatInfo::encode`]. To be called where code is compiled for the
/// vectors.
#[inline(always)]
pub fn encode_words<V: Vector>(v: V, info: &FormatInfo, texels: &[V::I; 4]) -> [V::I; 4] {
    if info.in_vectors {
        return encode(v, info, texels);
    }
    let mut rows = [[0; LANES]; 4];
    for (texel, row) in texels.iter().zip(&mut rows) {
        v.store_i(*texel, row);
    }
    load_rows(v, &encode_each(info, &rows))
}

/// Sixteen texels from their little-endian words: the same bits as [`FormatInfo::decode`]. To be
/// called where code is compiled for the vectors.
#[inline(always)]
pub fn decode_words<V: Vector>(v: V, info: &FormatInfo, words: &[V::I; 4]) -> [V::I; 4] {
    if info.decoded_in_vectors {
        let mut texels = decode(v, info, words);
        let units = block::unit_scale(info);
        for (component, texel) in texels.iter_mut().enumerate() {
            if info.channels[component].bits == 0 {
                *texel = v.splat_i(info.missing(component) as i32);
            } else if units != 1.0 {
                *texel = v.bits_of(v.div_units(v.bits_to_f(*texel), units));
            }
        }
        return texels;
    }
    let mut rows = [[0; LANES]; 4];
    for (word, row) in words.iter().zip(&mut rows) {
        v.store_i(*word, row);
    }
    load_rows(v, &decode_each(info, &rows))
}

#[inline(always)]
fn load_rows<V: Vector>(v: V, rows: &Texels) -> [V::I; 4] {
    [
        v.load_i(&rows[0]),
        v.load_i(&rows[1]),
        v.load_i(&rows[2]),
        v.load_i(&rows[3]),
    ]
}

/// [`encode_words`], lane by lane.
#[inline(never)]
fn encode_each(info: &FormatInfo, texels: &Texels) -> Texels {
    let mut rows = [[0; LANES]; 4];
    for lane in 0..LANES {
        let mut bytes = [0; super::format::MAX_TEXEL_BYTES];
        info.encode(texels.map(|row| row[lane]), &mut bytes);
        for (word, row) in rows.iter_mut().enumerate() {
            row[lane] = u32::from_le_bytes(bytes[4 * word..4 * word + 4].try_into().expect("four"));
        }
    }
    rows
}

/// [`decode_words`], lane by lane.
#[inline(never)]
fn decode_each(info: &FormatInfo, words: &Texels) -> Texels {
    let mut rows = [[0; LANES]; 4];
    for lane in 0..LANES {
        let mut bytes = [0; super::format::MAX_TEXEL_BYTES];
        for (word, row) in words.iter().enumerate() {
            bytes[4 * word..4 * word + 4].copy_from_slice(&row[lane].to_le_bytes());
        }
        for (row, word) in rows.iter_mut().zip(info.decode(&bytes)) {
            row[lane] = word;
        }
    }
    rows
}
