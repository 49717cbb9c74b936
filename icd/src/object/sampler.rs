//! Samplers.

#![forbid(unsafe_code)]

use images::SamplerDescriptor;

use super::view_entry::ViewEntry;

/// A sampler, resolved to what shaders read.
pub struct Sampler {
    pub descriptor: ViewEntry<SamplerDescriptor>,
}
