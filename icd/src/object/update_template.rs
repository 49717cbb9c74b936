//! Descriptor update templates.

#![forbid(unsafe_code)]

use ash::vk;

use super::PipelineLayout;
use crate::handle::Ref;

/// A descriptor update template: where in the application's data each descriptor is.
pub struct DescriptorUpdateTemplate {
    pub entries: Vec<vk::DescriptorUpdateTemplateEntry>,
    pub bind_point: vk::PipelineBindPoint,
    pub set: u32,
    /// Push descriptor templates.
    pub layout: Option<Ref<PipelineLayout>>,
}
