//! Formats for attachments, and vertices: those that the specification makes mandatory (chapter Formats, "Required Format Support"), which
//! it does for every implementation, with a graphics queue or without. Images of them are created, viewed, cleared, copied and bound to
//! framebuffers like any other.

#![forbid(unsafe_code)]

use ash::vk;
use spirv_jit::image::format::Numeric;

use super::texel_format;

/// `VK_FORMAT_FEATURE_COLOR_ATTACHMENT_BIT` and `…_BLEND_BIT`.
#[rustfmt::skip]
const BLENDED: [vk::Format; 14] = [
    vk::Format::R5G6B5_UNORM_PACK16, vk::Format::A1R5G5B5_UNORM_PACK16,
    vk::Format::R8_UNORM, vk::Format::R8G8_UNORM, vk::Format::R8G8B8A8_UNORM, vk::Format::R8G8B8A8_SRGB,
    vk::Format::B8G8R8A8_UNORM, vk::Format::B8G8R8A8_SRGB,
    vk::Format::A8B8G8R8_UNORM_PACK32, vk::Format::A8B8G8R8_SRGB_PACK32, vk::Format::A2B10G10R10_UNORM_PACK32,
    vk::Format::R16_SFLOAT, vk::Format::R16G16_SFLOAT, vk::Format::R16G16B16A16_SFLOAT,
];

/// `VK_FORMAT_FEATURE_COLOR_ATTACHMENT_BIT` alone.
#[rustfmt::skip]
const NOT_BLENDED: [vk::Format; 24] = [
    vk::Format::R8_UINT, vk::Format::R8_SINT, vk::Format::R8G8_UINT, vk::Format::R8G8_SINT,
    vk::Format::R8G8B8A8_UINT, vk::Format::R8G8B8A8_SINT,
    vk::Format::A8B8G8R8_UINT_PACK32, vk::Format::A8B8G8R8_SINT_PACK32, vk::Format::A2B10G10R10_UINT_PACK32,
    vk::Format::R16_UINT, vk::Format::R16_SINT, vk::Format::R16G16_UINT, vk::Format::R16G16_SINT,
    vk::Format::R16G16B16A16_UINT, vk::Format::R16G16B16A16_SINT,
    vk::Format::R32_UINT, vk::Format::R32_SINT, vk::Format::R32_SFLOAT,
    vk::Format::R32G32_UINT, vk::Format::R32G32_SINT, vk::Format::R32G32_SFLOAT,
    vk::Format::R32G32B32A32_UINT, vk::Format::R32G32B32A32_SINT, vk::Format::R32G32B32A32_SFLOAT,
];

/// What a format is as an attachment.
pub fn image_features(format: vk::Format) -> vk::FormatFeatureFlags2 {
    use vk::FormatFeatureFlags2 as Feature;
    match format {
        vk::Format::D16_UNORM
        | vk::Format::X8_D24_UNORM_PACK32
        | vk::Format::D32_SFLOAT
        | vk::Format::S8_UINT
        | vk::Format::D24_UNORM_S8_UINT
        | vk::Format::D32_SFLOAT_S8_UINT => Feature::DEPTH_STENCIL_ATTACHMENT,
        format if BLENDED.contains(&format) => {
            Feature::COLOR_ATTACHMENT | Feature::COLOR_ATTACHMENT_BLEND
        }
        format if NOT_BLENDED.contains(&format) => Feature::COLOR_ATTACHMENT,
        _ => Feature::empty(),
    }
}

/// Whether vertices come in a format: all of whole texels that are colours, but for sRGB and the shared exponent.
pub fn is_vertex(format: vk::Format) -> bool {
    let core = vk::Format::R4G4_UNORM_PACK8..vk::Format::E5B9G9R9_UFLOAT_PACK32;
    let info = texel_format(format).info();
    core.contains(&format) && info.is_some_and(|info| info.numeric != Numeric::Srgb)
}
