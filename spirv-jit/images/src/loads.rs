//! Loads from an image's levels: the texels of a chunk of subgroups are placed, then read.

use lanes::vector::Vector;

use super::LodMode;
use super::axes::{ImageAxis, axes, level};
use super::chunk::{self, SUBGROUPS, Texels};
use super::fast::index_in_block;
use super::plain::Plain;
use super::rows::Wave;

/// The axes of a level.
struct Axes {
    level: usize,
    /// The level's first texel.
    offset_bytes: u32,
    axes: [ImageAxis; 4],
    count: usize,
}

impl Axes {
    /// `None` where there are no texels.
    fn of(plain: &Plain<'_>, level: usize) -> Option<Axes> {
        let (op, image, info) = plain.parts();
        let (axes, count) = axes(op, image, info, level);
        let has_texels = axes[..count].iter().all(|axis| axis.size != 0);
        has_texels.then_some(Axes {
            level,
            offset_bytes: image.levels[level].offset_bytes as u32,
            axes,
            count,
        })
    }
}

/// Loads of subgroups, up to the first one whose lanes name several levels or one that does not
/// exist: the number of those before it. Subgroups without lanes are passed over.
///
/// # Safety
/// The wave is as [`Wave`] says, for the operation of `plain`; the image's memory stays allocated
/// during the call.
#[inline(always)]
pub(super) unsafe fn load<V: Vector>(v: V, plain: &Plain<'_>, wave: &Wave<'_>) -> usize {
    let (op, image, info) = plain.parts();
    // SAFETY: the caller keeps the contract of this function.
    let common = unsafe { level(op, wave) }.filter(|&level| image.has_level(level));
    let mut axes = None;
    let mut texels = Texels::new();
    let mut done = 0;
    let mut goes_on = true;
    while goes_on && done < wave.subgroups.len() {
        let (mut placed, mut count) = ([0; SUBGROUPS], 0);
        while done < wave.subgroups.len() && count < SUBGROUPS {
            // SAFETY: as for this function; lanes inside address texels of the image, and the
            // others its first one.
            unsafe {
                let mask = wave.mask(done);
                if mask == 0 {
                    done += 1;
                    continue;
                }
                let level = match (common, op.lod) {
                    (None, LodMode::Lod) => plain.level(v, Some(wave.lod(op, done, 0)), mask),
                    _ => common,
                };
                if axes.as_ref().map(|axes: &Axes| axes.level) != level {
                    axes = match level {
                        Some(level) => Axes::of(plain, level),
                        None => None,
                    };
                }
                let Some(axes) = &axes else {
                    goes_on = false;
                    break;
                };
                place(v, plain, wave, done, axes, (&mut texels, count));
                placed[count] = wave.subgroups[done];
                count += 1;
                done += 1;
            }
        }
        if count != 0 {
            let subgroups = &placed[..count];
            // SAFETY: as for this function; the texels of these subgroups were placed.
            unsafe {
                let wave = Wave { subgroups, ..*wave };
                chunk::put(v, image, info, &wave, &mut texels);
            }
        }
    }
    done
}

/// Places the texels of a subgroup of a wave as those of one of a chunk.
///
/// # Safety
/// As [`load`].
#[inline(always)]
unsafe fn place<V: Vector>(
    v: V,
    plain: &Plain<'_>,
    wave: &Wave<'_>,
    index: usize,
    axes: &Axes,
    (texels, to): (&mut Texels, usize),
) {
    let (op, _, info) = plain.parts();
    let spatial = op.spatial_count();
    let is_in_blocks = info.blocks().is_some();
    let zero = v.splat_i(0);
    let mut offsets = v.splat_i(axes.offset_bytes as i32);
    let mut outside = zero;
    let mut in_plane = [zero; 2];
    for (number, axis) in axes.axes.iter().enumerate().take(axes.count) {
        // SAFETY: the caller keeps the contract of `load`.
        let mut at = v.load_i(unsafe { wave.operand(index, axis.operand) });
        if op.has_offset && number < spatial {
            // SAFETY: the caller keeps the contract of `load`.
            at = v.add_i(at, v.load_i(unsafe { wave.offset(op, index, number) }));
        }
        // Nothing where it is inside.
        let least = v.min_u(at, v.splat_i(axis.size.wrapping_sub(1) as i32));
        outside = v.or_i(outside, v.xor_i(at, least));
        if is_in_blocks && number < 2 && number < spatial {
            in_plane[number] = at;
            at = v.right_u(at, 2);
        }
        offsets = v.add_i(offsets, v.mul_i(at, v.splat_i(axis.stride_bytes as i32)));
    }
    // SAFETY: the caller keeps the contract of `load`.
    let inside = unsafe { wave.mask(index) } & !v.ne_i(outside, zero);
    if inside != u16::MAX {
        offsets = v.keep(offsets, inside);
    }
    texels.offsets.put(v, to, offsets);
    texels.inside[to % SUBGROUPS] = inside;
    if is_in_blocks {
        let index = index_in_block(v, in_plane[0], in_plane[1]);
        texels.index.put(v, to, index);
    }
}
