//! The pages of a part of a partially resident image.

#![forbid(unsafe_code)]

use ash::vk;

use super::Image;
use crate::os::address_space::page_bytes;

/// A run of pages: its offset in the image, and its offset in the memory bound to a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pages {
    pub image_offset: u64,
    pub memory_offset: u64,
    pub size_bytes: u64,
}

/// The pages of a part of an image, in binding order: along a row, then by row, then by slice.
/// `None` if the image has no such part.
pub fn pages(image: &Image, bind: &vk::SparseImageMemoryBind) -> Vec<Pages> {
    spans(image, bind).unwrap_or_default()
}

fn spans(image: &Image, bind: &vk::SparseImageMemoryBind) -> Option<Vec<Pages>> {
    let page = page_bytes();
    let plane = image.plane(bind.subresource.aspect_mask)?;
    let level = plane.levels.get(bind.subresource.mip_level as usize)?;
    let layer = bind.subresource.array_layer;
    if layer >= image.array_layers {
        return None;
    }
    let [block_width, block_height] = plane.block_extent;
    let width = (page / plane.texel_size_bytes) as u32 * block_width;
    let first = |offset: i32, size: u32| Some(u64::from(u32::try_from(offset).ok()? / size));
    let (x, y) = (
        first(bind.offset.x, width)?,
        first(bind.offset.y, block_height)?,
    );
    let z = u64::from(u32::try_from(bind.offset.z).ok()?);
    let columns = u64::from(bind.extent.width.div_ceil(width));
    let rows = u64::from(bind.extent.height.div_ceil(block_height));
    let depth = u64::from(bind.extent.depth);
    let is_inside = x + columns <= level.row_stride_bytes / page
        && y + rows <= level.slice_stride_bytes / level.row_stride_bytes
        && z + depth <= u64::from(level.depth);
    if !is_inside {
        return None;
    }
    let base = level.offset_bytes + u64::from(layer) * plane.layer_stride_bytes;
    let size_bytes = columns * page;
    let mut all: Vec<Pages> = Vec::new();
    let mut memory_offset = 0;
    for slice in z..z + depth {
        for row in y..y + rows {
            let image_offset =
                base + slice * level.slice_stride_bytes + row * level.row_stride_bytes + x * page;
            match all.last_mut() {
                Some(last) if last.image_offset + last.size_bytes == image_offset => {
                    last.size_bytes += size_bytes;
                }
                _ => all.push(Pages {
                    image_offset,
                    memory_offset,
                    size_bytes,
                }),
            }
            memory_offset += size_bytes;
        }
    }
    Some(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: u32, height: u32) -> Image {
        let info = vk::ImageCreateInfo {
            flags: vk::ImageCreateFlags::SPARSE_BINDING | vk::ImageCreateFlags::SPARSE_RESIDENCY,
            image_type: vk::ImageType::TYPE_2D,
            format: vk::Format::R8G8B8A8_UNORM,
            extent: vk::Extent3D {
                width,
                height,
                depth: 1,
            },
            mip_levels: 1,
            array_layers: 1,
            samples: vk::SampleCountFlags::TYPE_1,
            ..Default::default()
        };
        Image::new(&info).unwrap()
    }

    fn bind(x: i32, y: i32, width: u32, height: u32) -> vk::SparseImageMemoryBind {
        let aspect = vk::ImageAspectFlags::COLOR;
        vk::SparseImageMemoryBind {
            subresource: vk::ImageSubresource {
                aspect_mask: aspect,
                ..Default::default()
            },
            offset: vk::Offset3D { x, y, z: 0 },
            extent: vk::Extent3D {
                width,
                height,
                depth: 1,
            },
            ..Default::default()
        }
    }

    #[test]
    fn a_part_is_pages_of_its_rows() {
        let page = page_bytes();
        let texels = (page / 4) as u32;
        let wide = image(2 * texels, 4);
        let pages_of = |bind| -> Vec<_> {
            let pages = pages(&wide, &bind);
            let of = |it: &Pages| {
                [it.image_offset, it.memory_offset, it.size_bytes].map(|bytes| bytes / page)
            };
            pages.iter().map(of).collect()
        };
        assert_eq!(
            pages_of(bind(texels as i32, 1, texels, 2)),
            [[3, 0, 1], [5, 1, 1]]
        );
        // Whole rows are adjacent.
        assert_eq!(pages_of(bind(0, 1, 2 * texels, 3)), [[2, 0, 6]]);
        assert!(pages_of(bind(0, 2, texels, 3)).is_empty());
        assert!(pages_of(bind(2 * texels as i32, 0, 1, 1)).is_empty());
        assert!(pages_of(bind(-1, 0, 1, 1)).is_empty());
        // The last block of a row is a whole one.
        assert_eq!(image(texels + 1, 3).size_bytes, 6 * page);
    }
}
