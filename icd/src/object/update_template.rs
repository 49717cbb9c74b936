//! Descriptor update templates.

#![forbid(unsafe_code)]

use ash::vk;

use super::PipelineLayout;
use crate::handle::Ref;

/// A descriptor update template: the offsets of the descriptors in the application's data.
pub struct DescriptorUpdateTemplate {
    pub entries: Vec<vk::DescriptorUpdateTemplateEntry>,
    pub bind_point: vk::PipelineBindPoint,
    pub set: u32,
    /// The target of push descriptor templates.
    pub layout: Option<Ref<PipelineLayout>>,
}
