//! Samples of the nearest texels.

use lanes::vector::{Task, Vector};

use super::super::AddressMode;
use super::super::chunk::{self, ChunkRows, SUBGROUPS, Texels};
use super::super::decode::Decoder;
use super::super::rows::Wave;
use super::Fast;
use super::blend::{Finish, Out, Take, To};
use super::footprints::Tap;
use super::places::At;

impl Fast<'_> {
    /// # Safety
    /// As [`Self::of_level`].
    #[inline(always)]
    pub(super) unsafe fn nearest_of_level<V: Vector>(
        &self,
        v: V,
        wave: &Wave<'_>,
        at: At<'_>,
        out: Out<'_>,
    ) {
        let (fast, info, count) = (self, self.info, wave.subgroups.len());
        let mut texels = Texels::new();
        // SAFETY: the caller keeps the contract of this function; texels of all axes are placed
        // inside the level.
        unsafe {
            for axis in 0..self.spatial {
                v.apart(Nearest {
                    fast,
                    wave,
                    at,
                    axis,
                    texels: &mut texels,
                });
            }
            let base = self.image.data.cast_const();
            let is_plain = !self.op.depth_compare && !self.has_border;
            let is_value = matches!(out, Out::Results) && self.decoder != Decoder::Each;
            if is_plain && is_value {
                return chunk::put(v, info, base, self.image.swizzle, wave, &mut texels);
            }
            let inside = texels.inside;
            self.fetch(
                v,
                count,
                self.words_of_components(),
                Tap {
                    offsets: &texels.offsets,
                    index: &texels.index,
                    words: texels.words.each_mut(),
                },
            );
            let mut own = [const { ChunkRows::new() }; 4];
            let (to, near) = match out {
                Out::Rows(rows) => (rows, None),
                Out::Results => (&mut own, Some(None)),
                Out::BehindNear(near) => (&mut own, Some(Some(near))),
            };
            for (component, rows) in to.iter_mut().enumerate() {
                if !self.computes(component) {
                    continue;
                }
                let source = self.source(component);
                v.apart(Take {
                    fast,
                    wave,
                    source,
                    component,
                    words: &texels.words[source.word().unwrap_or(0)],
                    inside,
                    to: To::Rows(rows),
                });
            }
            if let Some(near) = near {
                v.apart(Finish {
                    fast,
                    wave,
                    rows: to,
                    near,
                    counts: None,
                });
            }
        }
    }
}

/// Adds the offsets of nearest texels along an axis; along the first one to those of levels and
/// layers.
struct Nearest<'a, 'b> {
    fast: &'b Fast<'a>,
    wave: &'b Wave<'b>,
    at: At<'b>,
    axis: usize,
    texels: &'b mut Texels,
}

impl<V: Vector> Task<V> for Nearest<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, wave, axis) = (&{ *self.fast }, &{ *self.wave }, self.axis);
        let (places, levels) = self.at;
        let Texels {
            offsets,
            index: in_blocks,
            inside,
            ..
        } = self.texels;
        let block_shift = fast.block_shift(axis);
        macro_rules! each {
            ($mode:expr, $has_offset:expr, |$index:ident| $extent:expr) => {
                for $index in 0..wave.subgroups.len() {
                    // SAFETY: the caller keeps the contract of `Fast::of_level`; offsets along
                    // axes before this one, and indices along x, were put.
                    unsafe {
                        let at = v.load(places.coordinate(wave, $index, axis));
                        let offset = match $has_offset {
                            true => Some(v.load_i(wave.offset(fast.op, $index, axis))),
                            false => None,
                        };
                        let (size, stride) = $extent;
                        let mut texel = match $mode {
                            AddressMode::ClampToBorder => {
                                let (texel, is_inside) =
                                    fast.nearest_or_border(v, (at, offset), size);
                                inside[$index % SUBGROUPS] &= is_inside;
                                texel
                            }
                            _ => fast.nearest(v, $mode, (at, offset), size),
                        };
                        if block_shift != 0 {
                            let part = v.and_i(texel, v.splat_i(3));
                            let part = match axis {
                                0 => part,
                                _ => v.add_i(in_blocks.get(v, $index), v.left_i(part, 2)),
                            };
                            in_blocks.put(v, $index, part);
                            texel = v.right_u(texel, block_shift);
                        }
                        let before = match axis {
                            0 => fast.first_texel(v, places, levels, $index),
                            _ => offsets.get(v, $index),
                        };
                        offsets.put(v, $index, v.add_i(before, v.mul_i(texel, stride)));
                    }
                }
            };
        }
        let extent = fast.extent_of_first(v, axis);
        match (fast.mode(axis), levels) {
            (mode, Some(levels)) => {
                let texel_bytes = v.splat_i(fast.info.size_bytes as i32);
                each!(mode, fast.op.has_offset, |index| levels.extent(
                    v,
                    index,
                    axis,
                    texel_bytes
                ));
            }
            (AddressMode::Repeat, _) if !fast.op.has_offset => {
                each!(AddressMode::Repeat, false, |index| extent);
            }
            (AddressMode::ClampToEdge, _)
                if !fast.op.has_offset && !fast.sampler.unnormalized_coordinates =>
            {
                each!(AddressMode::ClampToEdge, false, |index| extent);
            }
            (mode, _) => each!(mode, fast.op.has_offset, |index| extent),
        }
    }
}
