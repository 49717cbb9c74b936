//! Texels of a chunk of a wave, up to sixteen subgroups, in steps: offsets of all texels, then
//! their words, then one component after another. Each step is a short loop over the subgroups,
//! chosen once, so that subgroups overlap and all constants stay in registers; rows between the
//! steps stay in the first cache. Offsets that single loads take were stored long before.
//!
//! Here, too, there are no closures over vectors: those would not be compiled for the vectors'
//! instruction set.

use std::mem::MaybeUninit;

use lanes::vector::{QUADS, Task, Vector};
use lanes::{LANES, Row, Tier, map};

use super::ImageDescriptor;
use super::decode::{Decoder, Field, expand};
use super::format::{FormatInfo, Numeric};
use super::rows::Wave;
use super::srgb;

/// Subgroups of a chunk.
pub(super) const SUBGROUPS: usize = 16;

/// A row for each subgroup of a chunk, on a cache line of its own.
#[repr(align(64))]
pub(super) struct ChunkRows([MaybeUninit<Row>; SUBGROUPS]);

impl ChunkRows {
    #[inline(always)]
    pub const fn new() -> ChunkRows {
        ChunkRows([const { MaybeUninit::uninit() }; SUBGROUPS])
    }

    #[inline(always)]
    pub fn put<V: Vector>(&mut self, v: V, index: usize, words: V::I) {
        v.store_i(words, self.0[index % SUBGROUPS].write([0; LANES]));
    }

    /// # Safety
    /// The row was put.
    #[inline(always)]
    pub unsafe fn row(&self, index: usize) -> &Row {
        // SAFETY: the caller guarantees that the row was put.
        unsafe { self.0[index % SUBGROUPS].assume_init_ref() }
    }

    /// # Safety
    /// The row was put.
    #[inline(always)]
    pub unsafe fn get<V: Vector>(&self, v: V, index: usize) -> V::I {
        // SAFETY: the caller guarantees that the row was put.
        v.load_i(unsafe { self.row(index) })
    }
}

/// The texels of a chunk, one a lane.
pub(super) struct Texels {
    /// Byte offsets of the texels, or of their blocks.
    pub offsets: ChunkRows,
    /// In compressed formats: indices in blocks.
    pub index: ChunkRows,
    /// Lanes with a texel; the offsets of others are those of some texel, too.
    pub inside: [u16; SUBGROUPS],
    pub words: [ChunkRows; 4],
}

impl Texels {
    #[inline(always)]
    pub fn new() -> Texels {
        Texels {
            offsets: ChunkRows::new(),
            index: ChunkRows::new(),
            inside: [u16::MAX; SUBGROUPS],
            words: [const { ChunkRows::new() }; 4],
        }
    }
}

impl Texels {
    /// Zeros in the lanes without a texel.
    ///
    /// # Safety
    /// Such words (a bit each) were put for so many subgroups.
    #[inline(always)]
    unsafe fn keep_inside<V: Vector>(&mut self, v: V, count: usize, words: u8) {
        for (word, rows) in self.words.iter_mut().enumerate() {
            if words >> word & 1 == 0 {
                continue;
            }
            for index in 0..count {
                let inside = self.inside[index % SUBGROUPS];
                // SAFETY: the caller guarantees that the words were put.
                let kept = v.keep(unsafe { rows.get(v, index) }, inside);
                rows.put(v, index, kept);
            }
        }
    }
}

/// Where the number of a component comes from.
#[derive(Clone, Copy)]
pub(super) enum Source {
    Constant(u32),
    /// A word as it is.
    Word(u8),
    Fixed(Field),
    Half(Field),
    /// A byte of sRGB.
    Srgb(Field),
}

impl Source {
    /// That of a component of a view: its swizzle's. The format is not one that is decoded lane by
    /// lane.
    #[inline]
    pub fn of_view(info: &FormatInfo, decoder: Decoder, from: u8) -> Source {
        Source::of_swizzle(info, decoder, from, true)
    }

    /// The same in units (see [`block`](super::format::block)) where formats have some.
    pub fn units_of_view(info: &FormatInfo, decoder: Decoder, from: u8) -> Source {
        Source::of_swizzle(info, decoder, from, info.numeric == Numeric::Srgb)
    }

    fn of_swizzle(info: &FormatInfo, decoder: Decoder, from: u8, is_value: bool) -> Source {
        let component = match from {
            0..=3 => usize::from(from),
            4 => return Source::Constant(0),
            _ => return Source::Constant(info.missing(3)),
        };
        let channel = info.channels[component];
        if channel.bits == 0 {
            return Source::Constant(info.missing(component));
        }
        if decoder == Decoder::Words && channel.bits == 32 {
            return Source::Word(channel.offset / 32);
        }
        if decoder.is_expanded() || decoder == Decoder::Each {
            return Source::Word(component as u8);
        }
        let field = Field::of(info, component, is_value);
        match decoder {
            Decoder::Halves => Source::Half(field),
            Decoder::Srgb if component != 3 => Source::Srgb(field),
            _ => Source::Fixed(field),
        }
    }

    /// The number of the word that is looked at.
    pub fn word(&self) -> Option<usize> {
        match self {
            Source::Constant(_) => None,
            Source::Word(word) => Some(usize::from(word & 3)),
            Source::Fixed(field) | Source::Half(field) | Source::Srgb(field) => {
                Some(usize::from(field.word & 3))
            }
        }
    }
}

/// Fetches texels, expands those of compressed formats and shared exponents, and writes the wanted
/// components to the rows of results. Lanes without a texel get zeros.
///
/// # Safety
/// A texel, or a block, is readable at each offset in the image; the wave has the chunk's
/// subgroups, which are as many as have offsets and indices.
#[inline(always)]
pub(super) unsafe fn put<V: Vector>(
    v: V,
    image: &ImageDescriptor,
    info: &FormatInfo,
    wave: &Wave<'_>,
    texels: &mut Texels,
) {
    let count = wave.subgroups.len().min(SUBGROUPS);
    let decoder = Decoder::of(info);
    let is_expanded = decoder.is_expanded();
    let mut sources = [Source::Constant(0); 4];
    let (mut results, mut wanted) = (0, 0);
    for (component, source) in sources.iter_mut().enumerate() {
        if wave.results[component].first.is_null() {
            continue;
        }
        results |= 1 << component;
        *source = Source::of_view(info, decoder, image.swizzle[component]);
        if let Some(word) = source.word() {
            wanted |= 1 << word;
        }
    }
    let is_inside = texels.inside[..count]
        .iter()
        .all(|&inside| inside == u16::MAX);
    let direct = match is_inside && decoder == Decoder::Words {
        true => rows_of_words(&sources, results, wave),
        false => None,
    };
    // SAFETY: the caller keeps the contract of this function; words that are looked at were
    // fetched.
    unsafe {
        if wanted != 0 {
            let words = match direct {
                Some((rows, taken)) => {
                    results &= !taken;
                    rows
                }
                None => WordRows::of_chunk(texels.words.each_mut(), count),
            };
            v.apart(Fetch {
                base: image.data.cast_const(),
                readable: image.size_bytes,
                size_bytes: info.size_bytes,
                wanted: if is_expanded { 0xf } else { wanted },
                offsets: &texels.offsets,
                words,
            });
        }
        if is_expanded && wanted != 0 {
            v.apart(Expand {
                info,
                count,
                index: &texels.index,
                words: texels.words.each_mut(),
            });
        }
        if wanted != 0 && !is_inside {
            let words = if is_expanded { 0xf } else { wanted };
            texels.keep_inside(v, count, words);
        }
        if results != 0 {
            let words = sources.each_ref();
            let words = words.map(|source| &texels.words[source.word().unwrap_or(0)]);
            v.apart(Decode {
                sources: &sources,
                words,
                wave,
                wanted: results,
            });
        }
    }
}

/// Rows of results that take the words of texels as they are, and these results, a bit each: if
/// there is one for each word at most, and none takes parts of words.
#[inline(always)]
fn rows_of_words<'a>(
    sources: &[Source; 4],
    results: u8,
    wave: &Wave<'a>,
) -> Option<(WordRows<'a>, u8)> {
    let mut first = [std::ptr::null_mut::<Row>(); 4];
    let (mut taken, mut step_bytes) = (0, 0);
    for (component, source) in sources.iter().enumerate() {
        if results >> component & 1 == 0 {
            continue;
        }
        let rows = wave.results[component];
        match source {
            Source::Word(word) if first[usize::from(word & 3)].is_null() => {
                if taken != 0 && rows.step_bytes != step_bytes {
                    return None;
                }
                step_bytes = rows.step_bytes;
                first[usize::from(word & 3)] = rows.first;
                taken |= 1 << component;
            }
            Source::Constant(_) => {}
            _ => return None,
        }
    }
    let subgroups = &wave.subgroups[..wave.subgroups.len().min(SUBGROUPS)];
    let rows = WordRows {
        subgroups,
        first,
        step_bytes,
    };
    Some((rows, taken))
}

/// Texels that lie as those of pixels next to each other do: in a row, or in four quads as
/// [`QUADS`] has it.
struct Pattern<V: Vector> {
    /// Offsets from the first lane's.
    relative: V::I,
    /// Between the rows of quads; 0 of a row.
    stride_bytes: usize,
}

impl<V: Vector> Pattern<V> {
    /// That of the texels of a subgroup.
    #[inline(always)]
    fn of(v: V, places: &Row, size: u32) -> Option<Pattern<V>> {
        let offsets = v.sub_i(v.load_i(places), v.splat_i(places[0] as i32));
        let steps: Row = std::array::from_fn(|lane| lane as u32 * size);
        let relative = v.load_i(&steps);
        if size <= 4 && v.ne_i(offsets, relative) == 0 {
            return Some(Pattern {
                relative,
                stride_bytes: 0,
            });
        }
        let stride = places[2].wrapping_sub(places[0]);
        let columns = v.left_i(v.load_i(&QUADS[0]), size.trailing_zeros());
        let rows = v.mul_i(v.load_i(&QUADS[1]), v.splat_i(stride as i32));
        let relative = v.add_i(columns, rows);
        let has_stride = size >= 2 && (1..1 << 31).contains(&stride);
        if !has_stride || v.ne_i(offsets, relative) != 0 {
            return None;
        }
        Some(Pattern {
            relative,
            stride_bytes: stride as usize,
        })
    }

    #[inline(always)]
    fn has(&self, v: V, places: &Row) -> bool {
        let offsets = v.sub_i(v.load_i(places), v.splat_i(places[0] as i32));
        v.ne_i(offsets, self.relative) == 0
    }

    /// Words of one, two or four bytes.
    ///
    /// # Safety
    /// The pattern is that of readable texels of so many bytes, of which the first one is there.
    #[inline(always)]
    unsafe fn load<const SIZE: u32>(&self, v: V, first: *const u8) -> V::I {
        // SAFETY: the caller guarantees that the bytes are those of texels.
        unsafe {
            match (SIZE, self.stride_bytes) {
                (1, _) => {
                    let bytes = first.cast::<[u8; LANES]>().read_unaligned();
                    v.load_i(&map(&bytes, u32::from))
                }
                (2, 0) => {
                    let shorts = first.cast::<[u16; LANES]>().read_unaligned();
                    v.load_i(&map(&shorts, u32::from))
                }
                (2, stride) => v.load_quads_of_shorts(first, stride),
                (_, 0) => v.load_i(&first.cast::<Row>().read_unaligned()),
                (_, stride) => v.load_quads(first, stride),
            }
        }
    }
}

/// Where the words of a chunk's texels are put: rows by numbers of subgroups.
pub(super) struct WordRows<'a> {
    subgroups: &'a [u16],
    /// The rows of each word of subgroup 0; null if the word is not put anywhere.
    first: [*mut Row; 4],
    /// From a subgroup's row to the next one's.
    step_bytes: usize,
}

impl<'a> WordRows<'a> {
    /// The numbers of rows of a chunk.
    const ALL: [u16; SUBGROUPS] = {
        let mut numbers = [0; SUBGROUPS];
        let mut index = 0;
        while index < SUBGROUPS {
            numbers[index] = index as u16;
            index += 1;
        }
        numbers
    };

    #[inline(always)]
    pub fn of_chunk(words: [&'a mut ChunkRows; 4], count: usize) -> WordRows<'a> {
        WordRows {
            subgroups: &Self::ALL[..count],
            first: words.map(|rows| rows.0.as_mut_ptr().cast()),
            step_bytes: size_of::<Row>(),
        }
    }

    /// Puts the words of a subgroup, the first ones of four.
    ///
    /// # Safety
    /// There is such a subgroup, and it has a row of each word that is put somewhere.
    #[inline(always)]
    unsafe fn put<V: Vector, const WORDS: usize>(&self, v: V, index: usize, words: [V::I; WORDS]) {
        // SAFETY: the caller guarantees that there is such a subgroup, and that it has such rows.
        unsafe {
            let subgroup = *self.subgroups.get_unchecked(index);
            let behind = usize::from(subgroup) * self.step_bytes;
            for (first, words) in self.first.iter().zip(words) {
                if WORDS == 1 || !first.is_null() {
                    v.store_i(words, &mut *first.byte_add(behind));
                }
            }
        }
    }

    /// As [`Self::put`], of one word.
    ///
    /// # Safety
    /// As there; the word is put somewhere.
    #[inline(always)]
    unsafe fn put_word<V: Vector>(&self, v: V, index: usize, word: usize, words: V::I) {
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            let subgroup = *self.subgroups.get_unchecked(index);
            let behind = usize::from(subgroup) * self.step_bytes;
            v.store_i(words, &mut *self.first[word & 3].byte_add(behind));
        }
    }
}

/// Fetches the wanted words of texels.
pub(super) struct Fetch<'a> {
    pub base: *const u8,
    /// Bytes behind that.
    pub readable: u64,
    pub size_bytes: u8,
    /// A bit a word.
    pub wanted: u8,
    pub offsets: &'a ChunkRows,
    pub words: WordRows<'a>,
}

impl Fetch<'_> {
    /// Texels of one word.
    ///
    /// # Safety
    /// As [`put`].
    #[inline(always)]
    unsafe fn single<V: Vector, const SIZE: u32>(self, v: V) {
        let (base, offsets, words_of_all) = (self.base, self.offsets, self.words);
        let mut has_windows = V::HAS_WINDOWS;
        // SAFETY: the caller keeps the contract of `put`.
        unsafe {
            let pattern = Pattern::of(v, offsets.row(0), SIZE);
            for index in 0..words_of_all.subgroups.len() {
                let places = offsets.row(index);
                let words = match &pattern {
                    Some(pattern) if pattern.has(v, places) => {
                        pattern.load::<SIZE>(v, base.add(places[0] as usize))
                    }
                    _ => {
                        let near = match has_windows {
                            true => v.words_in_windows::<SIZE>(base, places, self.readable),
                            false => None,
                        };
                        // Not tried again where it is in vain.
                        has_windows &= near.is_some();
                        match (near, SIZE) {
                            (Some(words), _) => words,
                            (None, 1) => v.scalars_at::<u8>(base, places),
                            (None, 2) => v.scalars_at::<u16>(base, places),
                            _ => v.words_at(base, places),
                        }
                    }
                };
                words_of_all.put(v, index, [words]);
            }
        }
    }
}

impl<V: Vector> Task<V> for Fetch<'_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (base, wanted) = (self.base, self.wanted);
        let count = self.words.subgroups.len();
        // SAFETY: the caller keeps the contract of `put`; each access lies inside the texel.
        unsafe {
            match self.size_bytes {
                1 => return self.single::<V, 1>(v),
                2 => return self.single::<V, 2>(v),
                4 => return self.single::<V, 4>(v),
                _ => {}
            }
            let (offsets, words) = (self.offsets, self.words);
            match self.size_bytes {
                8 | 16 if wanted.count_ones() == 1 => {
                    let word = wanted.trailing_zeros() as usize & 3;
                    let base = base.add(4 * word);
                    for index in 0..count {
                        let of_lanes = v.words_at(base, offsets.row(index));
                        words.put_word(v, index, word, of_lanes);
                    }
                }
                8 => {
                    let pattern = Pattern::of(v, offsets.row(0), 8);
                    for index in 0..count {
                        let places = offsets.row(index);
                        let (a, b) = match &pattern {
                            Some(pattern) if pattern.has(v, places) => {
                                let first = base.add(places[0] as usize);
                                v.load_quads_of_pairs(first, pattern.stride_bytes)
                            }
                            _ => v.pairs_at(base, places),
                        };
                        words.put(v, index, [a, b]);
                    }
                }
                16 => {
                    for index in 0..count {
                        words.put(v, index, v.quads_at(base, offsets.row(index)));
                    }
                }
                3 => {
                    for index in 0..count {
                        let places = offsets.row(index);
                        let low = v.scalars_at::<u16>(base, places);
                        let high = v.scalars_at::<u8>(base.add(2), places);
                        words.put(v, index, [v.or_i(low, v.left_i(high, 16))]);
                    }
                }
                6 => {
                    for index in 0..count {
                        let places = offsets.row(index);
                        let low = v.words_at(base, places);
                        let high = v.scalars_at::<u16>(base.add(4), places);
                        words.put(v, index, [low, high]);
                    }
                }
                _ => {
                    for index in 0..count {
                        let places = offsets.row(index);
                        let (a, b) = v.pairs_at(base, places);
                        words.put(v, index, [a, b, v.words_at(base.add(8), places)]);
                    }
                }
            }
        }
    }
}

/// Decodes the words of texels to a word a component.
pub(super) struct Expand<'a> {
    pub info: &'a FormatInfo,
    pub count: usize,
    /// Of texels in blocks.
    pub index: &'a ChunkRows,
    pub words: [&'a mut ChunkRows; 4],
}

impl<V: Vector> Task<V> for Expand<'_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let info = self.info;
        let decoder = Decoder::of(info);
        let size_bytes = info.size_bytes;
        let [a, b, c, d] = self.words;
        for subgroup in 0..self.count {
            let zero = v.splat_i(0);
            let mut words = [zero; 4];
            let mut index = zero;
            // SAFETY: the caller guarantees that the words of texels of such a size were fetched,
            // and that texels in blocks have indices.
            unsafe {
                words[0] = a.get(v, subgroup);
                if size_bytes >= 8 {
                    words[1] = b.get(v, subgroup);
                }
                if size_bytes == 16 {
                    words[2] = c.get(v, subgroup);
                    words[3] = d.get(v, subgroup);
                }
                if decoder != Decoder::SharedExponent {
                    index = self.index.get(v, subgroup);
                }
            }
            let numbers = expand(v, info, decoder, words, index);
            a.put(v, subgroup, v.bits_of(numbers[0]));
            b.put(v, subgroup, v.bits_of(numbers[1]));
            c.put(v, subgroup, v.bits_of(numbers[2]));
            d.put(v, subgroup, v.bits_of(numbers[3]));
        }
    }
}

/// Writes components of a chunk's texels to the rows of results: of each wanted one its source, and
/// the words of the texels that it is from.
pub(super) struct Decode<'a, 'b> {
    pub sources: &'a [Source; 4],
    pub words: [&'a ChunkRows; 4],
    pub wave: &'a Wave<'b>,
    /// A bit for each component.
    pub wanted: u8,
}

impl<V: Vector> Task<V> for Decode<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (sources, words, wanted) = (&{ *self.sources }, self.words, self.wanted);
        let wave = &{ *self.wave };
        let count = wave.subgroups.len().min(SUBGROUPS);
        // SAFETY: the caller guarantees that the words were fetched, and that the wave has such
        // rows of each of its subgroups.
        unsafe {
            // Other tiers lack registers for the constants of four fields.
            if V::TIER == Tier::Avx512
                && wanted == 0xf
                && let Some(fields) = unsigned_fields(sources)
            {
                for index in 0..count {
                    let numbers = [
                        fields[0].unsigned(v, words[0].get(v, index)),
                        fields[1].unsigned(v, words[1].get(v, index)),
                        fields[2].unsigned(v, words[2].get(v, index)),
                        fields[3].unsigned(v, words[3].get(v, index)),
                    ];
                    wave.put_all(v, index, numbers);
                }
                return;
            }
            for (component, (source, words)) in sources.iter().zip(words).enumerate() {
                if wanted >> component & 1 == 1 {
                    decode(v, source, words, wave, (component, count));
                }
            }
        }
    }
}

/// The fields of four numbers, if all are codes without signs over their greatest values.
#[inline(always)]
fn unsigned_fields(sources: &[Source; 4]) -> Option<[&Field; 4]> {
    match sources {
        [
            Source::Fixed(a),
            Source::Fixed(b),
            Source::Fixed(c),
            Source::Fixed(d),
        ] => {
            let fields = [a, b, c, d];
            fields
                .iter()
                .all(|field| field.is_unsigned())
                .then_some(fields)
        }
        _ => None,
    }
}

/// Writes a component of so many subgroups.
///
/// # Safety
/// The words were fetched, and the wave has a row of the result for each of the subgroups.
#[inline(always)]
unsafe fn decode<V: Vector>(
    v: V,
    source: &Source,
    words: &ChunkRows,
    wave: &Wave<'_>,
    (component, count): (usize, usize),
) {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        match *source {
            Source::Constant(word) => {
                let word = v.splat_i(word as i32);
                for index in 0..count {
                    wave.put_component(v, index, component, word);
                }
            }
            Source::Word(_) => {
                for index in 0..count {
                    wave.put_component(v, index, component, words.get(v, index));
                }
            }
            Source::Fixed(field) if field.is_integer => {
                for index in 0..count {
                    let code = field.code(v, words.get(v, index));
                    wave.put_component(v, index, component, code);
                }
            }
            Source::Fixed(field) if field.is_unsigned() => {
                for index in 0..count {
                    let number = field.unsigned(v, words.get(v, index));
                    wave.put_component(v, index, component, v.bits_of(number));
                }
            }
            Source::Fixed(field) => {
                for index in 0..count {
                    let number = field.fixed(v, words.get(v, index));
                    wave.put_component(v, index, component, v.bits_of(number));
                }
            }
            Source::Half(field) => {
                for index in 0..count {
                    let number = field.half(v, words.get(v, index), true);
                    wave.put_component(v, index, component, v.bits_of(number));
                }
            }
            Source::Srgb(field) => {
                let mut offsets = ChunkRows::new();
                for index in 0..count {
                    let code = field.code(v, words.get(v, index));
                    offsets.put(v, index, v.left_i(code, 2));
                }
                let table = srgb::LINEAR.words().as_ptr().cast();
                for index in 0..count {
                    let linear = v.words_at(table, offsets.row(index));
                    wave.put_component(v, index, component, linear);
                }
            }
        }
    }
}
