//! The uses of each format, derived from its texel description in `images::format`.

#![forbid(unsafe_code)]

mod attachment;
pub mod structure;

use ash::vk;
use images::Format;
use images::format::{Aspect, FormatInfo, Numeric};
use images::ycbcr::Planes;

use self::structure::radius_format;
use self::structure::vertex_format;
use crate::ffi::vk::{
    FORMAT_FEATURE_2_ACCELERATION_STRUCTURE_RADIUS_BUFFER_NV,
    FORMAT_FEATURE_2_COPY_IMAGE_INDIRECT_DST_KHR,
};

/// A Vulkan format as the image code knows it.
pub fn texel_format(format: vk::Format) -> Format {
    Format(format.as_raw() as u32)
}

/// Bytes of a texel of a format with one plane, of a block in compressed ones; 0 if the format is
/// not supported.
pub fn texel_size_bytes(format: vk::Format) -> u64 {
    texel_format(format).size_bytes() as u64
}

/// Width and height of a block in texels: 1×1 unless the format is compressed.
pub fn block_extent(format: vk::Format) -> [u32; 2] {
    texel_format(format)
        .info()
        .map_or([1, 1], FormatInfo::block_extent)
}

/// The planes of a format that needs a sampler Y′CbCr conversion.
pub fn ycbcr_planes(format: vk::Format) -> Option<Planes> {
    Planes::of(texel_format(format)).filter(Planes::requires_conversion)
}

/// How a plane of a format is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlaneFormat {
    pub aspect: vk::ImageAspectFlags,
    pub format: vk::Format,
    /// Texels of the plane for which one of the format is stored.
    pub block_extent: [u32; 2],
    /// Whether it has half the image's width, half its height.
    pub halved: [bool; 2],
}

/// The planes of a format: one, depth and stencil apart, or luma and chroma. None for formats that
/// are not supported.
pub fn planes(format: vk::Format) -> Vec<PlaneFormat> {
    match ycbcr_planes(format) {
        Some(planes) if planes.memory_count() == 1 => {
            // A pair of texels shares its chroma: the format of the second plane has all four
            // components.
            let pair = vk::Format::from_raw(planes.planes[1].format.0 as i32);
            vec![PlaneFormat {
                aspect: vk::ImageAspectFlags::COLOR,
                format: pair,
                block_extent: [2, 1],
                halved: [false; 2],
            }]
        }
        Some(planes) => planes
            .planes()
            .iter()
            .zip(PLANE_ASPECTS)
            .map(|(plane, aspect)| PlaneFormat {
                aspect,
                format: vk::Format::from_raw(plane.format.0 as i32),
                block_extent: [1, 1],
                halved: plane.halved,
            })
            .collect(),
        None => aspect_planes(format)
            .into_iter()
            .map(|(aspect, format)| PlaneFormat {
                aspect,
                format,
                block_extent: block_extent(format),
                halved: [false; 2],
            })
            .collect(),
    }
}

/// The aspects of multi-planar formats.
pub const PLANE_ASPECTS: [vk::ImageAspectFlags; 3] = [
    vk::ImageAspectFlags::PLANE_0,
    vk::ImageAspectFlags::PLANE_1,
    vk::ImageAspectFlags::PLANE_2,
];

/// Colour, depth and stencil, those that a format has.
fn aspect_planes(format: vk::Format) -> Vec<(vk::ImageAspectFlags, vk::Format)> {
    const ASPECTS: [(Aspect, vk::ImageAspectFlags); 3] = [
        (Aspect::Color, vk::ImageAspectFlags::COLOR),
        (Aspect::Depth, vk::ImageAspectFlags::DEPTH),
        (Aspect::Stencil, vk::ImageAspectFlags::STENCIL),
    ];
    ASPECTS
        .into_iter()
        .filter_map(|(aspect, bit)| {
            let plane = texel_format(format).plane(aspect)?;
            Some((bit, vk::Format::from_raw(plane.0 as i32)))
        })
        .collect()
}

/// The uses of a format.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Features {
    /// Images, of either tiling: they are stored the same way.
    pub image: vk::FormatFeatureFlags2,
    pub buffer: vk::FormatFeatureFlags2,
}

/// A format's features; empty if it is not supported.
pub fn features(format: vk::Format) -> Features {
    if let Some(planes) = ycbcr_planes(format) {
        return Features {
            image: ycbcr_features(&planes),
            buffer: vk::FormatFeatureFlags2::empty(),
        };
    }
    let texel = texel_format(format);
    let Some(info) = texel.info() else {
        return Features::default();
    };
    let mut features = Features {
        image: image_features(texel, info) | attachment::image_features(format, info),
        buffer: buffer_features(texel, info),
    };
    if attachment::is_vertex(format) {
        features.buffer |= vk::FormatFeatureFlags2::VERTEX_BUFFER;
    }
    if vertex_format(format).is_some() {
        features.buffer |= vk::FormatFeatureFlags2::ACCELERATION_STRUCTURE_VERTEX_BUFFER_KHR;
    }
    if radius_format(format).is_some() {
        features.buffer |= FORMAT_FEATURE_2_ACCELERATION_STRUCTURE_RADIUS_BUFFER_NV;
    }
    features
}

fn is_scaled(info: &FormatInfo) -> bool {
    matches!(info.numeric, Numeric::Uscaled | Numeric::Sscaled)
}

/// 64-bit components: single integers are there for `shaderImageInt64Atomics`, the rest for
/// vertices.
fn is_wide(info: &FormatInfo) -> bool {
    info.channels[0].bits == 64
}

/// Formats with texels of a power of two of bytes and components of whole bytes, the packed ones of
/// graphics' storage images, and those of one or two padded components.
fn is_storable(texel: Format, info: &FormatInfo) -> bool {
    const PACKED: [Format; 7] = [
        Format::A2B10G10R10_UNORM_PACK32,
        Format::A2B10G10R10_UINT_PACK32,
        Format::B10G11R11_UFLOAT_PACK32,
        Format::R10X6_UNORM_PACK16,
        Format::R10X6G10X6_UNORM_2PACK16,
        Format::R12X4_UNORM_PACK16,
        Format::R12X4G12X4_UNORM_2PACK16,
    ];
    let has_whole_bytes = info
        .channels
        .iter()
        .all(|channel| channel.bits % 8 == 0 && channel.offset % 8 == 0);
    let regular = has_whole_bytes && info.component_count() != 3;
    info.is_color()
        && info.blocks().is_none()
        && info.numeric != Numeric::Srgb
        && !is_scaled(info)
        && (regular || PACKED.contains(&texel))
}

fn has_atomics(texel: Format) -> bool {
    [
        Format::R32_UINT,
        Format::R32_SINT,
        Format::R32_SFLOAT,
        Format::R64_UINT,
        Format::R64_SINT,
    ]
    .contains(&texel)
}

/// Formats of one plane without subsampling that may be converted, which are not blitted (section
/// "Formats Requiring Sampler Y′CBCR Conversion").
fn is_luma_and_chroma(texel: Format) -> bool {
    [
        Format::R10X6G10X6B10X6A10X6_UNORM_4PACK16,
        Format::R12X4G12X4B12X4A12X4_UNORM_4PACK16,
    ]
    .contains(&texel)
}

fn image_features(texel: Format, info: &FormatInfo) -> vk::FormatFeatureFlags2 {
    use vk::FormatFeatureFlags2 as Feature;
    let transfer = Feature::TRANSFER_SRC
        | Feature::TRANSFER_DST
        | Feature::HOST_IMAGE_TRANSFER_EXT
        | FORMAT_FEATURE_2_COPY_IMAGE_INDIRECT_DST_KHR;
    let storage = Feature::STORAGE_IMAGE
        | Feature::STORAGE_READ_WITHOUT_FORMAT
        | Feature::STORAGE_WRITE_WITHOUT_FORMAT;
    if is_scaled(info) {
        return Feature::empty();
    }
    if is_wide(info) {
        return match has_atomics(texel) {
            true => transfer | storage | Feature::STORAGE_IMAGE_ATOMIC,
            // Copied and cleared, but not read by shaders, whose texels have one component of 64
            // bits at the most.
            false if info.size_bytes.is_power_of_two() => transfer,
            false => Feature::empty(),
        };
    }
    let mut features = transfer | Feature::SAMPLED_IMAGE;
    if !is_luma_and_chroma(texel) {
        features |= Feature::BLIT_SRC;
        if info.blocks().is_none() {
            features |= Feature::BLIT_DST;
        }
    }
    if !info.numeric.is_integer() {
        features |= Feature::SAMPLED_IMAGE_FILTER_LINEAR | Feature::SAMPLED_IMAGE_FILTER_MINMAX;
    }
    if info.has_depth {
        features |= Feature::SAMPLED_IMAGE_DEPTH_COMPARISON;
    }
    if is_storable(texel, info) {
        features |= storage;
    }
    if has_atomics(texel) {
        features |= Feature::STORAGE_IMAGE_ATOMIC;
    }
    features
}

/// Of formats that need a conversion. Reconstruction is implicit.
fn ycbcr_features(planes: &Planes) -> vk::FormatFeatureFlags2 {
    use vk::FormatFeatureFlags2 as Feature;
    let features = Feature::TRANSFER_SRC
        | Feature::TRANSFER_DST
        | Feature::HOST_IMAGE_TRANSFER_EXT
        | FORMAT_FEATURE_2_COPY_IMAGE_INDIRECT_DST_KHR
        | Feature::SAMPLED_IMAGE
        | Feature::SAMPLED_IMAGE_FILTER_LINEAR
        | Feature::MIDPOINT_CHROMA_SAMPLES
        | Feature::COSITED_CHROMA_SAMPLES
        | Feature::SAMPLED_IMAGE_YCBCR_CONVERSION_LINEAR_FILTER
        | Feature::SAMPLED_IMAGE_YCBCR_CONVERSION_SEPARATE_RECONSTRUCTION_FILTER;
    match planes.memory_count() {
        1 => features,
        _ => features | Feature::DISJOINT,
    }
}

fn buffer_features(texel: Format, info: &FormatInfo) -> vk::FormatFeatureFlags2 {
    use vk::FormatFeatureFlags2 as Feature;
    let mut features = Feature::empty();
    if is_storable(texel, info) && (!is_wide(info) || has_atomics(texel)) {
        features |= Feature::UNIFORM_TEXEL_BUFFER
            | Feature::STORAGE_TEXEL_BUFFER
            | Feature::STORAGE_READ_WITHOUT_FORMAT
            | Feature::STORAGE_WRITE_WITHOUT_FORMAT;
    }
    if info.is_color()
        && info.blocks().is_none()
        && !is_scaled(info)
        && !is_wide(info)
        && !is_luma_and_chroma(texel)
    {
        features |= Feature::UNIFORM_TEXEL_BUFFER;
    }
    if has_atomics(texel) {
        features |= Feature::STORAGE_TEXEL_BUFFER_ATOMIC;
    }
    features
}

#[cfg(test)]
mod tests {
    use super::*;
    use vk::FormatFeatureFlags2 as Feature;

    /// Spec, "Required Format Support", for what there is without rasterization.
    #[test]
    fn required_features_are_there() {
        let storage = Feature::STORAGE_IMAGE | Feature::STORAGE_TEXEL_BUFFER;
        let has = |format: vk::Format, image: Feature, buffer: Feature| {
            let features = features(format);
            assert!(
                features.image.contains(image),
                "{format:?} {:?}",
                features.image
            );
            assert!(
                features.buffer.contains(buffer),
                "{format:?} {:?}",
                features.buffer
            );
        };
        for format in [
            vk::Format::R8G8B8A8_UNORM,
            vk::Format::R8G8B8A8_SNORM,
            vk::Format::R8G8B8A8_UINT,
            vk::Format::R8G8B8A8_SINT,
            vk::Format::R16G16B16A16_UINT,
            vk::Format::R16G16B16A16_SINT,
            vk::Format::R16G16B16A16_SFLOAT,
            vk::Format::R32_UINT,
            vk::Format::R32_SINT,
            vk::Format::R32_SFLOAT,
            vk::Format::R32G32_UINT,
            vk::Format::R32G32_SINT,
            vk::Format::R32G32_SFLOAT,
            vk::Format::R32G32B32A32_UINT,
            vk::Format::R32G32B32A32_SINT,
            vk::Format::R32G32B32A32_SFLOAT,
        ] {
            has(
                format,
                Feature::STORAGE_IMAGE
                    | Feature::SAMPLED_IMAGE
                    | Feature::BLIT_SRC
                    | Feature::TRANSFER_DST,
                Feature::STORAGE_TEXEL_BUFFER | Feature::UNIFORM_TEXEL_BUFFER,
            );
        }
        for format in [
            vk::Format::B4G4R4A4_UNORM_PACK16,
            vk::Format::R5G6B5_UNORM_PACK16,
            vk::Format::A1R5G5B5_UNORM_PACK16,
            vk::Format::R8_UNORM,
            vk::Format::R8G8_SNORM,
            vk::Format::R8G8B8A8_SRGB,
            vk::Format::B8G8R8A8_UNORM,
            vk::Format::B8G8R8A8_SRGB,
            vk::Format::A8B8G8R8_UNORM_PACK32,
            vk::Format::A2B10G10R10_UNORM_PACK32,
            vk::Format::R16_SFLOAT,
            vk::Format::R16G16B16A16_SFLOAT,
            vk::Format::B10G11R11_UFLOAT_PACK32,
            vk::Format::E5B9G9R9_UFLOAT_PACK32,
        ] {
            has(
                format,
                Feature::SAMPLED_IMAGE_FILTER_LINEAR | Feature::BLIT_SRC | Feature::TRANSFER_SRC,
                Feature::empty(),
            );
        }
        for format in [
            vk::Format::B8G8R8A8_UNORM,
            vk::Format::A8B8G8R8_SINT_PACK32,
            vk::Format::A2B10G10R10_UNORM_PACK32,
            vk::Format::A2B10G10R10_UINT_PACK32,
            vk::Format::B10G11R11_UFLOAT_PACK32,
            vk::Format::R16_UINT,
        ] {
            has(
                format,
                Feature::SAMPLED_IMAGE,
                Feature::UNIFORM_TEXEL_BUFFER,
            );
        }
        // The latter ones with shaderImageFloat32Atomics and shaderImageInt64Atomics.
        for format in [
            vk::Format::R32_UINT,
            vk::Format::R32_SINT,
            vk::Format::R32_SFLOAT,
            vk::Format::R64_UINT,
            vk::Format::R64_SINT,
        ] {
            has(
                format,
                Feature::STORAGE_IMAGE_ATOMIC,
                Feature::STORAGE_TEXEL_BUFFER_ATOMIC,
            );
        }
        has(
            vk::Format::D16_UNORM,
            Feature::SAMPLED_IMAGE | Feature::BLIT_SRC,
            Feature::empty(),
        );
        has(
            vk::Format::D32_SFLOAT,
            Feature::SAMPLED_IMAGE_DEPTH_COMPARISON,
            Feature::empty(),
        );
        // VUs of vkCmdBuildAccelerationStructuresKHR: what every implementation takes.
        for format in [
            vk::Format::R32G32_SFLOAT,
            vk::Format::R32G32B32_SFLOAT,
            vk::Format::R16G16_SFLOAT,
            vk::Format::R16G16B16A16_SFLOAT,
            vk::Format::R16G16_SNORM,
            vk::Format::R16G16B16A16_SNORM,
        ] {
            has(
                format,
                Feature::empty(),
                Feature::ACCELERATION_STRUCTURE_VERTEX_BUFFER_KHR,
            );
        }
        assert!(
            !features(vk::Format::R8G8B8A8_SRGB)
                .image
                .intersects(storage)
        );
        // textureCompressionBC, ETC2 and ASTC_LDR: all formats of each, and nothing writes them but
        // copies.
        for raw in
            vk::Format::BC1_RGB_UNORM_BLOCK.as_raw()..=vk::Format::ASTC_12X12_SRGB_BLOCK.as_raw()
        {
            let format = vk::Format::from_raw(raw);
            has(
                format,
                Feature::SAMPLED_IMAGE
                    | Feature::SAMPLED_IMAGE_FILTER_LINEAR
                    | Feature::BLIT_SRC
                    | Feature::TRANSFER_SRC
                    | Feature::TRANSFER_DST,
                Feature::empty(),
            );
            let written = storage | Feature::BLIT_DST | Feature::COLOR_ATTACHMENT;
            assert!(!features(format).image.intersects(written));
            assert!(features(format).buffer.is_empty());
        }
        assert_eq!(features(vk::Format::UNDEFINED), Features::default());
    }

    #[test]
    fn luma_and_chroma_are_planes() {
        let of = |format| -> Vec<_> {
            let planes = planes(format);
            planes
                .into_iter()
                .map(|it| (it.aspect, it.format, it.halved))
                .collect()
        };
        assert_eq!(
            of(vk::Format::G10X6_B10X6R10X6_2PLANE_422_UNORM_3PACK16),
            [
                (
                    PLANE_ASPECTS[0],
                    vk::Format::R10X6_UNORM_PACK16,
                    [false, false]
                ),
                (
                    PLANE_ASPECTS[1],
                    vk::Format::R10X6G10X6_UNORM_2PACK16,
                    [true, false]
                ),
            ]
        );
        assert_eq!(of(vk::Format::G8_B8_R8_3PLANE_420_UNORM).len(), 3);
        let pairs = planes(vk::Format::B16G16R16G16_422_UNORM);
        assert_eq!(pairs[0].format, vk::Format::R16G16B16A16_UNORM);
        assert_eq!((pairs.len(), pairs[0].block_extent), (1, [2, 1]));
        // "Required Format Support": these two, with one location of chroma.
        for format in [
            vk::Format::G8_B8R8_2PLANE_420_UNORM,
            vk::Format::G8_B8_R8_3PLANE_420_UNORM,
        ] {
            let features = features(format).image;
            let needed = Feature::TRANSFER_SRC | Feature::TRANSFER_DST | Feature::SAMPLED_IMAGE;
            assert!(features.contains(needed | Feature::MIDPOINT_CHROMA_SAMPLES));
        }
    }

    #[test]
    fn depth_and_stencil_are_planes() {
        use vk::ImageAspectFlags as Bits;
        let planes = aspect_planes;
        assert_eq!(
            planes(vk::Format::D24_UNORM_S8_UINT),
            [
                (Bits::DEPTH, vk::Format::X8_D24_UNORM_PACK32),
                (Bits::STENCIL, vk::Format::S8_UINT)
            ]
        );
        assert_eq!(
            planes(vk::Format::R8_UNORM),
            [(Bits::COLOR, vk::Format::R8_UNORM)]
        );
        assert_eq!(planes(vk::Format::ASTC_5X4_SFLOAT_BLOCK), []);
    }
}
