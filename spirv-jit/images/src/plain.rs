//! The common fetch, read and write: one image for all lanes, in a format that vectors take.
//! Everything about the image is looked up once ([`Plain`]), then blocks of lanes are done in
//! vectors of the machine. The same results as [`access`](super::access), bit for bit.

use lanes::LANES;
use lanes::vector::{Task, Vector};

use super::decode::{Decoder, expand};
use super::fast::index_in_block;
use super::format::FormatInfo;
use super::format::block::{self, Texels};
use super::operands::Operands;
use super::texels::{self, Wanted};
use super::{Dim, ImageDescriptor, ImageOp, ImageOpKind, LodMode, TexelType};

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
    /// Of formats in blocks of four by four.
    blocks: Option<Decoder>,
}

impl<'a> Plain<'a> {
    pub fn new(
        op: &'a ImageOp,
        image: &'a ImageDescriptor,
        info: &'a FormatInfo,
    ) -> Option<Plain<'a>> {
        let blocks = Decoder::of(info);
        let blocks = matches!(blocks, Decoder::Colors | Decoder::Ramps).then_some(blocks);
        let format_fits = match op.kind {
            ImageOpKind::Write => info.in_vectors,
            _ => info.decoded_in_vectors || blocks.is_some(),
        };
        let applies = may_apply(op) && format_fits && image.size_bytes <= i32::MAX as u64;
        applies.then_some(Plain {
            op,
            image,
            info,
            blocks,
        })
    }

    #[inline(always)]
    pub(super) fn op(&self) -> &ImageOp {
        self.op
    }

    /// The operation, the image and its format.
    pub(super) fn parts(&self) -> (&'a ImageOp, &'a ImageDescriptor, &'a FormatInfo) {
        (self.op, self.image, self.info)
    }

    /// The level that all lanes of the mask name, if they name one.
    #[inline(always)]
    fn level<V: Vector>(&self, v: V, operands: &Operands<'_>, mask: u16) -> Option<usize> {
        if self.op.lod != LodMode::Lod {
            return self.image.has_level(0).then_some(0);
        }
        let row = operands.lod[0];
        let first = row[mask.trailing_zeros() as usize & 15];
        let others = v.ne_i(v.load_i(row), v.splat_i(first as i32));
        let is_one = others & mask == 0 && self.image.has_level(first as usize);
        is_one.then_some(first as usize)
    }

    /// Byte offsets of the lanes' texels or blocks, texels' indices in their blocks, and the lanes
    /// of the mask whose texel exists; the offsets of others are zero.
    #[inline(always)]
    fn locate<V: Vector, const IN_BLOCKS: bool>(
        &self,
        v: V,
        operands: &Operands<'_>,
        mask: u16,
        level: usize,
    ) -> (V::I, V::I, u16) {
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
        let mut in_plane = [v.splat_i(0); 2];
        for axis in 0..spatial {
            let mut at = v.load_i(operands.coordinates[axis]);
            if op.has_offset && axis < operands.offsets.len() {
                at = v.add_i(at, v.load_i(operands.offsets[axis]));
            }
            inside &= v.lt_u(at, v.splat_i(sizes[axis] as i32));
            if IN_BLOCKS && axis < 2 {
                in_plane[axis] = at;
                at = v.right_u(at, 2);
            }
            offsets = v.add_i(offsets, v.mul_i(at, v.splat_i(strides[axis] as i32)));
        }
        if op.coordinate_count() > spatial {
            let layer = v.load_i(operands.coordinates[spatial]);
            inside &= v.lt_u(layer, v.splat_i(image.layer_count as i32));
            let stride = v.splat_i(image.layer_stride_bytes as i32);
            offsets = v.add_i(offsets, v.mul_i(layer, stride));
        }
        let index = index_in_block(v, in_plane[0], in_plane[1]);
        (v.keep(offsets, inside), index, inside)
    }

    /// `OpImageWrite` in the lanes of `mask`, which is not empty. False where it does not apply
    /// after all.
    ///
    /// # Safety
    /// The image's memory stays allocated during the call.
    #[inline(always)]
    pub(super) unsafe fn write<V: Vector>(&self, v: V, operands: &Operands<'_>, mask: u16) -> bool {
        let Some(level) = self.level(v, operands, mask) else {
            return false;
        };
        let (offsets, _, inside) = self.locate::<V, false>(v, operands, mask, level);
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

    /// The components that a load is asked for, of those that results have rows for.
    pub(super) fn wanted(&self, results: [bool; 4]) -> Wanted {
        match self.image.swizzle {
            [0, 1, 2, 3] => Wanted::new(self.info, results),
            _ => Wanted::ALL,
        }
    }

    /// `OpImageFetch`, `OpImageRead` in the lanes of `mask`, which is not empty: the texel's
    /// components that are wanted. None where it does not apply after all.
    ///
    /// # Safety
    /// As [`Self::write`].
    #[inline(always)]
    pub(super) unsafe fn read<V: Vector>(
        &self,
        v: V,
        operands: &Operands<'_>,
        mask: u16,
        wanted: Wanted,
    ) -> Option<[V::I; 4]> {
        let level = self.level(v, operands, mask)?;
        let (info, data) = (self.info, self.image.data.cast_const());
        // SAFETY: lanes inside address texels of the image, and so does offset zero.
        let (loaded, inside) = unsafe {
            match self.blocks {
                None => {
                    let (offsets, _, inside) = self.locate::<V, false>(v, operands, mask, level);
                    (texels::load(v, info, data, offsets, wanted), inside)
                }
                Some(decoder) => {
                    let (offsets, index, inside) = self.locate::<V, true>(v, operands, mask, level);
                    let texels = v.apart(OfBlocks {
                        info,
                        decoder,
                        data,
                        offsets,
                        index,
                    });
                    (texels, inside)
                }
            }
        };
        let components = [
            self.component(v, 0, loaded[0], inside, wanted),
            self.component(v, 1, loaded[1], inside, wanted),
            self.component(v, 2, loaded[2], inside, wanted),
            self.component(v, 3, loaded[3], inside, wanted),
        ];
        if self.image.swizzle == [0, 1, 2, 3] {
            return Some(components);
        }
        let mut texels: Texels = [[0; LANES]; 4];
        for (component, row) in components.into_iter().zip(&mut texels) {
            v.store_i(component, row);
        }
        super::operands::swizzle(self.image, self.info, &mut texels);
        Some([
            v.load_i(&texels[0]),
            v.load_i(&texels[1]),
            v.load_i(&texels[2]),
            v.load_i(&texels[3]),
        ])
    }

    /// A component as the format has it, in the lanes with a texel.
    #[inline(always)]
    fn component<V: Vector>(
        &self,
        v: V,
        component: usize,
        word: V::I,
        inside: u16,
        wanted: Wanted,
    ) -> V::I {
        if !wanted.has(component) {
            return word;
        }
        if self.info.channels[component].bits == 0 {
            return v.splat_i(self.info.missing(component) as i32);
        }
        let word = v.keep(word, inside);
        match block::unit_scale(self.info) {
            1.0 => word,
            scale => v.bits_of(v.div_units(v.bits_to_f(word), scale)),
        }
    }
}

/// Texels by offsets of their blocks and their indices in these.
struct OfBlocks<'a, I> {
    info: &'a FormatInfo,
    decoder: Decoder,
    data: *const u8,
    offsets: I,
    index: I,
}

impl<V: Vector> Task<V> for OfBlocks<'_, V::I> {
    type Output = [V::I; 4];

    /// # Safety
    /// A block is readable at each offset.
    #[inline(always)]
    unsafe fn run(self, v: V) -> [V::I; 4] {
        let mut words = [v.splat_i(0); 4];
        // SAFETY: the caller guarantees that a block is readable at each offset.
        unsafe {
            match self.info.size_bytes {
                8 => (words[0], words[1]) = v.gather_pairs(self.data, self.offsets),
                _ => words = v.gather_quads(self.data, self.offsets),
            }
        }
        let texel = expand(v, self.info, self.decoder, words, self.index);
        [
            v.bits_of(texel[0]),
            v.bits_of(texel[1]),
            v.bits_of(texel[2]),
            v.bits_of(texel[3]),
        ]
    }
}
