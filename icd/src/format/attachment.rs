//! Formats for attachments and vertices, the mandatory ones (chapter Formats, "Required Format
//! Support") among them.

#![forbid(unsafe_code)]

use ash::vk;
use images::format::{FormatInfo, Numeric};

use super::{is_luma_and_chroma, texel_format};

/// Bytes of the texels that tiles load and store.
const TEXEL_BYTES: [u8; 6] = [1, 2, 4, 8, 12, 16];

/// Whether a format is one of colours that can be drawn: every uncompressed one with texels of
/// these sizes, but those of the shared exponent, of 64-bit and scaled components, and those that
/// may be converted from Y′CbCr.
fn is_drawn(format: vk::Format, info: &FormatInfo) -> bool {
    let no_colors = [Numeric::Uscaled, Numeric::Sscaled].contains(&info.numeric)
        || format == vk::Format::E5B9G9R9_UFLOAT_PACK32
        || is_luma_and_chroma(texel_format(format));
    info.is_color()
        && info.blocks().is_none()
        && info.channels.iter().all(|channel| channel.bits < 64)
        && TEXEL_BYTES.contains(&info.size_bytes)
        && !no_colors
}

/// Attachment features of a format.
pub fn image_features(format: vk::Format, info: &FormatInfo) -> vk::FormatFeatureFlags2 {
    use vk::FormatFeatureFlags2 as Feature;
    if info.has_depth || info.has_stencil {
        return Feature::DEPTH_STENCIL_ATTACHMENT;
    }
    let rates = match format {
        vk::Format::R8_UINT => Feature::FRAGMENT_SHADING_RATE_ATTACHMENT_KHR,
        _ => Feature::empty(),
    };
    rates
        | match is_drawn(format, info) {
            false => Feature::empty(),
            // Blending signed fractions amplifies their rounding past what the conformance suite
            // allows.
            true if info.numeric.is_integer() || info.numeric == Numeric::Snorm => {
                Feature::COLOR_ATTACHMENT
            }
            true => Feature::COLOR_ATTACHMENT | Feature::COLOR_ATTACHMENT_BLEND,
        }
}

/// Whether vertex attributes can have a format: all uncompressed colour formats, except sRGB and
/// formats with Y′CbCr conversion.
pub fn is_vertex(format: vk::Format) -> bool {
    let texel = texel_format(format);
    texel.info().is_some_and(|info| {
        info.is_color()
            && info.blocks().is_none()
            && info.numeric != Numeric::Srgb
            && !is_luma_and_chroma(texel)
    })
}
