//! Render passes, framebuffers and `VkRenderingInfo`.

use std::ffi::c_void;

use ash::vk;
use smallvec::SmallVec;

use crate::command::pass::{Attachment, Pass, PassRecorder, Resolve, inside};
use crate::ffi::{find, slice, vk as newer};
use crate::handle::{Ref, from_handle, optional, retain};
use crate::object::render_pass::{DepthStencilResolve, PassAttachment, ResolveMode, Subpass};
use crate::object::{Framebuffer, ImageView, RenderPass};

fn used(attachment: u32) -> Option<u32> {
    (attachment != vk::ATTACHMENT_UNUSED).then_some(attachment)
}

fn is_clear(op: vk::AttachmentLoadOp) -> bool {
    op == vk::AttachmentLoadOp::CLEAR
}

/// `VkRenderPassCreateInfo`.
///
/// # Safety
/// The info is valid.
pub unsafe fn render_pass(info: &vk::RenderPassCreateInfo<'_>) -> RenderPass {
    // SAFETY: the caller guarantees that the info is valid.
    unsafe {
        let views = find::<vk::RenderPassMultiviewCreateInfo>(info.p_next)
            .map_or(&[][..], |views| {
                slice(views.p_view_masks, views.subpass_count)
            });
        let attachments = slice(info.p_attachments, info.attachment_count);
        let attachment = |it: &vk::AttachmentDescription| PassAttachment {
            format: it.format,
            samples: it.samples.as_raw(),
            clears: is_clear(it.load_op),
            clears_stencil: is_clear(it.stencil_load_op),
            encoded_mean: (it.flags)
                .contains(newer::ATTACHMENT_DESCRIPTION_RESOLVE_SKIP_TRANSFER_FUNCTION_KHR),
        };
        let subpasses = slice(info.p_subpasses, info.subpass_count)
            .iter()
            .enumerate();
        let subpass = |(index, it): (usize, &vk::SubpassDescription<'_>)| {
            let list = |start: *const vk::AttachmentReference, count: u32| {
                let references = slice(start, count).iter();
                references
                    .map(|it| used(it.attachment))
                    .collect::<SmallVec<[_; 4]>>()
            };
            Subpass {
                view_mask: views.get(index).copied().unwrap_or(0),
                samples: 1,
                inputs: list(it.p_input_attachments, it.input_attachment_count),
                colors: list(it.p_color_attachments, it.color_attachment_count),
                resolves: list(it.p_resolve_attachments, it.color_attachment_count),
                depth_stencil: (it.p_depth_stencil_attachment.as_ref())
                    .and_then(|it| used(it.attachment)),
                depth_stencil_resolve: None,
                rates: None,
            }
        };
        RenderPass {
            attachments: attachments.iter().map(attachment).collect(),
            subpasses: subpasses.map(subpass).collect(),
        }
    }
}

/// `VkRenderPassCreateInfo2`.
///
/// # Safety
/// The info is valid.
pub unsafe fn render_pass2(info: &vk::RenderPassCreateInfo2<'_>) -> RenderPass {
    // SAFETY: the caller guarantees that the info is valid.
    unsafe {
        let attachments = slice(info.p_attachments, info.attachment_count);
        let attachment = |it: &vk::AttachmentDescription2<'_>| PassAttachment {
            format: it.format,
            samples: it.samples.as_raw(),
            clears: is_clear(it.load_op),
            clears_stencil: is_clear(it.stencil_load_op),
            encoded_mean: (it.flags)
                .contains(newer::ATTACHMENT_DESCRIPTION_RESOLVE_SKIP_TRANSFER_FUNCTION_KHR),
        };
        let subpass = |it: &vk::SubpassDescription2<'_>| {
            let list = |start: *const vk::AttachmentReference2<'_>, count: u32| {
                let references = slice(start, count).iter();
                references
                    .map(|it| used(it.attachment))
                    .collect::<SmallVec<[_; 4]>>()
            };
            let resolve = find::<vk::SubpassDescriptionDepthStencilResolve>(it.p_next);
            let rates = find::<vk::FragmentShadingRateAttachmentInfoKHR>(it.p_next);
            let rates = rates.and_then(|it| it.p_fragment_shading_rate_attachment.as_ref());
            Subpass {
                view_mask: it.view_mask,
                samples: pass_samples(it.p_next),
                inputs: list(it.p_input_attachments, it.input_attachment_count),
                colors: list(it.p_color_attachments, it.color_attachment_count),
                resolves: list(it.p_resolve_attachments, it.color_attachment_count),
                depth_stencil: (it.p_depth_stencil_attachment.as_ref())
                    .and_then(|it| used(it.attachment)),
                depth_stencil_resolve: resolve.map(|it| DepthStencilResolve {
                    attachment: (it.p_depth_stencil_resolve_attachment.as_ref())
                        .and_then(|reference| used(reference.attachment)),
                    depth: it.depth_resolve_mode,
                    stencil: it.stencil_resolve_mode,
                }),
                rates: rates.and_then(|it| used(it.attachment)),
            }
        };
        RenderPass {
            attachments: attachments.iter().map(attachment).collect(),
            subpasses: slice(info.p_subpasses, info.subpass_count)
                .iter()
                .map(subpass)
                .collect(),
        }
    }
}

/// Samples per pixel of draws to attachments with one sample; 1 by default.
///
/// # Safety
/// The chain is valid.
unsafe fn pass_samples(next: *const c_void) -> u32 {
    // SAFETY: the caller guarantees that the chain is valid.
    let info = unsafe { find::<vk::MultisampledRenderToSingleSampledInfoEXT>(next) };
    let info = info.filter(|it| it.multisampled_render_to_single_sampled_enable != vk::FALSE);
    info.map_or(1, |it| it.rasterization_samples.as_raw().clamp(1, 8))
}

/// `VkFramebufferCreateInfo`.
///
/// # Safety
/// The info is valid and its handles are alive.
pub unsafe fn framebuffer(info: &vk::FramebufferCreateInfo<'_>) -> Framebuffer {
    // SAFETY: the caller guarantees that the info is valid and its handles are alive.
    unsafe {
        let attachments = match info.flags.contains(vk::FramebufferCreateFlags::IMAGELESS) {
            true => &[],
            false => slice(info.p_attachments, info.attachment_count),
        };
        let retained = |&view: &vk::ImageView| retain::<ImageView>(view);
        Framebuffer {
            attachments: attachments.iter().map(retained).collect(),
            extent: [info.width, info.height],
            layers: info.layers,
        }
    }
}

/// `VkRenderPassBeginInfo`.
///
/// # Safety
/// The info is valid and its handles are alive.
pub unsafe fn begin(info: &vk::RenderPassBeginInfo<'_>) -> PassRecorder {
    // SAFETY: the caller guarantees that the info is valid and its handles are alive.
    unsafe {
        let framebuffer = from_handle::<Framebuffer>(info.framebuffer);
        let imageless = find::<vk::RenderPassAttachmentBeginInfo>(info.p_next);
        let views = match imageless {
            Some(views) if framebuffer.attachments.is_empty() => {
                let views = slice(views.p_attachments, views.attachment_count).iter();
                views.map(|&view| retain::<ImageView>(view)).collect()
            }
            _ => framebuffer.attachments.clone(),
        };
        PassRecorder::new(
            retain(info.render_pass),
            views,
            slice(info.p_clear_values, info.clear_value_count).to_vec(),
            inside(info.render_area, framebuffer.extent),
            framebuffer.layers,
        )
    }
}

/// `VkRenderingInfo`.
///
/// # Safety
/// The info is valid and its handles are alive.
pub unsafe fn rendering(info: &vk::RenderingInfo<'_>) -> Pass {
    // SAFETY: the caller guarantees that the info is valid and its handles are alive.
    unsafe {
        let colors = slice(info.p_color_attachments, info.color_attachment_count);
        let resumes = info.flags.contains(vk::RenderingFlags::RESUMING);
        let rates = find::<vk::RenderingFragmentShadingRateAttachmentInfoKHR>(info.p_next);
        Pass {
            area: info.render_area,
            layers: info.layer_count,
            view_mask: info.view_mask,
            samples: pass_samples(info.p_next),
            colors: std::array::from_fn(|color| rendering_attachment(colors.get(color)?)),
            depth: aspect(info.p_depth_attachment, vk::ImageAspectFlags::DEPTH),
            stencil: aspect(info.p_stencil_attachment, vk::ImageAspectFlags::STENCIL),
            rates: rates.and_then(|it| optional_view(it.image_view)),
            clears: Vec::new(),
            resumes,
            suspends: info.flags.contains(vk::RenderingFlags::SUSPENDING),
        }
    }
}

/// # Safety
/// The pointer is null or leads to a valid info, whose handles are alive.
unsafe fn aspect(
    info: *const vk::RenderingAttachmentInfo<'_>,
    aspect: vk::ImageAspectFlags,
) -> Option<Attachment> {
    // SAFETY: the caller guarantees that the pointer is null or to a valid info, whose handles are
    // alive.
    let attachment = unsafe { rendering_attachment(info.as_ref()?) }?;
    attachment.view.image.plane(aspect)?;
    Some(attachment)
}

/// # Safety
/// The info is valid and its handles are alive.
unsafe fn rendering_attachment(info: &vk::RenderingAttachmentInfo<'_>) -> Option<Attachment> {
    // SAFETY: the caller guarantees that the info is valid and its handles are alive.
    unsafe {
        let view = optional_view(info.image_view)?;
        let flags = find::<newer::RenderingAttachmentFlagsInfoKHR<'_>>(info.p_next);
        let mode = ResolveMode {
            mode: info.resolve_mode,
            encoded_mean: flags.is_some_and(|it| {
                it.flags & newer::RENDERING_ATTACHMENT_RESOLVE_SKIP_TRANSFER_FUNCTION_KHR != 0
            }),
        };
        let resolve = (!info.resolve_mode.is_empty())
            .then(|| optional_view(info.resolve_image_view))
            .flatten();
        Some(Attachment {
            view,
            clear: is_clear(info.load_op).then_some((info.clear_value, u32::MAX)),
            resolve: resolve.map(|view| Resolve { view, mode }),
            mode,
        })
    }
}

/// # Safety
/// The handle is null or alive.
unsafe fn optional_view(view: vk::ImageView) -> Option<Ref<ImageView>> {
    // SAFETY: the caller guarantees that the handle is null or alive.
    unsafe { optional::<ImageView>(view).map(|_| retain(view)) }
}
