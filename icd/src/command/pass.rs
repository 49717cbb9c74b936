//! Passes as they are executed: what is drawn into, and what happens at their beginning and end.
//!
//! Render passes become passes of this kind when they are recorded, one a subpass: an attachment's
//! load operation stands in the first subpass that uses it (of each view), a resolve in the subpass
//! that asks for it. So there is one way to draw.

#![forbid(unsafe_code)]

use ash::vk;
use smallvec::SmallVec;

use crate::handle::Ref;
use crate::object::graphics_state::MAX_COLOR_ATTACHMENTS;
use crate::object::render_pass::ResolveMode;
use crate::object::{ImageView, RenderPass};

/// `VkRenderingInfo`, or a subpass.
pub struct Pass {
    pub area: vk::Rect2D,
    /// Layers that are drawn to; with views, that they may lie in.
    pub layers: u32,
    /// 0 without multiview.
    pub view_mask: u32,
    /// Samples that draws have of attachments with one
    /// (`VkMultisampledRenderToSingleSampledInfoEXT`), or 1.
    pub samples: u32,
    pub colors: [Option<Attachment>; MAX_COLOR_ATTACHMENTS],
    pub depth: Option<Attachment>,
    pub stencil: Option<Attachment>,
    /// The attachment of fragment shading rates.
    pub rates: Option<Ref<ImageView>>,
    /// Load operations of what is not drawn into: input attachments, and destinations of resolves.
    pub clears: Vec<ViewClear>,
    /// It goes on with what an earlier one suspended: nothing is loaded.
    pub resumes: bool,
    /// A later one goes on: nothing is resolved.
    pub suspends: bool,
}

/// An attachment of a pass; depth and stencil are apart.
pub struct Attachment {
    pub view: Ref<ImageView>,
    /// `VK_ATTACHMENT_LOAD_OP_CLEAR`: with what, and in which views (all of the pass's, but in
    /// render passes).
    pub clear: Option<(vk::ClearValue, u32)>,
    pub resolve: Option<Resolve>,
    /// How samples of the pass become the attachment's only one, where it draws with more.
    pub mode: ResolveMode,
}

/// A resolve at the end of a pass.
pub struct Resolve {
    pub view: Ref<ImageView>,
    pub mode: ResolveMode,
}

/// A clear at the beginning of a pass.
pub struct ViewClear {
    pub view: Ref<ImageView>,
    /// Of the attachment, those with this load operation.
    pub aspects: vk::ImageAspectFlags,
    pub value: vk::ClearValue,
    /// 0 without multiview.
    pub view_mask: u32,
}

/// A render pass while it is recorded.
pub struct PassRecorder {
    render_pass: Ref<RenderPass>,
    views: Vec<Ref<ImageView>>,
    clear_values: Vec<vk::ClearValue>,
    area: vk::Rect2D,
    layers: u32,
    subpass: usize,
    /// By attachment: the views whose load operations are done; all bits without multiview.
    loaded: Vec<u32>,
}

impl PassRecorder {
    /// Before the first subpass. `views` are the framebuffer's attachments.
    pub fn new(
        render_pass: Ref<RenderPass>,
        views: Vec<Ref<ImageView>>,
        clear_values: Vec<vk::ClearValue>,
        area: vk::Rect2D,
        layers: u32,
    ) -> Self {
        let loaded = vec![0; render_pass.attachments.len()];
        Self {
            render_pass,
            views,
            clear_values,
            area,
            layers,
            subpass: 0,
            loaded,
        }
    }

    /// On to the next subpass.
    pub fn advance(&mut self) {
        self.subpass += 1;
    }

    /// The current subpass; `None` past the last one.
    pub fn pass(&mut self) -> Option<Pass> {
        let render_pass = Ref::clone(&self.render_pass);
        let subpass = render_pass.subpasses.get(self.subpass)?;
        let views = match subpass.view_mask {
            0 => u32::MAX,
            mask => mask,
        };
        let (mut loads, mut clears) = (vec![0; self.loaded.len()], Vec::new());
        for attachment in subpass.attachments() {
            if let Some(loaded) = self.loaded.get_mut(attachment as usize) {
                loads[attachment as usize] |= views & !*loaded;
                *loaded |= views;
            }
        }
        let drawn =
            |index| subpass.colors.contains(&Some(index)) || subpass.depth_stencil == Some(index);
        for (index, &load) in loads.iter().enumerate().filter(|(_, load)| **load != 0) {
            let Some((view, info)) = self.attachment(index as u32) else {
                continue;
            };
            let mut aspects = vk::ImageAspectFlags::empty();
            if info.clears {
                aspects |= vk::ImageAspectFlags::COLOR | vk::ImageAspectFlags::DEPTH;
            }
            if info.clears_stencil {
                aspects |= vk::ImageAspectFlags::STENCIL;
            }
            if !drawn(index as u32) && !aspects.is_empty() {
                clears.push(ViewClear {
                    view: Ref::clone(view),
                    aspects,
                    value: self.clear_value(index),
                    view_mask: load & subpass.view_mask,
                });
            }
        }
        let attachment = |index: u32, clears: bool, resolve: Option<Resolve>, mode| {
            let (view, _) = self.attachment(index)?;
            let load = loads[index as usize];
            Some(Attachment {
                view: Ref::clone(view),
                clear: (clears && load != 0).then(|| (self.clear_value(index as usize), load)),
                resolve,
                mode,
            })
        };
        let resolve = |index: u32, mode: ResolveMode| {
            let (view, info) = self.attachment(index)?;
            let mode = ResolveMode {
                encoded_mean: info.encoded_mean,
                ..mode
            };
            let view = Ref::clone(view);
            (!mode.mode.is_empty()).then_some(Resolve { view, mode })
        };
        let colors = std::array::from_fn(|color| {
            let index = subpass.colors.get(color).copied().flatten()?;
            let (_, info) = self.attachment(index)?;
            let destination = subpass.resolves.get(color).copied().flatten();
            let resolve = destination.and_then(|it| resolve(it, ResolveMode::AVERAGE));
            let mode = ResolveMode {
                encoded_mean: info.encoded_mean,
                ..ResolveMode::AVERAGE
            };
            attachment(index, info.clears, resolve, mode)
        });
        let side = |stencil: bool| {
            let index = subpass.depth_stencil?;
            let (view, info) = self.attachment(index)?;
            let (aspect, clears) = match stencil {
                false => (vk::ImageAspectFlags::DEPTH, info.clears),
                true => (vk::ImageAspectFlags::STENCIL, info.clears_stencil),
            };
            view.image.plane(aspect)?;
            let mode = match (subpass.depth_stencil_resolve, stencil) {
                (None, _) => vk::ResolveModeFlags::NONE,
                (Some(modes), false) => modes.depth,
                (Some(modes), true) => modes.stencil,
            };
            let mode = ResolveMode::linear(mode);
            let to = subpass.depth_stencil_resolve.and_then(|it| it.attachment);
            let resolve = to.and_then(|to| resolve(to, mode));
            attachment(index, clears, resolve, mode)
        };
        Some(Pass {
            area: self.area,
            layers: self.layers,
            view_mask: subpass.view_mask,
            samples: subpass.samples,
            colors,
            depth: side(false),
            stencil: side(true),
            rates: (subpass.rates.and_then(|it| self.attachment(it)))
                .map(|(view, _)| Ref::clone(view)),
            clears,
            resumes: false,
            suspends: false,
        })
    }

    fn attachment(
        &self,
        index: u32,
    ) -> Option<(&Ref<ImageView>, &crate::object::render_pass::PassAttachment)> {
        let index = index as usize;
        Some((
            self.views.get(index)?,
            self.render_pass.attachments.get(index)?,
        ))
    }

    fn clear_value(&self, index: usize) -> vk::ClearValue {
        self.clear_values.get(index).copied().unwrap_or_default()
    }
}

/// The colours of a clear of several attachments, or of one (`VkClearAttachment`).
#[derive(Clone, Copy)]
pub struct AttachmentClear {
    pub aspects: vk::ImageAspectFlags,
    /// Of colour.
    pub attachment: u32,
    pub value: vk::ClearValue,
}

/// `vkCmdClearAttachments`.
pub struct AttachmentClears {
    pub clears: SmallVec<[AttachmentClear; 2]>,
    pub rects: SmallVec<[vk::ClearRect; 1]>,
}

/// An area, as far as it lies inside what has this size.
pub fn inside(area: vk::Rect2D, [width, height]: [u32; 2]) -> vk::Rect2D {
    let side = |first: i32, size: u32, most: u32| {
        let end = (i64::from(first) + i64::from(size)).clamp(0, i64::from(most));
        let first = i64::from(first).clamp(0, end);
        (first as i32, (end - first) as u32)
    };
    let (x, width) = side(area.offset.x, area.extent.width, width);
    let (y, height) = side(area.offset.y, area.extent.height, height);
    vk::Rect2D {
        offset: vk::Offset2D { x, y },
        extent: vk::Extent2D { width, height },
    }
}
