//! Render passes and framebuffers.

#![forbid(unsafe_code)]

use ash::vk;
use smallvec::SmallVec;

use super::ImageView;
use crate::handle::Ref;

/// `VkRenderPass`: what beginning one in a command buffer needs to know. What becomes of contents
/// that are not stored is as good as what was drawn, so store operations are not kept.
pub struct RenderPass {
    pub attachments: Vec<PassAttachment>,
    pub subpasses: Vec<Subpass>,
}

/// `VkAttachmentDescription`.
#[derive(Clone, Copy, Debug)]
pub struct PassAttachment {
    pub format: vk::Format,
    pub samples: u32,
    /// Of colour, or of depth.
    pub clears: bool,
    pub clears_stencil: bool,
    /// `VK_ATTACHMENT_DESCRIPTION_RESOLVE_SKIP_TRANSFER_FUNCTION_BIT_KHR`.
    pub encoded_mean: bool,
}

/// The way in which samples become one.
#[derive(Clone, Copy, Debug)]
pub struct ResolveMode {
    /// One mode, or none.
    pub mode: vk::ResolveModeFlags,
    /// Means of sRGB samples are those of their codes.
    pub encoded_mean: bool,
}

impl ResolveMode {
    /// The mean of colours in linear light.
    pub const AVERAGE: Self = Self::linear(vk::ResolveModeFlags::AVERAGE);

    /// A mode that gives means in linear light.
    pub const fn linear(mode: vk::ResolveModeFlags) -> Self {
        Self {
            mode,
            encoded_mean: false,
        }
    }
}

/// `VkSubpassDescription`: attachments by index; none where one is unused.
#[derive(Clone, Debug, Default)]
pub struct Subpass {
    /// 0 without multiview.
    pub view_mask: u32,
    /// Samples that draws have of attachments with one
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
    /// None if only samples of the pass are resolved.
    pub attachment: Option<u32>,
    pub depth: vk::ResolveModeFlags,
    pub stencil: vk::ResolveModeFlags,
}

impl Subpass {
    /// All that it uses.
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
    /// Empty for imageless ones.
    pub attachments: Vec<Ref<ImageView>>,
    pub extent: [u32; 2],
    pub layers: u32,
}
