//! Images. Storage is linear: planes hold layers, layers hold samples, and samples hold mip levels.
//! In partially resident images each row starts at a page ([`resident`](super::resident)).

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ash::vk;
use images::format::FormatInfo;
use images::{ImageDescriptor, Level, MAX_LEVELS};
use parking_lot::Mutex;
use spirv_jit::reach::Range;
use spirv_jit::views::{Key, Views};

use super::address_space::GRANULE;
use super::descriptor_heap_replay::Identity;
use super::resident;
use super::sparse::Reservation;
use super::view_entry::ViewEntry;
use crate::VkResult;
use crate::capabilities::limits;
use crate::format::{self, PlaneFormat, texel_format};
use crate::os::address_space::page_bytes;

/// Alignment of levels, samples and layers.
const SUBRESOURCE_ALIGNMENT: u64 = 64;

/// One aspect of an image: color, depth or stencil. A combined depth-stencil format has two planes
/// of simple formats.
#[derive(Clone, Debug)]
pub struct Plane {
    pub aspect: vk::ImageAspectFlags,
    /// The index of the plane's memory binding: each plane of a disjoint image has its own.
    pub binding: usize,
    /// The plane's own format: `D32_SFLOAT` and `S8_UINT` for `D32_SFLOAT_S8_UINT`.
    pub format: vk::Format,
    /// Size of a texel, or of a block in compressed formats, whose rows are rows of blocks.
    pub texel_size_bytes: u64,
    /// The levels of layer 0, sample 0, with offsets from the image's start.
    pub levels: Vec<Level>,
    /// Texels of a block.
    pub block_extent: [u32; 2],
    pub layer_stride_bytes: u64,
    /// Distance between samples; a layer has `samples` of these.
    pub sample_stride_bytes: u64,
}

/// An image.
pub struct Image {
    pub flags: vk::ImageCreateFlags,
    pub image_type: vk::ImageType,
    pub format: vk::Format,
    pub extent: vk::Extent3D,
    pub mip_levels: u32,
    pub array_layers: u32,
    /// Samples per texel: 1, 2, 4 or 8.
    pub samples: u32,
    pub tiling: vk::ImageTiling,
    pub usage: vk::ImageUsageFlags,
    pub planes: Vec<Plane>,
    /// Size of the first binding.
    pub size_bytes: u64,
    /// The memory of the image, or of each plane of a disjoint image.
    bindings: Vec<Binding>,
    /// The address space of a sparse image.
    pub reservation: Option<Arc<Reservation>>,
    /// Views for descriptors in heaps, kept while the image lives.
    heap_views: Mutex<Vec<ViewEntry<ImageDescriptor>>>,
    /// The identity of an image with replayable descriptors, until the image is destroyed.
    identity: Mutex<Option<Identity>>,
}

/// A separately bound part of an image.
struct Binding {
    size_bytes: u64,
    address: AtomicU64,
}

impl Image {
    /// Lays an image out, unbound.
    ///
    /// # Errors
    /// `VK_ERROR_FORMAT_NOT_SUPPORTED`; `VK_ERROR_OUT_OF_DEVICE_MEMORY` if its size does not fit in
    /// 63 bits.
    pub fn new(info: &vk::ImageCreateInfo<'_>) -> VkResult<Self> {
        let samples = info.samples.as_raw().max(1);
        let is_disjoint = info.flags.contains(vk::ImageCreateFlags::DISJOINT)
            && format::ycbcr_planes(info.format).is_some();
        let mut size_bytes = 0u64;
        let mut sizes = Vec::new();
        let mut planes = Vec::new();
        for format in format::planes(info.format) {
            if format::texel_size_bytes(format.format) == 0 {
                return Err(vk::Result::ERROR_FORMAT_NOT_SUPPORTED);
            }
            let mut plane = lay_out_plane(info, &format, samples, &mut size_bytes)
                .ok_or(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY)?;
            if is_disjoint {
                plane.binding = sizes.len();
                sizes.push(std::mem::take(&mut size_bytes));
            }
            planes.push(plane);
        }
        if planes.is_empty() {
            return Err(vk::Result::ERROR_FORMAT_NOT_SUPPORTED);
        }
        if !is_disjoint {
            sizes.push(size_bytes);
        }
        Ok(Self {
            flags: info.flags,
            image_type: info.image_type,
            format: info.format,
            extent: info.extent,
            mip_levels: info.mip_levels,
            array_layers: info.array_layers,
            samples,
            tiling: info.tiling,
            usage: info.usage,
            planes,
            size_bytes: sizes[0],
            bindings: sizes
                .into_iter()
                .map(|size_bytes| Binding {
                    size_bytes,
                    address: AtomicU64::new(0),
                })
                .collect(),
            reservation: None,
            heap_views: Mutex::default(),
            identity: Mutex::default(),
        })
    }

    /// Creates an image with replayable descriptors in heaps.
    pub fn identified(self, identity: Identity) -> Self {
        Self {
            identity: Mutex::new(Some(identity)),
            ..self
        }
    }

    /// The opaque capture data of descriptors in heaps; zero of an image without an identity.
    pub fn capture_data(&self) -> u64 {
        self.identity.lock().as_ref().map_or(0, Identity::data)
    }

    /// Frees the identity at the image's destruction. Recorded commands may hold the image longer,
    /// but another image may take its identity and views from now on.
    pub fn forget_identity(&self) {
        let identity = self.identity.lock().take();
        if identity.is_some() {
            self.heap_views.lock().clear();
        }
    }

    /// The alignment of memory bindings and of the image's address.
    pub fn alignment(flags: vk::ImageCreateFlags) -> u64 {
        match flags {
            flags if flags.contains(vk::ImageCreateFlags::SPARSE_RESIDENCY) => page_bytes(),
            flags if flags.contains(vk::ImageCreateFlags::SPARSE_BINDING) => GRANULE,
            _ => limits::MEMORY_ALIGNMENT,
        }
    }

    /// Makes the image sparse, with an address from the start.
    pub fn reserved(self, reservation: Arc<Reservation>) -> Self {
        self.bind(reservation.address());
        Self {
            reservation: Some(reservation),
            ..self
        }
    }

    /// The key of a view of the image in heaps: the same for the same view.
    ///
    /// # Errors
    /// `VK_ERROR_OUT_OF_HOST_MEMORY`; `VK_ERROR_INVALID_OPAQUE_CAPTURE_ADDRESS` if something else
    /// has the view's name.
    pub fn heap_view(&self, views: &Arc<Views>, view: ImageDescriptor) -> VkResult<Key> {
        let mut known = self.heap_views.lock();
        if let Some(entry) = known.iter().find(|it| ***it == view) {
            return Ok(entry.key);
        }
        known
            .try_reserve(1)
            .map_err(|_| vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
        let name = self.identity.lock().as_ref().map(|it| it.name(&view));
        let entry = match name {
            Some(name) => ViewEntry::named(views, |it| &it.images, view, name)?,
            None => ViewEntry::store(views, |it| &it.images, view, None)?,
        };
        let key = entry.key;
        known.push(entry);
        Ok(key)
    }

    /// Host address of the first byte, of a disjoint image's first plane; null while unbound.
    pub fn data(&self) -> *mut u8 {
        self.data_of(0)
    }

    /// Host address from which a plane's offsets count; null while unbound.
    pub fn plane_data(&self, plane: &Plane) -> *mut u8 {
        self.data_of(plane.binding)
    }

    fn data_of(&self, binding: usize) -> *mut u8 {
        self.bindings[binding].address.load(Ordering::Relaxed) as *mut u8
    }

    /// Binds the image, or the aspect's plane of a disjoint image, to an address.
    pub fn bind_plane(&self, aspect: Option<vk::ImageAspectFlags>, address: u64) {
        let binding = &self.bindings[self.binding_of(aspect)];
        binding.address.store(address, Ordering::Relaxed);
    }

    /// The size to bind, of the image or of the aspect's plane of a disjoint image.
    pub fn binding_size_bytes(&self, aspect: Option<vk::ImageAspectFlags>) -> u64 {
        self.bindings[self.binding_of(aspect)].size_bytes
    }

    /// The addresses of its bound memory.
    pub fn bound_ranges(&self) -> impl Iterator<Item = Range> {
        let ranges = self.bindings.iter().map(|binding| Range {
            start: binding.address.load(Ordering::Relaxed),
            size_bytes: binding.size_bytes,
        });
        ranges.filter(|range| range.start != 0)
    }

    fn binding_of(&self, aspect: Option<vk::ImageAspectFlags>) -> usize {
        aspect
            .and_then(|aspect| self.plane(aspect))
            .map_or(0, |plane| plane.binding)
    }

    /// Binds the image to an address.
    pub fn bind(&self, address: u64) {
        self.bind_plane(None, address);
    }

    /// The plane that an aspect (one bit, or color) names.
    pub fn plane(&self, aspect: vk::ImageAspectFlags) -> Option<&Plane> {
        self.planes
            .iter()
            .find(|plane| plane.aspect.intersects(aspect))
    }

    /// Width and height of the blocks of an aspect's plane in texels.
    pub fn block_extent(&self, aspect: vk::ImageAspectFlags) -> [u32; 2] {
        self.plane(aspect)
            .map_or([1, 1], |plane| plane.block_extent)
    }

    /// Layers of a subresource range, `VK_REMAINING_ARRAY_LAYERS` resolved.
    pub fn layer_count(&self, base: u32, count: u32) -> u32 {
        let remaining = self.array_layers.saturating_sub(base);
        if count == vk::REMAINING_ARRAY_LAYERS {
            remaining
        } else {
            count.min(remaining)
        }
    }

    /// The number of slices of a 3D image's level that a layer range names,
    /// `VK_REMAINING_ARRAY_LAYERS` resolved.
    pub fn slice_count(&self, layers: &vk::ImageSubresourceLayers) -> u32 {
        let level = |plane: &Plane| plane.levels.get(layers.mip_level as usize).copied();
        match layers.layer_count {
            vk::REMAINING_ARRAY_LAYERS => (self.plane(layers.aspect_mask).and_then(level))
                .map_or(0, |level| {
                    level.depth.saturating_sub(layers.base_array_layer)
                }),
            count => count,
        }
    }

    /// Levels of a subresource range, `VK_REMAINING_MIP_LEVELS` resolved.
    pub fn level_count(&self, base: u32, count: u32) -> u32 {
        let remaining = self.mip_levels.saturating_sub(base);
        if count == vk::REMAINING_MIP_LEVELS {
            remaining
        } else {
            count.min(remaining)
        }
    }
}

fn lay_out_plane(
    info: &vk::ImageCreateInfo<'_>,
    of: &PlaneFormat,
    samples: u32,
    size_bytes: &mut u64,
) -> Option<Plane> {
    let is_resident = info.flags.contains(vk::ImageCreateFlags::SPARSE_RESIDENCY);
    let alignment = match is_resident {
        true => page_bytes(),
        false => SUBRESOURCE_ALIGNMENT,
    };
    let start = size_bytes.checked_next_multiple_of(alignment)?;
    // No size allows more levels than this (chapter Images, `VkImageCreateInfo`).
    if info.mip_levels as usize > MAX_LEVELS {
        return None;
    }
    let texel_size_bytes = format::texel_size_bytes(of.format);
    let [block_width, block_height] = of.block_extent;
    let [halves_width, halves_height] = of.halved;
    let halved = |size: u32, is_halved: bool| if is_halved { size.div_ceil(2) } else { size };
    let base = vk::Extent3D {
        width: halved(info.extent.width, halves_width),
        height: halved(info.extent.height, halves_height),
        depth: info.extent.depth,
    };
    let mut levels = Vec::with_capacity(info.mip_levels as usize);
    let mut end = 0u64;
    for index in 0..info.mip_levels {
        let side = |extent: u32| (extent.checked_shr(index).unwrap_or(0)).max(1);
        let (width, height, depth) = (side(base.width), side(base.height), side(base.depth));
        let columns = u64::from(width.div_ceil(block_width));
        let rows = u64::from(height.div_ceil(block_height));
        let mut row_stride_bytes = texel_size_bytes.checked_mul(columns)?;
        if is_resident {
            row_stride_bytes = row_stride_bytes.checked_next_multiple_of(alignment)?;
        }
        let slice_stride_bytes = row_stride_bytes.checked_mul(rows)?;
        levels.push(Level {
            offset_bytes: start + end,
            row_stride_bytes,
            slice_stride_bytes,
            width,
            height,
            depth,
        });
        end = end
            .checked_add(slice_stride_bytes.checked_mul(u64::from(depth))?)?
            .checked_next_multiple_of(alignment)?;
    }
    let layer_stride_bytes = end.checked_mul(u64::from(samples))?;
    let total = layer_stride_bytes
        .checked_mul(u64::from(info.array_layers))?
        .checked_add(start)?;
    *size_bytes = i64::try_from(total).ok()? as u64;
    Some(Plane {
        aspect: of.aspect,
        binding: 0,
        format: of.format,
        block_extent: of.block_extent,
        texel_size_bytes,
        levels,
        layer_stride_bytes,
        sample_stride_bytes: end,
    })
}

/// The capabilities of an image of this kind (`vkGetPhysicalDeviceImageFormatProperties`).
///
/// # Errors
/// `VK_ERROR_FORMAT_NOT_SUPPORTED`.
pub fn supported_image(
    format: vk::Format,
    ty: vk::ImageType,
    tiling: vk::ImageTiling,
    usage: vk::ImageUsageFlags,
    flags: vk::ImageCreateFlags,
) -> VkResult<vk::ImageFormatProperties> {
    let features = format::features(format).image;
    let is_supported = supports_usage(features, usage, flags)
        && supports_shape(ty, tiling, usage, flags)
        && supports_residency(format, ty, flags)
        && supports_planes(format, features, ty, flags)
        && supports_blocks(format, ty, flags);
    if !is_supported {
        return Err(vk::Result::ERROR_FORMAT_NOT_SUPPORTED);
    }
    let (side, side_3d) = (limits::MAX_IMAGE_DIMENSION, limits::MAX_IMAGE_DIMENSION_3D);
    let (width, height, depth) = match ty {
        vk::ImageType::TYPE_1D => (side, 1, 1),
        vk::ImageType::TYPE_2D => (side, side, 1),
        _ => (side_3d, side_3d, side_3d),
    };
    let one_sample = tiling == vk::ImageTiling::LINEAR
        || flags.contains(vk::ImageCreateFlags::SPARSE_RESIDENCY)
        || ty != vk::ImageType::TYPE_2D
        || flags.contains(vk::ImageCreateFlags::CUBE_COMPATIBLE)
        || !features.intersects(ATTACHMENT);
    Ok(vk::ImageFormatProperties {
        max_extent: vk::Extent3D {
            width,
            height,
            depth,
        },
        max_mip_levels: match format::ycbcr_planes(format) {
            Some(_) => 1,
            None => width.ilog2() + 1,
        },
        max_array_layers: if ty == vk::ImageType::TYPE_3D {
            1
        } else {
            limits::MAX_IMAGE_ARRAY_LAYERS
        },
        sample_counts: if one_sample {
            vk::SampleCountFlags::TYPE_1
        } else {
            limits::SAMPLE_COUNTS
        },
        max_resource_size: limits::MAX_BUFFER_BYTES,
    })
}

/// Features of formats that attachments may have.
const ATTACHMENT: vk::FormatFeatureFlags2 = vk::FormatFeatureFlags2::from_raw(
    vk::FormatFeatureFlags2::COLOR_ATTACHMENT.as_raw()
        | vk::FormatFeatureFlags2::DEPTH_STENCIL_ATTACHMENT.as_raw(),
);

/// Whether a format with these features supports a usage.
fn supports_usage(
    features: vk::FormatFeatureFlags2,
    usage: vk::ImageUsageFlags,
    flags: vk::ImageCreateFlags,
) -> bool {
    use vk::FormatFeatureFlags2 as Feature;
    use vk::ImageUsageFlags as Usage;
    const NEEDS: [(Usage, Feature); 8] = [
        (Usage::HOST_TRANSFER_EXT, Feature::HOST_IMAGE_TRANSFER_EXT),
        (Usage::TRANSFER_SRC, Feature::TRANSFER_SRC),
        (Usage::TRANSFER_DST, Feature::TRANSFER_DST),
        (Usage::SAMPLED, Feature::SAMPLED_IMAGE),
        (Usage::STORAGE, Feature::STORAGE_IMAGE),
        (Usage::COLOR_ATTACHMENT, Feature::COLOR_ATTACHMENT),
        (
            Usage::DEPTH_STENCIL_ATTACHMENT,
            Feature::DEPTH_STENCIL_ATTACHMENT,
        ),
        (
            Usage::FRAGMENT_SHADING_RATE_ATTACHMENT_KHR,
            Feature::FRAGMENT_SHADING_RATE_ATTACHMENT_KHR,
        ),
    ];
    let missing = NEEDS
        .iter()
        .any(|&(bit, feature)| usage.contains(bit) && !features.contains(feature));
    let input = usage.contains(Usage::INPUT_ATTACHMENT) && !features.intersects(ATTACHMENT);
    let has_features = !missing && !input;
    !features.is_empty() && (has_features || flags.contains(vk::ImageCreateFlags::EXTENDED_USAGE))
}

/// Whether an image of any format can have this type, tiling and flags.
fn supports_shape(
    ty: vk::ImageType,
    tiling: vk::ImageTiling,
    usage: vk::ImageUsageFlags,
    flags: vk::ImageCreateFlags,
) -> bool {
    let has_rates = usage.contains(vk::ImageUsageFlags::FRAGMENT_SHADING_RATE_ATTACHMENT_KHR);
    let is_flat = ty == vk::ImageType::TYPE_2D && tiling == vk::ImageTiling::OPTIMAL;
    let is_cube = flags.contains(vk::ImageCreateFlags::CUBE_COMPATIBLE);
    let has_slices = flags.intersects(
        vk::ImageCreateFlags::TYPE_2D_ARRAY_COMPATIBLE
            | vk::ImageCreateFlags::TYPE_2D_VIEW_COMPATIBLE_EXT,
    );
    (tiling == vk::ImageTiling::OPTIMAL || tiling == vk::ImageTiling::LINEAR)
        && !flags.contains(vk::ImageCreateFlags::PROTECTED)
        && (!has_rates || is_flat)
        && (!is_cube || ty == vk::ImageType::TYPE_2D)
        && (!has_slices || ty == vk::ImageType::TYPE_3D)
}

/// Whether an image can be partially resident, if the flags ask for it.
fn supports_residency(format: vk::Format, ty: vk::ImageType, flags: vk::ImageCreateFlags) -> bool {
    !flags.contains(vk::ImageCreateFlags::SPARSE_RESIDENCY)
        || (ty != vk::ImageType::TYPE_1D && resident::is_divisible(format))
}

/// Whether an image supports the planes of its format, and disjoint planes if the flags ask for
/// them.
fn supports_planes(
    format: vk::Format,
    features: vk::FormatFeatureFlags2,
    ty: vk::ImageType,
    flags: vk::ImageCreateFlags,
) -> bool {
    let is_disjoint = flags.contains(vk::ImageCreateFlags::DISJOINT);
    let is_sparse = flags.contains(vk::ImageCreateFlags::SPARSE_BINDING);
    if is_disjoint && (is_sparse || !features.contains(vk::FormatFeatureFlags2::DISJOINT)) {
        return false;
    }
    let not_in_planes =
        vk::ImageCreateFlags::SPARSE_RESIDENCY | vk::ImageCreateFlags::CUBE_COMPATIBLE;
    format::ycbcr_planes(format).is_none()
        || (ty == vk::ImageType::TYPE_2D && !flags.intersects(not_in_planes))
}

/// Whether an image supports the blocks of its format: textureCompressionETC2 and
/// textureCompressionASTC_LDR cover 2D images, textureCompressionBC also 3D.
fn supports_blocks(format: vk::Format, ty: vk::ImageType, flags: vk::ImageCreateFlags) -> bool {
    match texel_format(format).info().and_then(FormatInfo::blocks) {
        None => !flags.contains(vk::ImageCreateFlags::BLOCK_TEXEL_VIEW_COMPATIBLE),
        Some(blocks) => {
            ty == vk::ImageType::TYPE_2D || (ty != vk::ImageType::TYPE_1D && blocks.is_bc())
        }
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;

    pub fn image(
        ty: vk::ImageType,
        extent: [u32; 3],
        mip_levels: u32,
        array_layers: u32,
    ) -> VkResult<Image> {
        Image::new(&vk::ImageCreateInfo {
            image_type: ty,
            format: vk::Format::R8G8B8A8_UNORM,
            extent: vk::Extent3D {
                width: extent[0],
                height: extent[1],
                depth: extent[2],
            },
            mip_levels,
            array_layers,
            samples: vk::SampleCountFlags::TYPE_1,
            ..Default::default()
        })
    }

    #[test]
    fn levels_and_layers_do_not_overlap() {
        let image = image(vk::ImageType::TYPE_2D, [5, 3, 1], 3, 2).unwrap();
        let plane = &image.planes[0];
        let end =
            |level: &Level| level.offset_bytes + level.slice_stride_bytes * u64::from(level.depth);
        assert_eq!((plane.levels[1].width, plane.levels[1].height), (2, 1));
        assert!(end(&plane.levels[0]) <= plane.levels[1].offset_bytes);
        assert!(end(&plane.levels[1]) <= plane.levels[2].offset_bytes);
        assert!(end(&plane.levels[2]) <= plane.layer_stride_bytes);
        assert!(plane.layer_stride_bytes + end(&plane.levels[2]) <= image.size_bytes);
    }

    #[test]
    fn impossible_sizes_are_refused() {
        let huge = image(vk::ImageType::TYPE_3D, [u32::MAX; 3], 1, u32::MAX);
        assert_eq!(huge.err(), Some(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY));
    }
}
