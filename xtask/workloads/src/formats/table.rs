//! The formats, and texels of each.

use tuff_tests::vk;

/// The numbers that texels are made of: finite ones.
#[derive(Clone, Copy)]
pub enum Fill {
    Bytes,
    /// Bytes below 60, whose floats of any size are finite.
    SmallBytes,
    /// Of 16 bits, between 1/16 and 1.
    Halves,
    /// Of 32 bits, between 0 and 1.
    Floats,
}

/// A format, the bytes of a texel or a block, and what these are.
pub struct FormatEntry(pub vk::Format, pub usize, pub Fill);

use Fill::{Bytes, Floats, Halves, SmallBytes};

pub static ALL: &[FormatEntry] = &[
    FormatEntry(vk::Format::R8_UNORM, 1, Bytes),
    FormatEntry(vk::Format::R8_SNORM, 1, Bytes),
    FormatEntry(vk::Format::R8_UINT, 1, Bytes),
    FormatEntry(vk::Format::R8_SINT, 1, Bytes),
    FormatEntry(vk::Format::R8_SRGB, 1, Bytes),
    FormatEntry(vk::Format::R8G8_UNORM, 2, Bytes),
    FormatEntry(vk::Format::R8G8_SNORM, 2, Bytes),
    FormatEntry(vk::Format::R8G8_UINT, 2, Bytes),
    FormatEntry(vk::Format::R8G8_SRGB, 2, Bytes),
    FormatEntry(vk::Format::R8G8B8A8_UNORM, 4, Bytes),
    FormatEntry(vk::Format::R8G8B8A8_SNORM, 4, Bytes),
    FormatEntry(vk::Format::R8G8B8A8_UINT, 4, Bytes),
    FormatEntry(vk::Format::R8G8B8A8_SINT, 4, Bytes),
    FormatEntry(vk::Format::R8G8B8A8_SRGB, 4, Bytes),
    FormatEntry(vk::Format::B8G8R8A8_UNORM, 4, Bytes),
    FormatEntry(vk::Format::B8G8R8A8_SRGB, 4, Bytes),
    FormatEntry(vk::Format::A2B10G10R10_UNORM_PACK32, 4, Bytes),
    FormatEntry(vk::Format::A2B10G10R10_UINT_PACK32, 4, Bytes),
    FormatEntry(vk::Format::A2R10G10B10_UNORM_PACK32, 4, Bytes),
    FormatEntry(vk::Format::B10G11R11_UFLOAT_PACK32, 4, SmallBytes),
    FormatEntry(vk::Format::E5B9G9R9_UFLOAT_PACK32, 4, SmallBytes),
    FormatEntry(vk::Format::R5G6B5_UNORM_PACK16, 2, Bytes),
    FormatEntry(vk::Format::B5G6R5_UNORM_PACK16, 2, Bytes),
    FormatEntry(vk::Format::R4G4B4A4_UNORM_PACK16, 2, Bytes),
    FormatEntry(vk::Format::B4G4R4A4_UNORM_PACK16, 2, Bytes),
    FormatEntry(vk::Format::A4R4G4B4_UNORM_PACK16, 2, Bytes),
    FormatEntry(vk::Format::R5G5B5A1_UNORM_PACK16, 2, Bytes),
    FormatEntry(vk::Format::A1R5G5B5_UNORM_PACK16, 2, Bytes),
    FormatEntry(vk::Format::R16_UNORM, 2, Bytes),
    FormatEntry(vk::Format::R16_SNORM, 2, Bytes),
    FormatEntry(vk::Format::R16_UINT, 2, Bytes),
    FormatEntry(vk::Format::R16_SINT, 2, Bytes),
    FormatEntry(vk::Format::R16_SFLOAT, 2, Halves),
    FormatEntry(vk::Format::R16G16_UNORM, 4, Bytes),
    FormatEntry(vk::Format::R16G16_SNORM, 4, Bytes),
    FormatEntry(vk::Format::R16G16_UINT, 4, Bytes),
    FormatEntry(vk::Format::R16G16_SFLOAT, 4, Halves),
    FormatEntry(vk::Format::R16G16B16A16_UNORM, 8, Bytes),
    FormatEntry(vk::Format::R16G16B16A16_SNORM, 8, Bytes),
    FormatEntry(vk::Format::R16G16B16A16_UINT, 8, Bytes),
    FormatEntry(vk::Format::R16G16B16A16_SFLOAT, 8, Halves),
    FormatEntry(vk::Format::R32_UINT, 4, Bytes),
    FormatEntry(vk::Format::R32_SINT, 4, Bytes),
    FormatEntry(vk::Format::R32_SFLOAT, 4, Floats),
    FormatEntry(vk::Format::R32G32_UINT, 8, Bytes),
    FormatEntry(vk::Format::R32G32_SFLOAT, 8, Floats),
    FormatEntry(vk::Format::R32G32B32A32_UINT, 16, Bytes),
    FormatEntry(vk::Format::R32G32B32A32_SFLOAT, 16, Floats),
    FormatEntry(vk::Format::D16_UNORM, 2, Bytes),
    FormatEntry(vk::Format::X8_D24_UNORM_PACK32, 4, Bytes),
    FormatEntry(vk::Format::D24_UNORM_S8_UINT, 4, Bytes),
    FormatEntry(vk::Format::D32_SFLOAT, 4, Floats),
    FormatEntry(vk::Format::D32_SFLOAT_S8_UINT, 4, Floats),
    FormatEntry(vk::Format::BC1_RGB_UNORM_BLOCK, 8, Bytes),
    FormatEntry(vk::Format::BC1_RGBA_UNORM_BLOCK, 8, Bytes),
    FormatEntry(vk::Format::BC1_RGBA_SRGB_BLOCK, 8, Bytes),
    FormatEntry(vk::Format::BC2_UNORM_BLOCK, 16, Bytes),
    FormatEntry(vk::Format::BC3_UNORM_BLOCK, 16, Bytes),
    FormatEntry(vk::Format::BC3_SRGB_BLOCK, 16, Bytes),
    FormatEntry(vk::Format::BC4_UNORM_BLOCK, 8, Bytes),
    FormatEntry(vk::Format::BC4_SNORM_BLOCK, 8, Bytes),
    FormatEntry(vk::Format::BC5_UNORM_BLOCK, 16, Bytes),
    FormatEntry(vk::Format::BC5_SNORM_BLOCK, 16, Bytes),
    FormatEntry(vk::Format::BC6H_UFLOAT_BLOCK, 16, Bytes),
    FormatEntry(vk::Format::BC6H_SFLOAT_BLOCK, 16, Bytes),
    FormatEntry(vk::Format::BC7_UNORM_BLOCK, 16, Bytes),
    FormatEntry(vk::Format::BC7_SRGB_BLOCK, 16, Bytes),
    FormatEntry(vk::Format::ETC2_R8G8B8_UNORM_BLOCK, 8, Bytes),
    FormatEntry(vk::Format::ETC2_R8G8B8A8_UNORM_BLOCK, 16, Bytes),
    FormatEntry(vk::Format::EAC_R11_UNORM_BLOCK, 8, Bytes),
];

impl FormatEntry {
    /// The name that the specification gives it, without `VK_FORMAT_`.
    pub fn name(&self) -> String {
        format!("{:?}", self.0)
    }

    pub fn is_depth(&self) -> bool {
        let name = self.name();
        name.starts_with('D') || name.starts_with("X8_D24")
    }

    /// `i` or `u` of integers, which GLSL's types start with.
    pub fn prefix(&self) -> &'static str {
        let name = self.name();
        match () {
            () if self.is_depth() => "",
            () if name.contains("UINT") => "u",
            () if name.contains("SINT") => "i",
            () => "",
        }
    }

    /// The aspects of an image, the first of which is sampled.
    pub fn aspects(&self) -> [vk::ImageAspectFlags; 2] {
        use vk::ImageAspectFlags as Aspect;
        match self.is_depth() {
            true if self.name().contains("S8") => [Aspect::DEPTH, Aspect::STENCIL],
            true => [Aspect::DEPTH; 2],
            false => [Aspect::COLOR; 2],
        }
    }

    /// Texels of a block's side.
    pub fn block_side(&self) -> u32 {
        if self.name().ends_with("BLOCK") { 4 } else { 1 }
    }

    /// So many texels or blocks.
    pub fn texels(&self, count: usize) -> Vec<u8> {
        let bytes = count * self.1;
        let words = (0..bytes as u32).map(super::super::operations::mixed);
        match self.2 {
            Bytes => words.map(|word| word as u8).collect(),
            SmallBytes => words.map(|word| (word % 60) as u8).collect(),
            Halves => {
                let halves = words
                    .take(bytes / 2)
                    .map(|word| 0x2c00 + (word & 0xfff) as u16);
                halves.flat_map(u16::to_ne_bytes).collect()
            }
            Floats => {
                let floats = words
                    .take(bytes / 4)
                    .map(|word| (word >> 8) as f32 / 16777216.0);
                floats.flat_map(f32::to_ne_bytes).collect()
            }
        }
    }
}
