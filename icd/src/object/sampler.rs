//! Samplers.

#![forbid(unsafe_code)]

use images::SamplerDescriptor;

use super::view_entry::ViewEntry;

/// A sampler, as the descriptor that shaders read.
pub struct Sampler {
    pub descriptor: ViewEntry<SamplerDescriptor>,
}
