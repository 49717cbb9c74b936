//! The three steps of a sample of any format: where its texels are, their words, and what they
//! weigh. Texels of a step are in memory, so that each function is short, whatever the format is.

use std::mem::MaybeUninit;

use lanes::LANES;
use lanes::vector::{FourOf, Task, Vector};

use super::super::decode::{Decoder, Field, expand};
use super::super::format::block;
use super::super::format::layout::BLOCK_INDEX_SHIFT;
use super::super::sample;
use super::axis::Axis;
use super::levels::Levels;
use super::{Components, Fast};

/// Most texels of a sample.
const MOST: usize = 8;

/// The texels around the lanes' places: neighbours in x first, then in y, then in z.
pub(super) struct Taps<V: Vector> {
    pub count: usize,
    /// A texel's right neighbour lies behind it in every lane that is looked at, and offsets are
    /// those of every second texel.
    pub in_pairs: bool,
    pub offsets: [MaybeUninit<V::I>; MOST],
    /// In compressed formats, indices in their blocks.
    pub index: [MaybeUninit<V::I>; MOST],
    pub weights: [V::F; 3],
    /// Lanes whose texel is none of the border's.
    pub inside: [u16; MOST],
    /// Lanes whose texel lies past a corner of a cube.
    pub past_corner: Option<[u16; 4]>,
    words: [[MaybeUninit<V::I>; 4]; MOST],
}

impl<V: Vector> Taps<V> {
    #[inline(always)]
    pub(super) fn new(v: V) -> Taps<V> {
        Taps {
            count: 0,
            in_pairs: false,
            offsets: [const { MaybeUninit::uninit() }; MOST],
            index: [const { MaybeUninit::uninit() }; MOST],
            weights: [v.splat(0.0); 3],
            inside: [u16::MAX; MOST],
            past_corner: None,
            words: [const { [const { MaybeUninit::uninit() }; 4] }; MOST],
        }
    }

    #[inline(always)]
    fn set(&mut self, tap: usize, words: [V::I; 4]) {
        self.words[tap] = [
            MaybeUninit::new(words[0]),
            MaybeUninit::new(words[1]),
            MaybeUninit::new(words[2]),
            MaybeUninit::new(words[3]),
        ];
    }

    /// # Safety
    /// The words were fetched.
    #[inline(always)]
    unsafe fn words<const COUNT: usize>(&self, v: V, tap: usize) -> [V::I; 4] {
        let mut words = [v.splat_i(0); 4];
        for index in 0..COUNT {
            // SAFETY: the caller guarantees that the words have been fetched.
            words[index] = unsafe { self.words[tap][index].assume_init() };
        }
        words
    }
}

impl Fast<'_> {
    /// The texels of the axes' footprints in levels and layers.
    #[inline(always)]
    pub(super) fn place_taps<V: Vector>(
        &self,
        v: V,
        levels: &Levels<'_, V>,
        layer: V::I,
        axes: &[Axis<V>; 3],
        taps: &mut Taps<V>,
    ) {
        let [x, y, z] = axes;
        let base = v.add_i(levels.offset, layer);
        taps.past_corner = None;
        if self.is_nearest {
            taps.count = 1;
            taps.in_pairs = false;
            let mut at = v.add_i(base, x.offsets[0]);
            if self.spatial >= 2 {
                at = v.add_i(at, y.offsets[0]);
            }
            if self.spatial == 3 {
                at = v.add_i(at, z.offsets[0]);
            }
            taps.offsets[0] = MaybeUninit::new(at);
            if self.block_shift != 0 {
                let index = index_in_block(v, x.index[0], y.index[0]);
                taps.index[0] = MaybeUninit::new(index);
            }
            taps.inside[0] = x.inside[0] & y.inside[0] & z.inside[0];
            return;
        }
        let count = 1 << self.spatial;
        taps.count = count;
        taps.weights = [x.weight, y.weight, z.weight];
        taps.in_pairs = x.is_inner && self.pairs;
        for line in 0..count / 2 {
            let mut at = base;
            if self.spatial >= 2 {
                at = v.add_i(at, y.offsets[line & 1]);
            }
            if self.spatial == 3 {
                at = v.add_i(at, z.offsets[line >> 1]);
            }
            taps.offsets[2 * line] = MaybeUninit::new(v.add_i(at, x.offsets[0]));
            if !taps.in_pairs {
                taps.offsets[2 * line + 1] = MaybeUninit::new(v.add_i(at, x.offsets[1]));
            }
        }
        if self.block_shift != 0 {
            for tap in 0..count {
                let index = index_in_block(v, x.index[tap & 1], y.index[tap >> 1 & 1]);
                taps.index[tap] = MaybeUninit::new(index);
            }
        }
        if self.has_border {
            for tap in 0..count {
                taps.inside[tap] = x.inside[tap & 1] & y.inside[tap >> 1 & 1];
                taps.inside[tap] &= z.inside[tap >> 2];
            }
        }
    }

    /// The weighted texels, or their comparisons with a reference; of a gather, its component of
    /// all four.
    ///
    /// # Safety
    /// The image's memory stays allocated during the call; the taps were placed in it.
    #[inline(always)]
    pub(super) unsafe fn blended<V: Vector>(
        &self,
        v: V,
        taps: &mut Taps<V>,
        reference: Option<V::F>,
        gathered: Option<usize>,
    ) -> Components<V> {
        let fast = self;
        // SAFETY: the caller guarantees that the image's memory stays allocated during the call;
        // the taps were placed in it; words are fetched before they are looked at.
        unsafe {
            macro_rules! neighbours {
                ($kind:ident) => {
                    match taps.count {
                        4 => v.apart(Neighbours::<V, { FourOf::$kind }, 2> { fast, taps: &*taps }),
                        _ => v.apart(Neighbours::<V, { FourOf::$kind }, 4> { fast, taps: &*taps }),
                    }
                };
            }
            // The constant alone decides: where it is false, nothing behind it is compiled.
            if V::BLENDS_NEIGHBOURS
                && taps.in_pairs
                && matches!(taps.count, 4 | 8)
                && let Some(kind) = self.four_of
            {
                let blended = match kind {
                    FourOf::BYTES => neighbours!(BYTES),
                    FourOf::SHORTS => neighbours!(SHORTS),
                    FourOf::HALVES => neighbours!(HALVES),
                    _ => neighbours!(WORDS),
                };
                return self.in_order(blended);
            }
            macro_rules! fetch {
                ($size:literal) => {
                    v.apart(Fetch::<V, $size> {
                        fast,
                        taps: &mut *taps,
                    })
                };
            }
            match (self.decoder, self.info.size_bytes) {
                (Decoder::Each, _) => fetch!(0),
                (_, 1) => fetch!(1),
                (_, 2) => fetch!(2),
                (_, 4) => fetch!(4),
                (_, 8) => fetch!(8),
                (_, 16) => fetch!(16),
                _ => fetch!(3),
            }
            macro_rules! blend {
                ($kind:ident) => {
                    v.apart(Blend::<V, { kind::$kind }> {
                        fast,
                        taps: &*taps,
                        reference,
                        gathered,
                    })
                };
            }
            match self.decoder {
                Decoder::Fields => return blend!(FIELDS),
                Decoder::Halves => return blend!(HALVES),
                Decoder::Words | Decoder::Each => {}
                _ => {
                    v.apart(Expand {
                        fast,
                        taps: &mut *taps,
                    });
                }
            }
            blend!(WORDS)
        }
    }
}

/// Blends texels of four components that lie in pairs, in so many lines.
struct Neighbours<'a, 'b, V: Vector, const KIND: u8, const LINES: usize> {
    fast: &'b Fast<'a>,
    taps: &'b Taps<V>,
}

impl<V: Vector, const KIND: u8, const LINES: usize> Task<V> for Neighbours<'_, '_, V, KIND, LINES> {
    type Output = Components<V>;

    #[inline(always)]
    unsafe fn run(self, v: V) -> Components<V> {
        let Neighbours { fast, taps } = self;
        let base = fast.image.data.cast_const();
        let mut offsets = [v.splat_i(0); LINES];
        // SAFETY: the caller keeps the contract of this function; lines have left texels in the
        // image, and right neighbours.
        unsafe {
            for (line, at) in offsets.iter_mut().enumerate() {
                *at = taps.offsets[2 * line].assume_init();
            }
            v.blend_neighbours::<KIND, LINES>(base, offsets, taps.weights)
        }
    }
}

/// A texel's index in a block of four by four.
#[inline(always)]
pub(crate) fn index_in_block<V: Vector>(v: V, x: V::I, y: V::I) -> V::I {
    let three = v.splat_i(3);
    v.add_i(v.and_i(x, three), v.left_i(v.and_i(y, three), 2))
}

/// Fetches texels of so many bytes; 0: decoded lane by lane, 3: of three components.
struct Fetch<'a, 'b, V: Vector, const SIZE: usize> {
    fast: &'b Fast<'a>,
    taps: &'b mut Taps<V>,
}

impl<V: Vector, const SIZE: usize> Task<V> for Fetch<'_, '_, V, SIZE> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let Fetch { fast, taps } = self;
        let base = fast.image.data.cast_const();
        let zero = v.splat_i(0);
        // SAFETY: the caller keeps the contract of this function; offsets are of texels, and what
        // is in pairs has a right neighbour.
        unsafe {
            if matches!(SIZE, 1 | 2 | 4 | 8 | 16) && taps.in_pairs {
                for line in 0..taps.count / 2 {
                    let at = taps.offsets[2 * line].assume_init();
                    let [mut left, mut right] = [[zero; 4]; 2];
                    match SIZE {
                        1 => {
                            left[0] = v.gather_scalars::<u16>(base, at);
                            right[0] = v.right_u(left[0], 8);
                        }
                        2 => {
                            left[0] = v.gather(base, at);
                            right[0] = v.right_u(left[0], 16);
                        }
                        4 => (left[0], right[0]) = v.gather_pairs(base, at),
                        8 => [left[0], left[1], right[0], right[1]] = v.gather_quads(base, at),
                        _ => {
                            left = v.gather_quads(base, at);
                            right = v.gather_quads(base.add(16), at);
                        }
                    }
                    taps.put::<SIZE>(2 * line, left);
                    taps.put::<SIZE>(2 * line + 1, right);
                }
                return;
            }
            for tap in 0..taps.count {
                let at = taps.offsets[tap].assume_init();
                let mut words = [zero; 4];
                match SIZE {
                    1 => words[0] = v.gather_scalars::<u8>(base, at),
                    2 => words[0] = v.gather_scalars::<u16>(base, at),
                    4 => words[0] = v.gather(base, at),
                    8 => (words[0], words[1]) = v.gather_pairs(base, at),
                    16 => words = v.gather_quads(base, at),
                    3 => words = odd(v, base, at, fast.info.size_bytes),
                    _ => words = fast.each(v, at, taps.index[tap]),
                }
                taps.put::<SIZE>(tap, words);
            }
        }
    }
}

impl<V: Vector> Taps<V> {
    /// Those words that a texel of so many bytes has.
    #[inline(always)]
    fn put<const SIZE: usize>(&mut self, tap: usize, words: [V::I; 4]) {
        self.words[tap][0] = MaybeUninit::new(words[0]);
        if !matches!(SIZE, 1 | 2 | 4) {
            self.words[tap][1] = MaybeUninit::new(words[1]);
        }
        if !matches!(SIZE, 1 | 2 | 4 | 8) {
            self.words[tap][2] = MaybeUninit::new(words[2]);
            self.words[tap][3] = MaybeUninit::new(words[3]);
        }
    }
}

/// The words of texels of 3, 6 or 12 bytes.
///
/// # Safety
/// The offsets are of such texels.
#[inline(always)]
unsafe fn odd<V: Vector>(v: V, base: *const u8, at: V::I, size_bytes: u8) -> [V::I; 4] {
    let mut words = [v.splat_i(0); 4];
    // SAFETY: the caller guarantees that the offsets are of such texels; each access lies inside
    // the texel.
    unsafe {
        match size_bytes {
            3 => {
                let low = v.gather_scalars::<u16>(base, at);
                let high = v.gather_scalars::<u8>(base.add(2), at);
                words[0] = v.or_i(low, v.left_i(high, 16));
            }
            6 => {
                words[0] = v.gather(base, at);
                words[1] = v.gather_scalars::<u16>(base.add(4), at);
            }
            _ => {
                (words[0], words[1]) = v.gather_pairs(base, at);
                words[2] = v.gather(base.add(8), at);
            }
        }
    }
    words
}

/// Decodes texels to words.
struct Expand<'a, 'b, V: Vector> {
    fast: &'b Fast<'a>,
    taps: &'b mut Taps<V>,
}

impl<V: Vector> Task<V> for Expand<'_, '_, V> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let Expand { fast, taps } = self;
        for tap in 0..taps.count {
            // SAFETY: as many words as a texel has were fetched, and the indices in blocks are set.
            let numbers = unsafe {
                let words = match fast.info.size_bytes {
                    16 => taps.words::<4>(v, tap),
                    8 => taps.words::<2>(v, tap),
                    _ => taps.words::<1>(v, tap),
                };
                let index = match fast.block_shift {
                    0 => v.splat_i(0),
                    _ => taps.index[tap].assume_init(),
                };
                expand(v, fast.info, fast.decoder, words, index)
            };
            taps.set(
                tap,
                [
                    v.bits_of(numbers[0]),
                    v.bits_of(numbers[1]),
                    v.bits_of(numbers[2]),
                    v.bits_of(numbers[3]),
                ],
            );
        }
    }
}

/// How a component is decoded while it is weighted.
mod kind {
    pub const FIELDS: u8 = 0;
    pub const HALVES: u8 = 1;
    pub const WORDS: u8 = 2;
}

/// Weights, compares or gathers.
struct Blend<'a, 'b, V: Vector, const KIND: u8> {
    fast: &'b Fast<'a>,
    taps: &'b Taps<V>,
    reference: Option<V::F>,
    gathered: Option<usize>,
}

impl<V: Vector, const KIND: u8> Blend<'_, '_, V, KIND> {
    /// A component of a texel, or its comparison.
    ///
    /// # Safety
    /// The texels' words were fetched.
    #[inline(always)]
    unsafe fn number(
        &self,
        v: V,
        tap: usize,
        component: usize,
        field: &Field,
        border: &[u32; 4],
    ) -> V::F {
        let Blend { fast, taps, .. } = self;
        let as_it_is = taps.count == 1 || self.gathered.is_some();
        let word = match KIND {
            kind::WORDS => component,
            _ => field.word & 3,
        };
        // SAFETY: the caller guarantees that the texels' words were fetched; it is one of the words
        // that a component stands in.
        let word = unsafe { taps.words[tap][word].assume_init() };
        let mut number = match KIND {
            kind::WORDS => v.bits_to_f(word),
            kind::HALVES => field.half(v, word, as_it_is),
            _ => field.fixed(v, word),
        };
        if fast.has_border && taps.inside[tap] != u16::MAX {
            let border = v.splat_i(border[component] as i32);
            number = v.bits_to_f(v.select(taps.inside[tap], v.bits_of(number), border));
        }
        match self.reference {
            Some(reference) => fast.compare(v, number, reference),
            None => number,
        }
    }
}

impl<V: Vector, const KIND: u8> Task<V> for Blend<'_, '_, V, KIND> {
    type Output = Components<V>;

    #[inline(always)]
    unsafe fn run(self, v: V) -> Components<V> {
        let Blend { fast, taps, .. } = self;
        let border = match fast.has_border {
            true => sample::border_units(fast.sampler, fast.info),
            false => [0; 4],
        };
        let mut blended = [v.splat(0.0); 4];
        let keeps_all = taps.past_corner.is_some() || self.gathered.is_some();
        for component in 0..4 {
            let is_taken = match self.gathered {
                Some(gathered) => component == gathered && fast.info.channels[component].bits != 0,
                None => fast.takes(component),
            };
            if !is_taken {
                continue;
            }
            let field = Field::of(fast.info, component);
            let mut lines = [v.splat(0.0); 4];
            let mut all = [v.splat(0.0); 4];
            for line in 0..taps.count.div_ceil(2) {
                // SAFETY: the words were fetched, of components that the format has.
                unsafe {
                    let left = self.number(v, 2 * line, component, &field, &border);
                    if taps.count == 1 {
                        lines[0] = left;
                        break;
                    }
                    let right = self.number(v, 2 * line + 1, component, &field, &border);
                    if keeps_all {
                        [all[(2 * line) & 3], all[(2 * line + 1) & 3]] = [left, right];
                    }
                    if self.gathered.is_some() {
                        continue;
                    }
                    lines[line] = v.lerp(left, right, taps.weights[0]);
                }
            }
            if let Some(past) = taps.past_corner {
                fill_corners(v, &mut all, past);
                lines[0] = v.lerp(all[0], all[1], taps.weights[0]);
                lines[1] = v.lerp(all[2], all[3], taps.weights[0]);
            }
            if self.gathered.is_some() {
                // (0, 1), (1, 1), (1, 0), (0, 0).
                return [all[2], all[3], all[1], all[0]];
            }
            if taps.count >= 4 {
                lines[0] = v.lerp(lines[0], lines[1], taps.weights[1]);
            }
            if taps.count == 8 {
                let behind = v.lerp(lines[2], lines[3], taps.weights[1]);
                lines[0] = v.lerp(lines[0], behind, taps.weights[2]);
            }
            blended[component] = lines[0];
        }
        blended
    }
}

/// A texel past a cube's corner is the mean of the three around it.
#[inline(always)]
fn fill_corners<V: Vector>(v: V, taps: &mut [V::F; 4], past_corner: [u16; 4]) {
    for (tap, lanes) in past_corner.into_iter().enumerate() {
        if lanes == 0 {
            continue;
        }
        let mut others = [v.splat(0.0); 3];
        let mut count = 0;
        for other in 0..4 {
            if other != tap {
                others[count] = taps[other];
                count += 1;
            }
        }
        let sum = v.add(v.add(others[0], others[1]), others[2]);
        let mean = v.bits_of(v.div(sum, v.splat(3.0)));
        taps[tap] = v.bits_to_f(v.select(lanes, mean, v.bits_of(taps[tap])));
    }
}

impl Fast<'_> {
    /// Texels decoded lane by lane.
    ///
    /// # Safety
    /// The offsets are of texels, and in compressed formats the indices in blocks are set.
    #[inline(always)]
    unsafe fn each<V: Vector>(&self, v: V, at: V::I, index: MaybeUninit<V::I>) -> [V::I; 4] {
        let (mut places, mut indices) = ([0; LANES], [0; LANES]);
        v.store_i(at, &mut places);
        if self.block_shift != 0 {
            // SAFETY: the caller guarantees that the offsets are of texels, and in compressed
            // formats the indices in blocks are set.
            v.store_i(unsafe { index.assume_init() }, &mut indices);
        }
        let mut offsets = [0u64; LANES];
        for lane in 0..LANES {
            offsets[lane] = places[lane] as u64 | (indices[lane] as u64) << BLOCK_INDEX_SHIFT;
        }
        // SAFETY: the caller guarantees that the offsets are of texels, and in compressed formats
        // the indices in blocks are set.
        let texels = unsafe { block::load(self.info, self.image.data, &offsets) };
        [
            v.load_i(&texels[0]),
            v.load_i(&texels[1]),
            v.load_i(&texels[2]),
            v.load_i(&texels[3]),
        ]
    }
}
