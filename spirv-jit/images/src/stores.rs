//! Stores to an image's level. All that subgroups have in common is looked up once for a wave.

use lanes::vector::Vector;

use super::axes::{ImageAxis, axes, level};
use super::format::FormatInfo;
use super::plain::Plain;
use super::rows::Wave;
use super::texels;

/// Components of a texel operand.
const COMPONENTS: usize = 4;

/// Stores that [`Plain`] applies to, to one level.
pub(super) struct Stores<'a> {
    /// The level's first texel.
    base: *mut u8,
    axes: [ImageAxis; 4],
    axis_count: usize,
    /// The first operand of the texel.
    texel: usize,
    info: &'a FormatInfo,
}

impl<'a> Stores<'a> {
    /// `None` if lanes may differ in their level, or if the image has no such level.
    ///
    /// # Safety
    /// As [`Wave`] says; the operation is that of `plain`.
    #[inline(always)]
    pub unsafe fn new(plain: &Plain<'a>, wave: &Wave<'_>) -> Option<Stores<'a>> {
        let (op, image, info) = plain.parts();
        let texel = wave.operands.len().checked_sub(COMPONENTS)?;
        if op.has_offset {
            return None;
        }
        // SAFETY: the caller guarantees that the wave is as `Wave` requires, for the operation of
        // `plain`.
        let level = unsafe { level(op, wave) }.filter(|&level| image.has_level(level))?;
        let (axes, axis_count) = axes(op, image, info, level);
        Some(Stores {
            base: (image.data).wrapping_add(image.levels[level].offset_bytes as usize),
            axes,
            axis_count,
            texel,
            info,
        })
    }

    /// Stores the texels of a wave's subgroups.
    ///
    /// # Safety
    /// The wave is that of [`Self::new`]; the image's memory stays allocated during the call.
    #[inline(always)]
    pub unsafe fn store<V: Vector>(&self, v: V, wave: &Wave<'_>) {
        for index in 0..wave.subgroups.len() {
            // SAFETY: the caller guarantees that the wave is that of `Self::new`; the image's
            // memory stays allocated during the call; lanes inside address texels of the level, at
            // offsets that a level of fewer than 2^31 bytes has.
            unsafe {
                let mut inside = wave.mask(index);
                if inside == 0 {
                    continue;
                }
                let mut offsets = v.splat_i(0);
                for axis in self.axes.get_unchecked(..self.axis_count) {
                    let at = v.load_i(wave.operand(index, axis.operand));
                    inside &= v.lt_u(at, v.splat_i(axis.size as i32));
                    let stride = v.splat_i(axis.stride_bytes as i32);
                    offsets = v.add_i(offsets, v.mul_i(at, stride));
                }
                let texel = [
                    v.load_i(wave.operand(index, self.texel)),
                    v.load_i(wave.operand(index, self.texel + 1)),
                    v.load_i(wave.operand(index, self.texel + 2)),
                    v.load_i(wave.operand(index, self.texel + 3)),
                ];
                let offsets = v.keep(offsets, inside);
                texels::store(v, self.info, self.base, offsets, inside, &texel);
            }
        }
    }
}
