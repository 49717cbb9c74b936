//! The table of formats: texel size, planes, and what each can be used for.

#![forbid(unsafe_code)]

use ash::vk;

/// Bytes of a texel of a format with one plane; 0 if the format is not supported.
pub fn texel_size_bytes(format: vk::Format) -> u64 {
    row(format).map_or(0, |row| row.1)
}

/// The planes of a format: one, or depth and stencil apart.
pub fn planes(format: vk::Format) -> Vec<(vk::ImageAspectFlags, vk::Format)> {
    use vk::ImageAspectFlags as Aspect;
    match format {
        vk::Format::D32_SFLOAT | vk::Format::D16_UNORM | vk::Format::X8_D24_UNORM_PACK32 => {
            vec![(Aspect::DEPTH, format)]
        }
        vk::Format::S8_UINT => vec![(Aspect::STENCIL, format)],
        vk::Format::D32_SFLOAT_S8_UINT => {
            vec![
                (Aspect::DEPTH, vk::Format::D32_SFLOAT),
                (Aspect::STENCIL, vk::Format::S8_UINT),
            ]
        }
        vk::Format::D24_UNORM_S8_UINT => {
            vec![
                (Aspect::DEPTH, vk::Format::X8_D24_UNORM_PACK32),
                (Aspect::STENCIL, vk::Format::S8_UINT),
            ]
        }
        vk::Format::D16_UNORM_S8_UINT => {
            vec![
                (Aspect::DEPTH, vk::Format::D16_UNORM),
                (Aspect::STENCIL, vk::Format::S8_UINT),
            ]
        }
        _ => vec![(Aspect::COLOR, format)],
    }
}

/// What a format can be used for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Features {
    /// Images, of either tiling: they are stored the same way.
    pub image: vk::FormatFeatureFlags2,
    pub buffer: vk::FormatFeatureFlags2,
}

/// A format's features; empty if it is not supported.
pub fn features(format: vk::Format) -> Features {
    row(format).map_or(Features::default(), |row| row.2)
}

type Row = (vk::Format, u64, Features);

fn row(format: vk::Format) -> Option<&'static Row> {
    TABLE.iter().find(|row| row.0 == format)
}

const NO_FEATURES: Features = Features {
    image: vk::FormatFeatureFlags2::empty(),
    buffer: vk::FormatFeatureFlags2::empty(),
};

const TABLE: &[Row] = &[
    (vk::Format::R8G8B8A8_UNORM, 4, NO_FEATURES),
    (vk::Format::R32_UINT, 4, NO_FEATURES),
    (vk::Format::R32G32B32A32_SFLOAT, 16, NO_FEATURES),
];
