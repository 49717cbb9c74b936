//! The levels that lanes sample.

use std::mem::offset_of;

use lanes::vector::Vector;
use lanes::{LANES, Row};

use super::super::lod;
use super::super::{Filter, Level, LodMode};
use super::Fast;

/// The levels of the lanes.
pub(super) struct Levels<'a, V: Vector> {
    /// The level of all of them, where it is one.
    pub one: Option<&'a Level>,
    pub width: V::I,
    pub height: V::I,
    /// Of 3D images, as the slices' stride.
    pub depth: V::I,
    pub row_stride: V::I,
    pub slice_stride: V::I,
    pub offset: V::I,
}

/// The footprints of the lanes' samples from their derivatives, as in [`lod`].
pub(super) struct Footprint<V: Vector> {
    /// λ', without bias.
    pub lambda: V::F,
    pub anisotropy: Option<Anisotropy<V>>,
}

/// Sampling along the longer axis of a footprint.
pub(super) struct Anisotropy<V: Vector> {
    /// Samples to take, 1 to 16.
    pub count: V::F,
    /// The axis, in normalised coordinates.
    pub axis: [V::F; 3],
}

impl<V: Vector> Anisotropy<V> {
    /// Where sample `pass` of each lane is, or its last one, from the middle: samples i = 1..=N at
    /// i / (N + 1) - 1/2 along the axis.
    #[inline(always)]
    pub(super) fn place(&self, v: V, pass: u32) -> [V::F; 3] {
        let one = v.splat(1.0);
        let i = v.min(v.splat((pass + 1) as f32), self.count);
        let along = v.sub(v.div(i, v.add(self.count, one)), v.splat(0.5));
        [
            v.mul(along, self.axis[0]),
            v.mul(along, self.axis[1]),
            v.mul(along, self.axis[2]),
        ]
    }

    /// Whether lanes of the mask take a sample `pass`.
    #[inline(always)]
    pub(super) fn goes_on(&self, v: V, pass: u32, mask: u16) -> bool {
        v.gt(self.count, v.splat(pass as f32)) & mask != 0
    }

    /// The sum with sample `pass`, of lanes that take it.
    #[inline(always)]
    pub(super) fn sum(&self, v: V, pass: u32, total: V::F, sample: V::F) -> V::F {
        let takes_part = v.gt(self.count, v.splat(pass as f32));
        let sum = v.bits_of(v.add(total, sample));
        v.bits_to_f(v.select(takes_part, sum, v.bits_of(total)))
    }
}

/// Binary logarithm, as [`lod`]'s.
#[inline(always)]
fn log2<V: Vector>(v: V, x: V::F) -> V::F {
    let least = v.splat_i(lod::SQRT_HALF as i32);
    let bits = v.sub_i(v.bits_of(x), least);
    let exponent = v.to_f(v.right_i(bits, 23));
    let mantissa = v.and_i(bits, v.splat_i(0x007f_ffff));
    let mantissa = v.bits_to_f(v.add_i(mantissa, least));
    let one = v.splat(1.0);
    let t = v.div(v.sub(mantissa, one), v.add(mantissa, one));
    let square = v.mul(t, t);
    let mut series = v.splat(lod::SERIES[4]);
    for power in [3, 2, 1, 0] {
        series = v.add(v.splat(lod::SERIES[power]), v.mul(square, series));
    }
    v.add(exponent, v.mul(t, series))
}

/// One level for all lanes.
#[inline(always)]
pub(super) fn levels_of<V: Vector>(v: V, level: &Level) -> Levels<'_, V> {
    Levels {
        one: Some(level),
        width: v.splat_i(level.width as i32),
        height: v.splat_i(level.height as i32),
        depth: v.splat_i(level.depth as i32),
        slice_stride: v.splat_i(level.slice_stride_bytes as i32),
        row_stride: v.splat_i(level.row_stride_bytes as i32),
        offset: v.splat_i(level.offset_bytes as i32),
    }
}

#[inline(always)]
fn square_length<V: Vector>(v: V, x: V::F, y: V::F) -> V::F {
    v.add(v.mul(x, x), v.mul(y, y))
}

impl Fast<'_> {
    /// The footprints of derivatives along the screen's x, then y, by the image's axes; of the
    /// third one only in 3D images.
    #[inline(always)]
    pub(super) fn footprint<V: Vector>(&self, v: V, derivatives: [[V::F; 3]; 2]) -> Footprint<V> {
        let base = &self.image.levels[0];
        let (width, height) = (v.splat(base.width as f32), v.splat(base.height as f32));
        let [[sx, tx, rx], [sy, ty, ry]] = derivatives;
        let mut x = square_length(v, v.mul(sx, width), v.mul(tx, height));
        let mut y = square_length(v, v.mul(sy, width), v.mul(ty, height));
        if self.spatial == 3 {
            let depth = v.splat(base.depth as f32);
            let (of_x, of_y) = (v.mul(rx, depth), v.mul(ry, depth));
            (x, y) = (v.add(x, v.mul(of_x, of_x)), v.add(y, v.mul(of_y, of_y)));
        }
        let longer = v.max(x, y);
        let lambda = v.mul(v.splat(0.5), log2(v, longer));
        if !self.is_anisotropic {
            return Footprint {
                lambda,
                anisotropy: None,
            };
        }
        let one = v.splat(1.0);
        let most = lod::most_samples(self.sampler);
        let ratio = v.sqrt(v.div(longer, v.min(x, y)));
        let texels = v.max(v.ceil(v.sqrt(longer)), one);
        let count = v.min(v.max(v.ceil(ratio), one), v.splat(most.ceil()));
        let clamped = v.min(v.max(ratio, one), v.splat(most));
        let is_y = v.gt(y, x);
        let axis_s = v.select(is_y, v.bits_of(sy), v.bits_of(sx));
        let axis_t = v.select(is_y, v.bits_of(ty), v.bits_of(tx));
        let axis_r = v.select(is_y, v.bits_of(ry), v.bits_of(rx));
        Footprint {
            lambda: v.sub(lambda, log2(v, clamped)),
            anisotropy: Some(Anisotropy {
                count: v.min(count, texels),
                axis: [
                    v.bits_to_f(axis_s),
                    v.bits_to_f(axis_t),
                    v.bits_to_f(axis_r),
                ],
            }),
        }
    }

    /// The first of the levels that lanes sample, and the weight of the next. `lod` is bias or
    /// level, if the operation has one; `lambda` is that of a footprint.
    #[inline(always)]
    pub(super) fn chosen_levels<V: Vector>(
        &self,
        v: V,
        lod: Option<&Row>,
        lambda: Option<V::F>,
    ) -> (V::I, V::F) {
        let levels = self.levels_of_detail(v, lod, lambda);
        match self.sampler.mipmap_mode {
            Filter::Nearest => {
                let level = v.floor(v.add(levels, v.splat(0.5)));
                (v.to_i(level), v.splat(0.0))
            }
            Filter::Linear => {
                let floor = v.floor(levels);
                (v.to_i(floor), v.sub(levels, floor))
            }
        }
    }

    /// The level behind each lane's.
    #[inline(always)]
    pub(super) fn next_level<V: Vector>(&self, v: V, level: V::I) -> V::I {
        let last = v.splat_i(self.image.level_count as i32 - 1);
        v.min_i(v.add_i(level, v.splat_i(1)), last)
    }

    /// λ' to d', as in [`lod`].
    #[inline(always)]
    fn levels_of_detail<V: Vector>(&self, v: V, lod: Option<&Row>, lambda: Option<V::F>) -> V::F {
        if !self.has_levels() {
            return v.splat(0.0);
        }
        let bias = v.splat(self.sampler.mip_lod_bias);
        let bias = match (self.op.lod, lod) {
            (LodMode::Bias, Some(row)) => v.add(bias, v.load(row)),
            _ => bias,
        };
        let bias = v.max(bias, v.splat(-lod::MAX_LOD_BIAS));
        let bias = v.min(bias, v.splat(lod::MAX_LOD_BIAS));
        let lambda = match (self.op.lod, lod, lambda) {
            (LodMode::Lod, Some(row), _) => v.add(v.load(row), bias),
            (_, _, Some(lambda)) => v.add(lambda, bias),
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
    pub(super) unsafe fn levels<V: Vector>(&self, v: V, level: V::I, mask: u16) -> Levels<'_, V> {
        if !self.has_levels() {
            return levels_of(v, &self.image.levels[0]);
        }
        let mut row = [0; LANES];
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
        let (mut depth, mut slice_stride) = (level, level);
        if self.spatial == 3 {
            // SAFETY: fields of the image's levels.
            unsafe {
                depth = v.gather(base.add(offset_of!(Level, depth)), at);
                slice_stride = v.gather(base.add(offset_of!(Level, slice_stride_bytes) + low), at);
            }
        }
        // SAFETY: fields of the image's levels.
        unsafe {
            Levels {
                one: None,
                width: v.gather(base.add(offset_of!(Level, width)), at),
                height: v.gather(base.add(offset_of!(Level, height)), at),
                depth,
                slice_stride,
                row_stride: v.gather(base.add(offset_of!(Level, row_stride_bytes) + low), at),
                offset: v.gather(base.add(offset_of!(Level, offset_bytes) + low), at),
            }
        }
    }
}
