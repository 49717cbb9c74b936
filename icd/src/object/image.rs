//! Images and image views. Images are stored linearly: a plane per aspect, in it layers, in each layer samples, in each sample mip levels.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ash::vk;
use parking_lot::Mutex;
use spirv_jit::image::{ImageDescriptor, Level};

use crate::VkResult;
use crate::format;

/// Levels, samples and layers start at multiples of this.
const SUBRESOURCE_ALIGNMENT: u64 = 64;

/// One aspect of an image: color, depth or stencil. A combined depth-stencil format has two planes of simple formats.
#[derive(Clone, Debug)]
pub struct Plane {
    pub aspect: vk::ImageAspectFlags,
    /// The plane's own format: `D32_SFLOAT` and `S8_UINT` for `D32_SFLOAT_S8_UINT`.
    pub format: vk::Format,
    pub texel_size_bytes: u64,
    /// Of layer 0, sample 0, from the image's start in each level's `offset_bytes`.
    pub levels: Vec<Level>,
    pub layer_stride_bytes: u64,
    /// Between the planes of samples; the layer is `samples` of these.
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
    pub size_bytes: u64,
    address: AtomicU64,
}

impl Image {
    /// Lays an image out, unbound.
    ///
    /// # Errors
    /// `VK_ERROR_FORMAT_NOT_SUPPORTED`; `VK_ERROR_OUT_OF_DEVICE_MEMORY` if its size does not fit in 63 bits.
    pub fn new(info: &vk::ImageCreateInfo<'_>) -> VkResult<Self> {
        let samples = info.samples.as_raw().max(1);
        let mut size_bytes = 0u64;
        let mut planes = Vec::new();
        for (aspect, format) in format::planes(info.format) {
            let texel_size_bytes = format::texel_size_bytes(format);
            if texel_size_bytes == 0 {
                return Err(vk::Result::ERROR_FORMAT_NOT_SUPPORTED);
            }
            let plane = lay_out_plane(
                info,
                aspect,
                format,
                texel_size_bytes,
                samples,
                &mut size_bytes,
            )
            .ok_or(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY)?;
            planes.push(plane);
        }
        if planes.is_empty() {
            return Err(vk::Result::ERROR_FORMAT_NOT_SUPPORTED);
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
            size_bytes,
            address: AtomicU64::new(0),
        })
    }

    /// Host address of the first byte; null while unbound.
    pub fn data(&self) -> *mut u8 {
        self.address.load(Ordering::Relaxed) as *mut u8
    }

    /// Binds the image to an address.
    pub fn bind(&self, address: u64) {
        self.address.store(address, Ordering::Relaxed);
    }

    /// The plane that an aspect (one bit, or color) names.
    pub fn plane(&self, aspect: vk::ImageAspectFlags) -> Option<&Plane> {
        self.planes
            .iter()
            .find(|plane| plane.aspect.intersects(aspect))
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
    aspect: vk::ImageAspectFlags,
    format: vk::Format,
    texel_size_bytes: u64,
    samples: u32,
    size_bytes: &mut u64,
) -> Option<Plane> {
    let start = size_bytes.checked_next_multiple_of(SUBRESOURCE_ALIGNMENT)?;
    let mut levels = Vec::with_capacity(info.mip_levels as usize);
    let mut end = 0u64;
    for index in 0..info.mip_levels.min(32) {
        let side = |extent: u32| (extent.checked_shr(index).unwrap_or(0)).max(1);
        let (width, height, depth) = (
            side(info.extent.width),
            side(info.extent.height),
            side(info.extent.depth),
        );
        let row_stride_bytes = texel_size_bytes.checked_mul(u64::from(width))?;
        let slice_stride_bytes = row_stride_bytes.checked_mul(u64::from(height))?;
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
            .checked_next_multiple_of(SUBRESOURCE_ALIGNMENT)?;
    }
    let layer_stride_bytes = end.checked_mul(u64::from(samples))?;
    let total = layer_stride_bytes
        .checked_mul(u64::from(info.array_layers))?
        .checked_add(start)?;
    *size_bytes = i64::try_from(total).ok()? as u64;
    Some(Plane {
        aspect,
        format,
        texel_size_bytes,
        levels,
        layer_stride_bytes,
        sample_stride_bytes: end,
    })
}

/// Descriptor contents at an address that stays readable for the device's life: a descriptor set may still name a view that is gone.
/// Slots of destroyed objects are nulled and used again.
pub struct StableDescriptor<T: Send + 'static> {
    slot: Option<Box<T>>,
    home: Arc<DescriptorSlab<T>>,
}

impl<T: Send> StableDescriptor<T> {
    /// What descriptor sets store.
    pub fn as_ptr(&self) -> *const T {
        self.slot
            .as_deref()
            .map_or(std::ptr::null(), std::ptr::from_ref)
    }
}

impl<T: Send> std::ops::Deref for StableDescriptor<T> {
    type Target = T;

    fn deref(&self) -> &T {
        self.slot.as_deref().expect("present until dropped")
    }
}

impl<T: Send> Drop for StableDescriptor<T> {
    fn drop(&mut self) {
        if let Some(mut slot) = self.slot.take() {
            (self.home.nullify)(&mut slot);
            self.home.free.lock().push(slot);
        }
    }
}

/// The slots of one kind of descriptor contents.
pub struct DescriptorSlab<T: Send + 'static> {
    free: Mutex<Vec<Box<T>>>,
    nullify: fn(&mut T),
}

impl<T: Send> DescriptorSlab<T> {
    /// An empty slab; `nullify` makes contents that reads give zeros from.
    pub fn new(nullify: fn(&mut T)) -> Arc<Self> {
        Arc::new(Self {
            free: Mutex::new(Vec::new()),
            nullify,
        })
    }

    /// Stores contents in a slot.
    pub fn store(self: &Arc<Self>, contents: T) -> StableDescriptor<T> {
        let slot = match self.free.lock().pop() {
            Some(mut slot) => {
                *slot = contents;
                slot
            }
            None => Box::new(contents),
        };
        StableDescriptor {
            slot: Some(slot),
            home: Arc::clone(self),
        }
    }
}

/// An image view, resolved to what shaders read, and the part of the image that commands write.
pub struct ImageView {
    pub descriptor: StableDescriptor<SendDescriptor>,
    pub range: vk::ImageSubresourceRange,
}

/// An [`ImageDescriptor`] that may change threads: its pointer is the application's memory.
#[repr(transparent)]
pub struct SendDescriptor(pub ImageDescriptor);

// SAFETY: plain data; accesses through the pointer are synchronised by the application (chapter Synchronization).
unsafe impl Send for SendDescriptor {}
// SAFETY: as above.
unsafe impl Sync for SendDescriptor {}
