//! Samples and gathers in vectors. Everything about the image and the
//! sampler is looked up once ([`Fast`]), then blocks of lanes are sampled in vectors of the
//! machine. Gives the same results as [`sample`](super::sample), bit for bit.

mod axis;
mod footprints;
mod levels;
mod planes;
mod steps;
mod taps;
mod texels;
mod whole;

use lanes::vector::{FourOf, Vector};
use lanes::{LANES, Row};

use super::decode::Decoder;
use super::format::block::{self, Texels};
use super::format::layout::Codec;
use super::format::{FormatInfo, Numeric};
use super::lod;
use super::operands::Operands;
use super::{
    AddressMode, Dim, Filter, ImageDescriptor, ImageOp, ImageOpKind, LodMode, Reduction,
    SamplerDescriptor, TexelType,
};
pub(super) use taps::index_in_block;
use whole::Whole;

/// Whether an operation is one of these, as far as its instruction tells.
pub fn may_apply(op: &ImageOp) -> bool {
    let dim_fits = match op.dim {
        Dim::D1 | Dim::D2 | Dim::D3 => true,
        Dim::Cube => !op.has_offset,
        Dim::Buffer => false,
    };
    let kind_fits = matches!(op.kind, ImageOpKind::Sample | ImageOpKind::Gather(_));
    let has_others = op.has_min_lod || op.has_offsets || op.residency;
    kind_fits && dim_fits && !has_others && op.texel != TexelType::I64
}

/// An operation that [`may_apply`], with an image and a sampler for which it does.
#[derive(Clone, Copy)]
pub struct Fast<'a> {
    op: &'a ImageOp,
    image: &'a ImageDescriptor,
    info: &'a FormatInfo,
    sampler: &'a SamplerDescriptor,
    /// A bit per component that is looked at.
    wanted: u8,
    /// Texels are four bytes of 8 bits.
    bytes: bool,
    srgb: bool,
    /// The format has four linear bytes, and most of them are wanted: they are sampled in memory
    /// order, without a swizzle.
    straight: bool,
    /// One texel is taken, not four.
    is_nearest: bool,
    is_cube: bool,
    /// Axes of the image, or of a face.
    spatial: usize,
    decoder: Decoder,
    /// One load serves for two neighbours.
    pairs: bool,
    /// Of linear samples of four numbers a texel, most of them wanted: a kind of [`FourOf`].
    four_of: Option<u8>,
    /// Nearest texels need no more than [`texels::load`](super::texels::load).
    is_loaded: bool,
    /// Binary logarithm of a block's width and height.
    block_shift: u32,
    has_border: bool,
    /// Several samples along a footprint, by derivatives.
    is_anisotropic: bool,
    /// There is more to do than [`planes`] has code for: see [`Whole`].
    has_more: bool,
}

impl<'a> Fast<'a> {
    pub fn new(
        op: &'a ImageOp,
        image: &'a ImageDescriptor,
        info: &'a FormatInfo,
        sampler: &'a SamplerDescriptor,
        wanted: u8,
    ) -> Option<Fast<'a>> {
        let is_cube = op.dim == Dim::Cube;
        let spatial = match op.dim {
            Dim::Cube => 2,
            _ => op.spatial_count(),
        };
        let modes = &sampler.address_mode[..spatial];
        let applies = Self::applies(op, image, info, sampler, modes);
        let is_gather = op.kind != ImageOpKind::Sample;
        let srgb = matches!(info.codec, Codec::Srgb8Rgba | Codec::Srgb8Bgra);
        let bytes = srgb || matches!(info.codec, Codec::Unorm8(4) | Codec::Bgra8);
        let in_order = image.swizzle == [0, 1, 2, 3];
        let has_border = !is_cube && modes.contains(&AddressMode::ClampToBorder);
        let is_anisotropic =
            !is_gather && !is_cube && op.lod == LodMode::Grad && lod::is_anisotropic(sampler);
        let decoder = Decoder::of(info);
        let has_levels = image.level_count != 1;
        let is_nearest = !is_gather && sampler.mag_filter == Filter::Nearest;
        let is_loaded = info.decoded_in_vectors && !has_border;
        let has_more = match (is_gather, spatial) {
            (true, _) => false,
            _ if is_cube => true,
            _ if has_border => true,
            _ if op.depth_compare => true,
            (_, 2) => false,
            (_, 3) => is_anisotropic || has_levels && op.lod == LodMode::Grad,
            _ => true,
        };
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
                && wanted.count_ones() >= 3
                && !op.depth_compare
                && !is_gather,
            is_nearest,
            is_cube,
            spatial,
            decoder,
            pairs: decoder != Decoder::Each
                && info.blocks().is_none()
                && info.size_bytes.is_power_of_two(),
            is_loaded,
            four_of: match is_gather || op.depth_compare || has_border {
                true => None,
                false => four_of(info).filter(|_| !in_order || wanted.count_ones() >= 2),
            },
            block_shift: if info.blocks().is_some() { 2 } else { 0 },
            has_border,
            is_anisotropic,
            has_more,
        })
    }

    /// Whether a sample or gather that [`may_apply`] is fast with this image and sampler.
    fn applies(
        op: &ImageOp,
        image: &ImageDescriptor,
        info: &FormatInfo,
        sampler: &SamplerDescriptor,
        modes: &[AddressMode],
    ) -> bool {
        let is_cube = op.dim == Dim::Cube;
        let is_gather = op.kind != ImageOpKind::Sample;
        let modes_fit = !is_cube || !sampler.non_seamless && !sampler.unnormalized_coordinates;
        let kind_fits = match is_gather {
            // They take the base level, which may be outside of the view.
            true => image.has_level(0),
            false => {
                sampler.mag_filter == sampler.min_filter
                    && sampler.reduction == Reduction::WeightedAverage
            }
        };
        // One texel of one level, or gathered ones: nothing is computed with them.
        let takes_integers = !info.is_wide()
            && (is_gather
                || sampler.mag_filter == Filter::Nearest
                    && (sampler.mipmap_mode == Filter::Nearest || image.level_count == 1)
                    && !lod::is_anisotropic(sampler));
        may_apply(op)
            && modes_fit
            // Those are clamped, by valid usage.
            && (!sampler.unnormalized_coordinates
                || modes.iter().all(|mode| *mode == AddressMode::ClampToEdge))
            && kind_fits
            && (!info.numeric.is_integer() || takes_integers)
            // Blocks of four by four, or texels.
            && matches!(info.block_extent(), [1, 1] | [4, 4])
            && image.conversion.is_none()
            && image.size_bytes <= i32::MAX as u64
    }

    #[inline(always)]
    pub(super) fn op(&self) -> &ImageOp {
        self.op
    }

    #[inline(always)]
    fn is_gather(&self) -> bool {
        self.op.kind != ImageOpKind::Sample
    }

    #[inline(always)]
    fn has_words(&self) -> bool {
        has_words(self.info)
    }

    #[inline(always)]
    fn has_levels(&self) -> bool {
        self.image.level_count != 1
    }

    /// Whether derivatives are looked at, where the operation has them.
    #[inline]
    pub fn takes_derivatives(&self) -> bool {
        self.has_levels() || self.is_anisotropic
    }
}

/// Whether texels are words, of one component.
#[inline(always)]
fn has_words(info: &FormatInfo) -> bool {
    info.codec == Codec::Words(1) && info.size_bytes == 4
}

/// How the four components of texels lie, where [`Vector::blend_neighbours`] blends such.
#[inline(always)]
fn four_of(info: &FormatInfo) -> Option<u8> {
    match info.codec {
        Codec::Unorm8(4) | Codec::Bgra8 => Some(FourOf::BYTES),
        Codec::Unorm16(4) => Some(FourOf::SHORTS),
        Codec::Half(4) => Some(FourOf::HALVES),
        Codec::Words(4) if info.numeric == Numeric::Sfloat => Some(FourOf::WORDS),
        _ => None,
    }
}

/// The sample of a lane, in units (see [`block`]).
pub(super) type Components<V> = [<V as Vector>::F; 4];

/// Offsets of an operation that has some, in texels along the axes.
pub(super) type Offsets<V> = [Option<<V as Vector>::I>; 3];

impl Fast<'_> {
    /// The results of any sample of the lanes of `mask`, which is not empty. Those that are not
    /// wanted are anything.
    ///
    /// # Safety
    /// The image's memory stays allocated during the call.
    #[inline(always)]
    pub(super) unsafe fn whole<V: Vector>(
        &self,
        v: V,
        operands: &Operands<'_>,
        mask: u16,
    ) -> Components<V> {
        let fast = self;
        // SAFETY: the caller guarantees that the image's memory stays allocated during the call.
        let components = unsafe {
            v.apart(Whole {
                fast,
                operands,
                mask,
            })
        };
        self.finish(v, components)
    }

    #[inline(always)]
    fn offsets<V: Vector>(&self, v: V, operands: &Operands<'_>) -> Offsets<V> {
        if !self.op.has_offset {
            return [None; 3];
        }
        let mut offsets = [None; 3];
        for axis in 0..self.spatial {
            offsets[axis] = Some(v.load_i(operands.offsets[axis]));
        }
        offsets
    }

    /// The byte offsets of the lanes' layers.
    #[inline(always)]
    fn layer_offset<V: Vector>(&self, v: V, coordinate: Option<&Row>) -> V::I {
        let Some(coordinate) = coordinate else {
            return v.splat_i(0);
        };
        let layer = self.layer(v, coordinate, self.image.layer_count.max(1) as i32 - 1);
        v.mul_i(layer, v.splat_i(self.image.layer_stride_bytes as i32))
    }

    /// The nearest layer to a coordinate ("Array Layer Selection").
    #[inline(always)]
    fn layer<V: Vector>(&self, v: V, coordinate: &Row, last: i32) -> V::I {
        let layer = v.round_ties_even(v.load(coordinate));
        let layer = v.max(layer, v.splat(0.0));
        v.to_i(v.min(layer, v.splat(last as f32)))
    }

    /// Units to values, missing components, the view's component mapping: the results, where they
    /// are of 32 bits.
    #[inline(always)]
    fn finish<V: Vector>(&self, v: V, components: Components<V>) -> Components<V> {
        if self.straight {
            return [
                v.div_units(components[0], 255.0),
                v.div_units(components[1], 255.0),
                v.div_units(components[2], 255.0),
                v.div_units(components[3], 255.0),
            ];
        }
        if self.is_gather() {
            return self.gathered_values(v, components);
        }
        if self.op.depth_compare {
            return components;
        }
        // Those are values, of all four components.
        if self.srgb && !self.has_more && self.image.swizzle == [0, 1, 2, 3] {
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
        let mut texels: Texels = [[0; LANES]; 4];
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
}
