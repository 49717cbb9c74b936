//! Texels around the lanes' places, and what they sum up to.

use lanes::LANES;
use lanes::vector::{QUADS, Task, Vector};

use super::super::Level;
use super::super::format::FormatInfo;
use super::super::format::layout::Codec;
use super::super::srgb;
use super::super::texels;
use super::axis::Axis;
use super::levels::Levels;
use super::taps::Taps;
use super::{Components, Fast};

/// A byte of each of four texels, linear between them.
#[inline(always)]
fn blend_bytes<V: Vector>(v: V, words: [V::I; 4], index: u32, x: V::F, y: V::F) -> V::F {
    let upper = v.lerp(
        v.to_f(v.byte(words[0], index)),
        v.to_f(v.byte(words[1], index)),
        x,
    );
    let lower = v.lerp(
        v.to_f(v.byte(words[2], index)),
        v.to_f(v.byte(words[3], index)),
        x,
    );
    v.lerp(upper, lower, y)
}

/// The least of the indices of four lanes, which are those of a block's corners.
#[inline(always)]
fn least_of_corners<V: Vector>(v: V, indices: V::I) -> u32 {
    let mut row = [0; LANES];
    v.store_i(indices, &mut row);
    row[0].min(row[5]).min(row[10].min(row[15]))
}

impl Fast<'_> {
    /// The weighted texels of footprints in a plane.
    ///
    /// # Safety
    /// The image's memory stays allocated during the call; the axes are of the levels, which are
    /// the image's, and offsets of its layers are given: so each texel's offset is of a texel of
    /// the image. Sums of them fit in 31 bits, as the image's size does.
    #[inline(always)]
    pub(super) unsafe fn weighted<V: Vector>(
        &self,
        v: V,
        levels: &Levels<'_, V>,
        layer: V::I,
        axes: &[Axis<V>; 3],
        mask: u16,
    ) -> Components<V> {
        let [x, y, _] = axes;
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            if self.is_nearest && self.bytes {
                let indices = [x.index[0], y.index[0]];
                return self.nearest_bytes(v, levels, layer, indices, mask);
            }
            if self.is_nearest && self.is_loaded {
                return self.nearest_texel(v, levels, layer, axes);
            }
            if self.straight {
                let words = self.four_words(v, levels, layer, [x, y], mask);
                return self.in_order([
                    blend_bytes(v, words, 0, x.weight, y.weight),
                    blend_bytes(v, words, 1, x.weight, y.weight),
                    blend_bytes(v, words, 2, x.weight, y.weight),
                    blend_bytes(v, words, 3, x.weight, y.weight),
                ]);
            }
            if self.srgb {
                let words = self.four_words(v, levels, layer, [x, y], mask);
                return self.blend_srgb(v, words, x, y);
            }
            let mut taps = Taps::new(v);
            self.place_taps(v, levels, layer, axes, &mut taps);
            self.blended(v, &mut taps, None, None)
        }
    }

    /// The texels at columns and rows, where [`Fast::is_loaded`].
    ///
    /// # Safety
    /// As [`Self::weighted`]: the indices are of texels of the levels.
    #[inline(always)]
    pub(super) unsafe fn nearest_of<V: Vector>(
        &self,
        v: V,
        levels: &Levels<'_, V>,
        layer: V::I,
        indices: [V::I; 2],
        mask: u16,
    ) -> Components<V> {
        let info = self.info;
        // SAFETY: the caller keeps the contract of `Self::weighted`: the indices are of texels of
        // the levels.
        unsafe {
            if info.size_bytes == 4
                && let Some(word) = self.nearest_word(v, levels, indices, mask)
            {
                return match self.has_words() {
                    true => [v.bits_to_f(word), v.splat(0.0), v.splat(0.0), v.splat(0.0)],
                    false => v.apart(Decode { info, word }),
                };
            }
            let row = v.mul_i(indices[1], levels.row_stride);
            let column = v.mul_i(indices[0], v.splat_i(info.size_bytes as i32));
            let at = v.add_i(v.add_i(levels.offset, layer), v.add_i(row, column));
            v.apart(Load {
                info,
                data: self.image.data,
                at,
            })
        }
    }

    /// The nearest texel, where [`Fast::is_loaded`].
    ///
    /// # Safety
    /// As [`Self::weighted`].
    #[inline(always)]
    pub(super) unsafe fn nearest_texel<V: Vector>(
        &self,
        v: V,
        levels: &Levels<'_, V>,
        layer: V::I,
        [x, y, z]: &[Axis<V>; 3],
    ) -> Components<V> {
        let mut at = v.add_i(v.add_i(levels.offset, layer), x.offsets[0]);
        if self.spatial >= 2 {
            at = v.add_i(at, y.offsets[0]);
        }
        if self.spatial == 3 {
            at = v.add_i(at, z.offsets[0]);
        }
        let (info, data) = (self.info, self.image.data);
        // SAFETY: the caller keeps the contract of `Self::weighted`.
        unsafe { v.apart(Load { info, data, at }) }
    }

    /// Components in memory's order, as the format has them.
    #[inline(always)]
    pub(super) fn in_order<F>(&self, [a, b, c, d]: [F; 4]) -> [F; 4] {
        match self.info.codec {
            Codec::Bgra8 => [c, b, a, d],
            _ => [a, b, c, d],
        }
    }

    /// The texels at columns and rows, of four bytes each.
    ///
    /// # Safety
    /// As [`Self::weighted`]: the indices are of texels of the levels.
    #[inline(always)]
    pub(super) unsafe fn nearest_bytes<V: Vector>(
        &self,
        v: V,
        levels: &Levels<'_, V>,
        layer: V::I,
        indices: [V::I; 2],
        mask: u16,
    ) -> Components<V> {
        // SAFETY: the caller keeps the contract of `Self::weighted`: the indices are of texels of
        // the levels.
        let word = unsafe {
            match self.nearest_word(v, levels, indices, mask) {
                Some(word) => word,
                None => {
                    let row = v.mul_i(indices[1], levels.row_stride);
                    let texel = v.add_i(row, v.left_i(indices[0], 2));
                    let at = v.add_i(v.add_i(levels.offset, layer), texel);
                    v.gather(self.image.data, at)
                }
            }
        };
        self.texel_of(v, word)
    }

    /// The four texels around each lane, of four bytes each.
    ///
    /// # Safety
    /// As [`Self::weighted`].
    #[inline(always)]
    pub(super) unsafe fn four_words<V: Vector>(
        &self,
        v: V,
        levels: &Levels<'_, V>,
        layer: V::I,
        [x, y]: [&Axis<V>; 2],
        mask: u16,
    ) -> [V::I; 4] {
        let texel_bytes = v.splat_i(4);
        // SAFETY: the caller keeps the contract of `Self::weighted`.
        unsafe {
            match self.window(v, [x, y], texel_bytes, levels, mask) {
                Some(words) => words,
                None => {
                    let offset = v.add_i(levels.offset, layer);
                    let rows = [v.add_i(offset, y.offsets[0]), v.add_i(offset, y.offsets[1])];
                    self.words(v, rows, x, texel_bytes)
                }
            }
        }
    }

    /// Linear between the colours of four sRGB texels, and between their alpha.
    #[inline(always)]
    fn blend_srgb<V: Vector>(
        &self,
        v: V,
        words: [V::I; 4],
        x: &Axis<V>,
        y: &Axis<V>,
    ) -> Components<V> {
        let alpha = match self.takes(3) {
            true => {
                let [a, b, c, d] = [
                    v.div_units(v.to_f(v.byte(words[0], 3)), 255.0),
                    v.div_units(v.to_f(v.byte(words[1], 3)), 255.0),
                    v.div_units(v.to_f(v.byte(words[2], 3)), 255.0),
                    v.div_units(v.to_f(v.byte(words[3], 3)), 255.0),
                ];
                v.lerp(v.lerp(a, b, x.weight), v.lerp(c, d, x.weight), y.weight)
            }
            false => v.splat(0.0),
        };
        let [upper_left, upper_right, lower_left, lower_right] = v.bytes_in(&srgb::LINEAR, words);
        let mut blended = [alpha; 4];
        for (i, component) in blended.iter_mut().take(3).enumerate() {
            let upper = v.lerp(upper_left[i], upper_right[i], x.weight);
            let lower = v.lerp(lower_left[i], lower_right[i], x.weight);
            *component = v.lerp(upper, lower, y.weight);
        }
        if self.info.codec == Codec::Srgb8Bgra {
            blended.swap(0, 2);
        }
        blended
    }

    /// [`Self::words`] where all lanes' texels lie in a window of eight columns and five rows of
    /// one level: loads of its rows cost less than gathers.
    ///
    /// # Safety
    /// As [`Self::weighted`]: the indices are of texels of the image.
    #[inline(always)]
    unsafe fn window<V: Vector>(
        &self,
        v: V,
        [x, y]: [&Axis<V>; 2],
        texel_bytes: V::I,
        levels: &Levels<'_, V>,
        mask: u16,
    ) -> Option<[V::I; 4]> {
        let level = self.one_level(levels)?;
        let mut apart = v.ne_i(v.sub_i(x.offsets[1], x.offsets[0]), texel_bytes);
        apart |= v.ne_i(v.sub_i(y.offsets[1], y.offsets[0]), levels.row_stride);
        // SAFETY: the caller keeps the contract of `Self::weighted`: the indices are of texels of
        // the image.
        unsafe { self.window_of(v, level, [x.index[0], y.index[0]], apart, mask) }
    }

    /// The words at the lanes' indices, where a window has all of them.
    ///
    /// # Safety
    /// As [`Self::window`].
    #[inline(always)]
    unsafe fn nearest_word<V: Vector>(
        &self,
        v: V,
        levels: &Levels<'_, V>,
        indices: [V::I; 2],
        mask: u16,
    ) -> Option<V::I> {
        let level = self.one_level(levels)?;
        // SAFETY: the caller keeps the contract of `Self::weighted`: the indices are of texels of
        // the image.
        unsafe {
            if let Some(word) = self.square(v, indices, level, mask) {
                return Some(word);
            }
            let [word, ..] = self.window_of(v, level, indices, 0, mask)?;
            Some(word)
        }
    }

    /// The level of all lanes, if windows serve for it.
    #[inline(always)]
    fn one_level<'l, V: Vector>(&self, levels: &Levels<'l, V>) -> Option<&'l Level> {
        let level = levels.one?;
        let is_plane = self.spatial == 2 && !self.op.arrayed && !self.is_cube;
        let serves = is_plane && level.width >= 8 && level.height >= 5;
        serves.then_some(level)
    }

    /// The words at the lanes' indices in a level, those on their right, those below, and those
    /// below on the right, if a window has them. The neighbours of lanes in `apart` are none.
    ///
    /// # Safety
    /// As [`Self::window`]; the level serves for windows.
    #[inline(always)]
    unsafe fn window_of<V: Vector>(
        &self,
        v: V,
        level: &Level,
        [x, y]: [V::I; 2],
        apart: u16,
        mask: u16,
    ) -> Option<[V::I; 4]> {
        // Where coordinates change evenly, the least are at a corner of a block, or at an end of a
        // row.
        let left = least_of_corners(v, x).min(level.width - 8);
        let top = least_of_corners(v, y).min(level.height - 5);
        let columns = v.sub_i(x, v.splat_i(left as i32));
        let rows = v.sub_i(y, v.splat_i(top as i32));
        let inside = v.lt_u(columns, v.splat_i(7)) & v.lt_u(rows, v.splat_i(4));
        if mask & (apart | !inside) != 0 {
            return None;
        }
        let stride = level.row_stride_bytes as usize;
        let first = level.offset_bytes as usize + top as usize * stride + left as usize * 4;
        // SAFETY: eight texels of each of five rows are of the level.
        unsafe {
            let at = self.image.data.cast_const().add(first);
            Some(v.window(at, stride, v.keep(columns, mask), v.keep(rows, mask)))
        }
    }

    /// The nearest texels where lanes are a square of quads and sample one texel each, next to each
    /// other, as they do where an image is drawn in its own size.
    ///
    /// # Safety
    /// As [`Self::window`].
    #[inline(always)]
    unsafe fn square<V: Vector>(
        &self,
        v: V,
        [x, y]: [V::I; 2],
        level: &Level,
        mask: u16,
    ) -> Option<V::I> {
        let [mut columns, mut rows] = [[0; LANES]; 2];
        v.store_i(x, &mut columns);
        v.store_i(y, &mut rows);
        let (left, top) = (columns[0], rows[0]);
        let columns = v.add_i(v.splat_i(left as i32), v.load_i(&QUADS[0]));
        let rows = v.add_i(v.splat_i(top as i32), v.load_i(&QUADS[1]));
        let others = v.ne_i(x, columns) | v.ne_i(y, rows);
        if others & mask != 0 || left + 4 > level.width || top + 4 > level.height {
            return None;
        }
        let stride = level.row_stride_bytes as usize;
        let first = level.offset_bytes as usize + top as usize * stride + left as usize * 4;
        // SAFETY: four texels of each of four rows are of the level.
        unsafe { Some(v.load_quads(self.image.data.cast_const().add(first), stride)) }
    }

    /// The four texels around each lane, of four bytes each.
    ///
    /// # Safety
    /// As [`Self::weighted`]: the offsets are of texels of the image.
    #[inline(always)]
    pub(super) unsafe fn words<V: Vector>(
        &self,
        v: V,
        rows: [V::I; 2],
        x: &Axis<V>,
        texel_bytes: V::I,
    ) -> [V::I; 4] {
        let data = self.image.data.cast_const();
        let (upper, lower) = (
            v.add_i(rows[0], x.offsets[0]),
            v.add_i(rows[1], x.offsets[0]),
        );
        // SAFETY: the caller keeps the contract of `Self::weighted`: the offsets are of texels of
        // the image; a texel's right neighbour is of the image too.
        unsafe {
            if v.ne_i(v.sub_i(x.offsets[1], x.offsets[0]), texel_bytes) == 0 {
                let ((a, b), (c, d)) = (v.gather_pairs(data, upper), v.gather_pairs(data, lower));
                return [a, b, c, d];
            }
            [
                v.gather(data, upper),
                v.gather(data, v.add_i(rows[0], x.offsets[1])),
                v.gather(data, lower),
                v.gather(data, v.add_i(rows[1], x.offsets[1])),
            ]
        }
    }

    /// Whether a component is wanted and the format has it.
    #[inline(always)]
    pub(super) fn takes(&self, component: usize) -> bool {
        self.wanted >> component & 1 == 1 && self.info.channels[component].bits != 0
    }

    /// A texel of four bytes.
    #[inline(always)]
    fn texel_of<V: Vector>(&self, v: V, word: V::I) -> Components<V> {
        let mut texel = [self.unpack(v, word)];
        if self.srgb {
            self.put_linear(v, [word], &mut texel);
        }
        texel[0]
    }

    /// The components of 8 bits each, except those that [`Self::put_linear`] writes.
    #[inline(always)]
    fn unpack<V: Vector>(&self, v: V, word: V::I) -> Components<V> {
        if self.straight {
            return self.in_order([
                v.to_f(v.byte(word, 0)),
                v.to_f(v.byte(word, 1)),
                v.to_f(v.byte(word, 2)),
                v.to_f(v.byte(word, 3)),
            ]);
        }
        if self.srgb {
            let alpha = v.div_units(v.to_f(v.byte(word, 3)), 255.0);
            return [v.splat(0.0), v.splat(0.0), v.splat(0.0), alpha];
        }
        let mut components = [v.splat(0.0); 4];
        for (component, result) in components.iter_mut().enumerate() {
            if self.takes(component) {
                *result = v.to_f(v.byte(word, self.info.channels[component].offset as u32 / 8));
            }
        }
        components
    }

    /// The colours of sRGB texels.
    #[inline(always)]
    fn put_linear<V: Vector, const N: usize>(
        &self,
        v: V,
        words: [V::I; N],
        texels: &mut [Components<V>; N],
    ) {
        let linear = v.bytes_in(&srgb::LINEAR, words);
        for (texel, [a, b, c]) in texels.iter_mut().zip(linear) {
            [texel[0], texel[1], texel[2]] = match self.info.codec {
                Codec::Srgb8Bgra => [c, b, a],
                _ => [a, b, c],
            };
        }
    }
}

/// Texels of a word.
struct Decode<'a, I> {
    info: &'a FormatInfo,
    word: I,
}

impl<V: Vector> Task<V> for Decode<'_, V::I> {
    type Output = Components<V>;

    #[inline(always)]
    unsafe fn run(self, v: V) -> Self::Output {
        let zero = v.splat_i(0);
        let words = texels::decode(v, self.info, &[self.word, zero, zero, zero]);
        [
            v.bits_to_f(words[0]),
            v.bits_to_f(words[1]),
            v.bits_to_f(words[2]),
            v.bits_to_f(words[3]),
        ]
    }
}

/// Texels at offsets.
struct Load<'a, I> {
    info: &'a FormatInfo,
    data: *mut u8,
    at: I,
}

impl<V: Vector> Task<V> for Load<'_, V::I> {
    type Output = Components<V>;

    #[inline(always)]
    unsafe fn run(self, v: V) -> Self::Output {
        // SAFETY: the caller keeps the contract of this function.
        let words = unsafe { texels::load(v, self.info, self.data, self.at) };
        [
            v.bits_to_f(words[0]),
            v.bits_to_f(words[1]),
            v.bits_to_f(words[2]),
            v.bits_to_f(words[3]),
        ]
    }
}
