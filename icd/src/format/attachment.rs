//! Formats for attachments and vertices, the mandatory ones (chapter Formats, "Required Format Support") among them.

#![forbid(unsafe_code)]

use ash::vk;
use spirv_jit::image::format::{FormatInfo, Numeric};

use super::texel_format;

/// Bytes of the texels that tiles load and store.
const TEXEL_BYTES: [u8; 5] = [1, 2, 4, 8, 16];

/// Formats whose components have bits that mean nothing.
const PADDED: [vk::Format; 6] = [
    vk::Format::R10X6_UNORM_PACK16,
    vk::Format::R10X6G10X6_UNORM_2PACK16,
    vk::Format::R10X6G10X6B10X6A10X6_UNORM_4PACK16,
    vk::Format::R12X4_UNORM_PACK16,
    vk::Format::R12X4G12X4_UNORM_2PACK16,
    vk::Format::R12X4G12X4B12X4A12X4_UNORM_4PACK16,
];

/// Whether a format is one of colours that can be drawn: every uncompressed one whose texels have a power of two of bytes, but those of the
/// shared exponent, of 64-bit, scaled and padded components.
fn is_drawn(format: vk::Format, info: &FormatInfo) -> bool {
    let no_colors = [Numeric::Uscaled, Numeric::Sscaled].contains(&info.numeric)
        || format == vk::Format::E5B9G9R9_UFLOAT_PACK32
        || PADDED.contains(&format);
    info.is_color()
        && info.blocks().is_none()
        && info.channels.iter().all(|channel| channel.bits < 64)
        && TEXEL_BYTES.contains(&info.size_bytes)
        && !no_colors
}

/// What a format is as an attachment.
pub fn image_features(format: vk::Format, info: &FormatInfo) -> vk::FormatFeatureFlags2 {
    use vk::FormatFeatureFlags2 as Feature;
    if info.has_depth || info.has_stencil {
        return Feature::DEPTH_STENCIL_ATTACHMENT;
    }
    match is_drawn(format, info) {
        false => Feature::empty(),
        // Blending signed fractions amplifies their rounding past what the conformance suite allows.
        true if info.numeric.is_integer() || info.numeric == Numeric::Snorm => {
            Feature::COLOR_ATTACHMENT
        }
        true => Feature::COLOR_ATTACHMENT | Feature::COLOR_ATTACHMENT_BLEND,
    }
}

/// Whether vertices come in a format: all of whole texels that are colours, but for sRGB and the shared exponent.
pub fn is_vertex(format: vk::Format) -> bool {
    let core = vk::Format::R4G4_UNORM_PACK8..vk::Format::E5B9G9R9_UFLOAT_PACK32;
    let info = texel_format(format).info();
    core.contains(&format) && info.is_some_and(|info| info.numeric != Numeric::Srgb)
}
