//! Render passes and framebuffers. Nothing can begin one while there is no graphics queue, but applications create them with their other
//! objects, and what they name must live as long as they do.

#![forbid(unsafe_code)]

use super::ImageView;
use crate::handle::Ref;

/// `VkRenderPass`.
pub struct RenderPass {
    pub attachment_count: u32,
    pub subpass_count: u32,
}

/// `VkFramebuffer`.
pub struct Framebuffer {
    pub render_pass: Ref<RenderPass>,
    /// Empty for imageless ones.
    pub attachments: Vec<Ref<ImageView>>,
    pub extent: [u32; 2],
    pub layers: u32,
}
