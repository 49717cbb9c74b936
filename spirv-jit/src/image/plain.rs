//! The common fetch, read and write: one image for all lanes, in a format that vectors take. Everything about the image is looked up once
//! ([`Plain`]), then blocks of lanes are done in vectors of the machine. The same results as [`access`](super::access), bit for bit.

use super::format::FormatInfo;
use super::format::block::{self, Texels};
use super::operands::{Operands, put_texels};
use super::texels;
use super::vector::Vector;
use super::{Dim, ImageDescriptor, ImageOp, ImageOpKind, LodMode};
use crate::SUBGROUP_SIZE;
use crate::row::Row;
use crate::types::Type;

/// Whether an operation is one of these, as far as its instruction tells.
pub(crate) fn may_apply(op: &ImageOp) -> bool {
    let kind = matches!(
        op.kind,
        ImageOpKind::Fetch | ImageOpKind::Read | ImageOpKind::Write
    );
    kind && !op.multisampled && op.texel != Type::I64
}

/// An operation that [`may_apply`], with an image for which it does.
#[derive(Clone, Copy)]
pub(crate) struct Plain<'a> {
    op: &'a ImageOp,
    image: &'a ImageDescriptor,
    info: &'a FormatInfo,
}

impl<'a> Plain<'a> {
    pub(crate) fn new(
        op: &'a ImageOp,
        image: &'a ImageDescriptor,
        info: &'a FormatInfo,
    ) -> Option<Plain<'a>> {
        let applies = may_apply(op) && info.in_vectors && image.size_bytes <= i32::MAX as u64;
        applies.then_some(Plain { op, image, info })
    }

    /// The level that all lanes of the mask name, if they name one.
    #[inline(always)]
    fn level(&self, operands: &Operands<'_>, mask: u16) -> Option<usize> {
        if self.op.lod != LodMode::Lod {
            return self.image.has_level(0).then_some(0);
        }
        let row = operands.lod[0];
        let first = row[mask.trailing_zeros() as usize & 15];
        let mut others = 0u16;
        for lane in 0..SUBGROUP_SIZE {
            others |= ((row[lane] != first) as u16) << lane;
        }
        let is_one = others & mask == 0 && self.image.has_level(first as usize);
        is_one.then_some(first as usize)
    }

    /// Byte offsets of the lanes' texels, and the lanes of the mask whose texel exists; the offsets of others are zero.
    #[inline(always)]
    fn locate<V: Vector>(
        &self,
        v: V,
        operands: &Operands<'_>,
        mask: u16,
        level: usize,
    ) -> (V::I, u16) {
        let (op, image) = (self.op, self.image);
        let spatial = op.spatial_count();
        let level = &image.levels[level];
        let (slices, slice_bytes) = match op.dim {
            Dim::Cube => (image.layer_count, image.layer_stride_bytes),
            _ => (level.depth, level.slice_stride_bytes),
        };
        let texel_bytes = self.info.size_bytes as u64;
        let sizes = [level.width, level.height, slices];
        let strides = [texel_bytes, level.row_stride_bytes, slice_bytes];
        let mut inside = mask;
        let mut offsets = v.splat_i(level.offset_bytes as i32);
        for axis in 0..spatial {
            let mut at = v.load_i(operands.coordinates[axis]);
            if op.has_offset && axis < operands.offsets.len() {
                at = v.add_i(at, v.load_i(operands.offsets[axis]));
            }
            inside &= v.lt_u(at, v.splat_i(sizes[axis] as i32));
            offsets = v.add_i(offsets, v.mul_i(at, v.splat_i(strides[axis] as i32)));
        }
        if op.coordinate_count() > spatial {
            let layer = v.load_i(operands.coordinates[spatial]);
            inside &= v.lt_u(layer, v.splat_i(image.layer_count as i32));
            let stride = v.splat_i(image.layer_stride_bytes as i32);
            offsets = v.add_i(offsets, v.mul_i(layer, stride));
        }
        (v.keep(offsets, inside), inside)
    }

    /// `OpImageWrite` in the lanes of `mask`, which is not empty. False where it does not apply after all.
    ///
    /// # Safety
    /// The image's memory stays allocated during the call.
    #[inline(always)]
    pub(crate) unsafe fn write<V: Vector>(&self, v: V, operands: &Operands<'_>, mask: u16) -> bool {
        let Some(level) = self.level(operands, mask) else {
            return false;
        };
        let (offsets, inside) = self.locate(v, operands, mask, level);
        let rows = operands.texel;
        let texels = [
            v.load_i(rows[0]),
            v.load_i(rows[1]),
            v.load_i(rows[2]),
            v.load_i(rows[3]),
        ];
        // SAFETY: lanes inside address texels of the image.
        unsafe { texels::store(v, self.info, self.image.data, offsets, inside, &texels) };
        true
    }

    /// `OpImageFetch`, `OpImageRead` in the lanes of `mask`, which is not empty. False where it does not apply after all.
    ///
    /// # Safety
    /// As [`Self::write`].
    #[inline(always)]
    pub(crate) unsafe fn read<V: Vector>(
        &self,
        v: V,
        operands: &Operands<'_>,
        mask: u16,
        results: &mut [Row],
    ) -> bool {
        let Some(level) = self.level(operands, mask) else {
            return false;
        };
        let (offsets, inside) = self.locate(v, operands, mask, level);
        // SAFETY: lanes inside address texels of the image, and so does offset zero.
        let loaded = unsafe { texels::load(v, self.info, self.image.data, offsets) };
        let scale = block::unit_scale(self.info);
        let mut texels: Texels = [[0; SUBGROUP_SIZE]; 4];
        for (component, row) in texels.iter_mut().enumerate() {
            let word = v.keep(loaded[component], inside);
            if self.info.channels[component].bits == 0 {
                *row = [self.info.missing(component); SUBGROUP_SIZE];
            } else if scale != 1.0 {
                v.store(v.div_units(v.bits_to_f(word), scale), row);
            } else {
                v.store_i(word, row);
            }
        }
        super::operands::swizzle(self.image, self.info, &mut texels);
        put_texels(self.op, self.info, &texels, results);
        true
    }
}
