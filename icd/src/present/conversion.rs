//! Converts rows of texels to the pixel layouts of windows, with vector instructions where the
//! processor has them.
//!
//! Each component becomes the nearest value of the layout, as conversions to UNORM do (Vulkan 1.4,
//! section 3.10.1).

use std::sync::OnceLock;

use ash::vk;
use half::f16;
use lanes::Tier;

/// The layout of a window's pixels in 32-bit or 16-bit words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// `VK_FORMAT_B8G8R8A8_UNORM`.
    Argb8888,
    /// `VK_FORMAT_R8G8B8A8_UNORM`.
    Abgr8888,
    /// `VK_FORMAT_A2R10G10B10_UNORM_PACK32`.
    Argb2101010,
    /// `VK_FORMAT_A2B10G10R10_UNORM_PACK32`.
    Abgr2101010,
    /// `VK_FORMAT_R5G6B5_UNORM_PACK16`.
    Rgb565,
}

impl Layout {
    /// The layout with this word size and these masks of red, green and blue.
    pub fn from_masks(bits: u8, masks: [u32; 3]) -> Option<Self> {
        match (bits, masks) {
            (32, [0xff_0000, 0xff00, 0xff]) => Some(Self::Argb8888),
            (32, [0xff, 0xff00, 0xff_0000]) => Some(Self::Abgr8888),
            (32, [0x3ff0_0000, 0xf_fc00, 0x3ff]) => Some(Self::Argb2101010),
            (32, [0x3ff, 0xf_fc00, 0x3ff0_0000]) => Some(Self::Abgr2101010),
            (16, [0xf800, 0x7e0, 0x1f]) => Some(Self::Rgb565),
            _ => None,
        }
    }

    pub fn bytes(self) -> usize {
        if self == Self::Rgb565 { 2 } else { 4 }
    }

    /// The image formats that have this layout already. `_SRGB` formats are stored encoded, as
    /// windows show them.
    pub fn is_that_of(self, format: vk::Format) -> bool {
        match self {
            Self::Argb8888 => matches!(
                format,
                vk::Format::B8G8R8A8_UNORM | vk::Format::B8G8R8A8_SRGB
            ),
            Self::Abgr8888 => matches!(
                format,
                vk::Format::R8G8B8A8_UNORM | vk::Format::R8G8B8A8_SRGB
            ),
            Self::Argb2101010 => format == vk::Format::A2R10G10B10_UNORM_PACK32,
            Self::Abgr2101010 => format == vk::Format::A2B10G10R10_UNORM_PACK32,
            Self::Rgb565 => format == vk::Format::R5G6B5_UNORM_PACK16,
        }
    }
}

/// A row of consecutive texels of one format.
#[derive(Clone, Copy)]
pub struct Texels {
    pub data: *const u8,
    pub count: usize,
    pub format: vk::Format,
    /// The components are linear light (`VK_COLOR_SPACE_EXTENDED_SRGB_LINEAR_EXT`).
    pub is_linear: bool,
}

pub fn texel_bytes(format: vk::Format) -> usize {
    match format {
        vk::Format::R16G16B16A16_SFLOAT => 8,
        vk::Format::R5G6B5_UNORM_PACK16 => 2,
        _ => 4,
    }
}

/// Converts a row; `row` has as many pixels. With `is_opaque` every pixel's alpha is one.
///
/// # Safety
/// The texels are readable and aligned to their size.
pub unsafe fn convert(tier: Tier, texels: Texels, layout: Layout, is_opaque: bool, row: &mut [u8]) {
    assert_eq!(row.len(), texels.count * layout.bytes());
    // SAFETY: the caller guarantees that the texels are readable and aligned to their size.
    unsafe {
        match layout {
            Layout::Argb8888 => to_layout::<Argb8888>(tier, texels, is_opaque, row),
            Layout::Abgr8888 => to_layout::<Abgr8888>(tier, texels, is_opaque, row),
            Layout::Argb2101010 => to_layout::<Argb2101010>(tier, texels, is_opaque, row),
            Layout::Abgr2101010 => to_layout::<Abgr2101010>(tier, texels, is_opaque, row),
            Layout::Rgb565 => to_layout::<Rgb565>(tier, texels, is_opaque, row),
        }
    }
}

/// # Safety
/// As for [`convert`].
unsafe fn to_layout<L: Words>(tier: Tier, texels: Texels, is_opaque: bool, row: &mut [u8]) {
    // SAFETY: the caller keeps the promises of `convert`.
    unsafe {
        match texels.format {
            vk::Format::R16G16B16A16_SFLOAT => floats::<L>(tier, texels, is_opaque, row),
            vk::Format::R5G6B5_UNORM_PACK16 => words::<Rgb565, L>(tier, texels, is_opaque, row),
            vk::Format::B8G8R8A8_UNORM | vk::Format::B8G8R8A8_SRGB => {
                words::<Argb8888, L>(tier, texels, is_opaque, row);
            }
            vk::Format::A2R10G10B10_UNORM_PACK32 => {
                words::<Argb2101010, L>(tier, texels, is_opaque, row);
            }
            vk::Format::A2B10G10R10_UNORM_PACK32 => {
                words::<Abgr2101010, L>(tier, texels, is_opaque, row);
            }
            _ => words::<Abgr8888, L>(tier, texels, is_opaque, row),
        }
    }
}

/// The bit positions of red, green, blue and alpha in a word.
trait Words {
    type Word: Copy + TryFrom<u32> + Into<u32>;
    /// Bits of each component; a layout without alpha bits is opaque.
    const BITS: [u32; 4];
    const SHIFTS: [u32; 4];
}

macro_rules! words {
    ($($name:ident: $word:ty, $bits:expr, $shifts:expr;)*) => {
        $(
            struct $name;

            impl Words for $name {
                type Word = $word;
                const BITS: [u32; 4] = $bits;
                const SHIFTS: [u32; 4] = $shifts;
            }
        )*
    };
}

words! {
    Argb8888: u32, [8; 4], [16, 8, 0, 24];
    Abgr8888: u32, [8; 4], [0, 8, 16, 24];
    Argb2101010: u32, [10, 10, 10, 2], [20, 10, 0, 30];
    Abgr2101010: u32, [10, 10, 10, 2], [0, 10, 20, 30];
    Rgb565: u16, [5, 6, 5, 0], [11, 5, 0, 0];
}

/// The largest value of this many bits.
const fn most(bits: u32) -> u32 {
    (1 << bits) - 1
}

/// A component converted from one width to another.
#[inline(always)]
fn rescale(value: u32, from: u32, to: u32) -> u32 {
    match (from, to) {
        (0, _) => most(to),
        _ if from == to => value,
        _ => (value * most(to) + most(from) / 2) / most(from),
    }
}

/// The alpha bits that an opaque pixel sets.
fn opaque<L: Words>(is_opaque: bool) -> u32 {
    match is_opaque {
        true => most(L::BITS[3]) << L::SHIFTS[3],
        false => 0,
    }
}

/// # Safety
/// As for [`convert`].
unsafe fn words<T: Words, L: Words>(tier: Tier, texels: Texels, is_opaque: bool, row: &mut [u8]) {
    /// # Safety
    /// As for [`words`].
    #[inline(always)]
    unsafe fn body<T: Words, L: Words>(texels: Texels, alpha: u32, row: &mut [u8]) {
        let texel = texels.data.cast::<T::Word>();
        for (x, pixel) in row.chunks_exact_mut(size_of::<L::Word>()).enumerate() {
            // SAFETY: there are as many texels as pixels (`convert`), and the caller guarantees
            // that they are aligned.
            let word: u32 = unsafe { texel.add(x).read() }.into();
            let mut packed = alpha;
            for c in 0..4 {
                let value = word >> T::SHIFTS[c] & most(T::BITS[c]);
                packed |= rescale(value, T::BITS[c], L::BITS[c]) << L::SHIFTS[c];
            }
            pixel.copy_from_slice(&packed.to_le_bytes()[..size_of::<L::Word>()]);
        }
    }
    /// # Safety
    /// As for [`words`]; the machine has AVX2.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    unsafe fn avx2<T: Words, L: Words>(texels: Texels, alpha: u32, row: &mut [u8]) {
        // SAFETY: the caller guarantees that the texels are readable and aligned to their size.
        unsafe { body::<T, L>(texels, alpha, row) }
    }
    let alpha = opaque::<L>(is_opaque);
    // SAFETY: the caller keeps the promises of `convert`; a tier is one that the machine has
    // (`Tier::best`).
    unsafe {
        match tier {
            #[cfg(target_arch = "x86_64")]
            Tier::Avx2 | Tier::Avx512 => avx2::<T, L>(texels, alpha, row),
            _ => body::<T, L>(texels, alpha, row),
        }
    }
}

/// # Safety
/// As for [`convert`], of 16-bit floats.
unsafe fn floats<L: Words>(tier: Tier, texels: Texels, is_opaque: bool, row: &mut [u8]) {
    let alpha = opaque::<L>(is_opaque);
    #[cfg(target_arch = "x86_64")]
    let done =
        match matches!(tier, Tier::Avx2 | Tier::Avx512) && !texels.is_linear && L::BITS == [8; 4] {
            // SAFETY: the tier has these instructions; the caller keeps the contract of `convert`,
            // of 16-bit floats.
            true => unsafe { eight_bits(texels, L::SHIFTS[0] != 0, alpha, row) },
            false => 0,
        };
    #[cfg(not(target_arch = "x86_64"))]
    let (done, _) = (0, tier);
    let table = |c: usize| float_table(texels.is_linear && c < 3, L::BITS[c]);
    let tables = [table(0), table(1), table(2), table(3)];
    let texel = texels.data.cast::<[u16; 4]>();
    let pixels = row.chunks_exact_mut(size_of::<L::Word>()).enumerate();
    for (x, pixel) in pixels.skip(done) {
        // SAFETY: `convert` has checked that there are as many texels as pixels; its caller
        // guarantees that they are aligned.
        let halves = unsafe { texel.add(x).read() };
        let mut packed = alpha;
        for c in 0..4 {
            packed |= u32::from(tables[c][usize::from(halves[c])]) << L::SHIFTS[c];
        }
        pixel.copy_from_slice(&packed.to_le_bytes()[..size_of::<L::Word>()]);
    }
}

/// Converts to RGBA or BGRA bytes, eight pixels at a time. Returns the number of converted pixels.
///
/// The product of a half float and 255 has 19 bits, so it is exact, and so is its sum with 0.5.
///
/// # Safety
/// As for [`convert`], of 16-bit floats to four bytes each.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,f16c")]
unsafe fn eight_bits(texels: Texels, is_blue_first: bool, alpha: u32, row: &mut [u8]) -> usize {
    use std::arch::x86_64::*;
    let (zero, one) = (_mm256_setzero_ps(), _mm256_set1_ps(1.0));
    let (most, half) = (_mm256_set1_ps(255.0), _mm256_set1_ps(0.5));
    let alpha = _mm256_set1_epi32(alpha as i32);
    let first = if is_blue_first { 2 } else { 0 };
    let word =
        |x: i32| (3 + 4 * x) << 24 | (4 * x + 2 - first) << 16 | (4 * x + 1) << 8 | (4 * x + first);
    let places = _mm_set_epi32(word(3), word(2), word(1), word(0));
    let places = _mm256_broadcastsi128_si256(places);
    // Packing works within 128-bit halves: this order undoes it.
    let order = _mm256_set_epi32(7, 3, 6, 2, 5, 1, 4, 0);
    let two = |texel: *const u8| {
        // SAFETY: the loop below leaves at least two texels from here on.
        let values = _mm256_cvtph_ps(unsafe { _mm_loadu_si128(texel.cast()) });
        // The result is the second operand if the first is NaN.
        let values = _mm256_min_ps(_mm256_max_ps(values, zero), one);
        _mm256_cvttps_epi32(_mm256_add_ps(_mm256_mul_ps(values, most), half))
    };
    let mut done = 0;
    for pixels in row.chunks_exact_mut(32) {
        // SAFETY: eight texels of eight bytes each are readable, and the store fills eight pixels
        // of four bytes.
        unsafe {
            let source = texels.data.add(8 * done);
            let low = _mm256_packus_epi32(two(source), two(source.add(16)));
            let high = _mm256_packus_epi32(two(source.add(32)), two(source.add(48)));
            let bytes = _mm256_packus_epi16(low, high);
            let bytes = _mm256_permutevar8x32_epi32(bytes, order);
            let bytes = _mm256_or_si256(_mm256_shuffle_epi8(bytes, places), alpha);
            _mm256_storeu_si256(pixels.as_mut_ptr().cast(), bytes);
        }
        done += 8;
    }
    done
}

/// A table of each 16-bit float's value in a number of bits, clamped to the window's range.
fn float_table(is_linear: bool, bits: u32) -> &'static [u16; 1 << 16] {
    // One table for each transfer function and number of bits.
    static TABLES: [[OnceLock<Box<[u16; 1 << 16]>>; 11]; 2] =
        [const { [const { OnceLock::new() }; 11] }; 2];
    TABLES[usize::from(is_linear)][bits as usize].get_or_init(|| {
        let entry = |bits_of_half: u16| {
            let value = f64::from(f16::from_bits(bits_of_half));
            let value = if is_linear { srgb(value) } else { value };
            // The cast turns NaN to black.
            (value.clamp(0.0, 1.0) * f64::from(most(bits)) + 0.5) as u16
        };
        let table: Box<[u16]> = (0..=u16::MAX).map(entry).collect();
        table.try_into().expect("an entry for each half")
    })
}

/// The transfer function of sRGB (Khronos Data Format Specification, section 13.3.2).
fn srgb(linear: f64) -> f64 {
    if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FORMATS: [(vk::Format, [u32; 4], [u32; 4]); 5] = [
        (vk::Format::B8G8R8A8_SRGB, Argb8888::BITS, Argb8888::SHIFTS),
        (vk::Format::R8G8B8A8_UNORM, Abgr8888::BITS, Abgr8888::SHIFTS),
        (
            vk::Format::A2R10G10B10_UNORM_PACK32,
            Argb2101010::BITS,
            Argb2101010::SHIFTS,
        ),
        (
            vk::Format::A2B10G10R10_UNORM_PACK32,
            Abgr2101010::BITS,
            Abgr2101010::SHIFTS,
        ),
        (
            vk::Format::R5G6B5_UNORM_PACK16,
            Rgb565::BITS,
            Rgb565::SHIFTS,
        ),
    ];

    const LAYOUTS: [(Layout, [u32; 4], [u32; 4]); 5] = [
        (Layout::Argb8888, Argb8888::BITS, Argb8888::SHIFTS),
        (Layout::Abgr8888, Abgr8888::BITS, Abgr8888::SHIFTS),
        (Layout::Argb2101010, Argb2101010::BITS, Argb2101010::SHIFTS),
        (Layout::Abgr2101010, Abgr2101010::BITS, Abgr2101010::SHIFTS),
        (Layout::Rgb565, Rgb565::BITS, Rgb565::SHIFTS),
    ];

    fn converted(
        tier: Tier,
        texels: &[u64],
        bytes: usize,
        (format, is_linear): (vk::Format, bool),
        (layout, is_opaque): (Layout, bool),
    ) -> Vec<u32> {
        let count = bytes / texel_bytes(format);
        let texels = Texels {
            data: texels.as_ptr().cast(),
            count,
            format,
            is_linear,
        };
        let mut row = vec![0xee; count * layout.bytes()];
        // SAFETY: `texels` lives.
        unsafe { convert(tier, texels, layout, is_opaque, &mut row) };
        let word = |pixel: &[u8]| {
            pixel
                .iter()
                .rev()
                .fold(0, |word, &b| word << 8 | u32::from(b))
        };
        row.chunks_exact(layout.bytes()).map(word).collect()
    }

    /// A component as a fraction of its largest value; a missing component is one.
    fn share(word: u32, bits: u32, shift: u32) -> f64 {
        match bits {
            0 => 1.0,
            _ => f64::from(word >> shift & most(bits)) / f64::from(most(bits)),
        }
    }

    /// Every tier converts each component to within half a step of the texel's.
    #[test]
    fn words_become_the_nearest_words() {
        let mut random = 1u64;
        let mut bits = || {
            random = random
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            random ^ random >> 31
        };
        let texels: Vec<u64> = (0..2051).map(|_| bits()).collect();
        let bytes = texels.len() * 8 - 4;
        for (format, from_bits, from_shifts) in FORMATS {
            for (layout, to_bits, to_shifts) in LAYOUTS {
                for (&tier, is_opaque) in Tier::available()
                    .iter()
                    .flat_map(|t| [(t, false), (t, true)])
                {
                    let how = (layout, is_opaque);
                    let words = converted(tier, &texels, bytes, (format, false), how);
                    let size = texel_bytes(format);
                    for (x, word) in words.into_iter().enumerate() {
                        let place = x * size;
                        let texel = (texels[place / 8] >> (place % 8 * 8)) as u32;
                        let texel = if size == 2 { texel & 0xffff } else { texel };
                        for c in 0..4 {
                            let mut wanted = share(texel, from_bits[c], from_shifts[c]);
                            if c == 3 && is_opaque {
                                wanted = 1.0;
                            }
                            let step = 1.0 / f64::from(most(to_bits[c]).max(1));
                            let off = share(word, to_bits[c], to_shifts[c]) - wanted;
                            let is_there = to_bits[c] > 0;
                            let near = off.abs() <= step * 0.5 + 1e-12;
                            assert!(near || !is_there, "{format:?} {layout:?} {c} {tier:?}");
                        }
                    }
                }
            }
        }
    }

    /// Every tier converts every 16-bit float, in every component, to the nearest value; linear
    /// light goes through the transfer function.
    #[test]
    fn floats_become_the_nearest_words() {
        let texels: Vec<u64> = (0..=u16::MAX)
            .map(|half| {
                let others = [
                    half,
                    half.rotate_left(3),
                    half ^ 0x5555,
                    half.reverse_bits(),
                ];
                (0..4).fold(0, |texel, c| texel | u64::from(others[c]) << (16 * c))
            })
            .collect();
        let format = vk::Format::R16G16B16A16_SFLOAT;
        for (layout, bits, shifts) in LAYOUTS {
            for (&tier, is_linear) in Tier::available()
                .iter()
                .flat_map(|t| [(t, false), (t, true)])
            {
                let bytes = texels.len() * 8 - 8;
                let words = converted(tier, &texels, bytes, (format, is_linear), (layout, false));
                for (word, texel) in words.into_iter().zip(&texels) {
                    let halves = [0, 16, 32, 48].map(|shift| (texel >> shift) as u16);
                    for c in (0..4).filter(|&c| bits[c] > 0) {
                        let value = f64::from(f16::from_bits(halves[c]));
                        let value = match is_linear && c < 3 {
                            true => srgb(value),
                            false => value,
                        };
                        let wanted = if value.is_nan() {
                            0.0
                        } else {
                            value.clamp(0.0, 1.0)
                        };
                        let off = share(word, bits[c], shifts[c]) - wanted;
                        let near = off.abs() <= 0.5 / f64::from(most(bits[c])) + 1e-12;
                        assert!(near, "{value} {layout:?} {c} {tier:?} {is_linear}");
                    }
                }
            }
        }
    }

    #[test]
    fn linear_light_is_encoded() {
        // Mid grey of sRGB is 0.5 encoded, 0.21404 linear (IEC 61966-2-1).
        assert!((srgb(0.214_041_14) - 0.5).abs() < 1e-6);
        let table = float_table(true, 10);
        let grey = table[usize::from(f16::from_f32(0.214_041_14).to_bits())];
        assert!((f64::from(grey) / 1023.0 - 0.5).abs() < 1e-3);
        assert_eq!(table[usize::from(f16::NAN.to_bits())], 0);
    }
}
