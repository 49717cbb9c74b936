//! Steps of samples of the texels around places: where these are, their words, and what they blend
//! to. There are four, in three dimensions eight.

use lanes::Row;
use lanes::vector::{FourOf, Task, Vector};

use super::super::chunk::{ChunkRows, SUBGROUPS, Source};
use super::super::format::block;
use super::super::rows::Wave;
use super::super::{AddressMode, srgb};
use super::Fast;
use super::axis::Along;

impl Fast<'_> {
    /// The size of an axis of the base level, and the bytes between its texels or blocks.
    #[inline(always)]
    pub(super) fn extent(&self, axis: usize) -> (u32, u32) {
        let level = &self.image.levels[0];
        match axis {
            0 => (level.width, u32::from(self.info.size_bytes)),
            1 => (level.height, level.row_stride_bytes as u32),
            _ => (level.depth, level.slice_stride_bytes as u32),
        }
    }

    #[inline(always)]
    pub(super) fn mode(&self, axis: usize) -> AddressMode {
        match self.is_cube {
            true => AddressMode::ClampToEdge,
            false => self.sampler.address_mode[axis % 3],
        }
    }

    /// Units of a blended component.
    #[inline(always)]
    fn blended_scale(&self) -> f32 {
        match self.op.depth_compare {
            true => 1.0,
            false => block::unit_scale(self.info),
        }
    }

    /// The first texel of the base level.
    ///
    /// # Safety
    /// The image's memory is allocated.
    #[inline(always)]
    pub(super) unsafe fn base(&self) -> *const u8 {
        let offset = self.image.levels[0].offset_bytes as usize;
        // SAFETY: the caller guarantees that the image's memory is allocated.
        unsafe { self.image.data.cast_const().add(offset) }
    }
}

/// The texels around lanes' places: of each slice the left one and the right one of the upper line,
/// then those of the lower line.
pub(super) struct Taps {
    /// Byte offsets of layers.
    pub layers: ChunkRows,
    /// Those of the two texels along each axis.
    pub along: [[ChunkRows; 2]; 3],
    /// Of the second texels.
    pub weights: [ChunkRows; 3],
    /// Offsets of the texels, then a word of each.
    pub texels: [[ChunkRows; 4]; 2],
    /// The second words of texels of eight bytes.
    pub seconds: [[ChunkRows; 4]; 2],
}

impl Taps {
    #[inline(always)]
    pub fn new() -> Taps {
        Taps {
            layers: ChunkRows::new(),
            along: [const { [const { ChunkRows::new() }; 2] }; 3],
            weights: [const { ChunkRows::new() }; 3],
            texels: [const { [const { ChunkRows::new() }; 4] }; 2],
            seconds: [const { [const { ChunkRows::new() }; 4] }; 2],
        }
    }
}

/// The row of a coordinate.
///
/// # Safety
/// As [`Wave::mask`]; the rows on faces were put.
#[inline(always)]
pub(super) unsafe fn coordinate<'w>(
    wave: &'w Wave<'_>,
    on_face: Option<&'w ChunkRows>,
    index: usize,
    axis: usize,
) -> &'w Row {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        match on_face {
            Some(rows) => rows.row(index),
            None => wave.operand(index, axis),
        }
    }
}

/// Offsets of the two texels around places along an axis. A bit for each subgroup whose lanes have
/// both inside, one behind the other.
pub(super) struct AxisTexels<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub axis: usize,
    pub on_face: Option<&'b ChunkRows>,
    pub offsets: &'b mut [ChunkRows; 2],
    pub weight: &'b mut ChunkRows,
}

impl<V: Vector> Task<V> for AxisTexels<'_, '_> {
    type Output = u16;

    #[inline(always)]
    unsafe fn run(self, v: V) -> u16 {
        let (fast, wave) = (&{ *self.fast }, &{ *self.wave });
        let (axis, mode) = (self.axis, fast.mode(self.axis));
        let (size, stride) = fast.extent(axis);
        let (size, stride) = (v.splat_i(size as i32), v.splat_i(stride as i32));
        let mut inner = 0;
        for index in 0..wave.subgroups.len() {
            // SAFETY: the caller keeps the contract of `Fast::steps`; coordinates on faces were
            // put.
            unsafe {
                let at = v.load(coordinate(wave, self.on_face, index, axis));
                let offset = match fast.op.has_offset {
                    true => Some(v.load_i(wave.offset(fast.op, index, axis))),
                    false => None,
                };
                let along = Along {
                    size,
                    stride,
                    block_shift: 0,
                    looked_at: wave.mask(index),
                };
                let footprint = fast.axis(v, mode, (at, offset), along);
                self.offsets[0].put(v, index, footprint.offsets[0]);
                self.offsets[1].put(v, index, footprint.offsets[1]);
                self.weight.put(v, index, v.bits_of(footprint.weight));
                inner |= u16::from(footprint.is_inner) << (index % SUBGROUPS);
            }
        }
        inner
    }
}

/// Offsets along the axes to those of the texels.
pub(super) struct Combine<'a, 'b> {
    pub wave: &'b Wave<'a>,
    pub spatial: usize,
    pub taps: &'b mut Taps,
}

impl<V: Vector> Task<V> for Combine<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let Taps {
            layers,
            along: [x, y, z],
            texels,
            ..
        } = self.taps;
        for index in 0..self.wave.subgroups.len() {
            // SAFETY: the caller guarantees that all axes were placed.
            unsafe {
                let layer = layers.get(v, index);
                let [left, right] = [x[0].get(v, index), x[1].get(v, index)];
                let [upper, lower] = [y[0].get(v, index), y[1].get(v, index)];
                for (slice, texels) in texels.iter_mut().enumerate().take(self.spatial - 1) {
                    let base = match self.spatial {
                        3 => v.add_i(layer, z[slice].get(v, index)),
                        _ => layer,
                    };
                    let (upper, lower) = (v.add_i(upper, base), v.add_i(lower, base));
                    texels[0].put(v, index, v.add_i(upper, left));
                    texels[1].put(v, index, v.add_i(upper, right));
                    texels[2].put(v, index, v.add_i(lower, left));
                    texels[3].put(v, index, v.add_i(lower, right));
                }
            }
        }
    }
}

/// Fetches words of the texels: one, or both of eight bytes.
pub(super) struct FetchTaps<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub word: Option<usize>,
    /// A bit for each subgroup whose lanes have the right texels behind the left ones.
    pub in_pairs: u16,
    pub texels: &'b mut [ChunkRows; 4],
    pub seconds: &'b mut [ChunkRows; 4],
}

impl<V: Vector> Task<V> for FetchTaps<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, texels) = (self.fast, self.texels);
        // SAFETY: the word is one of the texels'; the image's memory is allocated.
        let base = unsafe { fast.base().add(4 * self.word.unwrap_or(0)) };
        macro_rules! each {
            (|$places:ident| $pair:expr, $single:expr) => {
                for index in 0..self.wave.subgroups.len() {
                    let is_pair = self.in_pairs >> (index % SUBGROUPS) & 1 == 1;
                    for left in [0, 2] {
                        // SAFETY: the caller guarantees that all texels were placed, in the image.
                        let (first, second) = unsafe {
                            let $places = texels[left].row(index);
                            match is_pair {
                                true => $pair,
                                false => {
                                    let first = $single;
                                    let $places = texels[left + 1].row(index);
                                    (first, $single)
                                }
                            }
                        };
                        texels[left].put(v, index, first);
                        texels[left + 1].put(v, index, second);
                    }
                }
            };
        }
        match (self.word, fast.info.size_bytes) {
            (_, 1) => each!(
                |places| {
                    let both = v.scalars_at::<u16>(base, places);
                    (both, v.right_u(both, 8))
                },
                v.scalars_at::<u8>(base, places)
            ),
            (_, 2) => each!(
                |places| {
                    let both = v.words_at(base, places);
                    (both, v.right_u(both, 16))
                },
                v.scalars_at::<u16>(base, places)
            ),
            (_, 4) => each!(|places| v.pairs_at(base, places), v.words_at(base, places)),
            (Some(_), size) => each!(
                |places| {
                    let left = v.words_at(base, places);
                    (left, v.words_at(base.add(usize::from(size)), places))
                },
                v.words_at(base, places)
            ),
            (None, _) => {
                for index in 0..self.wave.subgroups.len() {
                    let is_pair = self.in_pairs >> (index % SUBGROUPS) & 1 == 1;
                    for left in [0, 2] {
                        // SAFETY: the caller guarantees that all texels were placed, in the image.
                        let [a, b, c, d] = unsafe {
                            let places = texels[left].row(index);
                            match is_pair {
                                true => v.quads_at(base, places),
                                false => {
                                    let (a, b) = v.pairs_at(base, places);
                                    let (c, d) = v.pairs_at(base, texels[left + 1].row(index));
                                    [a, b, c, d]
                                }
                            }
                        };
                        texels[left].put(v, index, a);
                        self.seconds[left].put(v, index, b);
                        texels[left + 1].put(v, index, c);
                        self.seconds[left + 1].put(v, index, d);
                    }
                }
            }
        }
    }
}

/// Compares depths with the reference, and writes the results.
pub(super) struct Compare<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub source: Source,
    pub words: &'b ChunkRows,
    pub component: usize,
}

impl<V: Vector> Task<V> for Compare<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, wave) = (&{ *self.fast }, &{ *self.wave });
        for index in 0..wave.subgroups.len() {
            // SAFETY: the caller guarantees that the words were fetched, and that the wave has a
            // row of the result for each subgroup.
            unsafe {
                let word = self.words.get(v, index);
                let depth = match self.source {
                    Source::Fixed(field) => field.fixed(v, word),
                    Source::Half(field) => field.half(v, word, false),
                    _ => v.bits_to_f(word),
                };
                let reference = fast.reference(v, wave.reference(fast.op, index));
                let passed = v.bits_of(fast.passes(v, depth, reference));
                wave.put_component(v, index, self.component, passed);
            }
        }
    }
}

/// Blends a component of four texels, or its comparisons.
pub(super) struct Blend<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub source: Source,
    pub words: &'b [ChunkRows; 4],
    pub weights: &'b [ChunkRows; 3],
    pub component: usize,
    /// In the place of the rows of the result.
    pub to: Option<&'b mut ChunkRows>,
}

impl<V: Vector> Task<V> for Blend<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, wave) = (&{ *self.fast }, &{ *self.wave });
        let (words, weights) = (self.words, self.weights);
        let mut to = self.to;
        let scale = fast.blended_scale();
        macro_rules! each {
            (|$word:ident| $number:expr) => {
                for index in 0..wave.subgroups.len() {
                    // SAFETY: the caller guarantees that words and weights were put, and that the
                    // wave has a row of the result for each subgroup.
                    unsafe {
                        let mut taps = [v.splat(0.0); 4];
                        for (tap, rows) in taps.iter_mut().zip(words) {
                            let $word = rows.get(v, index);
                            *tap = $number;
                        }
                        if fast.op.depth_compare {
                            let reference = fast.reference(v, wave.reference(fast.op, index));
                            for tap in &mut taps {
                                *tap = fast.passes(v, *tap, reference);
                            }
                        }
                        let x = v.bits_to_f(weights[0].get(v, index));
                        let y = v.bits_to_f(weights[1].get(v, index));
                        let upper = v.lerp(taps[0], taps[1], x);
                        let lower = v.lerp(taps[2], taps[3], x);
                        let mut blended = v.lerp(upper, lower, y);
                        if let Some(rows) = &mut to {
                            rows.put(v, index, v.bits_of(blended));
                            continue;
                        }
                        if scale != 1.0 {
                            blended = v.div_units(blended, scale);
                        }
                        wave.put_component(v, index, self.component, v.bits_of(blended));
                    }
                }
            };
        }
        match self.source {
            Source::Fixed(field) => each!(|word| field.fixed(v, word)),
            Source::Half(field) => each!(|word| field.half(v, word, false)),
            Source::Srgb(field) => each!(|word| {
                let at = v.left_i(field.code(v, word), 2);
                v.bits_to_f(v.gather(srgb::LINEAR.words().as_ptr().cast(), at))
            }),
            _ => each!(|word| v.bits_to_f(word)),
        }
    }
}

/// Blends a component of two slices, and writes the results.
pub(super) struct BlendSlices<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub slices: &'b [ChunkRows; 2],
    pub weight: &'b ChunkRows,
    pub component: usize,
}

impl<V: Vector> Task<V> for BlendSlices<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let scale = self.fast.blended_scale();
        for index in 0..self.wave.subgroups.len() {
            // SAFETY: the caller guarantees that slices and weights were put, and that the wave has
            // a row of the result for each subgroup.
            unsafe {
                let near = v.bits_to_f(self.slices[0].get(v, index));
                let far = v.bits_to_f(self.slices[1].get(v, index));
                let weight = v.bits_to_f(self.weight.get(v, index));
                let mut blended = v.lerp(near, far, weight);
                if scale != 1.0 {
                    blended = v.div_units(blended, scale);
                }
                let words = v.bits_of(blended);
                self.wave.put_component(v, index, self.component, words);
            }
        }
    }
}

/// Blends the four components of texels that lie in pairs, and writes the results.
pub(super) struct BlendNeighbours<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub kind: u8,
    pub in_pairs: u16,
    pub taps: &'b Taps,
}

impl<V: Vector> Task<V> for BlendNeighbours<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, wave) = (&{ *self.fast }, &{ *self.wave });
        let [near, far] = &self.taps.texels;
        macro_rules! each {
            ($kind:ident, $lines:literal) => {
                for index in 0..wave.subgroups.len() {
                    if self.in_pairs >> (index % SUBGROUPS) & 1 == 0 {
                        continue;
                    }
                    // SAFETY: the caller guarantees that texels were placed in the image, and that
                    // the wave has the rows of the results.
                    unsafe {
                        let mut lines = [v.splat_i(0); $lines];
                        let mut weights = [v.splat(0.0); 3];
                        for (line, at) in lines.iter_mut().enumerate() {
                            let slice = if line < 2 { near } else { far };
                            *at = slice[2 * line & 3].get(v, index);
                        }
                        for (axis, weight) in weights.iter_mut().enumerate().take(fast.spatial) {
                            *weight = v.bits_to_f(self.taps.weights[axis].get(v, index));
                        }
                        let blended = v.blend_neighbours::<{ FourOf::$kind }, $lines>(
                            fast.base(),
                            lines,
                            weights,
                        );
                        let values = fast.finish(v, fast.in_order(blended));
                        wave.put_numbers(v, index, values);
                    }
                }
            };
        }
        match (self.kind, fast.spatial) {
            (FourOf::BYTES, 2) => each!(BYTES, 2),
            (FourOf::SHORTS, 2) => each!(SHORTS, 2),
            (FourOf::HALVES, 2) => each!(HALVES, 2),
            (_, 2) => each!(WORDS, 2),
            (FourOf::BYTES, _) => each!(BYTES, 4),
            (FourOf::SHORTS, _) => each!(SHORTS, 4),
            (FourOf::HALVES, _) => each!(HALVES, 4),
            _ => each!(WORDS, 4),
        }
    }
}
