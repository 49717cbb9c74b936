//! The formats of vertices and radii that structures are built from, and the sizes of what builds
//! read.
#![forbid(unsafe_code)]

use ash::vk;
use traversal::{IndexType, RadiusFormat, VertexFormat};

/// Largest position: four 64-bit components.
pub const MAX_VERTEX_BYTES: u64 = 32;

/// Bytes of an index.
pub fn index_size_bytes(ty: IndexType) -> u64 {
    match ty {
        IndexType::None => 0,
        IndexType::U8 => 1,
        IndexType::U16 => 2,
        IndexType::U32 => 4,
    }
}

/// The vertex formats that structures are built from, by `VkFormat`; those with
/// `VK_FORMAT_FEATURE_ACCELERATION_STRUCTURE_VERTEX_BUFFER_BIT_KHR`.
pub fn vertex_format(format: vk::Format) -> Option<VertexFormat> {
    Some(match format {
        vk::Format::R32G32_SFLOAT => VertexFormat::F32x2,
        vk::Format::R32G32B32_SFLOAT => VertexFormat::F32x3,
        vk::Format::R32G32B32A32_SFLOAT => VertexFormat::F32x4,
        vk::Format::R16G16_SFLOAT => VertexFormat::F16x2,
        vk::Format::R16G16B16_SFLOAT => VertexFormat::F16x3,
        vk::Format::R16G16B16A16_SFLOAT => VertexFormat::F16x4,
        vk::Format::R64G64_SFLOAT => VertexFormat::F64x2,
        vk::Format::R64G64B64_SFLOAT => VertexFormat::F64x3,
        vk::Format::R64G64B64A64_SFLOAT => VertexFormat::F64x4,
        vk::Format::R8G8_SNORM => VertexFormat::Snorm8x2,
        vk::Format::R8G8B8_SNORM => VertexFormat::Snorm8x3,
        vk::Format::R8G8B8A8_SNORM => VertexFormat::Snorm8x4,
        vk::Format::R8G8_UNORM => VertexFormat::Unorm8x2,
        vk::Format::R8G8B8_UNORM => VertexFormat::Unorm8x3,
        vk::Format::R8G8B8A8_UNORM => VertexFormat::Unorm8x4,
        vk::Format::R16G16_SNORM => VertexFormat::Snorm16x2,
        vk::Format::R16G16B16_SNORM => VertexFormat::Snorm16x3,
        vk::Format::R16G16B16A16_SNORM => VertexFormat::Snorm16x4,
        vk::Format::R16G16_UNORM => VertexFormat::Unorm16x2,
        vk::Format::R16G16B16_UNORM => VertexFormat::Unorm16x3,
        vk::Format::R16G16B16A16_UNORM => VertexFormat::Unorm16x4,
        vk::Format::A2B10G10R10_UNORM_PACK32 => VertexFormat::Unorm10x3A2,
        vk::Format::A2B10G10R10_SNORM_PACK32 => VertexFormat::Snorm10x3A2,
        _ => return None,
    })
}

/// The radius formats that structures are built from, by `VkFormat`; those with
/// `VK_FORMAT_FEATURE_2_ACCELERATION_STRUCTURE_RADIUS_BUFFER_BIT_NV`.
pub fn radius_format(format: vk::Format) -> Option<RadiusFormat> {
    Some(match format {
        vk::Format::R32_SFLOAT => RadiusFormat::F32,
        vk::Format::R16_SFLOAT => RadiusFormat::F16,
        _ => return None,
    })
}
