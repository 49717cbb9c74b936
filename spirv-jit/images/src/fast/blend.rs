//! Steps from words of texels to results: numbers, compared and weighted.

use lanes::vector::{FourOf, Task, Vector};

use super::super::chunk::{ChunkRows, SUBGROUPS, Source};
use super::super::format::Numeric;
use super::super::format::block;
use super::super::format::layout::Codec;
use super::super::rows::Wave;
use super::super::srgb;
use super::super::{CompareOp, sample};
use super::Fast;
use super::footprints::Taps;
use super::levels::{Anisotropy, Lods};

/// A number of a texel, from the word that it stands in.
#[inline(always)]
fn number<V: Vector>(v: V, source: Source, word: V::I, as_it_is: bool) -> V::F {
    match source {
        Source::Fixed(field) => field.fixed(v, word),
        Source::Half(field) => field.half(v, word, as_it_is),
        Source::Srgb(field) => {
            let at = v.left_i(field.code(v, word), 2);
            // SAFETY: the table has an entry for every byte.
            v.bits_to_f(unsafe { v.gather(srgb::LINEAR.words().as_ptr().cast(), at) })
        }
        _ => v.bits_to_f(word),
    }
}

impl Fast<'_> {
    /// The border's word in a component of the format; zero if there is none.
    #[inline(always)]
    pub(super) fn border(&self, component: usize) -> u32 {
        match self.has_border {
            true => sample::border_units(self.sampler, self.info)[component & 3],
            false => 0,
        }
    }

    /// The source of a component of the format that is blended or replaced by a border, in units;
    /// of depths without borders, which are only compared, that of their values.
    #[inline(always)]
    pub(super) fn source(&self, component: usize) -> Source {
        match self.op.depth_compare && !self.has_border {
            true => Source::of_view(self.info, self.decoder, 0),
            false => Source::units_of_view(self.info, self.decoder, component as u8),
        }
    }

    /// The reference of depth comparisons: fixed-point depths lie in 0..1, so the reference must,
    /// too.
    ///
    /// # Safety
    /// As [`Wave::mask`]; the operation has one.
    #[inline(always)]
    unsafe fn reference<V: Vector>(&self, v: V, wave: &Wave<'_>, index: usize) -> V::F {
        // SAFETY: the caller keeps the contract of this function.
        let reference = v.load(unsafe { wave.reference(self.op, index) });
        match self.info.numeric {
            Numeric::Unorm => v.min(v.max(reference, v.splat(0.0)), v.splat(1.0)),
            _ => reference,
        }
    }

    /// 1 where the comparison of a depth of [`Self::source`] with the reference holds, else 0.
    #[inline(always)]
    fn compare<V: Vector>(&self, v: V, depth: V::F, reference: V::F) -> V::F {
        let depth = match block::unit_scale(self.info) {
            // A border need not be among the units.
            scale if scale != 1.0 && self.has_border => v.div(depth, v.splat(scale)),
            _ => depth,
        };
        self.passes(v, depth, reference)
    }

    /// As [`Self::compare`], of a depth that is not in units.
    #[inline(always)]
    fn passes<V: Vector>(&self, v: V, depth: V::F, reference: V::F) -> V::F {
        let ones = v.splat_i(-1);
        let at_most = v.at_least(reference, depth);
        let at_least = v.at_least(depth, reference);
        let holds = match self.sampler.compare.unwrap_or(CompareOp::Never) {
            CompareOp::Never => v.splat_i(0),
            // Above, and not equal: `at_most` of a NaN is zero, too.
            CompareOp::Less => v.and_i(at_least, v.xor_i(at_most, ones)),
            CompareOp::Equal => v.and_i(at_most, at_least),
            CompareOp::LessOrEqual => at_least,
            CompareOp::Greater => v.and_i(at_most, v.xor_i(at_least, ones)),
            CompareOp::NotEqual => v.xor_i(v.and_i(at_most, at_least), ones),
            CompareOp::GreaterOrEqual => at_most,
            CompareOp::Always => ones,
        };
        v.bits_to_f(v.and_i(holds, v.bits_of(v.splat(1.0))))
    }

    /// Units of a result.
    #[inline(always)]
    fn result_scale(&self) -> f32 {
        match self.op.depth_compare {
            true => 1.0,
            false => block::unit_scale(self.info),
        }
    }
}

/// Takes a component of one texel, or its comparison: a result of a gather, or a number of a
/// nearest texel.
pub(super) struct Take<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub source: Source,
    /// The component of the format.
    pub component: usize,
    pub words: &'b ChunkRows,
    /// Lanes whose texel is none of the border's.
    pub inside: [u16; SUBGROUPS],
    pub to: To<'b>,
}

/// Where numbers are written.
pub(super) enum To<'b> {
    /// The rows of a result, as values.
    Result(usize),
    /// In units, to be blended.
    Rows(&'b mut ChunkRows),
}

impl<V: Vector> Task<V> for Take<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, wave) = (&{ *self.fast }, &{ *self.wave });
        let source = self.source;
        let border = v.splat_i(fast.border(self.component) as i32);
        let mut to = self.to;
        let scale = fast.result_scale();
        for index in 0..wave.subgroups.len() {
            // SAFETY: the caller guarantees that the words were put, if the format has the
            // component, and that the wave has a row of the result for each subgroup.
            unsafe {
                let mut taken = match source {
                    Source::Constant(word) => v.bits_to_f(v.splat_i(word as i32)),
                    _ => number(v, source, self.words.get(v, index), !fast.op.depth_compare),
                };
                let inside = self.inside[index % SUBGROUPS];
                if inside != u16::MAX {
                    taken = v.bits_to_f(v.select(inside, v.bits_of(taken), border));
                }
                if fast.op.depth_compare {
                    taken = fast.compare(v, taken, fast.reference(v, wave, index));
                }
                match &mut to {
                    To::Rows(rows) => rows.put(v, index, v.bits_of(taken)),
                    To::Result(result) => {
                        if scale != 1.0 {
                            taken = v.div(taken, v.splat(scale));
                        }
                        wave.put_component(v, index, *result, v.bits_of(taken));
                    }
                }
            }
        }
    }
}

/// Where samples of one level are written.
pub(super) enum Out<'b> {
    Results,
    /// As numbers in units, to be blended.
    Rows(&'b mut [ChunkRows; 4]),
    /// As results, blended with those of the nearer level.
    BehindNear(Near<'b>),
}

/// Numbers of nearer levels, and what the farther ones weigh.
#[derive(Clone, Copy)]
pub(super) struct Near<'b> {
    pub rows: &'b [ChunkRows; 4],
    pub weights: &'b ChunkRows,
    /// A bit for each subgroup that has farther ones.
    pub between: u16,
}

impl Near<'_> {
    /// A number of a subgroup, blended with that of the farther level.
    ///
    /// # Safety
    /// The numbers of such a component, and weights, were put.
    #[inline(always)]
    unsafe fn blended<V: Vector>(&self, v: V, index: usize, component: usize, far: V::F) -> V::F {
        // SAFETY: the caller guarantees that the rows were put.
        unsafe {
            let near = v.bits_to_f(self.rows[component].get(v, index));
            match self.between >> (index % SUBGROUPS) & 1 {
                1 => v.lerp(near, far, v.bits_to_f(self.weights.get(v, index))),
                _ => near,
            }
        }
    }
}

/// A texel past a cube's corner is the mean of the three around it.
#[inline(always)]
fn fill_corners<V: Vector>(v: V, taps: [V::F; 4], past_corner: [u16; 4]) -> [V::F; 4] {
    let mut filled = taps;
    for (tap, lanes) in past_corner.into_iter().enumerate() {
        if lanes == 0 {
            continue;
        }
        let mut others = [v.splat(0.0); 3];
        let mut count = 0;
        for other in 0..4 {
            if other != tap {
                others[count] = filled[other];
                count += 1;
            }
        }
        let sum = v.add(v.add(others[0], others[1]), others[2]);
        let mean = v.bits_of(v.div(sum, v.splat(3.0)));
        filled[tap] = v.bits_to_f(v.select(lanes, mean, v.bits_of(filled[tap])));
    }
    filled
}

/// Gathers a component, or comparisons, in subgroups with texels past corners of a cube.
pub(super) struct GatherCorners<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub source: Source,
    pub taps: &'b Taps,
    /// The texel of each result.
    pub gathered: [usize; 4],
}

impl<V: Vector> Task<V> for GatherCorners<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, wave, taps) = (&{ *self.fast }, &{ *self.wave }, self.taps);
        let words = &taps.words[self.source.word().unwrap_or(0)];
        let scale = fast.result_scale();
        for index in 0..wave.subgroups.len() {
            if taps.corners >> (index % SUBGROUPS) & 1 == 0 {
                continue;
            }
            // SAFETY: the caller guarantees that the words were put, and that the wave has a row of
            // each wanted result for each subgroup.
            unsafe {
                let mut four = [v.splat(0.0); 4];
                for (tap, rows) in four.iter_mut().zip(words) {
                    let compares = fast.op.depth_compare;
                    *tap = number(v, self.source, rows.get(v, index), !compares);
                    if compares {
                        *tap = fast.compare(v, *tap, fast.reference(v, wave, index));
                    }
                }
                four = fill_corners(v, four, taps.past_corner[index % SUBGROUPS]);
                let mut values = [v.splat(0.0); 4];
                for (value, tap) in values.iter_mut().zip(self.gathered) {
                    *value = match scale {
                        1.0 => four[tap],
                        _ => v.div(four[tap], v.splat(scale)),
                    };
                }
                wave.put_numbers(v, index, values);
            }
        }
    }
}

/// Ways of [`Blend`]. Without borders and corners, in two dimensions or three: numbers, or their
/// comparisons.
pub(super) const LEAN: u8 = 0;
pub(super) const COMPARES: u8 = 1;
pub(super) const ANY: u8 = 2;

/// Blends a component of two or four texels of a slice, or its comparisons.
pub(super) struct Blend<'a, 'b, const WAY: u8> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub source: Source,
    /// The component of the format.
    pub component: usize,
    pub taps: &'b Taps,
    pub slice: usize,
    pub to: To<'b>,
}

impl<V: Vector, const WAY: u8> Task<V> for Blend<'_, '_, WAY> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, wave) = (&{ *self.fast }, &{ *self.wave });
        let taps = self.taps;
        let first = 4 * (self.slice & 1);
        let (slices, _) = taps.words[self.source.word().unwrap_or(0)].as_chunks::<4>();
        let words = &slices[self.slice & 1];
        let border = v.splat_i(fast.border(self.component) as i32);
        let mut to = self.to;
        let scale = fast.result_scale();
        macro_rules! each {
            (|$word:ident| $number:expr) => {
                for index in 0..wave.subgroups.len() {
                    // SAFETY: the caller guarantees that words and weights were put, and that the
                    // wave has a row of the result for each subgroup.
                    unsafe {
                        let mut four = [v.splat(0.0); 4];
                        for (tap, rows) in four.iter_mut().zip(words) {
                            let $word = rows.get(v, index);
                            *tap = $number;
                        }
                        if WAY == ANY && fast.has_border {
                            for (tap, number) in four.iter_mut().enumerate() {
                                let inside = taps.inside(index, first + tap);
                                let bits = v.select(inside, v.bits_of(*number), border);
                                *number = v.bits_to_f(bits);
                            }
                        }
                        if WAY == COMPARES || WAY == ANY && fast.op.depth_compare {
                            let reference = fast.reference(v, wave, index);
                            for tap in &mut four {
                                *tap = match WAY {
                                    COMPARES => fast.passes(v, *tap, reference),
                                    _ => fast.compare(v, *tap, reference),
                                };
                            }
                        }
                        if WAY == ANY && taps.corners >> (index % SUBGROUPS) & 1 == 1 {
                            let past = taps.past_corner[index % SUBGROUPS];
                            four = fill_corners(v, four, past);
                        }
                        let x = v.bits_to_f(taps.weights[0].get(v, index));
                        let mut blended = v.lerp(four[0], four[1], x);
                        if WAY != ANY || fast.spatial >= 2 {
                            let y = v.bits_to_f(taps.weights[1].get(v, index));
                            let lower = v.lerp(four[2], four[3], x);
                            blended = v.lerp(blended, lower, y);
                        }
                        match &mut to {
                            To::Rows(rows) => rows.put(v, index, v.bits_of(blended)),
                            To::Result(result) => {
                                if scale != 1.0 {
                                    blended = v.div_units(blended, scale);
                                }
                                wave.put_component(v, index, *result, v.bits_of(blended));
                            }
                        }
                    }
                }
            };
        }
        match self.source {
            Source::Fixed(field) if field.is_code() => each!(|word| v.to_f(field.code(v, word))),
            Source::Fixed(field) => each!(|word| field.fixed(v, word)),
            Source::Half(field) => each!(|word| field.half(v, word, false)),
            Source::Srgb(_) => each!(|word| number(v, self.source, word, false)),
            _ => each!(|word| v.bits_to_f(word)),
        }
    }
}

/// Blends a component of two slices.
pub(super) struct BlendSlices<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub slices: &'b [ChunkRows; 2],
    pub weight: &'b ChunkRows,
    pub to: To<'b>,
}

impl<V: Vector> Task<V> for BlendSlices<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let mut to = self.to;
        let scale = self.fast.result_scale();
        for index in 0..self.wave.subgroups.len() {
            // SAFETY: the caller guarantees that slices and weights were put, and that the wave has
            // a row of the result for each subgroup.
            unsafe {
                let near = v.bits_to_f(self.slices[0].get(v, index));
                let far = v.bits_to_f(self.slices[1].get(v, index));
                let weight = v.bits_to_f(self.weight.get(v, index));
                let mut blended = v.lerp(near, far, weight);
                match &mut to {
                    To::Rows(rows) => rows.put(v, index, v.bits_of(blended)),
                    To::Result(result) => {
                        if scale != 1.0 {
                            blended = v.div_units(blended, scale);
                        }
                        self.wave
                            .put_component(v, index, *result, v.bits_of(blended));
                    }
                }
            }
        }
    }
}

/// Writes the results of a subgroup, or the numbers that they are blended from.
///
/// # Safety
/// As [`Wave::put`]; numbers of nearer levels were put.
#[inline(always)]
unsafe fn put_blended<V: Vector>(
    v: V,
    fast: &Fast<'_>,
    wave: &Wave<'_>,
    index: usize,
    blended: [V::F; 4],
    out: &mut Out<'_>,
) {
    let mut blended = blended;
    match out {
        Out::Rows([a, b, c, d]) => {
            a.put(v, index, v.bits_of(blended[0]));
            b.put(v, index, v.bits_of(blended[1]));
            c.put(v, index, v.bits_of(blended[2]));
            d.put(v, index, v.bits_of(blended[3]));
            return;
        }
        // SAFETY: the caller guarantees that the numbers were put.
        Out::BehindNear(near) => unsafe {
            blended = [
                near.blended(v, index, 0, blended[0]),
                near.blended(v, index, 1, blended[1]),
                near.blended(v, index, 2, blended[2]),
                near.blended(v, index, 3, blended[3]),
            ];
        },
        Out::Results => {}
    }
    // SAFETY: the caller keeps the contract of `Wave::put`.
    unsafe { wave.put_numbers(v, index, fast.finish(v, blended)) };
}

/// Blends the four components of texels that lie in pairs, in all subgroups.
pub(super) struct BlendNeighbours<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub kind: u8,
    pub taps: &'b Taps,
    pub out: Out<'b>,
}

impl<V: Vector> Task<V> for BlendNeighbours<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, wave) = (&{ *self.fast }, &{ *self.wave });
        let taps = self.taps;
        let mut out = self.out;
        macro_rules! each {
            ($kind:ident, $lines:literal) => {
                for index in 0..wave.subgroups.len() {
                    // SAFETY: the caller guarantees that texels were placed in the image, and that
                    // the wave has the rows of the results.
                    unsafe {
                        let mut lines = [v.splat_i(0); $lines];
                        let mut weights = [v.splat(0.0); 3];
                        for (line, at) in lines.iter_mut().enumerate() {
                            *at = taps.offset(v, index, 2 * line);
                        }
                        for (axis, weight) in weights.iter_mut().enumerate().take(fast.spatial) {
                            *weight = v.bits_to_f(taps.weights[axis].get(v, index));
                        }
                        let blended = v.blend_neighbours::<{ FourOf::$kind }, $lines>(
                            fast.image.data.cast_const(),
                            lines,
                            weights,
                        );
                        put_blended(v, fast, wave, index, fast.in_order(blended), &mut out);
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

/// Fetches and blends the four texels of four bytes each, linear ones or sRGB, where
/// [`Fast::blends_bytes`].
pub(super) struct BlendBytes<'a, 'b, const IS_SRGB: bool> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub taps: &'b Taps,
    pub out: Out<'b>,
}

impl<V: Vector, const IS_SRGB: bool> Task<V> for BlendBytes<'_, '_, IS_SRGB> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, wave, taps) = (&{ *self.fast }, &{ *self.wave }, self.taps);
        let mut out = self.out;
        let mut has_windows = true;
        for index in 0..wave.subgroups.len() {
            // SAFETY: the caller guarantees that texels were placed, and that the wave has the rows
            // of the results.
            unsafe {
                let words = taps.four_words(v, fast, index, &mut has_windows);
                let x = v.bits_to_f(taps.weights[0].get(v, index));
                let y = v.bits_to_f(taps.weights[1].get(v, index));
                let blended = match IS_SRGB {
                    true => {
                        let past = match taps.corners >> (index % SUBGROUPS) & 1 {
                            1 => Some(taps.past_corner[index % SUBGROUPS]),
                            _ => None,
                        };
                        blend_srgb(v, fast, words, [x, y], past)
                    }
                    false => fast.in_order([
                        blend_bytes(v, words, 0, [x, y]),
                        blend_bytes(v, words, 1, [x, y]),
                        blend_bytes(v, words, 2, [x, y]),
                        blend_bytes(v, words, 3, [x, y]),
                    ]),
                };
                put_blended(v, fast, wave, index, blended, &mut out);
            }
        }
    }
}

#[inline(always)]
fn blend_four<V: Vector>(v: V, four: [V::F; 4], [x, y]: [V::F; 2]) -> V::F {
    v.lerp(v.lerp(four[0], four[1], x), v.lerp(four[2], four[3], x), y)
}

/// A byte of each of four texels, linear between them.
#[inline(always)]
fn blend_bytes<V: Vector>(v: V, words: [V::I; 4], index: u32, weights: [V::F; 2]) -> V::F {
    let four = [
        v.to_f(v.byte(words[0], index)),
        v.to_f(v.byte(words[1], index)),
        v.to_f(v.byte(words[2], index)),
        v.to_f(v.byte(words[3], index)),
    ];
    blend_four(v, four, weights)
}

/// Linear between the colours of four sRGB texels, and between their alpha.
#[inline(always)]
fn blend_srgb<V: Vector>(
    v: V,
    fast: &Fast<'_>,
    words: [V::I; 4],
    weights: [V::F; 2],
    past_corner: Option<[u16; 4]>,
) -> [V::F; 4] {
    let [a, b, c, d] = v.bytes_in(&srgb::LINEAR, words);
    let mut blended = [v.splat(0.0); 4];
    for component in 0..4 {
        let mut four = match component {
            3 if !fast.takes(3) => continue,
            3 => [
                v.div_units(v.to_f(v.byte(words[0], 3)), 255.0),
                v.div_units(v.to_f(v.byte(words[1], 3)), 255.0),
                v.div_units(v.to_f(v.byte(words[2], 3)), 255.0),
                v.div_units(v.to_f(v.byte(words[3], 3)), 255.0),
            ],
            _ => [a[component], b[component], c[component], d[component]],
        };
        if let Some(past) = past_corner {
            four = fill_corners(v, four, past);
        }
        blended[component] = blend_four(v, four, weights);
    }
    let [red, green, blue, alpha] = blended;
    match fast.info.codec {
        Codec::Srgb8Bgra => [blue, green, red, alpha],
        _ => blended,
    }
}

impl Fast<'_> {
    /// The components of a subgroup, in units; those that are not looked at are zero.
    ///
    /// # Safety
    /// All rows that the format asks for were put.
    #[inline(always)]
    unsafe fn numbers<V: Vector>(
        &self,
        v: V,
        rows: &[ChunkRows; 4],
        near: Option<Near<'_>>,
        index: usize,
    ) -> [V::F; 4] {
        let mut numbers = [v.splat(0.0); 4];
        for (component, number) in numbers.iter_mut().enumerate() {
            if !self.computes(component) {
                continue;
            }
            // SAFETY: the caller guarantees that the rows were put.
            unsafe {
                *number = v.bits_to_f(rows[component].get(v, index));
                if let Some(near) = &near {
                    *number = near.blended(v, index, component, *number);
                }
            }
        }
        numbers
    }
}

/// Writes results.
pub(super) struct Finish<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub rows: &'b [ChunkRows; 4],
    pub near: Option<Near<'b>>,
    /// Of sums of anisotropic samples, their counts.
    pub counts: Option<&'b ChunkRows>,
}

impl<V: Vector> Task<V> for Finish<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, wave) = (&{ *self.fast }, &{ *self.wave });
        for index in 0..wave.subgroups.len() {
            // SAFETY: the caller guarantees that the numbers were put, and that the wave has the
            // rows of the results.
            unsafe {
                let mut numbers = fast.numbers(v, self.rows, self.near, index);
                if let Some(counts) = self.counts {
                    let count = v.bits_to_f(counts.get(v, index));
                    numbers = [
                        v.div(numbers[0], count),
                        v.div(numbers[1], count),
                        v.div(numbers[2], count),
                        v.div(numbers[3], count),
                    ];
                }
                wave.put_numbers(v, index, fast.finish(v, numbers));
            }
        }
    }
}

/// Adds anisotropic samples of subgroups.
pub(super) struct Accumulate<'a, 'b> {
    pub fast: &'b Fast<'a>,
    /// The subgroup of each sample, and its number along the footprint.
    pub samples: &'b [(u8, u8)],
    pub lods: &'b Lods,
    pub rows: &'b [ChunkRows; 4],
    pub near: Option<Near<'b>>,
    pub sums: &'b mut [ChunkRows; 4],
}

impl<V: Vector> Task<V> for Accumulate<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let fast = &{ *self.fast };
        let sums = self.sums;
        for (sample, &(subgroup, pass)) in self.samples.iter().enumerate() {
            let subgroup = usize::from(subgroup);
            // SAFETY: the caller guarantees that the numbers were put, and samples of a subgroup
            // before this one were added.
            unsafe {
                let numbers = fast.numbers(v, self.rows, self.near, sample);
                let anisotropy: Anisotropy<V> = self.lods.anisotropy(v, subgroup);
                for (rows, number) in sums.iter_mut().zip(numbers) {
                    let sum = match pass {
                        0 => number,
                        _ => {
                            let sum = v.bits_to_f(rows.get(v, subgroup));
                            anisotropy.sum(v, u32::from(pass), sum, number)
                        }
                    };
                    rows.put(v, subgroup, v.bits_of(sum));
                }
            }
        }
    }
}
