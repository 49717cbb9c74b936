//! Pixels of images to pixels of windows, in one pass.

use std::sync::OnceLock;

use ash::vk;
use half::f16;

/// How a window's pixels lie in 32-bit or 16-bit words.
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
    /// The layout of words of so many bits with these masks of red, green and blue.
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

    /// The formats of images whose pixels lie so already. Those of `_SRGB` are stored encoded, as
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

    /// A pixel of 16-bit components.
    fn pack(self, [r, g, b, a]: [u16; 4]) -> u32 {
        let part = |component: u16, bits: u32| {
            // To the nearest, as conversions to UNORM are: 65535 is a multiple of 255, and nearly
            // one of the others.
            (u32::from(component) * ((1 << bits) - 1) + 32767) / 65535
        };
        match self {
            Self::Argb8888 => part(a, 8) << 24 | part(r, 8) << 16 | part(g, 8) << 8 | part(b, 8),
            Self::Abgr8888 => part(a, 8) << 24 | part(b, 8) << 16 | part(g, 8) << 8 | part(r, 8),
            Self::Argb2101010 => {
                part(a, 2) << 30 | part(r, 10) << 20 | part(g, 10) << 10 | part(b, 10)
            }
            Self::Abgr2101010 => {
                part(a, 2) << 30 | part(b, 10) << 20 | part(g, 10) << 10 | part(r, 10)
            }
            Self::Rgb565 => part(r, 5) << 11 | part(g, 6) << 5 | part(b, 5),
        }
    }
}

/// The layer of an image that is shown.
#[derive(Clone, Copy)]
pub struct Picture {
    pub data: *const u8,
    pub row_stride_bytes: usize,
    pub extent: vk::Extent2D,
    pub format: vk::Format,
    /// The components are linear light (`VK_COLOR_SPACE_EXTENDED_SRGB_LINEAR_EXT`).
    pub is_linear: bool,
}

// SAFETY: whoever makes one keeps what it points to; it is only read.
unsafe impl Send for Picture {}

/// Where a picture is on a window: a part of the picture, stretched over a part of the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Placement {
    pub from: vk::Rect2D,
    pub to: vk::Rect2D,
}

impl Placement {
    /// Texel for pixel, from the upper left corner, as much as there is of both.
    pub fn one_to_one(picture: vk::Extent2D, window: vk::Extent2D) -> Self {
        let extent = vk::Extent2D {
            width: picture.width.min(window.width),
            height: picture.height.min(window.height),
        };
        let rect = vk::Rect2D {
            offset: vk::Offset2D::default(),
            extent,
        };
        Self {
            from: rect,
            to: rect,
        }
    }
}

/// Pixels of a window, `width` a row.
pub struct Canvas<'a> {
    pub pixels: &'a mut [u8],
    pub row_stride_bytes: usize,
    pub extent: vk::Extent2D,
    pub layout: Layout,
    /// The window would be seen through, and should not be.
    pub is_opaque: bool,
}

/// Draws a picture; what it does not cover becomes black.
///
/// # Safety
/// The picture's memory is alive.
pub unsafe fn draw(picture: &Picture, placement: &Placement, canvas: &mut Canvas<'_>) {
    let window = vk::Rect2D {
        offset: vk::Offset2D::default(),
        extent: canvas.extent,
    };
    if placement.to != window {
        canvas.pixels.fill(0);
    }
    let (from, to) = (placement.from, placement.to);
    let bytes = canvas.layout.bytes();
    let texel_bytes = texel_bytes(picture.format);
    let is_plain = from.extent.width == to.extent.width
        && canvas.layout.is_that_of(picture.format)
        && !canvas.is_opaque;
    let columns: Vec<usize> = (0..to.extent.width)
        .map(|x| nearest(x, to.extent.width, from.extent.width) + from.offset.x as usize)
        .collect();
    for y in 0..to.extent.height {
        let source_y = nearest(y, to.extent.height, from.extent.height) + from.offset.y as usize;
        let start = (to.offset.y as usize + y as usize) * canvas.row_stride_bytes
            + to.offset.x as usize * bytes;
        let row = &mut canvas.pixels[start..][..to.extent.width as usize * bytes];
        // SAFETY: the row is one of the picture's, whose memory is alive (the caller's promise).
        let source = unsafe { picture.data.add(source_y * picture.row_stride_bytes) };
        if is_plain {
            // SAFETY: as many bytes as the row of the picture has from there on.
            unsafe {
                let source = source.add(from.offset.x as usize * texel_bytes);
                source.copy_to_nonoverlapping(row.as_mut_ptr(), row.len());
            }
            continue;
        }
        // SAFETY: the columns are those of the picture.
        unsafe {
            draw_row(
                picture,
                source,
                &columns,
                canvas.layout,
                canvas.is_opaque,
                row,
            )
        };
    }
}

/// The texel whose middle is nearest to a pixel's.
fn nearest(pixel: u32, pixels: u32, texels: u32) -> usize {
    ((2 * u64::from(pixel) + 1) * u64::from(texels) / (2 * u64::from(pixels))) as usize
}

fn texel_bytes(format: vk::Format) -> usize {
    match format {
        vk::Format::R16G16B16A16_SFLOAT => 8,
        vk::Format::R5G6B5_UNORM_PACK16 => 2,
        _ => 4,
    }
}

/// # Safety
/// `source` is a row of the picture, and `columns` are texels of it.
unsafe fn draw_row(
    picture: &Picture,
    source: *const u8,
    columns: &[usize],
    layout: Layout,
    is_opaque: bool,
    row: &mut [u8],
) {
    let eight_bits = |format| {
        matches!(
            format,
            vk::Format::B8G8R8A8_UNORM
                | vk::Format::B8G8R8A8_SRGB
                | vk::Format::R8G8B8A8_UNORM
                | vk::Format::R8G8B8A8_SRGB
        )
    };
    let alpha = if is_opaque { 0xff00_0000 } else { 0 };
    // SAFETY: four bytes of a texel of the row; images lie at multiples of their texels.
    let word = |x: usize| unsafe { source.cast::<u32>().add(x).read() };
    if eight_bits(picture.format) && matches!(layout, Layout::Argb8888 | Layout::Abgr8888) {
        let same = layout.is_that_of(picture.format);
        for (pixel, &x) in row.chunks_exact_mut(4).zip(columns) {
            let word = word(x);
            let swapped = word & 0xff00_ff00 | (word >> 16 & 0xff) | (word & 0xff) << 16;
            let word = if same { word } else { swapped };
            pixel.copy_from_slice(&(word | alpha).to_le_bytes());
        }
        return;
    }
    let floats = float_table(picture.is_linear);
    for (pixel, &x) in row.chunks_exact_mut(layout.bytes()).zip(columns) {
        // SAFETY: a texel of the row.
        let mut components = unsafe { components(picture.format, source, x, floats) };
        if is_opaque {
            components[3] = u16::MAX;
        }
        let packed = layout.pack(components).to_le_bytes();
        pixel.copy_from_slice(&packed[..pixel.len()]);
    }
}

/// Red, green, blue and alpha in 16 bits.
///
/// # Safety
/// `source` is a row with a texel `x` of this format.
unsafe fn components(
    format: vk::Format,
    source: *const u8,
    x: usize,
    floats: &FloatTable,
) -> [u16; 4] {
    let wide = |value: u32, bits: u32| (value * 65535 / ((1 << bits) - 1)) as u16;
    // SAFETY: the texel's own bytes; images lie at multiples of their texels.
    unsafe {
        match format {
            vk::Format::R16G16B16A16_SFLOAT => {
                let texel = source.cast::<[u16; 4]>().add(x).read();
                let color = |index: usize| floats.color[usize::from(texel[index])];
                let alpha = f16::from_bits(texel[3]).to_f32().clamp(0.0, 1.0);
                [color(0), color(1), color(2), (alpha * 65535.0 + 0.5) as u16]
            }
            vk::Format::R5G6B5_UNORM_PACK16 => {
                let word = u32::from(source.cast::<u16>().add(x).read());
                let (r, g, b) = (word >> 11, word >> 5 & 63, word & 31);
                [wide(r, 5), wide(g, 6), wide(b, 5), u16::MAX]
            }
            _ => {
                let word = source.cast::<u32>().add(x).read();
                let byte = |shift: u32| wide(word >> shift & 255, 8);
                let ten = |shift: u32| wide(word >> shift & 1023, 10);
                match format {
                    vk::Format::B8G8R8A8_UNORM | vk::Format::B8G8R8A8_SRGB => {
                        [byte(16), byte(8), byte(0), byte(24)]
                    }
                    vk::Format::A2R10G10B10_UNORM_PACK32 => {
                        [ten(20), ten(10), ten(0), wide(word >> 30, 2)]
                    }
                    vk::Format::A2B10G10R10_UNORM_PACK32 => {
                        [ten(0), ten(10), ten(20), wide(word >> 30, 2)]
                    }
                    _ => [byte(0), byte(8), byte(16), byte(24)],
                }
            }
        }
    }
}

/// What each 16-bit float is in 16 bits, clamped to what a window can show.
struct FloatTable {
    color: Vec<u16>,
}

fn float_table(is_linear: bool) -> &'static FloatTable {
    static TABLES: [OnceLock<FloatTable>; 2] = [OnceLock::new(), OnceLock::new()];
    TABLES[usize::from(is_linear)].get_or_init(|| FloatTable {
        color: (0..=u16::MAX)
            .map(|bits| {
                let value = f64::from(f16::from_bits(bits));
                let value = if is_linear { srgb(value) } else { value };
                // Not a number is black, as the cast has it.
                (value.clamp(0.0, 1.0) * 65535.0 + 0.5) as u16
            })
            .collect(),
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

    fn extent(width: u32, height: u32) -> vk::Extent2D {
        vk::Extent2D { width, height }
    }

    fn drawn(
        format: vk::Format,
        data: &[u8],
        size: vk::Extent2D,
        placement: &Placement,
        window: vk::Extent2D,
        layout: Layout,
        is_opaque: bool,
    ) -> Vec<u8> {
        let picture = Picture {
            data: data.as_ptr(),
            row_stride_bytes: size.width as usize * texel_bytes(format),
            extent: size,
            format,
            is_linear: false,
        };
        let stride = window.width as usize * layout.bytes();
        let mut pixels = vec![0xee; stride * window.height as usize];
        let mut canvas = Canvas {
            pixels: &mut pixels,
            row_stride_bytes: stride,
            extent: window,
            layout,
            is_opaque,
        };
        // SAFETY: `data` lives.
        unsafe { draw(&picture, placement, &mut canvas) };
        pixels
    }

    #[test]
    fn components_change_places_and_widths() {
        let size = extent(1, 1);
        let whole = Placement::one_to_one(size, size);
        let one = |format, data: &[u8], layout, opaque| {
            // Texels are read as words.
            let mut words = [0u64; 1];
            for (index, &byte) in data.iter().enumerate() {
                words[0] |= u64::from(byte) << (8 * index);
            }
            drawn(
                format,
                &words[0].to_le_bytes(),
                size,
                &whole,
                size,
                layout,
                opaque,
            )
        };
        let rgba = vk::Format::R8G8B8A8_UNORM;
        let bgra = vk::Format::B8G8R8A8_SRGB;
        assert_eq!(
            one(rgba, &[1, 2, 3, 4], Layout::Argb8888, false),
            [3, 2, 1, 4]
        );
        assert_eq!(
            one(bgra, &[1, 2, 3, 4], Layout::Argb8888, false),
            [1, 2, 3, 4]
        );
        assert_eq!(
            one(bgra, &[1, 2, 3, 4], Layout::Argb8888, true),
            [1, 2, 3, 255]
        );
        assert_eq!(
            one(bgra, &[0, 255, 0, 4], Layout::Rgb565, false),
            [0xe0, 0x07]
        );
        let ten = (1023u32 << 20 | 512 << 10 | 3 << 30).to_le_bytes();
        let format = vk::Format::A2R10G10B10_UNORM_PACK32;
        assert_eq!(
            one(format, &ten, Layout::Argb8888, false),
            [0, 128, 255, 255]
        );
        let half = |value: f32| f16::from_f32(value).to_le_bytes();
        let texel = [half(2.0), half(-1.0), half(0.5), half(1.0)].concat();
        let format = vk::Format::R16G16B16A16_SFLOAT;
        assert_eq!(
            one(format, &texel, Layout::Argb8888, false),
            [128, 0, 255, 255]
        );
    }

    #[test]
    fn pictures_are_cut_stretched_and_framed() {
        let data: Vec<u8> = (0..4u8).flat_map(|texel| [texel; 4]).collect();
        let format = vk::Format::B8G8R8A8_UNORM;
        let size = extent(2, 2);
        let cut = Placement::one_to_one(size, extent(1, 3));
        let pixels = drawn(
            format,
            &data,
            size,
            &cut,
            extent(1, 3),
            Layout::Argb8888,
            false,
        );
        assert_eq!(pixels, [0, 0, 0, 0, 2, 2, 2, 2, 0, 0, 0, 0]);
        let whole = |extent| vk::Rect2D {
            offset: vk::Offset2D::default(),
            extent,
        };
        let stretch = Placement {
            from: whole(size),
            to: whole(extent(4, 2)),
        };
        let pixels = drawn(
            format,
            &data,
            size,
            &stretch,
            extent(4, 2),
            Layout::Argb8888,
            false,
        );
        let firsts: Vec<u8> = pixels.chunks_exact(4).map(|pixel| pixel[0]).collect();
        assert_eq!(firsts, [0, 0, 1, 1, 2, 2, 3, 3]);
    }

    #[test]
    fn linear_light_is_encoded() {
        // Mid grey of sRGB is 0.5 encoded, 0.21404 linear (IEC 61966-2-1).
        assert!((srgb(0.214_041_14) - 0.5).abs() < 1e-6);
        let table = float_table(true);
        let grey = table.color[usize::from(f16::from_f32(0.214_041_14).to_bits())];
        assert!((f64::from(grey) / 65535.0 - 0.5).abs() < 1e-3);
        assert_eq!(table.color[usize::from(f16::NAN.to_bits())], 0);
    }
}
