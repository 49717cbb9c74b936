//! Descriptors as programs use them.

use images::{Format, ImageDescriptor, SamplerDescriptor};

/// One entry of a descriptor set, already resolved: an access is one load and one bounds check.
///
/// | type | `address` | `size_bytes` | `extra` |
/// |---|---|---|---|
/// | buffers (and inline uniform blocks, push constants) | first byte | range | – |
/// | images, texel buffers | – | – | the image is `image` |
/// | texel buffers without a view ([`Descriptor::texel_buffer`]) | first byte | range | format, in `image` |
/// | samplers | – | – | the sampler is `sampler` |
/// | acceleration structure | device address | – | – |
///
/// The all-zero descriptor is the null descriptor: reads give zero, writes are dropped.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug)]
pub struct Descriptor {
    pub address: u64,
    pub size_bytes: u64,
    /// Image or texel buffer view, or null.
    pub image: *const ImageDescriptor,
    /// Sampler, or null.
    pub sampler: *const SamplerDescriptor,
}

impl Descriptor {
    /// The null descriptor.
    pub const NULL: Descriptor = Descriptor {
        address: 0,
        size_bytes: 0,
        image: std::ptr::null(),
        sampler: std::ptr::null(),
    };

    /// A texel buffer without a view: the descriptor has all its data.
    pub fn texel_buffer(address: u64, size_bytes: u64, format: Format) -> Self {
        Self {
            address,
            size_bytes,
            // Odd, as no address of an image is.
            image: std::ptr::without_provenance((format.0 as usize) << 1 | 1),
            ..Self::NULL
        }
    }

    /// The image that the descriptor points to; null if it holds one itself.
    #[inline]
    pub fn viewed_image(&self) -> *const ImageDescriptor {
        if self.image.addr() & 1 == 0 {
            self.image
        } else {
            std::ptr::null()
        }
    }

    /// The image that the descriptor holds instead of pointing to it, if it does.
    #[inline]
    pub fn held_image(&self) -> Option<ImageDescriptor> {
        let is_held = self.image.addr() & 1 != 0;
        is_held.then(|| {
            let format = Format((self.image.addr() >> 1) as u32);
            ImageDescriptor::texel_buffer(self.address as *mut u8, self.size_bytes, format)
        })
    }
}

// SAFETY: a descriptor is plain data; what it points to is kept alive and synchronised by the
// Vulkan application's own rules.
unsafe impl Send for Descriptor {}
// SAFETY: a descriptor is plain data; what it points to is kept alive and synchronised by the
// Vulkan application's own rules.
unsafe impl Sync for Descriptor {}
