//! Copies of bytes between images and buffers (spec, chapter Copy Commands). Regions outside their
//! image are not copied.

use ash::vk;

use super::rows::for_rows;
use super::surface::{Region, Surface, aspects, blocks, region, slice_count};
use crate::object::Image;
use crate::wave::Workers;

/// `vkCmdCopyImage`, one region: all samples of all its aspects.
pub fn copy_image(workers: &Workers, source: &Image, destination: &Image, copy: &vk::ImageCopy) {
    let from_slices = slice_count(source, &copy.src_subresource, copy.extent.depth);
    let to_slices = slice_count(destination, &copy.dst_subresource, copy.extent.depth);
    let slices = from_slices.min(to_slices);
    // The extent counts texels of the source. Both sides copy the same number of blocks.
    let extent = blocks(
        copy.extent,
        source.block_extent(copy.src_subresource.aspect_mask),
    );
    let pairs =
        aspects(copy.src_subresource.aspect_mask).zip(aspects(copy.dst_subresource.aspect_mask));
    for (from_aspect, to_aspect) in pairs {
        let surfaces = (
            Surface::new(source, from_aspect, copy.src_subresource.mip_level),
            Surface::new(destination, to_aspect, copy.dst_subresource.mip_level),
        );
        let (Some(from), Some(to)) = surfaces else {
            continue;
        };
        let regions = (
            region(
                source,
                &copy.src_subresource,
                copy.src_offset,
                extent,
                slices,
            ),
            region(
                destination,
                &copy.dst_subresource,
                copy.dst_offset,
                extent,
                slices,
            ),
        );
        if let (Some(from_region), Some(to_region)) = regions {
            copy_surface(workers, &from, from_region, &to, to_region);
        }
    }
}

fn copy_surface(
    workers: &Workers,
    from: &Surface,
    from_region: Region,
    to: &Surface,
    to_region: Region,
) {
    let inside = from.inside(from_region).is_some() && to.inside(to_region).is_some();
    if !inside || from.texel_size_bytes != to.texel_size_bytes {
        return;
    }
    let row_bytes = from_region.width as usize * from.texel_size_bytes;
    let samples = from.samples.min(to.samples);
    let rows = u64::from(from_region.slices) * u64::from(samples) * u64::from(from_region.height);
    for_rows(workers, rows, row_bytes as u64, |rows| {
        for row in rows {
            let y = (row % u64::from(from_region.height)) as u32;
            let layer = row / u64::from(from_region.height);
            let sample = (layer % u64::from(samples)) as u32;
            let slice = (layer / u64::from(samples)) as u32;
            let (from_y, from_slice) = (from_region.y + y, from_region.slice + slice);
            let source = from.texel(from_region.x, from_y, from_slice, sample);
            let (to_y, to_slice) = (to_region.y + y, to_region.slice + slice);
            let destination = to.texel(to_region.x, to_y, to_slice, sample);
            // SAFETY: both rows are inside their images, which are bound to memory that the
            // application keeps during execution. `copy` allows the overlap of an invalid copy.
            unsafe { std::ptr::copy(source, destination, row_bytes) };
        }
    });
}

/// The layout of a region in a buffer (spec, "Buffer and Image Addressing").
struct BufferLayout {
    row_stride_bytes: u64,
    slice_stride_bytes: u64,
}

impl BufferLayout {
    fn new(
        copy: &vk::BufferImageCopy,
        texel_size_bytes: u64,
        [block_width, block_height]: [u32; 2],
    ) -> Self {
        let or = |value: u32, default: u32, block: u32| {
            u64::from((if value == 0 { default } else { value }).div_ceil(block))
        };
        let row_stride_bytes = or(copy.buffer_row_length, copy.image_extent.width, block_width)
            .saturating_mul(texel_size_bytes);
        let rows = or(
            copy.buffer_image_height,
            copy.image_extent.height,
            block_height,
        );
        Self {
            row_stride_bytes,
            slice_stride_bytes: row_stride_bytes.saturating_mul(rows),
        }
    }
}

/// Bytes of the buffer, from `bufferOffset`, that a region touches; `None` if the region names no
/// plane of the image.
pub fn buffer_size_bytes(image: &Image, copy: &vk::BufferImageCopy) -> Option<u64> {
    let plane = image.plane(copy.image_subresource.aspect_mask)?;
    let slices = slice_count(image, &copy.image_subresource, copy.image_extent.depth);
    let block_extent = image.block_extent(copy.image_subresource.aspect_mask);
    let vk::Extent3D { width, height, .. } = blocks(copy.image_extent, block_extent);
    if slices == 0 || width == 0 || height == 0 {
        return Some(0);
    }
    let layout = BufferLayout::new(copy, plane.texel_size_bytes, block_extent);
    // The last row ends with its last texel, not after a stride.
    u64::from(slices - 1)
        .saturating_mul(layout.slice_stride_bytes)
        .checked_add(u64::from(height - 1).saturating_mul(layout.row_stride_bytes))?
        .checked_add(u64::from(width).saturating_mul(plane.texel_size_bytes))
}

/// `vkCmdCopyBufferToImage`, one region. `source` is the address of the buffer's first byte.
pub fn copy_buffer_to_image(
    workers: &Workers,
    source: u64,
    destination: &Image,
    copy: &vk::BufferImageCopy,
) {
    for_each_row(
        workers,
        source,
        destination,
        copy,
        |buffer, image, row_bytes| {
            // SAFETY: the image's row is inside the image, the region's bytes in the buffer are in
            // reach, and the application keeps the memory of both during execution.
            unsafe { std::ptr::copy(buffer, image, row_bytes) };
        },
    );
}

/// `vkCmdCopyImageToBuffer`, one region. `destination` is the address of the buffer's first byte.
pub fn copy_image_to_buffer(
    workers: &Workers,
    source: &Image,
    destination: u64,
    copy: &vk::BufferImageCopy,
) {
    for_each_row(
        workers,
        destination,
        source,
        copy,
        |buffer, image, row_bytes| {
            // SAFETY: as in `copy_buffer_to_image`.
            unsafe { std::ptr::copy(image, buffer, row_bytes) };
        },
    );
}

/// Calls `transfer(buffer row, image row, bytes)` for the rows of a region.
fn for_each_row(
    workers: &Workers,
    buffer: u64,
    image: &Image,
    copy: &vk::BufferImageCopy,
    transfer: impl Fn(*mut u8, *mut u8, usize) + Sync,
) {
    let layers = &copy.image_subresource;
    let slices = slice_count(image, layers, copy.image_extent.depth);
    let Some(surface) = Surface::new(image, layers.aspect_mask, layers.mip_level) else {
        return;
    };
    let block_extent = image.block_extent(layers.aspect_mask);
    let extent = blocks(copy.image_extent, block_extent);
    let region = region(image, layers, copy.image_offset, extent, slices);
    let Some(region) = region.and_then(|region| surface.inside(region)) else {
        return;
    };
    let layout = BufferLayout::new(copy, surface.texel_size_bytes as u64, block_extent);
    let row_bytes = region.width as usize * surface.texel_size_bytes;
    let rows = u64::from(region.slices) * u64::from(region.height);
    for_rows(workers, rows, row_bytes as u64, |rows| {
        for row in rows {
            let slice = row / u64::from(region.height);
            let y = row % u64::from(region.height);
            let address = buffer
                .wrapping_add(copy.buffer_offset)
                .wrapping_add(slice.wrapping_mul(layout.slice_stride_bytes))
                .wrapping_add(y.wrapping_mul(layout.row_stride_bytes));
            let (slice, y) = (region.slice + slice as u32, region.y + y as u32);
            let texels = surface.texel(region.x, y, slice, 0);
            transfer(address as *mut u8, texels, row_bytes);
        }
    });
}
