//! The current pass of a submission: its attachments in the rasterizer's form, load operations and
//! resolves.

use std::sync::Arc;

use ash::vk;
use smallvec::SmallVec;
use spirv_jit::environment;

use super::samples::Samples;
use crate::capabilities::limits::{MAX_IMAGE_ARRAY_LAYERS, MAX_IMAGE_DIMENSION};
use crate::command::pass::{Attachment, Pass, inside};
use crate::object::ImageView;
use crate::object::graphics_state::MAX_COLOR_ATTACHMENTS;
use crate::raster::{Batch, Clear, ClearValue, Target, Targets, Work};
use crate::transfer::clear::clear_view;
use crate::transfer::resolve::resolve_attachment;
use crate::transfer::surface::Surface;
use crate::wave::{Stopped, Workers};

/// A pass that has begun.
pub struct Active<'a> {
    pub pass: &'a Pass,
    pub targets: Targets,
    has_attachments: bool,
    /// Samples of attachments with one sample, if the pass draws with more.
    samples: Vec<Samples>,
}

impl<'a> Active<'a> {
    /// Begins a pass. `clamps_to_one`: see [`Targets`]; `kept`: the samples that the suspended pass
    /// [kept](Self::keep).
    ///
    /// # Errors
    /// Out of memory for samples.
    pub fn new(pass: &'a Pass, clamps_to_one: bool, kept: Vec<Samples>) -> Result<Self, Stopped> {
        let mut colors: [Option<Target>; MAX_COLOR_ATTACHMENTS] = std::array::from_fn(|index| {
            let attachment = pass.colors[index].as_ref()?;
            target(attachment, vk::ImageAspectFlags::COLOR)
        });
        let side = |attachment: &Option<Attachment>, aspect| target(attachment.as_ref()?, aspect);
        let mut depth = side(&pass.depth, vk::ImageAspectFlags::DEPTH);
        let mut stencil = side(&pass.stencil, vk::ImageAspectFlags::STENCIL);
        // The area is limited without attachments, too (`maxFramebufferWidth`), since it determines
        // the memory that drawing needs.
        let mut area = inside(pass.area, [MAX_IMAGE_DIMENSION; 2]);
        let mut layers = match pass.view_mask {
            0 => pass.layers.min(MAX_IMAGE_ARRAY_LAYERS),
            mask => u32::BITS - mask.leading_zeros(),
        };
        let (mut samples, mut has_attachments) = (1, false);
        for target in colors.iter().chain([&depth, &stencil]).flatten() {
            area = inside(area, [target.surface.width, target.surface.height]);
            layers = layers.min(target.layers);
            samples = target.surface.samples;
            has_attachments = true;
        }
        let mut many = Vec::new();
        if pass.samples > 1 {
            samples = pass.samples;
            let mut kept = kept.into_iter();
            let attachments = (colors.iter_mut().zip(&pass.colors))
                .chain([(&mut depth, &pass.depth), (&mut stencil, &pass.stencil)]);
            for (target, attachment) in attachments {
                if let (Some(target), Some(attachment)) = (target, attachment)
                    && target.surface.samples == 1
                {
                    let of = Samples::new(*target, samples, attachment.mode, kept.next());
                    let of = of.ok_or(Stopped::OutOfMemory)?;
                    *target = of.many;
                    many.push(of);
                }
            }
        }
        let rates = pass
            .rates
            .as_ref()
            .and_then(|view| target_of(view, vk::ImageAspectFlags::COLOR));
        Ok(Self {
            pass,
            samples: many,
            targets: Targets {
                area,
                layers,
                view_mask: pass.view_mask,
                samples,
                clamps_to_one,
                colors,
                depth,
                stencil,
                rates: rates.filter(|it| it.surface.texel_size_bytes == 1),
            },
            has_attachments,
        })
    }

    /// Loads the samples, except those that the pass resumes with.
    pub fn load_samples(&mut self, workers: &Workers) {
        let layers = layers(self.pass.view_mask, self.targets.layers);
        for samples in &mut self.samples {
            samples.load(workers, layers.clone(), &self.targets.area);
        }
    }

    /// The samples that shaders read; `None` if the pass draws to its attachments alone.
    pub fn seen_samples(&self) -> Option<Arc<[environment::Samples]>> {
        let has_any = !self.samples.is_empty();
        has_any.then(|| self.samples.iter().map(Samples::seen).collect())
    }

    /// Hands over the samples for the pass that resumes this one.
    pub fn keep(self) -> Vec<Samples> {
        self.samples
    }

    /// Whether a draw with this sample count fits into the batch. Without attachments, draws decide
    /// the count.
    pub fn takes_samples(&self, samples: u32) -> bool {
        self.has_attachments || self.targets.samples == samples
    }

    /// Sets the sample count; the batch is empty or has the same count.
    pub fn set_samples(&mut self, samples: u32) {
        if !self.has_attachments {
            self.targets.samples = samples;
        }
    }

    /// Adds the load operations to a batch.
    pub fn load(&self, batch: &mut Batch) {
        for clear in &self.pass.clears {
            let layers = layers(
                clear.view_mask,
                clear.view.layer_count().min(self.pass.layers),
            );
            clear_view(
                &clear.view,
                clear.aspects,
                &clear.value,
                layers,
                &self.targets.area,
            );
        }
        let mut push = |attachment: &Attachment, value: &dyn Fn(vk::ClearValue) -> ClearValue| {
            let Some((clear, views)) = attachment.clear else {
                return;
            };
            let rect = |first, count| vk::ClearRect {
                rect: self.targets.area,
                base_array_layer: first,
                layer_count: count,
            };
            let rects: SmallVec<[vk::ClearRect; 1]> = match self.pass.view_mask & views {
                0 => SmallVec::from_slice(&[rect(0, self.targets.layers)]),
                mask => layers(mask, u32::MAX).map(|view| rect(view, 1)).collect(),
            };
            let value = value(clear);
            batch.work.push(Work::Clear(Clear { value, rects }));
        };
        for (index, attachment) in self.pass.colors.iter().enumerate() {
            if let Some(attachment) = attachment {
                // SAFETY: all members of the union are words, and the attachment's format says
                // which one is meant.
                let color = |it: vk::ClearValue| unsafe { it.color };
                push(attachment, &|it| ClearValue::Color(index, color(it)));
            }
        }
        // SAFETY: as for the color.
        let depth_stencil = |it: vk::ClearValue| unsafe { it.depth_stencil };
        if let Some(attachment) = &self.pass.depth {
            push(attachment, &|it| ClearValue::Depth(depth_stencil(it).depth));
        }
        if let Some(attachment) = &self.pass.stencil {
            push(attachment, &|it| {
                ClearValue::Stencil(depth_stencil(it).stencil)
            });
        }
    }

    /// The part of a rectangle of `vkCmdClearAttachments` that lies in the pass, once for each
    /// view.
    pub fn inside(&self, clear: &vk::ClearRect) -> SmallVec<[vk::ClearRect; 1]> {
        let area = &self.targets.area;
        let side = |first: i32, size: u32, least: i32, most: u32| {
            let (least, end) = (i64::from(least), i64::from(least) + i64::from(most));
            let start = i64::from(first).clamp(least, end);
            let end = (i64::from(first) + i64::from(size)).clamp(start, end);
            (start as i32, (end - start) as u32)
        };
        let (from, size) = (clear.rect.offset, clear.rect.extent);
        let (x, width) = side(from.x, size.width, area.offset.x, area.extent.width);
        let (y, height) = side(from.y, size.height, area.offset.y, area.extent.height);
        let rect = vk::Rect2D {
            offset: vk::Offset2D { x, y },
            extent: vk::Extent2D { width, height },
        };
        let part = |base_array_layer, layer_count| vk::ClearRect {
            rect,
            base_array_layer,
            layer_count,
        };
        if self.pass.view_mask != 0 {
            return layers(self.pass.view_mask, u32::MAX)
                .map(|view| part(view, 1))
                .collect();
        }
        let first = clear.base_array_layer.min(self.targets.layers);
        SmallVec::from_slice(&[part(
            first,
            clear.layer_count.min(self.targets.layers - first),
        )])
    }

    /// Performs the resolves at the end of the pass.
    pub fn resolve(&self, workers: &Workers) {
        for samples in &self.samples {
            let layers = layers(self.pass.view_mask, self.targets.layers);
            samples.store(workers, layers, &self.targets.area);
        }
        let colors = self.pass.colors.iter().flatten();
        let colors = colors.map(|attachment| (attachment, vk::ImageAspectFlags::COLOR));
        let depth = self
            .pass
            .depth
            .as_ref()
            .map(|it| (it, vk::ImageAspectFlags::DEPTH));
        let stencil = self
            .pass
            .stencil
            .as_ref()
            .map(|it| (it, vk::ImageAspectFlags::STENCIL));
        for (attachment, aspect) in colors.chain(depth).chain(stencil) {
            let Some(resolve) = &attachment.resolve else {
                continue;
            };
            let from = Surface::of_view(&attachment.view, aspect);
            let (Some(from), Some(to)) = (from, Surface::of_view(&resolve.view, aspect)) else {
                continue;
            };
            let of = |view: &ImageView, layer: u32| view.range.base_array_layer + layer;
            workers.install(|| {
                for layer in layers(self.pass.view_mask, self.targets.layers) {
                    resolve_attachment(
                        (&from, of(&attachment.view, layer)),
                        (&to, of(&resolve.view, layer)),
                        resolve.mode,
                        &self.targets.area,
                    );
                }
            });
        }
    }
}

/// The layers of a view mask; without views, all layers.
fn layers(view_mask: u32, count: u32) -> impl Iterator<Item = u32> + Clone {
    let views = (0..u32::BITS).filter(move |view| view_mask >> view & 1 != 0);
    let all = 0..if view_mask == 0 { count } else { 0 };
    all.chain(views)
}

fn target(attachment: &Attachment, aspect: vk::ImageAspectFlags) -> Option<Target> {
    target_of(&attachment.view, aspect)
}

fn target_of(view: &ImageView, aspect: vk::ImageAspectFlags) -> Option<Target> {
    Some(Target {
        surface: Surface::of_view(view, aspect)?,
        first_layer: view.range.base_array_layer,
        layers: view.layer_count(),
    })
}
