//! Samplers.

#![forbid(unsafe_code)]

use images::SamplerDescriptor;

use super::image_view::ViewEntry;

/// A sampler, resolved to what shaders read.
pub struct Sampler {
    pub descriptor: ViewEntry<SamplerDescriptor>,
}
