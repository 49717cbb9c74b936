//! Sparse blocks of partially resident images.
//!
//! Shaders and commands access images by rows. Each row starts at a page, so that parts can be
//! bound separately: a sparse block is a page of texels of one row. Levels of every size are bound
//! like this, so there is no mip tail.

#![forbid(unsafe_code)]

use ash::vk;

use crate::format::{self, PlaneFormat};
use crate::os::address_space::page_bytes;

/// Whether a page holds a whole number of texels, or blocks, of each plane.
pub fn is_divisible(format: vk::Format) -> bool {
    let page = page_bytes();
    let planes = format::planes(format);
    planes.iter().all(|plane| {
        let size = format::texel_size_bytes(plane.format);
        size != 0 && page.is_multiple_of(size)
    })
}

fn granularity(plane: &PlaneFormat) -> vk::Extent3D {
    let [width, height] = plane.block_extent;
    let columns = page_bytes() / format::texel_size_bytes(plane.format).max(1);
    vk::Extent3D {
        width: columns as u32 * width,
        height,
        depth: 1,
    }
}

/// `VkSparseImageFormatProperties` of the planes of a format.
pub fn properties(format: vk::Format) -> Vec<vk::SparseImageFormatProperties> {
    let planes = format::planes(format);
    let of = |plane: &PlaneFormat| vk::SparseImageFormatProperties {
        aspect_mask: plane.aspect,
        image_granularity: granularity(plane),
        flags: vk::SparseImageFormatFlags::NONSTANDARD_BLOCK_SIZE,
    };
    planes.iter().map(of).collect()
}

/// `VkSparseImageMemoryRequirements` of an image; none for an image that is bound as a whole.
pub fn requirements(
    flags: vk::ImageCreateFlags,
    format: vk::Format,
    mip_levels: u32,
) -> Vec<vk::SparseImageMemoryRequirements> {
    if !flags.contains(vk::ImageCreateFlags::SPARSE_RESIDENCY) {
        return Vec::new();
    }
    let of = |format_properties| vk::SparseImageMemoryRequirements {
        format_properties,
        image_mip_tail_first_lod: mip_levels,
        ..Default::default()
    };
    properties(format).into_iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_a_page_of_texels() {
        let of = |format| -> Vec<_> {
            let all = properties(format);
            let extent = |it: &vk::SparseImageFormatProperties| {
                let extent = it.image_granularity;
                (
                    it.aspect_mask,
                    u64::from(extent.width),
                    extent.height,
                    extent.depth,
                )
            };
            all.iter().map(extent).collect()
        };
        let page = page_bytes();
        use vk::ImageAspectFlags as Aspect;
        assert_eq!(
            of(vk::Format::D32_SFLOAT_S8_UINT),
            [
                (Aspect::DEPTH, page / 4, 1, 1),
                (Aspect::STENCIL, page, 1, 1)
            ]
        );
        assert_eq!(
            of(vk::Format::BC1_RGB_UNORM_BLOCK),
            [(Aspect::COLOR, page / 8 * 4, 4, 1)]
        );
        assert!(!is_divisible(vk::Format::R32G32B32_SFLOAT));
        assert!(is_divisible(vk::Format::R8_UNORM));
    }
}
