//! Passes as they are executed: their attachments, load operations and resolves.
//!
//! Recording turns each subpass of a render pass into such a pass. An attachment's load operation
//! goes to the first subpass that uses the attachment (for each view), a resolve to the subpass
//! that asks for it. So drawing handles one kind of pass.

#![forbid(unsafe_code)]

use ash::vk;
use smallvec::SmallVec;

use crate::handle::Ref;
use crate::object::graphics_state::MAX_COLOR_ATTACHMENTS;
use crate::object::render_pass::{ResolveMode, Subpass};
use crate::object::{ImageView, RenderPass};

/// `VkRenderingInfo`, or a subpass.
pub struct Pass {
    pub area: vk::Rect2D,
    /// Layers of the pass; with views, the layers that views may lie in.
    pub layers: u32,
    /// 0 without multiview.
    pub view_mask: u32,
    /// Samples per pixel of draws to attachments with one sample
    /// (`VkMultisampledRenderToSingleSampledInfoEXT`), or 1.
    pub samples: u32,
    pub colors: [Option<Attachment>; MAX_COLOR_ATTACHMENTS],
    pub depth: Option<Attachment>,
    pub stencil: Option<Attachment>,
    /// The attachment of fragment shading rates.
    pub rates: Option<Ref<ImageView>>,
    /// Clears of attachments that the pass does not draw to: input attachments, and destinations of
    /// resolves.
    pub clears: Vec<ViewClear>,
    /// The pass resumes a suspended one, and loads nothing.
    pub resumes: bool,
    /// A later pass resumes this one, which resolves nothing.
    pub suspends: bool,
}

/// An attachment of a pass. Depth and stencil are two attachments.
pub struct Attachment {
    pub view: Ref<ImageView>,
    /// `VK_ATTACHMENT_LOAD_OP_CLEAR`: the value, and the views to clear. Outside of render passes
    /// these are all views.
    pub clear: Option<(vk::ClearValue, u32)>,
    pub resolve: Option<Resolve>,
    /// How several samples of the pass become the attachment's single sample.
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
    /// The attachment's aspects that are cleared.
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
    /// For each attachment, the views whose load operations are done; all bits without multiview.
    loaded: Vec<u32>,
}

impl PassRecorder {
    /// Begins before the first subpass. `views` are the framebuffer's attachments.
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

    /// Advances to the next subpass.
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
        let loads = self.take_loads(subpass, views);
        let clears = self.clears(subpass, &loads);
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

    /// The views of each attachment that a subpass loads: those that it is the first to use.
    fn take_loads(&mut self, subpass: &Subpass, views: u32) -> Vec<u32> {
        let mut loads = vec![0; self.loaded.len()];
        for attachment in subpass.attachments() {
            if let Some(loaded) = self.loaded.get_mut(attachment as usize) {
                loads[attachment as usize] |= views & !*loaded;
                *loaded |= views;
            }
        }
        loads
    }

    /// The clears of attachments that a subpass loads and does not draw to.
    fn clears(&self, subpass: &Subpass, loads: &[u32]) -> Vec<ViewClear> {
        let drawn =
            |index| subpass.colors.contains(&Some(index)) || subpass.depth_stencil == Some(index);
        let mut clears = Vec::new();
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
        clears
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

/// `VkClearAttachment`.
#[derive(Clone, Copy)]
pub struct AttachmentClear {
    pub aspects: vk::ImageAspectFlags,
    /// The index of a color attachment.
    pub attachment: u32,
    pub value: vk::ClearValue,
}

/// `vkCmdClearAttachments`.
pub struct AttachmentClears {
    pub clears: SmallVec<[AttachmentClear; 2]>,
    pub rects: SmallVec<[vk::ClearRect; 1]>,
}

/// The part of an area that lies inside an image of this size.
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
