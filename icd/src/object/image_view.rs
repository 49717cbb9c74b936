//! Image views.

use ash::vk;
use images::ycbcr::Conversion;
use images::{Dim, Format, ImageDescriptor, Level, MAX_LEVELS};

use super::image::{Image, Plane};
use super::view_entry::ViewEntry;
use crate::VkResult;
use crate::format;
use crate::handle::Ref;
use crate::wave::mask::InvocationMask;

/// An image view: the descriptor that shaders read, and the part of the image that commands write.
pub struct ImageView {
    pub descriptor: ViewEntry<ImageDescriptor>,
    /// The descriptor of storage images, if those see only some slices.
    pub slices: Option<ViewEntry<ImageDescriptor>>,
    pub image: Ref<Image>,
    pub format: vk::Format,
    pub range: vk::ImageSubresourceRange,
}

impl ImageView {
    /// The view that a descriptor of a type names.
    pub fn entry(&self, ty: vk::DescriptorType) -> &ViewEntry<ImageDescriptor> {
        match (ty, &self.slices) {
            (vk::DescriptorType::STORAGE_IMAGE, Some(slices)) => slices,
            _ => &self.descriptor,
        }
    }

    /// The number of layers, or of slices of a 3D image.
    pub fn layer_count(&self) -> u32 {
        match self.image.image_type {
            vk::ImageType::TYPE_3D => {
                let level = self.image.planes[0]
                    .levels
                    .get(self.range.base_mip_level as usize);
                let depth = level.map_or(0, |level| level.depth);
                let rest = depth.saturating_sub(self.range.base_array_layer);
                self.range.layer_count.min(rest)
            }
            _ => self
                .image
                .layer_count(self.range.base_array_layer, self.range.layer_count),
        }
    }

    /// The texels of a `VK_FORMAT_R8_UINT` view, as an invocation mask.
    pub fn invocation_mask(&self) -> InvocationMask {
        let image = &*self.descriptor;
        let level = &image.levels[0];
        InvocationMask {
            address: image.data as u64 + level.offset_bytes,
            row_stride_bytes: level.row_stride_bytes,
            width: level.width,
            height: level.height,
        }
    }
}

/// Computes the descriptor of a view.
///
/// # Errors
/// `VK_ERROR_UNKNOWN` for a range outside the image, and for a format with another texel size.
pub fn view_descriptor(
    image: &Image,
    ty: vk::ImageViewType,
    view_format: vk::Format,
    components: vk::ComponentMapping,
    range: &vk::ImageSubresourceRange,
    min_lod: f32,
    conversion: Option<Conversion>,
) -> VkResult<ImageDescriptor> {
    const OUTSIDE: vk::Result = vk::Result::ERROR_UNKNOWN;
    let plane = image
        .plane(range.aspect_mask)
        .or(image.planes.first())
        .ok_or(OUTSIDE)?;
    let level_count = image
        .level_count(range.base_mip_level, range.level_count)
        .min(MAX_LEVELS as u32);
    let first = (plane.levels.get(range.base_mip_level as usize)).ok_or(OUTSIDE)?;
    // The layers of a 2D view of a 3D image are the slices of one level.
    let slices = image.image_type == vk::ImageType::TYPE_3D && ty != vk::ImageViewType::TYPE_3D;
    let (layer_stride_bytes, layers) = if slices {
        (first.slice_stride_bytes, first.depth)
    } else {
        (plane.layer_stride_bytes, image.array_layers)
    };
    let remaining = layers.checked_sub(range.base_array_layer).ok_or(OUTSIDE)?;
    let layer_count = range.layer_count.min(remaining);
    let from = &plane.levels[range.base_mip_level as usize..][..level_count as usize];
    let mut levels = view_levels(from, plane.format, view_format);
    for level in &mut levels[..from.len()] {
        level.offset_bytes += layer_stride_bytes * u64::from(range.base_array_layer);
        if slices {
            level.depth = 1;
        }
    }
    let (dim, arrayed) = dim_of(ty);
    let depth_or_stencil = vk::ImageAspectFlags::DEPTH | vk::ImageAspectFlags::STENCIL;
    let is_depth_or_stencil = plane.aspect.intersects(depth_or_stencil);
    let data = image.plane_data(plane);
    let conversion = conversion_of(image.format, conversion);
    let format = match &conversion {
        Some(conversion) if conversion.planes.requires_conversion() => {
            write_planes(&mut levels, image, data, range.base_array_layer);
            vk::Format::from_raw(conversion.planes.planes[0].format.0 as i32)
        }
        // A conversion of a single plane keeps the view's format.
        Some(_) => view_format,
        None if is_depth_or_stencil || format::ycbcr_planes(view_format).is_some() => plane.format,
        None => view_format,
    };
    // Formats with another texel size would access memory past the image
    // (VUID-VkImageViewCreateInfo-image-01761, -01583).
    if conversion.is_none_or(|it| !it.planes.requires_conversion()) && !fits(plane, format) {
        return Err(OUTSIDE);
    }
    // Texels that are stored in pairs are accessed in pairs, except by sampling.
    if plane.block_extent == [2, 1] && conversion.is_none() {
        for level in &mut levels {
            level.width = level.width.div_ceil(2);
        }
    }
    Ok(ImageDescriptor {
        data,
        size_bytes: image.binding_size_bytes(Some(plane.aspect)),
        format: Format(format.as_raw() as u32),
        dim,
        arrayed,
        samples: image.samples as u8,
        level_count: level_count as u8,
        layer_count,
        layer_stride_bytes,
        sample_stride_bytes: plane.sample_stride_bytes,
        swizzle: swizzle(components),
        min_lod: (min_lod - range.base_mip_level as f32).max(0.0),
        levels,
        conversion,
    })
}

/// The levels of a view, with their sizes in the view's texels. A view of blocks as texels has as
/// many texels as there are blocks ("Image Views", BLOCK_TEXEL_VIEW_COMPATIBLE).
fn view_levels(from: &[Level], plane: vk::Format, view: vk::Format) -> [Level; MAX_LEVELS] {
    let [block_width, block_height] = match format::block_extent(view) {
        [1, 1] => format::block_extent(plane),
        _ => [1, 1],
    };
    let mut levels = [Level::default(); MAX_LEVELS];
    for (to, from) in levels.iter_mut().zip(from) {
        *to = *from;
        to.width = to.width.div_ceil(block_width);
        to.height = to.height.div_ceil(block_height);
    }
    levels
}

/// The conversion of a view with the image's planes: the image decides them, not the format of the
/// conversion.
fn conversion_of(image: vk::Format, conversion: Option<Conversion>) -> Option<Conversion> {
    match (conversion, format::ycbcr_planes(image)) {
        (Some(conversion), Some(planes)) => Some(Conversion {
            planes,
            ..conversion
        }),
        (Some(conversion), None) if conversion.planes.requires_conversion() => None,
        (conversion, _) => conversion,
    }
}

/// Whether texels of a view's format are as large as the plane's, and blocks the same.
fn fits(plane: &Plane, view: vk::Format) -> bool {
    let blocks = format::block_extent(view);
    format::texel_size_bytes(view) == plane.texel_size_bytes
        && (blocks == [1, 1] || blocks == format::block_extent(plane.format))
}

/// The dimensions of a view, and whether it is an array.
fn dim_of(ty: vk::ImageViewType) -> (Dim, bool) {
    use vk::ImageViewType as Type;
    match ty {
        Type::TYPE_1D => (Dim::D1, false),
        Type::TYPE_1D_ARRAY => (Dim::D1, true),
        Type::TYPE_2D_ARRAY => (Dim::D2, true),
        Type::TYPE_3D => (Dim::D3, false),
        Type::CUBE => (Dim::Cube, false),
        Type::CUBE_ARRAY => (Dim::Cube, true),
        _ => (Dim::D2, false),
    }
}

/// Writes the image's planes in place of mip levels, for a conversion. Offsets count from `data`,
/// and a plane's slice stride is the stride of its layers.
fn write_planes(levels: &mut [Level], image: &Image, data: *mut u8, first_layer: u32) {
    for (to, plane) in levels.iter_mut().zip(&image.planes) {
        let Some(level) = plane.levels.first() else {
            continue;
        };
        *to = *level;
        let base_bytes = plane.layer_stride_bytes * u64::from(first_layer);
        let distance = (image.plane_data(plane) as u64).wrapping_sub(data as u64);
        to.offset_bytes = level
            .offset_bytes
            .wrapping_add(base_bytes)
            .wrapping_add(distance);
        to.slice_stride_bytes = plane.layer_stride_bytes;
    }
}

/// The view of a 3D image without the slices outside of a range, as storage images see it
/// (`VkImageViewSlicedCreateInfoEXT`).
pub fn sliced(
    mut view: ImageDescriptor,
    slices: &vk::ImageViewSlicedCreateInfoEXT<'_>,
) -> ImageDescriptor {
    for level in &mut view.levels {
        let first = slices.slice_offset.min(level.depth);
        level.offset_bytes += u64::from(first) * level.slice_stride_bytes;
        level.depth = (level.depth - first).min(slices.slice_count);
    }
    view
}

/// [`ImageDescriptor::swizzle`] of a component mapping.
pub fn swizzle(mapping: vk::ComponentMapping) -> [u8; 4] {
    let components = [mapping.r, mapping.g, mapping.b, mapping.a];
    std::array::from_fn(|index| match components[index] {
        vk::ComponentSwizzle::R => 0,
        vk::ComponentSwizzle::G => 1,
        vk::ComponentSwizzle::B => 2,
        vk::ComponentSwizzle::A => 3,
        vk::ComponentSwizzle::ZERO => 4,
        vk::ComponentSwizzle::ONE => 5,
        _ => index as u8,
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use images::SamplerDescriptor;
    use spirv_jit::views::Views;

    use super::super::image::tests::image;
    use super::*;

    #[test]
    fn views_start_at_their_layer_and_level() {
        let image = image(vk::ImageType::TYPE_2D, [8, 8, 1], 4, 6).unwrap();
        let range = vk::ImageSubresourceRange {
            aspect_mask: vk::ImageAspectFlags::COLOR,
            base_mip_level: 1,
            level_count: vk::REMAINING_MIP_LEVELS,
            base_array_layer: 2,
            layer_count: vk::REMAINING_ARRAY_LAYERS,
        };
        let ty = vk::ImageViewType::TYPE_2D_ARRAY;
        let view = view_descriptor(
            &image,
            ty,
            image.format,
            Default::default(),
            &range,
            2.5,
            None,
        )
        .unwrap();
        assert_eq!((view.level_count, view.layer_count), (3, 4));
        assert_eq!(view.min_lod, 1.5);
        assert_eq!((view.levels[0].width, view.levels[2].width), (4, 1));
        let plane = &image.planes[0];
        let first = plane.levels[1].offset_bytes + 2 * plane.layer_stride_bytes;
        assert_eq!(view.levels[0].offset_bytes, first);
        assert_eq!(view.swizzle, [0, 1, 2, 3]);
    }

    #[test]
    fn slices_of_a_volume_are_layers() {
        let image = image(vk::ImageType::TYPE_3D, [4, 4, 4], 2, 1).unwrap();
        let range = vk::ImageSubresourceRange {
            aspect_mask: vk::ImageAspectFlags::COLOR,
            base_mip_level: 1,
            level_count: 1,
            base_array_layer: 1,
            layer_count: 1,
        };
        let ty = vk::ImageViewType::TYPE_2D;
        let view = view_descriptor(
            &image,
            ty,
            image.format,
            Default::default(),
            &range,
            0.0,
            None,
        )
        .unwrap();
        let level = &image.planes[0].levels[1];
        assert_eq!(
            view.levels[0].offset_bytes,
            level.offset_bytes + level.slice_stride_bytes
        );
        assert_eq!(view.levels[0].depth, 1);
    }

    #[test]
    fn keys_of_destroyed_objects_are_free_though_others_hold_them() {
        let views = Arc::new(Views::default());
        let store = |replay| {
            let contents = SamplerDescriptor::DEFAULT;
            ViewEntry::store(&views, |it| &it.samplers, contents, replay)
        };
        let first = store(Some(None)).unwrap();
        let key = first.key;
        let taken = vk::Result::ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS;
        assert_eq!(store(Some(Some(key))).err(), Some(taken));
        first.release();
        assert!(first.as_ptr().is_null());
        let second = store(Some(Some(key))).unwrap();
        drop(first);
        assert!(!second.as_ptr().is_null());
        assert_eq!(store(Some(Some(key))).err(), Some(taken));
        // Every other key belongs to one object until its end.
        let plain = store(None).unwrap();
        plain.release();
        assert!(!plain.as_ptr().is_null());
    }
}
