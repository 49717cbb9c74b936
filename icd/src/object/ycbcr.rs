//! Sampler Y′CbCr conversions.

#![forbid(unsafe_code)]

use ash::vk;
use images::Filter;
use images::ycbcr::{Conversion, Model, Planes};

use super::image_view::swizzle;
use crate::VkResult;
use crate::format::texel_format;

/// A conversion, in the form that views hold.
pub struct YcbcrConversion {
    pub conversion: Conversion,
}

impl YcbcrConversion {
    /// # Errors
    /// `VK_ERROR_FORMAT_NOT_SUPPORTED`.
    pub fn new(info: &vk::SamplerYcbcrConversionCreateInfo<'_>) -> VkResult<Self> {
        let planes = Planes::of(texel_format(info.format));
        let is_midpoint = |location: vk::ChromaLocation| location == vk::ChromaLocation::MIDPOINT;
        let conversion = Conversion {
            planes: planes.ok_or(vk::Result::ERROR_FORMAT_NOT_SUPPORTED)?,
            model: match info.ycbcr_model {
                vk::SamplerYcbcrModelConversion::YCBCR_IDENTITY => Model::YcbcrIdentity,
                vk::SamplerYcbcrModelConversion::YCBCR_709 => Model::Bt709,
                vk::SamplerYcbcrModelConversion::YCBCR_601 => Model::Bt601,
                vk::SamplerYcbcrModelConversion::YCBCR_2020 => Model::Bt2020,
                _ => Model::RgbIdentity,
            },
            narrow: info.ycbcr_range == vk::SamplerYcbcrRange::ITU_NARROW,
            swizzle: swizzle(info.components),
            midpoint: [
                is_midpoint(info.x_chroma_offset),
                is_midpoint(info.y_chroma_offset),
            ],
            chroma_filter: match info.chroma_filter {
                vk::Filter::LINEAR => Filter::Linear,
                _ => Filter::Nearest,
            },
        };
        Ok(Self { conversion })
    }
}
