//! The meaning of a format's name: the bits of a texel for each component, and their numeric
//! interpretation.

use crate::compressed::{Blocks, Scheme};

/// How the bits of a component are read (spec, "Interpretation of Numeric Format").
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Numeric {
    Unorm,
    Snorm,
    Uscaled,
    Sscaled,
    Uint,
    Sint,
    /// Unsigned floats: B10G11R11 and the shared exponent of E5B9G9R9.
    Ufloat,
    Sfloat,
    /// R, G, B by the sRGB transfer function, A as `Unorm`.
    Srgb,
}

impl Numeric {
    /// Texels are integers in shaders, not floats.
    pub const fn is_integer(self) -> bool {
        matches!(self, Numeric::Uint | Numeric::Sint)
    }
}

/// The aspect of a format, or of a copy or view of it (`VkImageAspectFlags`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Aspect {
    Color,
    Depth,
    Stencil,
}

/// Where a component lies in the texel, read as one little-endian number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub struct Channel {
    pub offset: u8,
    /// 0: the format lacks the component.
    pub bits: u8,
}

/// Ways to decode and encode that have code of their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Codec {
    /// 8-bit unorm in this many components, R first.
    Unorm8(u8),
    /// B, G, R, A.
    Bgra8,
    Srgb8Rgba,
    Srgb8Bgra,
    Unorm16(u8),
    Half(u8),
    /// 32-bit float or integer components: the words are the texel.
    Words(u8),
    Blocks(Blocks),
    Generic,
}

/// Where the index of a texel in its block stands in an offset: no image is as large.
pub(crate) const BLOCK_INDEX_SHIFT: u32 = 56;

/// A format taken apart.
#[derive(Clone, Copy, Debug)]
pub struct FormatInfo {
    /// Vulkan's name without `VK_FORMAT_`.
    pub name: &'static str,
    /// Size of a texel, in compressed formats of a block; of a depth plane's texel for formats with
    /// depth (see [`Format::plane`](super::Format::plane)).
    pub size_bytes: u8,
    pub numeric: Numeric,
    /// R, G, B, A; depth and stencil stand in R. Compressed formats have components, but no bits of
    /// their own.
    pub channels: [Channel; 4],
    pub has_depth: bool,
    pub has_stencil: bool,
    pub(crate) codec: Codec,
    /// Vectors decode and encode it ([`texels`](crate::texels)).
    pub(crate) in_vectors: bool,
    /// Vectors decode it, whether or not they encode it.
    pub(crate) decoded_in_vectors: bool,
}

/// The components in a format's name.
struct NamedComponents {
    /// Letters and bits.
    order: [(u8, u8); 8],
    count: usize,
    /// Bits of all.
    bits: u16,
    /// The position in the name after them.
    end: usize,
    has_depth: bool,
    has_stencil: bool,
}

impl NamedComponents {
    const fn read(text: &[u8]) -> NamedComponents {
        let mut found = NamedComponents {
            order: [(0, 0); 8],
            count: 0,
            bits: 0,
            end: 0,
            has_depth: false,
            has_stencil: false,
        };
        loop {
            if text[found.end] == b'_' {
                // Only the depth formats separate their components.
                if text[found.end + 1] == b'D' && is_digit(text[found.end + 2]) {
                    found.end += 1;
                } else {
                    return found;
                }
            }
            let letter = text[found.end];
            found.end += 1;
            let mut bits = 0;
            while found.end < text.len() && is_digit(text[found.end]) {
                bits = bits * 10 + (text[found.end] - b'0');
                found.end += 1;
            }
            found.order[found.count] = (letter, bits);
            found.count += 1;
            found.bits += bits as u16;
            found.has_depth |= letter == b'D';
            found.has_stencil |= letter == b'S';
        }
    }

    /// The bits of R, G, B and A in a texel of the format of this name.
    const fn channels(&self, text: &[u8]) -> [Channel; 4] {
        // Several packed words are components one after the other.
        let packed = contains(text, b"PACK");
        let words = contains(text, b"2PACK") || contains(text, b"4PACK");
        let mut word = 0;
        let mut channels = [Channel { offset: 0, bits: 0 }; 4];
        let mut offset = if packed { self.bits } else { 0 };
        let mut index = 0;
        while index < self.count {
            let (letter, bits) = self.order[index];
            if packed {
                offset -= bits as u16;
            }
            let component = match letter {
                b'R' | b'D' | b'S' => 0,
                b'G' => 1,
                b'B' => 2,
                b'A' => 3,
                // X: unused; E: the shared exponent.
                _ => 4,
            };
            if component < 4 {
                channels[component] = Channel {
                    offset: match words {
                        // The padding below is as wide as a word lacks.
                        true => 16 * word + 16 - bits,
                        false => offset as u8,
                    },
                    bits,
                };
                word += 1;
            }
            if !packed {
                offset += bits as u16;
            }
            index += 1;
        }
        channels
    }
}

impl FormatInfo {
    /// NamedComponents present.
    pub const fn component_count(&self) -> usize {
        let mut count = 0;
        let mut index = 0;
        while index < 4 {
            count += (self.channels[index].bits != 0) as usize;
            index += 1;
        }
        count
    }

    pub const fn is_color(&self) -> bool {
        !self.has_depth && !self.has_stencil
    }

    /// The blocks of a compressed format.
    pub const fn blocks(&self) -> Option<Blocks> {
        match self.codec {
            Codec::Blocks(blocks) => Some(blocks),
            _ => None,
        }
    }

    /// Width and height, in texels, of what [`FormatInfo::size_bytes`] is the size of: 1×1, or a
    /// compressed format's block.
    pub const fn block_extent(&self) -> [u32; 2] {
        match self.codec {
            Codec::Blocks(blocks) => [blocks.width as u32, blocks.height as u32],
            _ => [1, 1],
        }
    }

    /// The offset of a texel in a slice, as [`block::load`](super::block::load) takes them: in
    /// compressed formats, that of its block, with the texel's index in the block above
    /// [`BLOCK_INDEX_SHIFT`].
    #[inline(always)]
    pub fn texel_offset(&self, x: u32, y: u32, row_stride_bytes: u64) -> u64 {
        match self.codec {
            Codec::Blocks(blocks) => {
                let (width, height) = (blocks.width as u32, blocks.height as u32);
                let index = y % height * width + x % width;
                let (column, row) = (u64::from(x / width), u64::from(y / height));
                let offset = row * row_stride_bytes + column * self.size_bytes as u64;
                offset + (u64::from(index) << BLOCK_INDEX_SHIFT)
            }
            _ => u64::from(y) * row_stride_bytes + u64::from(x) * self.size_bytes as u64,
        }
    }

    /// Reads a format's name (spec, "Format Definition"): components with their bits, from the most
    /// significant bit for packed formats and from the first byte for others, then the numeric
    /// format.
    pub(super) const fn parse(name: &'static str) -> FormatInfo {
        let text = name.as_bytes();
        if contains(text, b"_BLOCK") {
            return Self::parse_compressed(name);
        }
        let found = NamedComponents::read(text);
        let channels = found.channels(text);
        let numeric = numeric(text, found.end + 1);
        let (total, has_depth) = (found.bits, found.has_depth);
        let has_stencil = found.has_stencil || contains(text, b"_S8_");
        // A 24-bit depth takes a 32-bit word even where its name does not pad it.
        let size_bytes = if total == 24 && has_depth {
            4
        } else {
            (total / 8) as u8
        };
        FormatInfo {
            name,
            size_bytes,
            numeric,
            channels,
            has_depth,
            has_stencil,
            codec: codec(&channels, numeric),
            in_vectors: in_vectors(&channels, numeric),
            decoded_in_vectors: !has_component_of(&channels, 64),
        }
    }
}

impl FormatInfo {
    /// Reads the name of a compressed format: its scheme, the size of ASTC's blocks, then the
    /// numeric format.
    const fn parse_compressed(name: &'static str) -> FormatInfo {
        let text = name.as_bytes();
        /// Beginning of the name, scheme, that of signed ones, bytes of a block, components.
        const SCHEMES: [(&[u8], Scheme, Scheme, u8, u8); 14] = [
            (b"BC1_RGB_", Scheme::Bc1Rgb, Scheme::Bc1Rgb, 8, 3),
            (b"BC1_RGBA_", Scheme::Bc1Rgba, Scheme::Bc1Rgba, 8, 4),
            (b"BC2_", Scheme::Bc2, Scheme::Bc2, 16, 4),
            (b"BC3_", Scheme::Bc3, Scheme::Bc3, 16, 4),
            (b"BC4_", Scheme::Bc4, Scheme::Bc4Signed, 8, 1),
            (b"BC5_", Scheme::Bc5, Scheme::Bc5Signed, 16, 2),
            (b"BC6H_", Scheme::Bc6h, Scheme::Bc6hSigned, 16, 3),
            (b"BC7_", Scheme::Bc7, Scheme::Bc7, 16, 4),
            (b"ETC2_R8G8B8_", Scheme::Etc2Rgb, Scheme::Etc2Rgb, 8, 3),
            (
                b"ETC2_R8G8B8A1_",
                Scheme::Etc2RgbA1,
                Scheme::Etc2RgbA1,
                8,
                4,
            ),
            (b"ETC2_R8G8B8A8_", Scheme::Etc2Rgba, Scheme::Etc2Rgba, 16, 4),
            (b"EAC_R11_", Scheme::EacR, Scheme::EacRSigned, 8, 1),
            (b"EAC_R11G11_", Scheme::EacRg, Scheme::EacRgSigned, 16, 2),
            (b"ASTC_", Scheme::Astc, Scheme::Astc, 16, 4),
        ];
        let mut index = 0;
        while !starts_at(text, 0, SCHEMES[index].0) {
            index += 1;
        }
        let (start, unsigned, signed, size_bytes, components) = SCHEMES[index];
        let mut at = start.len();
        let (mut width, mut height) = (4, 4);
        if starts_at(text, 0, b"ASTC_") {
            (width, at) = number(text, at);
            (height, at) = number(text, at + 1);
            at += 1;
        }
        let numeric = numeric(text, at);
        let scheme = match numeric {
            Numeric::Snorm | Numeric::Sfloat => signed,
            _ => unsigned,
        };
        let mut channels = [Channel { offset: 0, bits: 0 }; 4];
        let mut component = 0;
        while component < components as usize {
            // Present, and no more is said.
            channels[component].bits = 8;
            component += 1;
        }
        FormatInfo {
            name,
            size_bytes,
            numeric,
            channels,
            has_depth: false,
            has_stencil: false,
            codec: Codec::Blocks(Blocks {
                scheme,
                width,
                height,
                srgb: matches!(numeric, Numeric::Srgb),
            }),
            in_vectors: false,
            decoded_in_vectors: false,
        }
    }
}

/// A number in a name, and where it ends.
const fn number(text: &[u8], mut at: usize) -> (u8, usize) {
    let mut value = 0;
    while at < text.len() && is_digit(text[at]) {
        value = value * 10 + (text[at] - b'0');
        at += 1;
    }
    (value, at)
}

const fn is_digit(byte: u8) -> bool {
    byte >= b'0' && byte <= b'9'
}

const fn starts_at(text: &[u8], at: usize, word: &[u8]) -> bool {
    let mut index = 0;
    while index < word.len() {
        if at + index >= text.len() || text[at + index] != word[index] {
            return false;
        }
        index += 1;
    }
    true
}

const fn contains(text: &[u8], word: &[u8]) -> bool {
    let mut at = 0;
    while at < text.len() {
        if starts_at(text, at, word) {
            return true;
        }
        at += 1;
    }
    false
}

const fn numeric(text: &[u8], at: usize) -> Numeric {
    const NAMES: [(&[u8], Numeric); 9] = [
        (b"UNORM", Numeric::Unorm),
        (b"SNORM", Numeric::Snorm),
        (b"USCALED", Numeric::Uscaled),
        (b"SSCALED", Numeric::Sscaled),
        (b"UINT", Numeric::Uint),
        (b"SINT", Numeric::Sint),
        (b"UFLOAT", Numeric::Ufloat),
        (b"SFLOAT", Numeric::Sfloat),
        (b"SRGB", Numeric::Srgb),
    ];
    let mut index = 0;
    while index < NAMES.len() {
        if starts_at(text, at, NAMES[index].0) {
            return NAMES[index].1;
        }
        index += 1;
    }
    panic!("a format without a numeric format")
}

/// Whether the present components are R, G, B, A in this order, each of `bits`; gives their number.
const fn array_of(channels: &[Channel; 4], bits: u8) -> u8 {
    let mut count = 0u8;
    while (count as usize) < 4 && channels[count as usize].bits != 0 {
        let channel = channels[count as usize];
        if channel.bits != bits || channel.offset != count * bits {
            return 0;
        }
        count += 1;
    }
    let mut index = count as usize;
    while index < 4 {
        if channels[index].bits != 0 {
            return 0;
        }
        index += 1;
    }
    count
}

/// Not 64-bit components, 24-bit depth and shared exponents.
const fn in_vectors(channels: &[Channel; 4], numeric: Numeric) -> bool {
    let mut index = 0;
    while index < 4 {
        let bits = channels[index].bits;
        if bits > 16 && bits != 32 {
            return false;
        }
        index += 1;
    }
    !matches!((numeric, channels[0].bits), (Numeric::Ufloat, 9))
}

const fn has_component_of(channels: &[Channel; 4], bits: u8) -> bool {
    let mut index = 0;
    while index < 4 {
        if channels[index].bits == bits {
            return true;
        }
        index += 1;
    }
    false
}

const fn codec(channels: &[Channel; 4], numeric: Numeric) -> Codec {
    let bytes = array_of(channels, 8);
    let halves = array_of(channels, 16);
    let words = array_of(channels, 32);
    let [r, g, b, a] = *channels;
    let bgra = r.bits == 8
        && r.offset == 16
        && g.bits == 8
        && g.offset == 8
        && b.bits == 8
        && b.offset == 0
        && a.bits == 8;
    match numeric {
        Numeric::Unorm if bytes != 0 => Codec::Unorm8(bytes),
        Numeric::Unorm if halves != 0 => Codec::Unorm16(halves),
        Numeric::Unorm if bgra => Codec::Bgra8,
        Numeric::Srgb if bytes == 4 => Codec::Srgb8Rgba,
        Numeric::Srgb if bgra => Codec::Srgb8Bgra,
        Numeric::Sfloat if halves != 0 => Codec::Half(halves),
        Numeric::Sfloat | Numeric::Uint | Numeric::Sint if words != 0 => Codec::Words(words),
        _ => Codec::Generic,
    }
}
