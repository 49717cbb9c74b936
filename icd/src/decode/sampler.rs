//! `VkSamplerCreateInfo` to a sampler descriptor.

use ash::vk;
use images::{AddressMode, CompareOp, Filter, Reduction, SamplerDescriptor};

use crate::ffi::chain;

fn filter(filter: vk::Filter) -> Filter {
    if filter == vk::Filter::LINEAR {
        Filter::Linear
    } else {
        Filter::Nearest
    }
}

fn address_mode(mode: vk::SamplerAddressMode) -> AddressMode {
    match mode {
        vk::SamplerAddressMode::MIRRORED_REPEAT => AddressMode::MirroredRepeat,
        vk::SamplerAddressMode::CLAMP_TO_EDGE => AddressMode::ClampToEdge,
        vk::SamplerAddressMode::CLAMP_TO_BORDER => AddressMode::ClampToBorder,
        vk::SamplerAddressMode::MIRROR_CLAMP_TO_EDGE => AddressMode::MirrorClampToEdge,
        _ => AddressMode::Repeat,
    }
}

fn compare(op: vk::CompareOp) -> CompareOp {
    match op {
        vk::CompareOp::LESS => CompareOp::Less,
        vk::CompareOp::EQUAL => CompareOp::Equal,
        vk::CompareOp::LESS_OR_EQUAL => CompareOp::LessOrEqual,
        vk::CompareOp::GREATER => CompareOp::Greater,
        vk::CompareOp::NOT_EQUAL => CompareOp::NotEqual,
        vk::CompareOp::GREATER_OR_EQUAL => CompareOp::GreaterOrEqual,
        vk::CompareOp::ALWAYS => CompareOp::Always,
        _ => CompareOp::Never,
    }
}

fn border_color(color: vk::BorderColor) -> [u32; 4] {
    const ONE: u32 = 1f32.to_bits();
    match color {
        vk::BorderColor::FLOAT_OPAQUE_BLACK => [0, 0, 0, ONE],
        vk::BorderColor::INT_OPAQUE_BLACK => [0, 0, 0, 1],
        vk::BorderColor::FLOAT_OPAQUE_WHITE => [ONE; 4],
        vk::BorderColor::INT_OPAQUE_WHITE => [1; 4],
        _ => [0; 4],
    }
}

/// The border color of a sampler, or its custom one.
///
/// # Safety
/// `info` is valid usage of `vkCreateSampler`.
unsafe fn border(info: &vk::SamplerCreateInfo<'_>) -> [u32; 4] {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkCreateSampler`. A clear color
    // is four words, whatever they mean.
    unsafe {
        chain::find::<vk::SamplerCustomBorderColorCreateInfoEXT>(info.p_next)
            .filter(|_| info.border_color.as_raw() >= vk::BorderColor::FLOAT_CUSTOM_EXT.as_raw())
            .map_or_else(
                || border_color(info.border_color),
                |custom| custom.custom_border_color.uint32,
            )
    }
}

/// Decodes a sampler.
///
/// # Safety
/// `info` is valid usage of `vkCreateSampler`.
pub unsafe fn decode_sampler(info: &vk::SamplerCreateInfo<'_>) -> SamplerDescriptor {
    // SAFETY: the caller guarantees that `info` is valid usage of `vkCreateSampler`.
    let (border_color, reduction) = unsafe {
        let reduction = chain::find::<vk::SamplerReductionModeCreateInfo>(info.p_next);
        (border(info), reduction.map(|it| it.reduction_mode))
    };
    SamplerDescriptor {
        mag_filter: filter(info.mag_filter),
        min_filter: filter(info.min_filter),
        mipmap_mode: if info.mipmap_mode == vk::SamplerMipmapMode::LINEAR {
            Filter::Linear
        } else {
            Filter::Nearest
        },
        address_mode: [
            info.address_mode_u,
            info.address_mode_v,
            info.address_mode_w,
        ]
        .map(address_mode),
        mip_lod_bias: info.mip_lod_bias,
        min_lod: info.min_lod,
        max_lod: info.max_lod,
        max_anisotropy: if info.anisotropy_enable == vk::TRUE {
            info.max_anisotropy
        } else {
            1.0
        },
        compare: (info.compare_enable == vk::TRUE).then(|| compare(info.compare_op)),
        reduction: match reduction {
            Some(vk::SamplerReductionMode::MIN) => Reduction::Min,
            Some(vk::SamplerReductionMode::MAX) => Reduction::Max,
            _ => Reduction::WeightedAverage,
        },
        border_color,
        unnormalized_coordinates: info.unnormalized_coordinates == vk::TRUE,
        non_seamless: info
            .flags
            .contains(vk::SamplerCreateFlags::NON_SEAMLESS_CUBE_MAP_EXT),
    }
}
