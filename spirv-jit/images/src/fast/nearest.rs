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
            let is_lean = !self.op.has_offset && !self.has_border && self.block_shift == 0;
            let axes = if is_lean { 0 } else { self.spatial };
            if is_lean {
                v.apart(NearestOfAll {
                    fast,
                    wave,
                    at,
                    offsets: &mut texels.offsets,
                });
            }
            for axis in 0..axes {
                v.apart(Nearest {
                    fast,
                    wave,
                    at,
                    axis,
                    texels: &mut texels,
                });
            }
            let is_plain = !self.op.depth_compare && !self.has_border;
            let is_value = matches!(out, Out::Results) && self.decoder != Decoder::Each;
            if is_plain && is_value {
                return chunk::put(v, self.image, info, wave, &mut texels);
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

/// Puts the offsets of nearest texels. Without offsets, borders and blocks.
struct NearestOfAll<'a, 'b> {
    fast: &'b Fast<'a>,
    wave: &'b Wave<'b>,
    at: At<'b>,
    offsets: &'b mut ChunkRows,
}

impl<V: Vector> Task<V> for NearestOfAll<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, wave, offsets) = (&{ *self.fast }, &{ *self.wave }, self.offsets);
        let (places, levels) = self.at;
        let modes = [fast.mode(0), fast.mode(1), fast.mode(2)];
        let texel_bytes = u32::from(fast.info.size_bytes);
        let shift = texel_bytes
            .is_power_of_two()
            .then(|| texel_bytes.trailing_zeros());
        let texel_bytes = v.splat_i(texel_bytes as i32);
        macro_rules! along {
            ($index:ident, $axis:literal, $extent:expr) => {{
                let at = v.load(places.coordinate(wave, $index, $axis));
                let (size, stride) = $extent;
                let texel = fast.nearest(v, modes[$axis], (at, None), size);
                match ($axis, shift) {
                    (0, Some(shift)) => v.left_i(texel, shift),
                    _ => v.mul_i(texel, stride),
                }
            }};
        }
        macro_rules! each {
            (|$index:ident, $axis:ident| $extent:expr) => {
                for $index in 0..wave.subgroups.len() {
                    // SAFETY: the caller keeps the contract of `Fast::of_level`; places and levels
                    // were put.
                    unsafe {
                        let mut offset = fast.first_texel(v, places, levels, $index);
                        let $axis = 0;
                        offset = v.add_i(offset, along!($index, 0, $extent));
                        if fast.spatial > 1 {
                            let $axis = 1;
                            offset = v.add_i(offset, along!($index, 1, $extent));
                        }
                        if fast.spatial > 2 {
                            let $axis = 2;
                            offset = v.add_i(offset, along!($index, 2, $extent));
                        }
                        offsets.put(v, $index, offset);
                    }
                }
            };
        }
        match levels {
            Some(levels) => each!(|index, axis| levels.extent(v, index, axis, texel_bytes)),
            None => {
                let extents = [
                    fast.extent_of_first(v, 0),
                    fast.extent_of_first(v, 1),
                    fast.extent_of_first(v, 2),
                ];
                each!(|index, axis| extents[axis]);
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
