//! Render passes and framebuffers.

#![forbid(unsafe_code)]

use ash::vk;
use smallvec::SmallVec;

use super::ImageView;
use crate::handle::Ref;

/// `VkRenderPass`: the data that its commands need. Store operations are not kept, because contents
/// that need not be stored may be stored as drawn.
pub struct RenderPass {
    pub attachments: Vec<PassAttachment>,
    pub subpasses: Vec<Subpass>,
}

/// `VkAttachmentDescription`.
#[derive(Clone, Copy, Debug)]
pub struct PassAttachment {
    pub format: vk::Format,
    pub samples: u32,
    /// Clears color or depth.
    pub clears: bool,
    pub clears_stencil: bool,
    /// `VK_ATTACHMENT_DESCRIPTION_RESOLVE_SKIP_TRANSFER_FUNCTION_BIT_KHR`.
    pub encoded_mean: bool,
}

/// The way in which samples are resolved to one.
#[derive(Clone, Copy, Debug)]
pub struct ResolveMode {
    /// One mode, or none.
    pub mode: vk::ResolveModeFlags,
    /// sRGB samples are averaged in encoded form.
    pub encoded_mean: bool,
}

impl ResolveMode {
    /// The mean of colors in linear light.
    pub const AVERAGE: Self = Self::linear(vk::ResolveModeFlags::AVERAGE);

    /// A mode with means in linear light.
    pub const fn linear(mode: vk::ResolveModeFlags) -> Self {
        Self {
            mode,
            encoded_mean: false,
        }
    }
}

/// `VkSubpassDescription`: attachments by index; `None` for unused ones.
#[derive(Clone, Debug, Default)]
pub struct Subpass {
    /// 0 without multiview.
    pub view_mask: u32,
    /// Samples per pixel of draws to attachments with one sample
    /// (`VkMultisampledRenderToSingleSampledInfoEXT`), or 1.
    pub samples: u32,
    pub inputs: SmallVec<[Option<u32>; 4]>,
    pub colors: SmallVec<[Option<u32>; 4]>,
    /// As many as `colors`, or none.
    pub resolves: SmallVec<[Option<u32>; 4]>,
    pub depth_stencil: Option<u32>,
    pub depth_stencil_resolve: Option<DepthStencilResolve>,
    /// `VkFragmentShadingRateAttachmentInfoKHR`.
    pub rates: Option<u32>,
}

/// `VkSubpassDescriptionDepthStencilResolve`.
#[derive(Clone, Copy, Debug)]
pub struct DepthStencilResolve {
    /// `None` if only the pass's own samples are resolved.
    pub attachment: Option<u32>,
    pub depth: vk::ResolveModeFlags,
    pub stencil: vk::ResolveModeFlags,
}

impl Subpass {
    /// All attachments that the subpass uses.
    pub fn attachments(&self) -> impl Iterator<Item = u32> {
        let resolve = (self.depth_stencil_resolve).and_then(|resolve| resolve.attachment);
        (self.inputs.iter().chain(&self.colors).chain(&self.resolves))
            .copied()
            .chain([self.depth_stencil, resolve])
            .flatten()
    }
}

/// `VkFramebuffer`.
pub struct Framebuffer {
    /// The attachments; empty for imageless framebuffers.
    pub attachments: Vec<Ref<ImageView>>,
    pub extent: [u32; 2],
    pub layers: u32,
}
