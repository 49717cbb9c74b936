//! From coordinates to texels, one axis at a time: as [`address`] has it.

use lanes::vector::Vector;

use super::super::{AddressMode, address};
use super::Fast;

/// An axis of the lanes' footprints at a level.
#[derive(Clone, Copy)]
pub(super) struct Axis<V: Vector> {
    /// Both texels are inside of the level in every lane that is looked at, as they lie: the second
    /// one behind the first.
    pub is_inner: bool,
    /// The first texel's index, before it is brought into the level.
    pub at: V::I,
    /// The texels' indices, inside the level.
    pub index: [V::I; 2],
    /// Their byte offsets.
    pub offsets: [V::I; 2],
    /// The second one's weight.
    pub weight: V::F,
    /// Lanes whose texels are none of the border's.
    pub inside: [u16; 2],
}

/// The least number but one.
const ABOVE_LEAST: f32 = f32::MIN.next_up();

/// A texel's index by the mode, inside the level for any index.
///
/// Here and below there are no closures: those would not be compiled for the vectors' instruction
/// set.
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
        // The complement of negative ones.
        AddressMode::MirrorClampToEdge => v.xor_i(i, v.sign_i(i)),
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

impl Fast<'_> {
    /// The index of the nearest texel, inside the level: [`Axis::index`] of a sample that takes one
    /// texel.
    #[inline(always)]
    pub(super) fn nearest<V: Vector>(
        &self,
        v: V,
        mode: AddressMode,
        (coordinate, offset): (V::F, Option<V::I>),
        size: V::I,
    ) -> V::I {
        let size_f = v.to_f(size);
        let last = v.sub_i(size, v.splat_i(1));
        let zero = v.splat(0.0);
        match mode {
            AddressMode::Repeat if offset.is_none() => {
                let fraction = v.sub(coordinate, v.floor(coordinate));
                // From 0 to `size`, to which a fraction just below 1 is rounded; or of no number.
                let i = v.max_i(v.to_i(v.mul(fraction, size_f)), v.splat_i(0));
                // Wraps where the index is less than the size.
                v.min_u(i, v.sub_i(i, size))
            }
            AddressMode::ClampToEdge
                if offset.is_none() && !self.sampler.unnormalized_coordinates =>
            {
                let texel = v.max(v.mul(coordinate, size_f), zero);
                v.to_i(v.min(texel, v.to_f(last)))
            }
            _ => {
                let along = Along {
                    size,
                    stride: size,
                    block_shift: 0,
                    looked_at: 0,
                };
                self.axis(v, mode, (coordinate, offset), along).index[0]
            }
        }
    }

    /// As [`Self::nearest`] of the mode that has a border, and the lanes whose texel is not the
    /// border's.
    #[inline(always)]
    pub(super) fn nearest_or_border<V: Vector>(
        &self,
        v: V,
        place: (V::F, Option<V::I>),
        size: V::I,
    ) -> (V::I, u16) {
        let along = Along {
            size,
            stride: size,
            block_shift: 0,
            looked_at: 0,
        };
        let axis = self.axis(v, AddressMode::ClampToBorder, place, along);
        (axis.index[0], axis.inside[0])
    }

    /// A coordinate in texels. Periodic modes reduce it, others clamp it near the level.
    #[inline(always)]
    fn texel_along<V: Vector>(
        &self,
        v: V,
        mode: AddressMode,
        coordinate: V::F,
        size: V::I,
    ) -> V::F {
        let size = v.to_f(size);
        let half = v.splat(if self.is_nearest { 0.0 } else { 0.5 });
        match mode {
            // Reduced before scaling, which loses nothing.
            AddressMode::Repeat => {
                let fraction = v.sub(coordinate, v.floor(coordinate));
                v.sub(v.mul(fraction, size), half)
            }
            AddressMode::MirroredRepeat => {
                let periods = v.floor(v.mul(coordinate, v.splat(0.5)));
                let period = v.sub(coordinate, v.mul(v.splat(2.0), periods));
                v.sub(v.mul(period, size), half)
            }
            // Far enough outside for both texels to be the edge's.
            _ => {
                let reach = v.add(size, v.splat(64.0));
                let least = v.sub(v.splat(0.0), reach);
                let texels = match self.sampler.unnormalized_coordinates {
                    true => coordinate,
                    false => v.mul(coordinate, size),
                };
                v.min(v.max(v.sub(texels, half), least), reach)
            }
        }
    }

    /// `offset`, in texels, comes from an operation that has one.
    #[inline(always)]
    pub(super) fn axis<V: Vector>(
        &self,
        v: V,
        mode: AddressMode,
        (coordinate, offset): (V::F, Option<V::I>),
        along: Along<V>,
    ) -> Axis<V> {
        let Along {
            size,
            stride,
            block_shift,
            looked_at,
        } = along;
        let texel = self.texel_along(v, mode, coordinate, size);
        let floor = v.floor(texel);
        let mut first = v.to_i(floor);
        if offset.is_some() || self.is_gather() {
            // NaN is 0 and only then moved: a periodic mode would carry any other number on, and a
            // gather takes the texel behind it.
            first = v.and_i(first, v.at_least(floor, v.splat(ABOVE_LEAST)));
        }
        if let Some(offset) = offset {
            let reach = address::REACH as i32;
            let offset = v.min_i(v.max_i(offset, v.splat_i(-reach)), v.splat_i(reach));
            first = v.add_i(first, offset);
        }
        let weight = v.sub(texel, floor);
        let one = v.splat_i(1);
        let last = v.sub_i(size, one);
        // No mode is applied where it changes nothing.
        let reach = if self.is_nearest { size } else { last };
        let is_inner = looked_at != 0 && looked_at & !v.lt_u(first, reach) == 0;
        if is_inner {
            let first = match looked_at {
                u16::MAX => first,
                _ => v.keep(first, looked_at),
            };
            let second = v.add_i(first, one);
            let offset = offset_along(v, first, stride, block_shift);
            let next = match block_shift {
                0 => v.add_i(offset, stride),
                _ => offset_along(v, second, stride, block_shift),
            };
            return Axis {
                is_inner,
                at: first,
                index: [first, second],
                offsets: [offset, next],
                weight,
                inside: [u16::MAX; 2],
            };
        }
        let has_offset = offset.is_some();
        let second = v.add_i(first, one);
        let index = [
            wrapped(v, mode, has_offset, first, size, last),
            wrapped(v, mode, has_offset, second, size, last),
        ];
        let inside = match mode {
            AddressMode::ClampToBorder => [v.lt_u(first, size), v.lt_u(second, size)],
            _ => [u16::MAX; 2],
        };
        Axis {
            is_inner,
            at: first,
            index,
            offsets: [
                offset_along(v, index[0], stride, block_shift),
                offset_along(v, index[1], stride, block_shift),
            ],
            weight,
            inside,
        }
    }
}

/// An axis of levels.
#[derive(Clone, Copy)]
pub(super) struct Along<V: Vector> {
    pub size: V::I,
    /// From a texel, or a block, to the next.
    pub stride: V::I,
    /// Binary logarithm of a block's texels.
    pub block_shift: u32,
    /// The lanes of which texels are looked at; not all only where all lanes have one level.
    pub looked_at: u16,
}

#[inline(always)]
fn offset_along<V: Vector>(v: V, index: V::I, stride: V::I, block_shift: u32) -> V::I {
    match block_shift {
        0 => v.mul_i(index, stride),
        _ => v.mul_i(v.right_u(index, block_shift), stride),
    }
}
