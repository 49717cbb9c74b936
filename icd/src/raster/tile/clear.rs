//! Clears: load operations and `vkCmdClearAttachments`.

use ash::vk;
use images::format::MAX_TEXEL_BYTES;
use rayon::prelude::*;

use crate::raster::primitive::Bounds;
use crate::raster::{Clear, ClearValue, Target, Targets};
use crate::transfer::pattern::Pattern;
use crate::wave::Workers;

/// Bytes of a clear for each task that it is cut into, at least.
const TASK_BYTES: u64 = 4 << 20;

/// The attachment that a clear is of, and its texel.
fn texel(clear: &Clear, targets: &Targets) -> Option<(Target, [u8; MAX_TEXEL_BYTES])> {
    let (target, words) = match clear.value {
        ClearValue::Color(index, value) => {
            // SAFETY: all members are four words, and the format says whether these are floats or
            // integers.
            (targets.colors.get(index)?.as_ref()?, unsafe {
                value.uint32
            })
        }
        ClearValue::Depth(depth) => (targets.depth.as_ref()?, [depth.to_bits(), 0, 0, 0]),
        ClearValue::Stencil(value) => (targets.stencil.as_ref()?, [value & 0xff, 0, 0, 0]),
    };
    let mut texel = [0; MAX_TEXEL_BYTES];
    target.surface.format.encode(words, &mut texel);
    Some((*target, texel))
}

/// The part of a clear's rectangle inside bounds.
fn inside(rect: &vk::ClearRect, area: &vk::Rect2D, bounds: Option<&Bounds>) -> Option<Bounds> {
    let mut inside = Bounds::of(&rect.rect).intersection(Bounds::of(area));
    if let Some(bounds) = bounds {
        inside = inside.intersection(*bounds);
    }
    (inside.left < inside.right && inside.top < inside.bottom).then_some(inside)
}

/// Fills rows of one sample of one layer.
///
/// # Safety
/// The bounds, the layer and the sample lie in the attachment, and no other thread writes there.
unsafe fn fill(target: &Target, pattern: &Pattern, bounds: &Bounds, slice: u32, sample: u32) {
    let surface = &target.surface;
    let (left, top) = (bounds.left as u32, bounds.top as u32);
    let row_bytes = (bounds.right - bounds.left) as usize * surface.texel_size_bytes;
    let rows = (bounds.bottom - bounds.top) as u32;
    // SAFETY: the caller keeps the contract of this function; rows that are next to each other are
    // one.
    unsafe {
        if row_bytes as u64 == surface.row_stride_bytes {
            let first = surface.texel(left, top, slice, sample);
            return pattern.fill(first, row_bytes * rows as usize);
        }
        for row in 0..rows {
            let first = surface.texel(left, top + row, slice, sample);
            pattern.fill(first, row_bytes);
        }
    }
}

/// Layers and samples of a rectangle.
fn planes(target: &Target, rect: &vk::ClearRect) -> impl Iterator<Item = (u32, u32)> {
    let end = rect.base_array_layer.saturating_add(rect.layer_count);
    let (first_layer, samples) = (target.first_layer, target.surface.samples);
    (rect.base_array_layer..end.min(target.layers))
        .flat_map(move |layer| (0..samples).map(move |sample| (first_layer + layer, sample)))
}

/// Does a clear inside a tile.
pub fn clear_tile(clear: &Clear, targets: &Targets, tile: &Bounds) {
    let Some((target, texel)) = texel(clear, targets) else {
        return;
    };
    let pattern = Pattern::new(&texel[..target.surface.texel_size_bytes]);
    for rect in &clear.rects {
        let Some(bounds) = inside(rect, &targets.area, Some(tile)) else {
            continue;
        };
        for (slice, sample) in planes(&target, rect) {
            // SAFETY: the render area lies in all attachments, and the layers are theirs; a tile
            // belongs to one worker.
            unsafe { fill(&target, &pattern, &bounds, slice, sample) };
        }
    }
}

/// Does a clear of all tiles, cut into rows.
pub fn clear_all(clear: &Clear, targets: &Targets, workers: &Workers) {
    let Some((target, texel)) = texel(clear, targets) else {
        return;
    };
    let pattern = Pattern::new(&texel[..target.surface.texel_size_bytes]);
    for rect in &clear.rects {
        let Some(bounds) = inside(rect, &targets.area, None) else {
            continue;
        };
        let rows = (bounds.bottom - bounds.top) as u64;
        let row_bytes =
            (bounds.right - bounds.left) as u64 * target.surface.texel_size_bytes as u64;
        let tasks = (rows * row_bytes / TASK_BYTES)
            .clamp(1, workers.current_num_threads() as u64)
            .min(rows);
        for (slice, sample) in planes(&target, rect) {
            let task = |index: u64| {
                let row = |index: u64| bounds.top + (rows * index / tasks) as i32;
                let part = Bounds {
                    top: row(index),
                    bottom: row(index + 1),
                    ..bounds
                };
                // SAFETY: as in a tile; tasks have different rows.
                unsafe { fill(&target, &pattern, &part, slice, sample) };
            };
            match tasks {
                1 => task(0),
                _ => workers.install(|| (0..tasks).into_par_iter().for_each(task)),
            }
        }
    }
}
