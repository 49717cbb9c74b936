//! Samples and gathers in vectors. Everything about the image and the
//! sampler is looked up once ([`Fast`]), then blocks of lanes are sampled in vectors of the
//! machine. Gives the same results as [`sample`](super::sample), bit for bit.

mod anisotropic;
mod axis;
mod blend;
mod footprints;
mod levels;
mod linear;
mod nearest;
mod places;
mod steps;

use lanes::LANES;
use lanes::vector::{FourOf, Vector};

use super::decode::Decoder;
use super::format::block::{self, Texels};
use super::format::layout::Codec;
use super::format::{FormatInfo, Numeric};
use super::lod;
use super::{
    AddressMode, Dim, Filter, ImageDescriptor, ImageOp, ImageOpKind, LodMode, Reduction,
    SamplerDescriptor, TexelType,
};
pub(super) use footprints::index_in_block;

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
    /// Binary logarithm of a block's width and height.
    block_shift: u32,
    has_border: bool,
    /// Several samples along a footprint, by derivatives.
    is_anisotropic: bool,
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
        let bytes = matches!(info.codec, Codec::Unorm8(4) | Codec::Bgra8);
        let in_order = image.swizzle == [0, 1, 2, 3];
        let has_border = !is_cube && modes.contains(&AddressMode::ClampToBorder);
        let is_anisotropic =
            !is_gather && !is_cube && op.lod == LodMode::Grad && lod::is_anisotropic(sampler);
        let decoder = Decoder::of(info);
        let is_nearest = !is_gather && sampler.mag_filter == Filter::Nearest;
        applies.then_some(Fast {
            op,
            image,
            info,
            sampler,
            wanted: match in_order {
                _ if is_gather => 0xf,
                true => wanted,
                false => 0xf,
            },
            straight: bytes
                && in_order
                && wanted.count_ones() >= 3
                && !op.depth_compare
                && !is_gather,
            is_nearest,
            is_cube,
            spatial,
            decoder,
            pairs: decoder != Decoder::Each
                && !decoder.is_expanded()
                && info.size_bytes.is_power_of_two(),
            four_of: match is_gather || op.depth_compare || has_border || spatial == 1 {
                true => None,
                false => four_of(info).filter(|_| !in_order || wanted.count_ones() >= 2),
            },
            block_shift: if info.blocks().is_some() { 2 } else { 0 },
            has_border,
            is_anisotropic,
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
    fn is_gather(&self) -> bool {
        self.op.kind != ImageOpKind::Sample
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

/// Samples, in units (see [`block`]).
type Components<V> = [<V as Vector>::F; 4];

impl Fast<'_> {
    /// Whether a component is wanted and the format has it.
    #[inline(always)]
    fn takes(&self, component: usize) -> bool {
        self.wanted >> component & 1 == 1 && self.info.channels[component].bits != 0
    }

    /// Components in memory's order, as the format has them.
    #[inline(always)]
    fn in_order<F>(&self, [a, b, c, d]: [F; 4]) -> [F; 4] {
        match self.info.codec {
            Codec::Bgra8 => [c, b, a, d],
            _ => [a, b, c, d],
        }
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
