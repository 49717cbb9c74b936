//! The axes that coordinates of loads and stores have.

use super::format::FormatInfo;
use super::rows::Wave;
use super::{Dim, ImageDescriptor, ImageOp, LodMode};

/// An axis of an image, or its layers.
#[derive(Clone, Copy)]
pub(super) struct ImageAxis {
    pub operand: usize,
    pub size: u32,
    pub stride_bytes: u32,
}

/// The level that all lanes of all subgroups name, where one row names it.
///
/// # Safety
/// The wave is as [`Wave`] says, for the operation.
pub(super) unsafe fn level(op: &ImageOp, wave: &Wave<'_>) -> Option<usize> {
    if op.lod != LodMode::Lod {
        return Some(0);
    }
    let rows = wave.operands.get(op.rows_before_lod())?;
    // SAFETY: the caller guarantees that the wave is as `Wave` requires; the first subgroup has a
    // row, which all others share.
    let row = unsafe { rows.first.as_ref() }.filter(|_| rows.step_bytes == 0)?;
    (row.iter().all(|&level| level == row[0])).then_some(row[0] as usize)
}

/// The axes of a level as an operation has coordinates for them, and how many these are.
pub(super) fn axes(
    op: &ImageOp,
    image: &ImageDescriptor,
    info: &FormatInfo,
    level: usize,
) -> ([ImageAxis; 4], usize) {
    let level = &image.levels[level];
    let (slices, slice_bytes) = match op.dim {
        Dim::Cube => (image.layer_count, image.layer_stride_bytes),
        _ => (level.depth, level.slice_stride_bytes),
    };
    let sizes = [level.width, level.height, slices];
    let strides = [info.size_bytes as u64, level.row_stride_bytes, slice_bytes];
    let spatial = op.spatial_count();
    let count = op.coordinate_count();
    let axis = |operand: usize| match operand < spatial {
        true => ImageAxis {
            operand,
            size: sizes[operand.min(2)],
            stride_bytes: strides[operand.min(2)] as u32,
        },
        false => ImageAxis {
            operand,
            size: image.layer_count,
            stride_bytes: image.layer_stride_bytes as u32,
        },
    };
    ([0, 1, 2, 3].map(axis), count.min(4))
}
