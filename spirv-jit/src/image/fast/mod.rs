//! Samples and gathers of 2D images and cubes in vectors. Everything about the image and the sampler is looked up once ([`Fast`]), then blocks
//! of lanes are sampled in vectors of the machine. Gives the same results as [`sample`](super::sample), bit for bit.

mod axis;
mod levels;
mod texels;
mod whole;

use std::hint::assert_unchecked;

use super::format::FormatInfo;
use super::format::block::{self, Texels};
use super::format::layout::Codec;
use super::lod;
use super::operands::{Operands, put_texels};
use super::vector::{Task, Vector};
use super::{
    AddressMode, Dim, Filter, ImageDescriptor, ImageOp, ImageOpKind, LodMode, Reduction,
    SamplerDescriptor,
};
use crate::SUBGROUP_SIZE;
use crate::row::Row;
use crate::types::Type;
use levels::levels_of;
use whole::Whole;

/// Whether an operation is one of these, as far as its instruction tells.
pub(crate) fn may_apply(op: &ImageOp) -> bool {
    let dim_fits = op.dim == Dim::D2 || op.dim == Dim::Cube && !op.has_offset;
    let kind_fits = matches!(op.kind, ImageOpKind::Sample | ImageOpKind::Gather(_));
    kind_fits && dim_fits && !op.has_min_lod && !op.has_offsets
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
    /// A bit per component that is looked at.
    wanted: u8,
    /// Texels are four bytes of 8 bits.
    bytes: bool,
    srgb: bool,
    /// Four bytes, each of them wanted and linear: they are sampled as they lie in memory, without a look at what each is.
    straight: bool,
    /// One texel is taken, not four.
    is_nearest: bool,
    is_cube: bool,
    has_border: bool,
    /// There is more to do than to weigh texels: see [`Whole`].
    has_more: bool,
    /// There is less to do: see [`Flat`].
    is_flat: bool,
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
        let is_gather = op.kind != ImageOpKind::Sample;
        let kind_fits = match is_gather {
            // They take the base level, which may be outside of the view.
            true => image.has_level(0),
            false => {
                sampler.mag_filter == sampler.min_filter
                    && sampler.reduction == Reduction::WeightedAverage
            }
        };
        let applies = may_apply(op)
            && modes_fit
            // Those are clamped, by valid usage.
            && (!sampler.unnormalized_coordinates
                || sampler.address_mode[..2] == [AddressMode::ClampToEdge; 2])
            && kind_fits
            && !info.numeric.is_integer()
            && info.blocks().is_none()
            && image.conversion.is_none()
            && image.size_bytes <= i32::MAX as u64;
        let srgb = matches!(info.codec, Codec::Srgb8Rgba | Codec::Srgb8Bgra);
        let bytes = srgb || matches!(info.codec, Codec::Unorm8(4) | Codec::Bgra8);
        let in_order = image.swizzle == [0, 1, 2, 3];
        let has_border =
            !is_cube && sampler.address_mode[..2].contains(&AddressMode::ClampToBorder);
        let has_more =
            is_gather || is_cube || has_border || op.depth_compare || lod::is_anisotropic(sampler);
        applies.then_some(Fast {
            op,
            image,
            info,
            sampler,
            wanted: match is_gather {
                true => whole::gathered_component(&op.kind, image).map_or(0, |source| 1 << source),
                false if in_order => wanted,
                false => 0xf,
            },
            bytes,
            srgb,
            straight: bytes
                && !srgb
                && in_order
                && wanted == 0xf
                && op.texel != Type::I64
                && !op.depth_compare
                && !is_gather,
            is_nearest: !is_gather && sampler.mag_filter == Filter::Nearest,
            is_cube,
            has_border,
            has_more,
            is_flat: !has_more && image.level_count == 1 && !op.arrayed && !op.has_offset,
        })
    }

    #[inline(always)]
    fn is_gather(&self) -> bool {
        self.op.kind != ImageOpKind::Sample
    }

    #[inline(always)]
    fn has_levels(&self) -> bool {
        self.image.level_count != 1
    }

    /// Whether derivatives are looked at, where the operation has them.
    #[inline(always)]
    pub(crate) fn takes_derivatives(&self) -> bool {
        self.has_levels() || !self.is_cube && lod::is_anisotropic(self.sampler)
    }
}

/// What a lane samples: numbers between 0 and 255 for 8-bit formats, in memory's order where they are sampled so, else values.
pub(crate) type Components<V> = [<V as Vector>::F; 4];

/// Offsets of an operation that has some, in texels along both axes.
type Offsets<V> = [Option<<V as Vector>::I>; 2];

/// Results of a block; only those that are wanted are written.
type Results<'r> = &'r mut [Row];

/// A block of samples of a plane of one level, to the nearest texel or linear, compiled by itself: with little to choose between, its numbers stay
/// in registers.
struct Flat<'a, 'b, const IS_NEAREST: bool>(&'b Fast<'a>, [&'b Row; 2], u16);

impl<V: Vector, const IS_NEAREST: bool> Task<V> for Flat<'_, '_, IS_NEAREST> {
    type Output = Components<V>;

    #[inline(always)]
    unsafe fn run(self, v: V) -> Self::Output {
        let Flat(fast, [s, t], mask) = self;
        // SAFETY: the caller's promise.
        unsafe {
            assert_unchecked(fast.is_nearest == IS_NEAREST);
            let levels = levels_of(v, &fast.image.levels[0]);
            let [mode_s, mode_t, _] = fast.sampler.address_mode;
            let texel_bytes = v.splat_i(fast.info.size_bytes as i32);
            let x = fast.axis(v, mode_s, (v.load(s), None), levels.width, texel_bytes);
            let y = fast.axis(
                v,
                mode_t,
                (v.load(t), None),
                levels.height,
                levels.row_stride,
            );
            fast.weighted(v, &levels, v.splat_i(0), [&x, &y], mask)
        }
    }
}

impl Fast<'_> {
    /// Samples the lanes of `mask`, which is not empty.
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
    ) {
        // SAFETY: as the caller promises.
        let components = unsafe { self.components(v, operands, mask) };
        self.finish(v, components, results);
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
    ) -> Components<V> {
        if self.has_more {
            // SAFETY: as the caller promises.
            return unsafe {
                v.apart(Whole {
                    fast: self,
                    operands,
                    mask,
                })
            };
        }
        if self.is_flat {
            let places = [operands.coordinates[0], operands.coordinates[1]];
            // SAFETY: as the caller promises; each is for the samples that it says.
            return unsafe {
                match self.is_nearest {
                    true => v.apart(Flat::<true>(self, places, mask)),
                    false => v.apart(Flat::<false>(self, places, mask)),
                }
            };
        }
        let offsets = self.offsets(v, operands);
        let (s, t, layer) = self.plane(v, operands);
        let footprint = match self.op.lod {
            LodMode::Grad if self.has_levels() => {
                let level = &self.image.levels[0];
                let size = [level.width, level.height];
                Some(lod::of_plane(operands.lod, size, self.sampler))
            }
            _ => None,
        };
        let (level, weight) = self.chosen_levels(v, operands, footprint.as_ref());
        let blends = self.has_levels() && v.gt(weight, v.splat(0.0)) & mask != 0;
        let (s, t) = ((s, offsets[0]), (t, offsets[1]));
        let levels = [level, self.next_level(v, level)];
        let mut components = [v.splat(0.0); 4];
        for (i, level) in levels.into_iter().enumerate().take(1 + blends as usize) {
            // SAFETY: the caller's promise; levels are the image's, layers the view's.
            let of_level = unsafe { self.of_level(v, level, layer, s, t, mask) };
            if i == 0 {
                components = of_level;
            } else {
                components = [
                    v.lerp(components[0], of_level[0], weight),
                    v.lerp(components[1], of_level[1], weight),
                    v.lerp(components[2], of_level[2], weight),
                    v.lerp(components[3], of_level[3], weight),
                ];
            }
        }
        components
    }

    /// # Safety
    /// As [`Self::sample`]; the levels are the image's, and offsets of its layers are given.
    #[inline(always)]
    unsafe fn of_level<V: Vector>(
        &self,
        v: V,
        level: V::I,
        layer: V::I,
        s: (V::F, Option<V::I>),
        t: (V::F, Option<V::I>),
        mask: u16,
    ) -> Components<V> {
        let modes = self.sampler.address_mode;
        // SAFETY: the caller's promise.
        unsafe {
            let levels = self.levels(v, level, mask);
            let texel_bytes = v.splat_i(self.info.size_bytes as i32);
            let x = self.axis(v, modes[0], s, levels.width, texel_bytes);
            let y = self.axis(v, modes[1], t, levels.height, levels.row_stride);
            self.weighted(v, &levels, layer, [&x, &y], mask)
        }
    }

    #[inline(always)]
    fn offsets<V: Vector>(&self, v: V, operands: &Operands<'_>) -> Offsets<V> {
        if !self.op.has_offset {
            return [None; 2];
        }
        let rows = operands.offsets;
        [Some(v.load_i(rows[0])), Some(v.load_i(rows[1]))]
    }

    /// The lanes' coordinates in a plane, and the byte offsets of their layers.
    #[inline(always)]
    fn plane<V: Vector>(&self, v: V, operands: &Operands<'_>) -> (V::F, V::F, V::I) {
        let rows = operands.coordinates;
        let (s, t) = (v.load(rows[0]), v.load(rows[1]));
        if !self.op.arrayed {
            return (s, t, v.splat_i(0));
        }
        let layer = self.layer(v, rows[2], self.image.layer_count.max(1) as i32 - 1);
        let stride = v.splat_i(self.image.layer_stride_bytes as i32);
        (s, t, v.mul_i(layer, stride))
    }

    /// The nearest layer to a coordinate ("Array Layer Selection").
    #[inline(always)]
    fn layer<V: Vector>(&self, v: V, coordinate: &Row, last: i32) -> V::I {
        let layer = v.round_ties_even(v.load(coordinate));
        let layer = v.max(layer, v.splat(0.0));
        v.to_i(v.min(layer, v.splat(last as f32)))
    }

    /// Units to values, missing components, the view's component mapping: the results, where they are of 32 bits.
    #[inline(always)]
    pub(crate) fn values<V: Vector>(&self, v: V, components: Components<V>) -> Components<V> {
        if self.straight {
            let [a, b, c, d] = [
                v.div_units(components[0], 255.0),
                v.div_units(components[1], 255.0),
                v.div_units(components[2], 255.0),
                v.div_units(components[3], 255.0),
            ];
            return match self.info.codec {
                Codec::Bgra8 => [c, b, a, d],
                _ => [a, b, c, d],
            };
        }
        if self.is_gather() {
            return self.gathered_values(v, components);
        }
        if self.op.depth_compare {
            return components;
        }
        let scale = block::unit_scale(self.info);
        let mut values = components;
        for (component, value) in values.iter_mut().enumerate() {
            if !self.takes(component) {
                *value = v.bits_to_f(v.splat_i(self.info.missing(component) as i32));
            } else if scale != 1.0 {
                *value = v.div_units(*value, scale);
            }
        }
        if self.image.swizzle == [0, 1, 2, 3] {
            return values;
        }
        let mut texels: Texels = [[0; SUBGROUP_SIZE]; 4];
        for (value, row) in values.into_iter().zip(&mut texels) {
            v.store(value, row);
        }
        super::operands::swizzle(self.image, self.info, &mut texels);
        [
            v.load(&texels[0]),
            v.load(&texels[1]),
            v.load(&texels[2]),
            v.load(&texels[3]),
        ]
    }

    /// Results of any width.
    #[inline(always)]
    pub(crate) fn finish<V: Vector>(&self, v: V, components: Components<V>, results: Results<'_>) {
        let values = self.values(v, components);
        if self.op.depth_compare && !self.is_gather() {
            return v.store(values[0], &mut results[0]);
        }
        let mut texels: Texels = [[0; SUBGROUP_SIZE]; 4];
        for (value, row) in values.into_iter().zip(&mut texels) {
            v.store(value, row);
        }
        put_texels(self.op, self.info, &texels, results);
    }
}
