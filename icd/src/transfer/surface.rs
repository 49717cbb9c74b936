//! A plane of a mip level of an image, in the form for transfers: slices of rows of texels.
//!
//! A block of a compressed format counts as one texel.
//!
//! Depth slices of a 3D image and layers of any other are both *slices*: a transfer between the two
//! kinds pairs them (spec, "Copying Data Between Images").

use ash::vk;
use images::Level;
use images::format::FormatInfo;
use spirv_jit::environment::Samples;

use crate::format::texel_format;
use crate::object::{Image, ImageView};

/// The texels of a plane's mip level.
#[derive(Clone, Copy)]
pub struct Surface {
    data: *mut u8,
    pub format: &'static FormatInfo,
    pub texel_size_bytes: usize,
    pub width: u32,
    pub height: u32,
    /// Layers, or the depth of a 3D image's level.
    pub slices: u32,
    pub samples: u32,
    pub row_stride_bytes: u64,
    pub slice_stride_bytes: u64,
    sample_stride_bytes: u64,
}

// SAFETY: the application keeps the memory during execution, and each transfer writes a texel from
// one thread only.
unsafe impl Sync for Surface {}

/// A box of texels inside of a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    pub x: u32,
    pub y: u32,
    pub slice: u32,
    pub width: u32,
    pub height: u32,
    pub slices: u32,
}

impl Surface {
    /// A level of the aspect's plane; `None` if there is none or the image is not bound.
    pub fn new(image: &Image, aspect: vk::ImageAspectFlags, level: u32) -> Option<Self> {
        let plane = image.plane(aspect)?;
        let level = plane.levels.get(level as usize)?;
        let data = image.plane_data(plane);
        if data.is_null() {
            return None;
        }
        let is_volume = image.image_type == vk::ImageType::TYPE_3D;
        let [block_width, block_height] = image.block_extent(aspect);
        Some(Self {
            data: data.wrapping_add(level.offset_bytes as usize),
            format: texel_format(plane.format).info()?,
            texel_size_bytes: plane.texel_size_bytes as usize,
            width: level.width.div_ceil(block_width),
            height: level.height.div_ceil(block_height),
            slices: if is_volume {
                level.depth
            } else {
                image.array_layers
            },
            samples: image.samples,
            row_stride_bytes: level.row_stride_bytes,
            slice_stride_bytes: if is_volume {
                level.slice_stride_bytes
            } else {
                plane.layer_stride_bytes
            },
            sample_stride_bytes: plane.sample_stride_bytes,
        })
    }

    /// The level of an attachment's view, with the view's format; `None` as for [`Self::new`], and
    /// for a format of another texel size. A view of a plane of a multi-planar image is a color
    /// attachment.
    pub fn of_view(view: &ImageView, aspect: vk::ImageAspectFlags) -> Option<Self> {
        let level = view.range.base_mip_level;
        if aspect != vk::ImageAspectFlags::COLOR {
            return Self::new(&view.image, aspect, level);
        }
        let surface = Self::new(&view.image, view.range.aspect_mask, level)?;
        let format = texel_format(view.format);
        (format.size_bytes() == surface.texel_size_bytes).then_some(Self {
            format: format.info()?,
            ..surface
        })
    }

    /// A surface of the same size and format with other counts of samples and slices, and its
    /// memory. `None` if memory is exhausted.
    pub fn like(&self, samples: u32, slices: u32) -> Option<(Self, Vec<u64>)> {
        let row = (u64::from(self.width) * self.texel_size_bytes as u64).next_multiple_of(16);
        let sample = row.checked_mul(u64::from(self.height))?;
        let slice = sample.checked_mul(u64::from(samples))?;
        let words = usize::try_from(slice.checked_mul(u64::from(slices))? / 8).ok()?;
        let mut memory = Vec::new();
        memory.try_reserve_exact(words).ok()?;
        memory.resize(words, 0);
        let surface = Self {
            data: memory.as_mut_ptr().cast(),
            samples,
            slices,
            row_stride_bytes: row,
            slice_stride_bytes: slice,
            sample_stride_bytes: sample,
            ..*self
        };
        Some((surface, memory))
    }

    /// The whole surface.
    pub fn whole(&self) -> Region {
        Region {
            x: 0,
            y: 0,
            slice: 0,
            width: self.width,
            height: self.height,
            slices: self.slices,
        }
    }

    /// The region, if it is inside of the surface. Invalid regions are not transferred.
    pub fn inside(&self, region: Region) -> Option<Region> {
        let fits = |first: u32, count: u32, size: u32| {
            first.checked_add(count).is_some_and(|end| end <= size)
        };
        let inside = fits(region.x, region.width, self.width)
            && fits(region.y, region.height, self.height)
            && fits(region.slice, region.slices, self.slices);
        inside.then_some(region)
    }

    /// Address of the texel (x, y) of a sample of a slice, which the caller keeps in range.
    pub fn texel(&self, x: u32, y: u32, slice: u32, sample: u32) -> *mut u8 {
        let offset = u64::from(slice) * self.slice_stride_bytes
            + u64::from(sample) * self.sample_stride_bytes
            + u64::from(y) * self.row_stride_bytes
            + u64::from(x) * self.texel_size_bytes as u64;
        self.data.wrapping_add(offset as usize)
    }

    /// The surface as a descriptor for shaders: the samples of the image whose first texel is
    /// `single`.
    pub fn samples_of(&self, single: *const u8) -> Samples {
        Samples {
            single,
            data: self.data,
            size_bytes: u64::from(self.slices) * self.slice_stride_bytes,
            samples: self.samples as u8,
            layer_count: self.slices,
            layer_stride_bytes: self.slice_stride_bytes,
            sample_stride_bytes: self.sample_stride_bytes,
            level: Level {
                offset_bytes: 0,
                row_stride_bytes: self.row_stride_bytes,
                slice_stride_bytes: self.slice_stride_bytes,
                width: self.width,
                height: self.height,
                depth: 1,
            },
        }
    }
}

/// The number of blocks that cover a number of texels.
pub fn blocks(extent: vk::Extent3D, [width, height]: [u32; 2]) -> vk::Extent3D {
    vk::Extent3D {
        width: extent.width.div_ceil(width),
        height: extent.height.div_ceil(height),
        ..extent
    }
}

/// The box of an offset in texels, an extent in blocks and layers. The extent's depth counts the
/// slices of 3D images, and layers count those of others. A copy between the two kinds has the same
/// number of both.
pub fn region(
    image: &Image,
    layers: &vk::ImageSubresourceLayers,
    offset: vk::Offset3D,
    extent: vk::Extent3D,
    slices: u32,
) -> Option<Region> {
    let is_volume = image.image_type == vk::ImageType::TYPE_3D;
    let [block_width, block_height] = image.block_extent(layers.aspect_mask);
    Some(Region {
        x: u32::try_from(offset.x).ok()? / block_width,
        y: u32::try_from(offset.y).ok()? / block_height,
        slice: if is_volume {
            u32::try_from(offset.z).ok()?
        } else {
            layers.base_array_layer
        },
        width: extent.width,
        height: extent.height,
        slices,
    })
}

/// The number of slices that a region of an image covers.
pub fn slice_count(image: &Image, layers: &vk::ImageSubresourceLayers, depth: u32) -> u32 {
    if image.image_type == vk::ImageType::TYPE_3D {
        depth
    } else {
        image.layer_count(layers.base_array_layer, layers.layer_count)
    }
}

/// The aspects of a mask, one by one.
pub fn aspects(mask: vk::ImageAspectFlags) -> impl Iterator<Item = vk::ImageAspectFlags> {
    [
        vk::ImageAspectFlags::COLOR,
        vk::ImageAspectFlags::DEPTH,
        vk::ImageAspectFlags::STENCIL,
        vk::ImageAspectFlags::PLANE_0,
        vk::ImageAspectFlags::PLANE_1,
        vk::ImageAspectFlags::PLANE_2,
    ]
    .into_iter()
    .filter(move |&bit| mask.contains(bit))
}
