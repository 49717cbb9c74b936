//! Copies and scales an image's pixels to a window's pixels, in one pass.

use ash::vk;
use lanes::Tier;

use super::conversion::{self, Layout, Texels, texel_bytes};

/// The pixels of a presented image.
#[derive(Clone, Copy)]
pub struct Picture {
    pub data: *const u8,
    pub row_stride_bytes: usize,
    pub extent: vk::Extent2D,
    pub format: vk::Format,
    /// The components are linear light (`VK_COLOR_SPACE_EXTENDED_SRGB_LINEAR_EXT`).
    pub is_linear: bool,
}

// SAFETY: the creator keeps the memory that it points to alive; it is only read.
unsafe impl Send for Picture {}

/// The placement of an image on a window: a part of the image, stretched over a part of the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Placement {
    pub from: vk::Rect2D,
    pub to: vk::Rect2D,
}

impl Placement {
    /// Texel for pixel, from the upper left corner, over the size that both have.
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

/// The pixels of a window.
pub struct Canvas<'a> {
    pub pixels: &'a mut [u8],
    pub row_stride_bytes: usize,
    pub extent: vk::Extent2D,
    pub layout: Layout,
    /// Alpha is set to one, because the window must not be transparent.
    pub is_opaque: bool,
}

/// Draws an image. Pixels outside of it become black.
///
/// # Safety
/// The image's memory is alive.
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
    let tier = Tier::best();
    let is_stretched = from.extent.width != to.extent.width;
    let is_plain = canvas.layout.is_that_of(picture.format) && !canvas.is_opaque;
    let width = to.extent.width as usize;
    let column = |x: u32| nearest(x, to.extent.width, from.extent.width);
    // The texels of a stretched row; 64-bit words, so that each lies at a multiple of its size.
    let mut stretched = vec![0u64; (width * texel_bytes).div_ceil(8)];
    for y in 0..to.extent.height {
        let source_y = nearest(y, to.extent.height, from.extent.height) + from.offset.y as usize;
        let start = (to.offset.y as usize + y as usize) * canvas.row_stride_bytes
            + to.offset.x as usize * bytes;
        let row = &mut canvas.pixels[start..][..width * bytes];
        let first = source_y * picture.row_stride_bytes + from.offset.x as usize * texel_bytes;
        // SAFETY: the offset is inside the image, whose memory the caller keeps alive.
        let mut data = unsafe { picture.data.add(first) };
        if is_stretched {
            let texels = stretched.as_mut_ptr().cast::<u8>();
            for x in 0..width {
                // SAFETY: the texel is inside the image's row, and `row` has room for a texel for
                // each pixel.
                unsafe {
                    let source = data.add(column(x as u32) * texel_bytes);
                    source.copy_to_nonoverlapping(texels.add(x * texel_bytes), texel_bytes);
                }
            }
            data = stretched.as_ptr().cast();
        }
        if is_plain {
            // SAFETY: the slice has as many bytes as the row of texels.
            unsafe { data.copy_to_nonoverlapping(row.as_mut_ptr(), row.len()) };
            continue;
        }
        let texels = Texels {
            data,
            count: width,
            format: picture.format,
            is_linear: picture.is_linear,
        };
        // SAFETY: the pointer leads to a row's texels; images are aligned to their texel size.
        unsafe { conversion::convert(tier, texels, canvas.layout, canvas.is_opaque, row) };
    }
}

/// The index of the texel whose center is nearest to a pixel's center.
fn nearest(pixel: u32, pixels: u32, texels: u32) -> usize {
    ((2 * u64::from(pixel) + 1) * u64::from(texels) / (2 * u64::from(pixels))) as usize
}

#[cfg(test)]
mod tests {
    use half::f16;

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
}
