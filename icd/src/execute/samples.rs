//! Attachments with one sample that a pass draws to with several
//! (`VK_EXT_multisampled_render_to_single_sampled`). The samples lie in memory of the pass. They
//! are loaded from the attachment when the pass begins, and resolved to it when the pass ends.

use ash::vk;
use spirv_jit::environment;

use crate::object::render_pass::ResolveMode;
use crate::raster::Target;
use crate::transfer::resolve::{resolve_attachment, spread};
use crate::wave::Workers;

/// The samples of an attachment.
pub struct Samples {
    /// The attachment.
    single: Target,
    /// An image of the same size with the pass's sample count.
    pub many: Target,
    /// How the samples are resolved.
    mode: ResolveMode,
    /// Not loaded yet.
    is_new: bool,
    /// Owns the texels of `many`.
    _memory: Vec<u64>,
}

impl Samples {
    /// The samples of an attachment; `kept` are those of the pass that this one resumes. `None` if
    /// memory is exhausted.
    pub fn new(
        single: Target,
        samples: u32,
        mode: ResolveMode,
        kept: Option<Samples>,
    ) -> Option<Self> {
        let is_same = |it: &Samples| {
            let (a, b) = (&it.single, &single);
            a.surface.texel(0, 0, a.first_layer, 0) == b.surface.texel(0, 0, b.first_layer, 0)
                && [a.surface.width, a.surface.height, a.layers]
                    == [b.surface.width, b.surface.height, b.layers]
                && std::ptr::eq(a.surface.format, b.surface.format)
                && it.many.surface.samples == samples
        };
        if let Some(kept) = kept.filter(is_same) {
            return Some(Self { mode, ..kept });
        }
        let (surface, memory) = single.surface.like(samples, single.layers)?;
        Some(Self {
            single,
            many: Target {
                surface,
                first_layer: 0,
                layers: single.layers,
            },
            mode,
            is_new: true,
            _memory: memory,
        })
    }

    /// The samples, for shaders that read the attachment.
    pub fn seen(&self) -> environment::Samples {
        let single = &self.single;
        let first = single.surface.texel(0, 0, single.first_layer, 0);
        self.many.surface.samples_of(first)
    }

    /// Gives each sample the attachment's value, in some layers.
    pub fn load(
        &mut self,
        workers: &Workers,
        layers: impl Iterator<Item = u32> + Send,
        area: &vk::Rect2D,
    ) {
        if !std::mem::take(&mut self.is_new) {
            return;
        }
        let (from, to) = (&self.single, &self.many);
        workers.install(|| {
            for layer in layers {
                let from = (&from.surface, from.first_layer + layer);
                spread(from, (&to.surface, layer), area);
            }
        });
    }

    /// Resolves the samples, in some layers.
    pub fn store(
        &self,
        workers: &Workers,
        layers: impl Iterator<Item = u32> + Send,
        area: &vk::Rect2D,
    ) {
        if self.mode.mode.is_empty() {
            return;
        }
        let (from, to) = (&self.many, &self.single);
        workers.install(|| {
            for layer in layers {
                let to = (&to.surface, to.first_layer + layer);
                resolve_attachment((&from.surface, layer), to, self.mode, area);
            }
        });
    }
}
