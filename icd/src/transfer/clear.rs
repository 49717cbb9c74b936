//! Clears outside of rendering (spec, "Clear Commands").

use ash::vk;
use images::format::MAX_TEXEL_BYTES;

use super::pattern::Pattern;
use super::surface::{Region, Surface, aspects};
use crate::object::{Image, ImageView};

/// `vkCmdClearColorImage`, one range.
pub fn clear_color_image(
    image: &Image,
    value: &vk::ClearColorValue,
    range: &vk::ImageSubresourceRange,
) {
    // A 64-bit component takes two words, low and high (VkClearColorValue), as texels do here.
    // SAFETY: all members of the union are four words, so that each may be read.
    let words = unsafe { value.uint32 };
    clear(image, vk::ImageAspectFlags::COLOR, range, words);
}

/// `vkCmdClearDepthStencilImage`, one range.
pub fn clear_depth_stencil_image(
    image: &Image,
    value: &vk::ClearDepthStencilValue,
    range: &vk::ImageSubresourceRange,
) {
    if range.aspect_mask.contains(vk::ImageAspectFlags::DEPTH) {
        let words = [value.depth.to_bits(), 0, 0, 0];
        clear(image, vk::ImageAspectFlags::DEPTH, range, words);
    }
    if range.aspect_mask.contains(vk::ImageAspectFlags::STENCIL) {
        let words = [value.stencil & 0xff, 0, 0, 0];
        clear(image, vk::ImageAspectFlags::STENCIL, range, words);
    }
}

/// Clears an area of some layers of a view that the pass does not draw to.
pub fn clear_view(
    view: &ImageView,
    aspects_mask: vk::ImageAspectFlags,
    value: &vk::ClearValue,
    layers: impl Iterator<Item = u32> + Clone,
    area: &vk::Rect2D,
) {
    for aspect in aspects(aspects_mask) {
        let Some(surface) = Surface::of_view(view, aspect) else {
            continue;
        };
        // SAFETY: all members of the union are words, so that each may be read.
        let words = unsafe {
            match aspect {
                vk::ImageAspectFlags::COLOR => value.color.uint32,
                vk::ImageAspectFlags::DEPTH => [value.depth_stencil.depth.to_bits(), 0, 0, 0],
                _ => [value.depth_stencil.stencil & 0xff, 0, 0, 0],
            }
        };
        for layer in layers.clone().filter(|&layer| layer < view.layer_count()) {
            let region = Region {
                x: area.offset.x.max(0) as u32,
                y: area.offset.y.max(0) as u32,
                slice: view.range.base_array_layer + layer,
                width: area.extent.width,
                height: area.extent.height,
                slices: 1,
            };
            fill(&surface, region, words);
        }
    }
}

fn clear(
    image: &Image,
    aspect: vk::ImageAspectFlags,
    range: &vk::ImageSubresourceRange,
    words: [u32; 4],
) {
    for level in 0..image.level_count(range.base_mip_level, range.level_count) {
        let Some(surface) = Surface::new(image, aspect, range.base_mip_level + level) else {
            return;
        };
        let mut region = surface.whole();
        // All slices of a 3D image's level.
        if image.image_type != vk::ImageType::TYPE_3D {
            region.slice = range.base_array_layer;
            region.slices = image.layer_count(range.base_array_layer, range.layer_count);
        }
        fill(&surface, region, words);
    }
}

/// Fills a region with one texel, in every sample.
fn fill(surface: &Surface, region: Region, words: [u32; 4]) {
    let Some(region) = surface.inside(region) else {
        return;
    };
    let size = surface.texel_size_bytes;
    let mut texel = [0; MAX_TEXEL_BYTES];
    surface.format.encode(words, &mut texel);
    let pattern = Pattern::new(&texel[..size]);
    let row_bytes = region.width as usize * size;
    // Adjacent rows are filled as one.
    let (rows, row_bytes) = match row_bytes as u64 == surface.row_stride_bytes {
        true => (1, row_bytes * region.height as usize),
        false => (region.height, row_bytes),
    };
    for slice in 0..region.slices {
        for sample in 0..surface.samples {
            for y in 0..rows {
                let to = surface.texel(region.x, region.y + y, region.slice + slice, sample);
                // SAFETY: the row is inside the image, which is bound to memory that the
                // application keeps during execution.
                unsafe { pattern.fill(to, row_bytes) };
            }
        }
    }
}
