//! The common fetch, read and write: one image for all lanes, in a format that vectors take.
//! Everything about the image is looked up once ([`Plain`]), then blocks of lanes are done in
//! vectors of the machine. The same results as [`access`](super::access), bit for bit.

use lanes::Row;
use lanes::vector::Vector;

use super::axes::axes;
use super::decode::Decoder;
use super::format::FormatInfo;
use super::operands::Operands;
use super::texels;
use super::{ImageDescriptor, ImageOp, ImageOpKind, LodMode, TexelType};

/// Whether an operation is one of these, as far as its instruction tells.
pub fn may_apply(op: &ImageOp) -> bool {
    let kind = matches!(
        op.kind,
        ImageOpKind::Fetch | ImageOpKind::Read | ImageOpKind::Write
    );
    let has_others = op.has_min_lod || op.has_offsets || op.residency || op.multisampled;
    let lod_fits = matches!(op.lod, LodMode::Implicit | LodMode::Lod);
    kind && lod_fits && !has_others && op.texel != TexelType::I64
}

/// An operation that [`may_apply`], with an image for which it does.
#[derive(Clone, Copy)]
pub struct Plain<'a> {
    op: &'a ImageOp,
    image: &'a ImageDescriptor,
    info: &'a FormatInfo,
}

impl<'a> Plain<'a> {
    pub fn new(
        op: &'a ImageOp,
        image: &'a ImageDescriptor,
        info: &'a FormatInfo,
    ) -> Option<Plain<'a>> {
        let format_fits = match op.kind {
            ImageOpKind::Write => info.in_vectors,
            _ => Decoder::of(info) != Decoder::Each,
        };
        let applies = may_apply(op) && format_fits && image.size_bytes <= i32::MAX as u64;
        applies.then_some(Plain { op, image, info })
    }

    #[inline(always)]
    pub(super) fn op(&self) -> &ImageOp {
        self.op
    }

    /// The operation, the image and its format.
    pub(super) fn parts(&self) -> (&'a ImageOp, &'a ImageDescriptor, &'a FormatInfo) {
        (self.op, self.image, self.info)
    }

    /// The level that all lanes of the mask name, if they name one. The row is that of levels.
    #[inline(always)]
    pub(super) fn level<V: Vector>(&self, v: V, row: Option<&Row>, mask: u16) -> Option<usize> {
        let Some(row) = row else {
            return self.image.has_level(0).then_some(0);
        };
        let first = row[mask.trailing_zeros() as usize & 15];
        let others = v.ne_i(v.load_i(row), v.splat_i(first as i32));
        let is_one = others & mask == 0 && self.image.has_level(first as usize);
        is_one.then_some(first as usize)
    }

    /// Byte offsets of the lanes' texels, and the lanes of the mask whose texel exists; the offsets
    /// of others are zero.
    #[inline(always)]
    fn locate<V: Vector>(
        &self,
        v: V,
        operands: &Operands<'_>,
        mask: u16,
        level: usize,
    ) -> (V::I, u16) {
        let (op, image) = (self.op, self.image);
        let (axes, count) = axes(op, image, self.info, level);
        let mut inside = mask;
        let mut offsets = v.splat_i(image.levels[level].offset_bytes as i32);
        for axis in &axes[..count] {
            let mut at = v.load_i(operands.coordinates[axis.operand]);
            if op.has_offset && axis.operand < operands.offsets.len() {
                at = v.add_i(at, v.load_i(operands.offsets[axis.operand]));
            }
            inside &= v.lt_u(at, v.splat_i(axis.size as i32));
            offsets = v.add_i(offsets, v.mul_i(at, v.splat_i(axis.stride_bytes as i32)));
        }
        (v.keep(offsets, inside), inside)
    }

    /// `OpImageWrite` in the lanes of `mask`, which is not empty. False where it does not apply
    /// after all.
    ///
    /// # Safety
    /// The image's memory stays allocated during the call.
    #[inline(always)]
    pub(super) unsafe fn write<V: Vector>(&self, v: V, operands: &Operands<'_>, mask: u16) -> bool {
        let Some(level) = self.level(v, operands.lod.first().copied(), mask) else {
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
}
