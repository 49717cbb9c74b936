//! The common sample: a 2D image or a cube, averaged. Everything about the image and the sampler is looked up once ([`Fast`]), then
//! blocks of lanes are sampled in vectors of the machine. Gives the same results as [`sample`](super::sample), bit for bit; samples
//! over the edges of a cube's faces are left to that.

use std::mem::offset_of;

use super::address;
use super::format::block::{self, Texels};
use super::format::layout::Codec;
use super::format::srgb;
use super::format::{FormatInfo, Numeric};
use super::lod::{self, Lod};
use super::operands::{Operands, put_texels};
use super::texels;
use super::vector::Vector;
use super::{
    AddressMode, CompareOp, Dim, Filter, ImageDescriptor, ImageOp, ImageOpKind, Level, LodMode,
    Reduction, SamplerDescriptor,
};
use super::{cube, sample};
use crate::SUBGROUP_SIZE;
use crate::row::Row;
use crate::types::Type;

/// Whether an operation is one of these, as far as its instruction tells.
pub(crate) fn may_apply(op: &ImageOp) -> bool {
    let dim_fits = op.dim == Dim::D2 || op.dim == Dim::Cube && !op.has_offset;
    op.kind == ImageOpKind::Sample && dim_fits && !op.has_min_lod
}

/// Most operand rows of an operation that [`may_apply`]: of a cube array's, four coordinates, a reference depth and six derivatives.
pub(crate) const MAX_OPERANDS: usize = 11;

/// An operation that [`may_apply`], with an image and a sampler for which it does.
#[derive(Clone, Copy)]
pub(crate) struct Fast<'a> {
    op: &'a ImageOp,
    image: &'a ImageDescriptor,
    info: &'a FormatInfo,
    sampler: &'a SamplerDescriptor,
    /// A bit per result that is looked at.
    wanted: u8,
    /// Texels are four bytes of 8 bits.
    bytes: bool,
    srgb: bool,
    /// Four bytes, each of them wanted and linear: they are sampled as they lie in memory, without a look at what each is.
    straight: bool,
    is_cube: bool,
    has_border: bool,
}

impl<'a> Fast<'a> {
    #[inline(always)]
    pub(crate) fn new(
        op: &'a ImageOp,
        image: &'a ImageDescriptor,
        info: &'a FormatInfo,
        sampler: &'a SamplerDescriptor,
        wanted: u8,
    ) -> Option<Fast<'a>> {
        let is_cube = op.dim == Dim::Cube;
        let modes_fit = match is_cube {
            true => !sampler.non_seamless && !sampler.unnormalized_coordinates,
            false => !sampler.address_mode[..2].contains(&AddressMode::MirrorClampToEdge),
        };
        let applies = may_apply(op)
            && modes_fit
            // Those are clamped, by valid usage.
            && (!sampler.unnormalized_coordinates
                || sampler.address_mode[..2] == [AddressMode::ClampToEdge; 2])
            && sampler.mag_filter == sampler.min_filter
            && sampler.reduction == Reduction::WeightedAverage
            && !info.numeric.is_integer()
            && info.blocks().is_none()
            && image.conversion.is_none()
            && image.size_bytes <= i32::MAX as u64;
        let srgb = matches!(info.codec, Codec::Srgb8Rgba | Codec::Srgb8Bgra);
        let bytes = srgb || matches!(info.codec, Codec::Unorm8(4) | Codec::Bgra8);
        let in_order = image.swizzle == [0, 1, 2, 3];
        applies.then_some(Fast {
            op,
            image,
            info,
            sampler,
            wanted: if in_order { wanted } else { 0xf },
            bytes,
            srgb,
            straight: bytes
                && !srgb
                && in_order
                && wanted == 0xf
                && op.texel != Type::I64
                && !op.depth_compare,
            is_cube,
            has_border: !is_cube && sampler.address_mode[..2].contains(&AddressMode::ClampToBorder),
        })
    }

    #[inline(always)]
    fn has_levels(&self) -> bool {
        self.image.level_count != 1
    }

    /// Whether derivatives are looked at, where the operation has them.
    #[inline(always)]
    pub(crate) fn takes_derivatives(&self) -> bool {
        self.has_levels() || lod::is_anisotropic(self.sampler)
    }
}

/// The levels of the lanes.
struct Levels<V: Vector> {
    width: V::I,
    height: V::I,
    row_stride: V::I,
    offset: V::I,
}

/// One level for all lanes.
#[inline(always)]
fn levels_of<V: Vector>(v: V, level: &Level) -> Levels<V> {
    Levels {
        width: v.splat_i(level.width as i32),
        height: v.splat_i(level.height as i32),
        row_stride: v.splat_i(level.row_stride_bytes as i32),
        offset: v.splat_i(level.offset_bytes as i32),
    }
}

/// A byte of each of four texels, linear between them.
#[inline(always)]
fn blend_bytes<V: Vector>(v: V, words: [V::I; 4], index: u32, x: V::F, y: V::F) -> V::F {
    let upper = v.lerp(
        v.to_f(v.byte(words[0], index)),
        v.to_f(v.byte(words[1], index)),
        x,
    );
    let lower = v.lerp(
        v.to_f(v.byte(words[2], index)),
        v.to_f(v.byte(words[3], index)),
        x,
    );
    v.lerp(upper, lower, y)
}

/// The least of the indices of four lanes, which are those of a block's corners.
#[inline(always)]
fn least_of_corners<V: Vector>(v: V, indices: V::I) -> u32 {
    let mut row = [0; SUBGROUP_SIZE];
    v.store_i(indices, &mut row);
    row[0].min(row[5]).min(row[10].min(row[15]))
}

/// Byte offsets of an axis's two texels, the first one's index, and the second one's weight.
struct Axis<V: Vector> {
    index: V::I,
    first: V::I,
    second: V::I,
    weight: V::F,
    /// The lanes in which they are inside the image, where that is asked for: with a border, and in cubes.
    inside: [u16; 2],
}

/// A texel's index by the mode, inside the level for any index.
///
/// Here and below there are no closures: those would not be compiled for the vectors' instruction set.
#[inline(always)]
fn wrapped<V: Vector>(
    v: V,
    mode: AddressMode,
    has_offset: bool,
    i: V::I,
    size: V::I,
    last: V::I,
) -> V::I {
    let i = match mode {
        AddressMode::Repeat if has_offset => modulo(v, i, size),
        AddressMode::MirroredRepeat if has_offset => {
            let period = v.add_i(size, size);
            let i = modulo(v, i, period);
            v.min_i(i, v.sub_i(v.sub_i(period, v.splat_i(1)), i))
        }
        // At most one texel out, since the coordinate is reduced.
        AddressMode::Repeat => {
            let i = v.add_i(i, v.and_i(size, v.sign_i(i)));
            let over = v.sign_i(v.sub_i(last, i));
            v.sub_i(i, v.and_i(size, over))
        }
        AddressMode::MirroredRepeat => {
            // Reduced to -1..=2 size: the ends reflect to the first texel.
            let i = v.xor_i(i, v.sign_i(i));
            v.min_i(i, v.sub_i(v.add_i(last, size), i))
        }
        _ => i,
    };
    v.min_i(v.max_i(i, v.splat_i(0)), last)
}

/// `i` modulo `size`, for `i` within a few sizes of 0: as [`address`](super::address) has it.
#[inline(always)]
fn modulo<V: Vector>(v: V, i: V::I, size: V::I) -> V::I {
    let quotient = v.floor(v.div(v.add(v.to_f(i), v.splat(0.5)), v.to_f(size)));
    v.sub_i(i, v.mul_i(v.to_i(quotient), size))
}

/// What a lane samples: numbers between 0 and 255 for 8-bit formats, in memory's order where they are sampled so, else values.
pub(crate) type Components<V> = [<V as Vector>::F; 4];

/// Results of a block; only those that are wanted are written.
type Results<'r> = &'r mut [Row];

impl Fast<'_> {
    /// Samples the lanes of `mask`, which is not empty; whether it can: it cannot over edges of faces.
    ///
    /// # Safety
    /// The image's memory stays allocated during the call.
    #[inline(always)]
    pub(crate) unsafe fn sample<V: Vector>(
        &self,
        v: V,
        operands: &Operands<'_>,
        mask: u16,
        results: Results<'_>,
    ) -> bool {
        // SAFETY: as the caller promises.
        match unsafe { self.components(v, operands, mask) } {
            Some(components) => {
                self.finish(v, components, results);
                true
            }
            None => false,
        }
    }

    /// The same up to where [`Self::values`] or [`Self::finish`] make results of it.
    ///
    /// # Safety
    /// As [`Self::sample`].
    #[inline(always)]
    pub(crate) unsafe fn components<V: Vector>(
        &self,
        v: V,
        operands: &Operands<'_>,
        mask: u16,
    ) -> Option<Components<V>> {
        let (mut offset_s, mut offset_t) = (None, None);
        if self.op.has_offset {
            (offset_s, offset_t) = (
                Some(v.load_i(operands.offsets[0])),
                Some(v.load_i(operands.offsets[1])),
            );
        }
        let (s, t, layer) = self.place(v, operands);
        let footprint = match self.op.lod {
            LodMode::Grad if self.is_cube && self.has_levels() => {
                let lod = lod::from_gradients(self.op, operands, self.image, self.sampler);
                Some(lod)
            }
            LodMode::Grad if self.takes_derivatives() && !self.is_cube => {
                let level = &self.image.levels[0];
                let size = [level.width, level.height];
                Some(lod::of_plane(operands.lod, size, self.sampler))
            }
            _ => None,
        };
        let reference = match operands.depth_reference {
            Some(row) => Some(self.reference(v, row)),
            None => None,
        };
        let levels = self.levels_of_detail(v, operands, footprint.as_ref());
        let (level, weight) = match self.sampler.mipmap_mode {
            // ⌈d' + 0.5⌉ - 1.
            Filter::Nearest => {
                let up = v.ceil(v.add(levels, v.splat(0.5)));
                let level = v.max(v.sub(up, v.splat(1.0)), v.splat(0.0));
                (v.to_i(level), v.splat(0.0))
            }
            Filter::Linear => {
                let floor = v.floor(levels);
                (v.to_i(floor), v.sub(levels, floor))
            }
        };
        let last = v.splat_i(self.image.level_count as i32 - 1);
        let blends = self.has_levels() && v.gt(weight, v.splat(0.0)) & mask != 0;
        let next = v.min_i(v.add_i(level, v.splat_i(1)), last);
        let anisotropy = match &footprint {
            Some(lod) => lod.anisotropy.as_ref(),
            None => None,
        };
        let (passes, count) = match anisotropy {
            Some(anisotropy) => (anisotropy.passes(mask), Some(v.load(&anisotropy.counts()))),
            None => (1, None),
        };
        let mut total = [v.splat(0.0); 4];
        for pass in 0..passes {
            let (mut s, mut t, mut takes_part) = ((s, offset_s), (t, offset_t), mask);
            if let (Some(anisotropy), Some(count)) = (anisotropy, count) {
                // Samples i = 1..=N at i / (N + 1) - 1/2 along the axis.
                let i = v.min(v.splat((pass + 1) as f32), count);
                let along = v.sub(v.div(i, v.add(count, v.splat(1.0))), v.splat(0.5));
                let axis_s = v.load(&lod::words(&anisotropy.axis[0]));
                let axis_t = v.load(&lod::words(&anisotropy.axis[1]));
                s.0 = v.add(s.0, v.mul(along, axis_s));
                t.0 = v.add(t.0, v.mul(along, axis_t));
                takes_part = v.gt(count, v.splat(pass as f32));
            }
            // SAFETY: indices are inside the level, levels and layers inside the view, so that each offset is of a texel of the image; sums fit in
            // 31 bits, as the image's size does.
            let components = unsafe {
                let mut components = self.of_level(v, level, layer, s, t, reference, mask)?;
                if blends {
                    let next = self.of_level(v, next, layer, s, t, reference, mask)?;
                    for (a, b) in components.iter_mut().zip(next) {
                        *a = v.lerp(*a, b, weight);
                    }
                }
                components
            };
            if pass == 0 {
                total = components;
                continue;
            }
            for (total, component) in total.iter_mut().zip(components) {
                let sum = v.bits_of(v.add(*total, component));
                *total = v.bits_to_f(v.select(takes_part, sum, v.bits_of(*total)));
            }
        }
        if let Some(count) = count {
            for total in &mut total {
                *total = v.div(*total, count);
            }
        }
        Some(total)
    }

    /// The lanes' coordinates, on their faces in cubes, and the offsets of their layers.
    #[inline(always)]
    fn place<V: Vector>(&self, v: V, operands: &Operands<'_>) -> (V::F, V::F, V::I) {
        let coordinates = operands.coordinates;
        let layers = self.image.layer_count.max(1) as i32;
        let stride = v.splat_i(self.image.layer_stride_bytes as i32);
        if !self.is_cube {
            let (s, t) = (v.load(coordinates[0]), v.load(coordinates[1]));
            let layer = match self.op.arrayed {
                true => self.layer(v, coordinates[2], layers - 1),
                false => return (s, t, v.splat_i(0)),
            };
            return (s, t, v.mul_i(layer, stride));
        }
        let direction = [
            &lod::floats(coordinates[0]),
            &lod::floats(coordinates[1]),
            &lod::floats(coordinates[2]),
        ];
        let on_cube = cube::place(direction);
        let mut faces = [0; SUBGROUP_SIZE];
        for lane in 0..SUBGROUP_SIZE {
            faces[lane] = on_cube.face[lane] as u32;
        }
        let mut layer = v.load_i(&faces);
        if self.op.arrayed {
            let first = self.layer(v, coordinates[3], (layers / 6).max(1) - 1);
            layer = v.add_i(layer, v.mul_i(first, v.splat_i(6)));
        }
        let layer = v.min_i(layer, v.splat_i(layers - 1));
        (
            v.load(&lod::words(&on_cube.s)),
            v.load(&lod::words(&on_cube.t)),
            v.mul_i(layer, stride),
        )
    }

    /// The nearest layer to a coordinate ("Array Layer Selection").
    #[inline(always)]
    fn layer<V: Vector>(&self, v: V, coordinate: &Row, last: i32) -> V::I {
        let layer = v.round_ties_even(v.load(coordinate));
        let layer = v.max(layer, v.splat(0.0));
        v.to_i(v.min(layer, v.splat(last as f32)))
    }

    /// What depths are compared with: fixed-point ones lie in 0..1, so it must.
    #[inline(always)]
    fn reference<V: Vector>(&self, v: V, row: &Row) -> V::F {
        let reference = v.load(row);
        match self.info.numeric {
            Numeric::Unorm => v.min(v.max(reference, v.splat(0.0)), v.splat(1.0)),
            _ => reference,
        }
    }

    /// The four results of what is sampled, where that is all there is to do.
    #[inline(always)]
    pub(crate) fn values<V: Vector>(&self, v: V, bytes: Components<V>) -> Option<Components<V>> {
        if !self.straight {
            return None;
        }
        let [a, b, c, d] = [
            v.div_units(bytes[0], 255.0),
            v.div_units(bytes[1], 255.0),
            v.div_units(bytes[2], 255.0),
            v.div_units(bytes[3], 255.0),
        ];
        match self.info.codec {
            Codec::Bgra8 => Some([c, b, a, d]),
            _ => Some([a, b, c, d]),
        }
    }

    /// λ' to d', as in [`lod`].
    #[inline(always)]
    fn levels_of_detail<V: Vector>(
        &self,
        v: V,
        operands: &Operands<'_>,
        footprint: Option<&Lod>,
    ) -> V::F {
        if !self.has_levels() {
            return v.splat(0.0);
        }
        let bias = v.splat(self.sampler.mip_lod_bias);
        let bias = match self.op.lod {
            LodMode::Bias => v.add(bias, v.load(operands.lod[0])),
            _ => bias,
        };
        let bias = v.max(bias, v.splat(-lod::MAX_LOD_BIAS));
        let bias = v.min(bias, v.splat(lod::MAX_LOD_BIAS));
        let lambda = match (self.op.lod, footprint) {
            (LodMode::Lod, _) => v.add(v.load(operands.lod[0]), bias),
            (_, Some(lod)) => v.add(v.load(&lod::words(&lod.lambda)), bias),
            _ => bias,
        };
        let lambda = v.min(lambda, v.splat(self.sampler.max_lod));
        let lambda = v.max(lambda, v.splat(self.sampler.min_lod));
        let level = v.max(v.max(lambda, v.splat(0.0)), v.splat(self.image.min_lod));
        v.min(level, v.splat((self.image.level_count - 1) as f32))
    }

    /// # Safety
    /// The levels are the image's.
    #[inline(always)]
    unsafe fn levels<V: Vector>(&self, v: V, level: V::I, mask: u16) -> Levels<V> {
        if !self.has_levels() {
            return levels_of(v, &self.image.levels[0]);
        }
        let mut row = [0; SUBGROUP_SIZE];
        v.store_i(level, &mut row);
        let first = row[mask.trailing_zeros() as usize & 15];
        // Inactive lanes follow the first active one.
        if v.ne_i(level, v.splat_i(first as i32)) & mask == 0 {
            return levels_of(v, &self.image.levels[first as usize]);
        }
        let at = v.mul_i(level, v.splat_i(size_of::<Level>() as i32));
        let base = self.image.levels.as_ptr().cast::<u8>();
        // The lower words of 64-bit fields.
        let low = if cfg!(target_endian = "big") { 4 } else { 0 };
        // SAFETY: fields of the image's levels.
        unsafe {
            Levels {
                width: v.gather(base.add(offset_of!(Level, width)), at),
                height: v.gather(base.add(offset_of!(Level, height)), at),
                row_stride: v.gather(base.add(offset_of!(Level, row_stride_bytes) + low), at),
                offset: v.gather(base.add(offset_of!(Level, offset_bytes) + low), at),
            }
        }
    }

    /// `offset`, in texels, comes from an operation that has one.
    #[inline(always)]
    fn axis<V: Vector>(
        &self,
        v: V,
        mode: AddressMode,
        (coordinate, offset): (V::F, Option<V::I>),
        size: V::I,
        stride: V::I,
    ) -> Axis<V> {
        let size_f = v.to_f(size);
        let half = match self.sampler.mag_filter {
            Filter::Linear => v.splat(0.5),
            Filter::Nearest => v.splat(0.0),
        };
        let texel = match mode {
            // Periodic: reduced before scaling, which loses nothing.
            AddressMode::Repeat => {
                let fraction = v.sub(coordinate, v.floor(coordinate));
                v.sub(v.mul(fraction, size_f), half)
            }
            AddressMode::MirroredRepeat => {
                let periods = v.floor(v.mul(coordinate, v.splat(0.5)));
                let period = v.sub(coordinate, v.mul(v.splat(2.0), periods));
                v.sub(v.mul(period, size_f), half)
            }
            // Far enough outside for both texels to be the edge's.
            _ => {
                let reach = v.add(size_f, v.splat(64.0));
                let least = v.sub(v.splat(0.0), reach);
                let texels = match self.sampler.unnormalized_coordinates {
                    true => coordinate,
                    false => v.mul(coordinate, size_f),
                };
                v.min(v.max(v.sub(texels, half), least), reach)
            }
        };
        let floor = v.floor(texel);
        let mut first = v.to_i(floor);
        if let Some(offset) = offset {
            // NaN is 0 and only then moved: a periodic mode would carry any other number on.
            first = v.keep(first, v.gt(floor, v.splat(f32::MIN)));
            let reach = address::REACH as i32;
            let offset = v.min_i(v.max_i(offset, v.splat_i(-reach)), v.splat_i(reach));
            first = v.add_i(first, offset);
        }
        let has_offset = offset.is_some();
        let last = v.sub_i(size, v.splat_i(1));
        let second = v.add_i(first, v.splat_i(1));
        let index = wrapped(v, mode, has_offset, first, size, last);
        let inside = match self.is_cube || mode == AddressMode::ClampToBorder {
            true => [v.lt_u(first, size), v.lt_u(second, size)],
            false => [u16::MAX; 2],
        };
        Axis {
            index,
            first: v.mul_i(index, stride),
            second: v.mul_i(wrapped(v, mode, has_offset, second, size, last), stride),
            weight: v.sub(texel, floor),
            inside,
        }
    }

    /// Nothing where a sample reaches over the edge of a cube's face.
    ///
    /// # Safety
    /// As [`Self::sample`]; the levels are the image's, and offsets of its layers are given.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    unsafe fn of_level<V: Vector>(
        &self,
        v: V,
        level: V::I,
        layer: V::I,
        s: (V::F, Option<V::I>),
        t: (V::F, Option<V::I>),
        reference: Option<V::F>,
        mask: u16,
    ) -> Option<Components<V>> {
        let is_nearest = self.sampler.mag_filter == Filter::Nearest;
        let texel_bytes = v.splat_i(self.info.size_bytes as i32);
        let modes = match self.is_cube {
            true => [AddressMode::ClampToEdge; 2],
            false => [self.sampler.address_mode[0], self.sampler.address_mode[1]],
        };
        // SAFETY: the caller's promise; indices on both axes are inside the level.
        unsafe {
            let levels = self.levels(v, level, mask);
            let x = self.axis(v, modes[0], s, levels.width, texel_bytes);
            let y = self.axis(v, modes[1], t, levels.height, levels.row_stride);
            let mut all_inside = x.inside[0] & y.inside[0];
            if !is_nearest {
                all_inside &= x.inside[1] & y.inside[1];
            }
            let is_inside = mask & !all_inside == 0;
            if self.is_cube && !is_inside && !is_nearest {
                return None;
            }
            let offset = v.add_i(levels.offset, layer);
            let upper = v.add_i(offset, y.first);
            let lower = v.add_i(offset, y.second);
            let replaces = self.has_border && !is_inside;
            if replaces || reference.is_some() {
                let inside = y.inside[0] & x.inside[0];
                let first = self.tap(v, v.add_i(upper, x.first), inside, reference);
                if is_nearest {
                    return Some(first);
                }
                let inside = [
                    y.inside[0] & x.inside[1],
                    y.inside[1] & x.inside[0],
                    y.inside[1] & x.inside[1],
                ];
                let taps = [
                    first,
                    self.tap(v, v.add_i(upper, x.second), inside[0], reference),
                    self.tap(v, v.add_i(lower, x.first), inside[1], reference),
                    self.tap(v, v.add_i(lower, x.second), inside[2], reference),
                ];
                return Some(self.blend(v, taps, &x, &y));
            }
            if is_nearest {
                let at = v.add_i(upper, x.first);
                return Some(match self.bytes {
                    true => self.unpack(v, v.gather(self.image.data, at)),
                    false => self.load(v, at),
                });
            }
            if !self.bytes {
                let taps = [
                    self.load(v, v.add_i(upper, x.first)),
                    self.load(v, v.add_i(upper, x.second)),
                    self.load(v, v.add_i(lower, x.first)),
                    self.load(v, v.add_i(lower, x.second)),
                ];
                return Some(self.blend(v, taps, &x, &y));
            }
            let words = match self.window(v, [&x, &y], texel_bytes, levels.row_stride, mask) {
                Some(words) => words,
                None => self.words(v, [upper, lower], &x, texel_bytes),
            };
            if self.straight {
                return Some([
                    blend_bytes(v, words, 0, x.weight, y.weight),
                    blend_bytes(v, words, 1, x.weight, y.weight),
                    blend_bytes(v, words, 2, x.weight, y.weight),
                    blend_bytes(v, words, 3, x.weight, y.weight),
                ]);
            }
            let taps = [
                self.unpack(v, words[0]),
                self.unpack(v, words[1]),
                self.unpack(v, words[2]),
                self.unpack(v, words[3]),
            ];
            Some(self.blend(v, taps, &x, &y))
        }
    }

    /// [`Self::words`] where all lanes' texels lie in a window of eight columns and five rows of an image of one level: loads of its rows cost less than
    /// gathers.
    ///
    /// # Safety
    /// As [`Self::of_level`]: the indices are of texels of the image.
    #[inline(always)]
    unsafe fn window<V: Vector>(
        &self,
        v: V,
        [x, y]: [&Axis<V>; 2],
        texel_bytes: V::I,
        row_stride: V::I,
        mask: u16,
    ) -> Option<[V::I; 4]> {
        let level = &self.image.levels[0];
        if self.has_levels()
            || self.op.arrayed
            || self.is_cube
            || level.width < 8
            || level.height < 5
        {
            return None;
        }
        let across = v.ne_i(v.sub_i(x.second, x.first), texel_bytes);
        let down = v.ne_i(v.sub_i(y.second, y.first), row_stride);
        // Where coordinates change evenly, the least are at a corner of a block, or at an end of a row.
        let left = least_of_corners(v, x.index).min(level.width - 8);
        let top = least_of_corners(v, y.index).min(level.height - 5);
        let columns = v.sub_i(x.index, v.splat_i(left as i32));
        let rows = v.sub_i(y.index, v.splat_i(top as i32));
        let inside = v.lt_u(columns, v.splat_i(7)) & v.lt_u(rows, v.splat_i(4));
        if mask & (across | down | !inside) != 0 {
            return None;
        }
        let stride = level.row_stride_bytes as usize;
        let first = level.offset_bytes as usize + top as usize * stride + left as usize * 4;
        // SAFETY: eight texels of each of five rows are of the level.
        unsafe {
            let at = self.image.data.cast_const().add(first);
            Some(v.window(at, stride, v.keep(columns, mask), v.keep(rows, mask)))
        }
    }

    /// A texel, which is the border in lanes where it is outside, or 1 where its comparison with the reference holds, else 0.
    ///
    /// # Safety
    /// The offsets are of texels of the image.
    #[inline(always)]
    unsafe fn tap<V: Vector>(
        &self,
        v: V,
        at: V::I,
        inside: u16,
        reference: Option<V::F>,
    ) -> Components<V> {
        // SAFETY: the caller's promise.
        let mut texel = unsafe {
            match self.bytes {
                true => self.unpack(v, v.gather(self.image.data, at)),
                false => self.load(v, at),
            }
        };
        if self.has_border && inside != u16::MAX {
            let mut border = sample::border_units(self.sampler, self.info);
            if self.straight && self.info.codec == Codec::Bgra8 {
                border.swap(0, 2);
            }
            for (component, word) in texel.iter_mut().zip(border) {
                let replaced = v.select(inside, v.bits_of(*component), v.splat_i(word as i32));
                *component = v.bits_to_f(replaced);
            }
        }
        if let Some(reference) = reference {
            let scale = v.splat(block::unit_scale(self.info));
            let depth = v.div(texel[0], scale);
            let holds = match self.sampler.compare.unwrap_or(CompareOp::Never) {
                CompareOp::Never => 0,
                CompareOp::Less => v.gt(depth, reference),
                CompareOp::Equal => v.eq(reference, depth),
                CompareOp::LessOrEqual => v.ge(depth, reference),
                CompareOp::Greater => v.gt(reference, depth),
                CompareOp::NotEqual => !v.eq(reference, depth),
                CompareOp::GreaterOrEqual => v.ge(reference, depth),
                CompareOp::Always => u16::MAX,
            };
            let (one, zero) = (v.splat(1.0), v.splat(0.0));
            texel[0] = v.bits_to_f(v.select(holds, v.bits_of(one), v.bits_of(zero)));
        }
        texel
    }

    /// The four texels around each lane, of four bytes each.
    ///
    /// # Safety
    /// As [`Self::of_level`]: the offsets are of texels of the image.
    #[inline(always)]
    unsafe fn words<V: Vector>(
        &self,
        v: V,
        rows: [V::I; 2],
        x: &Axis<V>,
        texel_bytes: V::I,
    ) -> [V::I; 4] {
        let data = self.image.data.cast_const();
        let (upper, lower) = (v.add_i(rows[0], x.first), v.add_i(rows[1], x.first));
        // SAFETY: the caller's promise; a texel's right neighbour is of the image too.
        unsafe {
            if v.ne_i(v.sub_i(x.second, x.first), texel_bytes) == 0 {
                let ((a, b), (c, d)) = (v.gather_pairs(data, upper), v.gather_pairs(data, lower));
                return [a, b, c, d];
            }
            [
                v.gather(data, upper),
                v.gather(data, v.add_i(rows[0], x.second)),
                v.gather(data, lower),
                v.gather(data, v.add_i(rows[1], x.second)),
            ]
        }
    }

    /// Linear between the four texels.
    #[inline(always)]
    fn blend<V: Vector>(
        &self,
        v: V,
        taps: [Components<V>; 4],
        x: &Axis<V>,
        y: &Axis<V>,
    ) -> Components<V> {
        let mut blended = [v.splat(0.0); 4];
        for (component, result) in blended.iter_mut().enumerate() {
            if self.takes(component) {
                let upper = v.lerp(taps[0][component], taps[1][component], x.weight);
                let lower = v.lerp(taps[2][component], taps[3][component], x.weight);
                *result = v.lerp(upper, lower, y.weight);
            }
        }
        blended
    }

    /// Whether a component is wanted and the format has it.
    #[inline(always)]
    fn takes(&self, component: usize) -> bool {
        self.wanted >> component & 1 == 1 && self.info.channels[component].bits != 0
    }

    /// The components of 8 bits each.
    #[inline(always)]
    fn unpack<V: Vector>(&self, v: V, word: V::I) -> Components<V> {
        if self.straight {
            return [
                v.to_f(v.byte(word, 0)),
                v.to_f(v.byte(word, 1)),
                v.to_f(v.byte(word, 2)),
                v.to_f(v.byte(word, 3)),
            ];
        }
        let mut components = [v.splat(0.0); 4];
        for (component, result) in components.iter_mut().enumerate() {
            if !self.takes(component) {
                continue;
            }
            let byte = v.byte(word, self.info.channels[component].offset as u32 / 8);
            *result = match (self.srgb, component) {
                (false, _) => v.to_f(byte),
                (true, 3) => v.div_units(v.to_f(byte), 255.0),
                (true, _) => {
                    let at = v.mul_i(byte, v.splat_i(4));
                    // SAFETY: the table has an entry for every byte.
                    v.bits_to_f(unsafe { v.gather(srgb::LINEAR.as_ptr().cast(), at) })
                }
            };
        }
        components
    }

    /// Texels of any format.
    ///
    /// # Safety
    /// The offsets are of texels of the image.
    #[inline(always)]
    unsafe fn load<V: Vector>(&self, v: V, at: V::I) -> Components<V> {
        if self.info.in_vectors {
            // SAFETY: the caller's promise.
            let words = unsafe { texels::load(v, self.info, self.image.data, at) };
            return [
                v.bits_to_f(words[0]),
                v.bits_to_f(words[1]),
                v.bits_to_f(words[2]),
                v.bits_to_f(words[3]),
            ];
        }
        let mut offsets = [0u32; SUBGROUP_SIZE];
        v.store_i(at, &mut offsets);
        // SAFETY: the caller's promise.
        let texels = unsafe { block::load(self.info, self.image.data, &offsets) };
        [
            v.load(&texels[0]),
            v.load(&texels[1]),
            v.load(&texels[2]),
            v.load(&texels[3]),
        ]
    }

    /// Units to values, missing components, the view's component mapping.
    #[inline(always)]
    pub(crate) fn finish<V: Vector>(&self, v: V, components: Components<V>, results: Results<'_>) {
        if let Some(values) = self.values(v, components) {
            for (value, row) in values.into_iter().zip(results) {
                v.store(value, row);
            }
            return;
        }
        if self.op.depth_compare {
            v.store(components[0], &mut results[0]);
            return;
        }
        let scale = block::unit_scale(self.info);
        let mut texels: Texels = [[0; SUBGROUP_SIZE]; 4];
        for (component, row) in texels.iter_mut().enumerate() {
            if !self.takes(component) {
                *row = [self.info.missing(component); SUBGROUP_SIZE];
            } else if scale != 1.0 {
                v.store(v.div_units(components[component], scale), row);
            } else {
                v.store(components[component], row);
            }
        }
        super::operands::swizzle(self.image, self.info, &mut texels);
        put_texels(self.op, self.info, &texels, results);
    }
}
