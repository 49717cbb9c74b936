//! The levels that lanes sample.

use std::mem::offset_of;

use super::super::lod::{self, Lod};
use super::super::vector::Vector;
use super::super::{Filter, Level, LodMode};
use super::Fast;
use crate::SUBGROUP_SIZE;
use crate::row::Row;

/// The levels of the lanes.
pub(super) struct Levels<'a, V: Vector> {
    /// The level of all of them, where it is one.
    pub one: Option<&'a Level>,
    pub width: V::I,
    pub height: V::I,
    pub row_stride: V::I,
    pub offset: V::I,
}

/// One level for all lanes.
#[inline(always)]
pub(super) fn levels_of<V: Vector>(v: V, level: &Level) -> Levels<'_, V> {
    Levels {
        one: Some(level),
        width: v.splat_i(level.width as i32),
        height: v.splat_i(level.height as i32),
        row_stride: v.splat_i(level.row_stride_bytes as i32),
        offset: v.splat_i(level.offset_bytes as i32),
    }
}

impl Fast<'_> {
    /// The first of the levels that lanes sample, and the weight of the next. `lod` is bias or level, if the operation has one.
    #[inline(always)]
    pub(super) fn chosen_levels<V: Vector>(
        &self,
        v: V,
        lod: Option<&Row>,
        footprint: Option<&Lod>,
    ) -> (V::I, V::F) {
        let levels = self.levels_of_detail(v, lod, footprint);
        match self.sampler.mipmap_mode {
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
    fn levels_of_detail<V: Vector>(
        &self,
        v: V,
        lod: Option<&Row>,
        footprint: Option<&Lod>,
    ) -> V::F {
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
        let lambda = match (self.op.lod, lod, footprint) {
            (LodMode::Lod, Some(row), _) => v.add(v.load(row), bias),
            (_, _, Some(lod)) => v.add(v.load(&lod::words(&lod.lambda)), bias),
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
                one: None,
                width: v.gather(base.add(offset_of!(Level, width)), at),
                height: v.gather(base.add(offset_of!(Level, height)), at),
                row_stride: v.gather(base.add(offset_of!(Level, row_stride_bytes) + low), at),
                offset: v.gather(base.add(offset_of!(Level, offset_bytes) + low), at),
            }
        }
    }
}
