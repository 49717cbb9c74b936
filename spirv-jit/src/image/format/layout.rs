//! What a format's name says: which bits of a texel hold which component, and how they are read as numbers.

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

/// What a format, or a copy or view of it, is about (`VkImageAspectFlags`).
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
    Generic,
}

/// A format taken apart.
#[derive(Clone, Copy, Debug)]
pub struct FormatInfo {
    /// Vulkan's name without `VK_FORMAT_`.
    pub name: &'static str,
    /// Size of a texel; of a depth plane's texel for formats with depth (see [`Format::plane`](super::Format::plane)).
    pub size_bytes: u8,
    pub numeric: Numeric,
    /// R, G, B, A; depth and stencil stand in R.
    pub channels: [Channel; 4],
    pub has_depth: bool,
    pub has_stencil: bool,
    pub(crate) codec: Codec,
    /// Vectors decode and encode it ([`texels`](crate::image::texels)).
    pub(crate) in_vectors: bool,
}

impl FormatInfo {
    /// Components present.
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

    /// Reads a format's name (spec, "Format Definition"): components with their bits, from the most significant bit for packed formats and from the first byte for
    /// others, then the numeric format.
    pub(super) const fn parse(name: &'static str) -> FormatInfo {
        let text = name.as_bytes();
        let packed = contains(text, b"PACK");
        let mut order = [(0u8, 0u8); 8];
        let mut count = 0;
        let mut total = 0u16;
        let mut at = 0;
        let (mut has_depth, mut has_stencil) = (false, false);
        loop {
            if text[at] == b'_' {
                // Only the depth formats separate their components.
                if text[at + 1] == b'D' && is_digit(text[at + 2]) {
                    at += 1;
                } else {
                    break;
                }
            }
            let letter = text[at];
            at += 1;
            let mut bits = 0;
            while at < text.len() && is_digit(text[at]) {
                bits = bits * 10 + (text[at] - b'0');
                at += 1;
            }
            order[count] = (letter, bits);
            count += 1;
            total += bits as u16;
            has_depth |= letter == b'D';
            has_stencil |= letter == b'S';
        }
        has_stencil |= contains(text, b"_S8_");
        let mut channels = [Channel { offset: 0, bits: 0 }; 4];
        let mut offset = if packed { total } else { 0 };
        let mut index = 0;
        while index < count {
            let (letter, bits) = order[index];
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
                    offset: offset as u8,
                    bits,
                };
            }
            if !packed {
                offset += bits as u16;
            }
            index += 1;
        }
        let numeric = numeric(text, at + 1);
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
        }
    }
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
