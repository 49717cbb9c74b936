//! Steps of samples of the texels around places: where these are, and their words. There are two,
//! four or eight.

use lanes::LANES;
use lanes::vector::{Task, Vector};

use super::super::AddressMode;
use super::super::chunk::{ChunkRows, SUBGROUPS};
use super::super::cube;
use super::super::format::FormatInfo;
use super::super::format::block;
use super::super::format::layout::{BLOCK_INDEX_SHIFT, Codec};
use super::super::rows::Wave;
use super::Fast;
use super::axis::Along;
use super::levels::LevelRows;
use super::places::Places;

/// Most texels of a sample.
const MOST: usize = 8;

impl Fast<'_> {
    /// The size of an axis of the base level, and the bytes between its texels or blocks.
    #[inline(always)]
    pub(super) fn extent_of_first<V: Vector>(&self, v: V, axis: usize) -> (V::I, V::I) {
        let level = &self.image.levels[0];
        let (size, stride) = match axis {
            0 => (level.width, u64::from(self.info.size_bytes)),
            1 => (level.height, level.row_stride_bytes),
            _ => (level.depth, level.slice_stride_bytes),
        };
        (v.splat_i(size as i32), v.splat_i(stride as i32))
    }

    /// The same, of levels that were put, if the image has several.
    ///
    /// # Safety
    /// They were.
    #[inline(always)]
    unsafe fn extent<V: Vector>(
        &self,
        v: V,
        levels: Option<&LevelRows>,
        index: usize,
        axis: usize,
    ) -> (V::I, V::I) {
        match levels {
            // SAFETY: the caller guarantees that the levels were put.
            Some(levels) => unsafe {
                let texel_bytes = v.splat_i(self.info.size_bytes as i32);
                levels.extent(v, index, axis, texel_bytes)
            },
            None => self.extent_of_first(v, axis),
        }
    }

    /// Whether four bytes a texel are blended as they are fetched.
    #[inline(always)]
    pub(super) fn blends_bytes(&self) -> bool {
        let is_plain = self.spatial == 2 && !self.has_border;
        match self.info.codec {
            Codec::Srgb8Rgba | Codec::Srgb8Bgra => is_plain,
            _ => is_plain && self.straight && !self.is_cube,
        }
    }

    /// Binary logarithm of the texels of a block along an axis.
    #[inline(always)]
    pub(super) fn block_shift(&self, axis: usize) -> u32 {
        match axis {
            0 | 1 => self.block_shift,
            _ => 0,
        }
    }

    #[inline(always)]
    pub(super) fn mode(&self, axis: usize) -> AddressMode {
        match self.is_cube {
            true => AddressMode::ClampToEdge,
            false => self.sampler.address_mode[axis % 3],
        }
    }

    /// The byte offsets of a subgroup's levels.
    ///
    /// # Safety
    /// Levels were put, if the image has several.
    #[inline(always)]
    unsafe fn level_offset<V: Vector>(
        &self,
        v: V,
        levels: Option<&LevelRows>,
        index: usize,
    ) -> V::I {
        match levels {
            // SAFETY: the caller guarantees that the levels were put.
            Some(levels) => unsafe { levels.offsets.get(v, index) },
            None => v.splat_i(self.image.levels[0].offset_bytes as i32),
        }
    }

    /// The byte offset that a subgroup's texels have in common: its layers', and its levels'.
    ///
    /// # Safety
    /// Places were put if the image has layers, and levels if it has several.
    #[inline(always)]
    pub(super) unsafe fn first_texel<V: Vector>(
        &self,
        v: V,
        places: &Places,
        levels: Option<&LevelRows>,
        index: usize,
    ) -> V::I {
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            let level = self.level_offset(v, levels, index);
            match self.has_layers() {
                true => v.add_i(level, places.layers.get(v, index)),
                false => level,
            }
        }
    }
}

/// The texels around lanes' places: of each slice the left one and the right one of the upper line,
/// then those of the lower line.
pub(super) struct Taps {
    /// Byte offsets of the two texels along each axis.
    along: [[ChunkRows; 2]; 3],
    /// In blocks: the indices of the two texels along x and y. On cubes: the first one's, before it
    /// is brought onto the face.
    at: [[ChunkRows; 2]; 2],
    /// Of the second texels.
    pub weights: [ChunkRows; 3],
    /// Lanes whose two texels along an axis are none of the border's.
    inside: [[[u16; 2]; 3]; SUBGROUPS],
    /// A bit for each subgroup whose lanes have both texels of an axis inside, one behind the
    /// other.
    pub inner: [u16; 3],
    /// A bit for each subgroup with texels past a corner of a cube, and their lanes.
    pub corners: u16,
    pub past_corner: [[u16; 4]; SUBGROUPS],
    offsets: [ChunkRows; MOST],
    /// In blocks: the texels' indices in these.
    index: [ChunkRows; MOST],
    /// The words of each texel.
    pub words: [[ChunkRows; MOST]; 4],
}

impl Taps {
    #[inline(always)]
    pub fn new() -> Taps {
        Taps {
            along: [const { [const { ChunkRows::new() }; 2] }; 3],
            at: [const { [const { ChunkRows::new() }; 2] }; 2],
            weights: [const { ChunkRows::new() }; 3],
            inside: [[[u16::MAX; 2]; 3]; SUBGROUPS],
            inner: [u16::MAX; 3],
            corners: 0,
            past_corner: [[0; 4]; SUBGROUPS],
            offsets: [const { ChunkRows::new() }; MOST],
            index: [const { ChunkRows::new() }; MOST],
            words: [const { [const { ChunkRows::new() }; MOST] }; 4],
        }
    }

    /// A bit for each subgroup whose lanes have right texels behind left ones; on cubes, of which
    /// all texels lie on the faces of the places.
    #[inline(always)]
    pub fn in_pairs(&self, fast: &Fast<'_>) -> u16 {
        match fast.is_cube {
            true => self.inner[0] & self.inner[1],
            false => self.inner[0],
        }
    }

    /// The lanes of a subgroup whose texel is none of the border's.
    #[inline(always)]
    pub fn inside(&self, index: usize, tap: usize) -> u16 {
        let [x, y, z] = self.inside[index % SUBGROUPS];
        x[tap & 1] & y[tap >> 1 & 1] & z[tap >> 2 & 1]
    }

    /// The byte offsets of a texel.
    ///
    /// # Safety
    /// They were put.
    #[inline(always)]
    pub unsafe fn offset<V: Vector>(&self, v: V, index: usize, tap: usize) -> V::I {
        // SAFETY: the caller guarantees that the offsets were put.
        unsafe { self.offsets[tap].get(v, index) }
    }
}

/// Ways of [`PlaceAlong`]. Without offsets, borders and blocks: on the base level, or on any.
pub(super) const LEAN: u8 = 0;
pub(super) const LEAN_OF_LEVELS: u8 = 1;
pub(super) const ANY: u8 = 2;

/// Places the two texels around places along an axis.
pub(super) struct PlaceAlong<'a, 'b, const WAY: u8> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub places: &'b Places,
    pub levels: Option<&'b LevelRows>,
    pub axis: usize,
    pub taps: &'b mut Taps,
}

impl<V: Vector, const WAY: u8> Task<V> for PlaceAlong<'_, '_, WAY> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, wave) = (&{ *self.fast }, &{ *self.wave });
        let (places, axis, mode) = (self.places, self.axis, fast.mode(self.axis));
        let is_lean = WAY != ANY;
        let block_shift = if is_lean { 0 } else { fast.block_shift(axis) };
        let Taps {
            along,
            at: indices,
            weights,
            inside,
            inner: inner_of,
            ..
        } = self.taps;
        let [firsts, seconds] = &mut along[axis];
        let (weights, indices) = (&mut weights[axis], &mut indices[axis & 1]);
        let mut inner = 0;
        macro_rules! each {
            (|$index:ident, $mask:ident| $extent:expr, $looked_at:expr) => {
                for $index in 0..wave.subgroups.len() {
                    // SAFETY: the caller keeps the contract of `Fast::sample`; coordinates and
                    // levels were put.
                    unsafe {
                        let at = v.load(places.coordinate(wave, $index, axis));
                        let offset = match !is_lean && fast.op.has_offset {
                            true => Some(v.load_i(wave.offset(fast.op, $index, axis))),
                            false => None,
                        };
                        let $mask = wave.mask($index);
                        let (size, stride) = $extent;
                        let along = Along {
                            size,
                            stride,
                            block_shift,
                            looked_at: $looked_at,
                        };
                        let footprint = fast.axis(v, mode, (at, offset), along);
                        firsts.put(v, $index, footprint.offsets[0]);
                        seconds.put(v, $index, footprint.offsets[1]);
                        weights.put(v, $index, v.bits_of(footprint.weight));
                        inner |= u16::from(footprint.is_inner) << ($index % SUBGROUPS);
                        if fast.is_cube {
                            indices[0].put(v, $index, footprint.at);
                        }
                        if !is_lean && fast.has_border {
                            inside[$index % SUBGROUPS][axis] = footprint.inside;
                        }
                        if !is_lean && block_shift != 0 {
                            let [first, second] = footprint.index;
                            if !fast.is_cube {
                                indices[0].put(v, $index, first);
                            }
                            indices[1].put(v, $index, second);
                        }
                    }
                }
            };
        }
        let extent = fast.extent_of_first(v, axis);
        match self.levels {
            Some(levels) if WAY != LEAN => {
                let texel_bytes = v.splat_i(fast.info.size_bytes as i32);
                each!(
                    |index, mask| levels.extent(v, index, axis, texel_bytes),
                    levels.looked_at(index, mask)
                );
            }
            _ if WAY == LEAN_OF_LEVELS => {}
            _ => each!(|index, mask| extent, mask),
        }
        inner_of[axis] = inner;
    }
}

/// Offsets along the axes to those of the texels, of one, two or three dimensions.
pub(super) struct Combine<'a, 'b, const DIMENSIONS: usize> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub places: &'b Places,
    pub levels: Option<&'b LevelRows>,
    pub taps: &'b mut Taps,
}

impl<V: Vector, const DIMENSIONS: usize> Task<V> for Combine<'_, '_, DIMENSIONS> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let (fast, wave) = (&{ *self.fast }, &{ *self.wave });
        let (places, levels) = (self.places, self.levels);
        let Taps {
            along: [x, y, z],
            offsets,
            ..
        } = self.taps;
        for index in 0..wave.subgroups.len() {
            // SAFETY: the caller guarantees that all axes were placed.
            unsafe {
                let base = fast.first_texel(v, places, levels, index);
                let [left, right] = [x[0].get(v, index), x[1].get(v, index)];
                let [upper, lower] = match DIMENSIONS {
                    1 => [base; 2],
                    _ => [
                        v.add_i(base, y[0].get(v, index)),
                        v.add_i(base, y[1].get(v, index)),
                    ],
                };
                let four = [
                    v.add_i(upper, left),
                    v.add_i(upper, right),
                    v.add_i(lower, left),
                    v.add_i(lower, right),
                ];
                if DIMENSIONS != 3 {
                    put_four(v, offsets, index, 0, four);
                    continue;
                }
                for slice in [0, 1] {
                    let slice_offset = z[slice].get(v, index);
                    let of_slice = [
                        v.add_i(four[0], slice_offset),
                        v.add_i(four[1], slice_offset),
                        v.add_i(four[2], slice_offset),
                        v.add_i(four[3], slice_offset),
                    ];
                    put_four(v, offsets, index, 4 * slice, of_slice);
                }
            }
        }
    }
}

/// Puts offsets of the texels of a slice, of which the first one has a number.
#[inline(always)]
fn put_four<V: Vector>(
    v: V,
    offsets: &mut [ChunkRows; MOST],
    index: usize,
    first: usize,
    [a, b, c, d]: [V::I; 4],
) {
    offsets[first].put(v, index, a);
    offsets[first + 1].put(v, index, b);
    offsets[first + 2].put(v, index, c);
    offsets[first + 3].put(v, index, d);
}

/// Puts the indices of texels in their blocks.
pub(super) struct PlaceInBlocks<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub taps: &'b mut Taps,
}

impl<V: Vector> Task<V> for PlaceInBlocks<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let Taps {
            at: [x, y], index, ..
        } = self.taps;
        for tap in 0..4 * self.fast.slices() {
            for subgroup in 0..self.wave.subgroups.len() {
                // SAFETY: the caller guarantees that all axes were placed.
                unsafe {
                    let x = x[tap & 1].get(v, subgroup);
                    let y = match self.fast.spatial {
                        1 => v.splat_i(0),
                        _ => y[tap >> 1 & 1].get(v, subgroup),
                    };
                    index[tap % MOST].put(v, subgroup, index_in_block(v, x, y));
                }
            }
        }
    }
}

/// Places the texels of a subgroup on a cube, of which some lie on other faces than their lanes'
/// places.
pub(super) struct PlaceAcrossEdges<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub places: &'b Places,
    pub levels: Option<&'b LevelRows>,
    pub taps: &'b mut Taps,
    pub index: usize,
}

impl<V: Vector> Task<V> for PlaceAcrossEdges<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let PlaceAcrossEdges {
            fast,
            places,
            levels,
            taps,
            index,
        } = self;
        let one = v.splat_i(1);
        let last_layer = v.splat_i(fast.image.layer_count.max(1) as i32 - 1);
        let layer_bytes = v.splat_i(fast.image.layer_stride_bytes as i32);
        // SAFETY: the caller guarantees that both axes were placed.
        unsafe {
            let (width, texel_bytes) = fast.extent(v, levels, index, 0);
            let (height, row_bytes) = fast.extent(v, levels, index, 1);
            let last_row = v.sub_i(height, one);
            let level = fast.level_offset(v, levels, index);
            let face = places.faces.get(v, index);
            let first_face = places.first_faces.get(v, index);
            let first = [taps.at[0][0].get(v, index), taps.at[1][0].get(v, index)];
            for tap in 0..4 {
                let mut at = first;
                if tap & 1 != 0 {
                    at[0] = v.add_i(at[0], one);
                }
                if tap >> 1 != 0 {
                    at[1] = v.add_i(at[1], one);
                }
                // Coordinates lie on their faces, so a footprint crosses an edge by one texel; NaN
                // excepted.
                let x = v.max_i(v.min_i(at[0], width), v.splat_i(-1));
                let y = v.max_i(v.min_i(at[1], width), v.splat_i(-1));
                let ([x, y, face], past) = cube::wrap_edges_in_vectors(v, [x, y, face], width);
                taps.past_corner[index % SUBGROUPS][tap] = past;
                if past != 0 {
                    taps.corners |= 1 << (index % SUBGROUPS);
                }
                let layer = v.min_i(v.add_i(first_face, face), last_layer);
                let y = v.min_i(y, last_row);
                let (mut column, mut row) = (x, y);
                if fast.block_shift != 0 {
                    column = v.right_u(x, fast.block_shift);
                    row = v.right_u(y, fast.block_shift);
                    taps.index[tap].put(v, index, index_in_block(v, x, y));
                }
                let offset = v.add_i(level, v.mul_i(layer, layer_bytes));
                let offset = v.add_i(offset, v.mul_i(row, row_bytes));
                let offset = v.add_i(offset, v.mul_i(column, texel_bytes));
                taps.offsets[tap].put(v, index, offset);
            }
        }
    }
}

/// A texel's index in a block of four by four.
#[inline(always)]
pub(crate) fn index_in_block<V: Vector>(v: V, x: V::I, y: V::I) -> V::I {
    let three = v.splat_i(3);
    v.add_i(v.and_i(x, three), v.left_i(v.and_i(y, three), 2))
}

/// Fetches a word of texels of one, two, four, eight or sixteen bytes.
pub(super) struct FetchPairs<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub word: usize,
    pub taps: &'b mut Taps,
}

impl<V: Vector> Task<V> for FetchPairs<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let fast = self.fast;
        let in_pairs = self.taps.in_pairs(fast);
        let Taps { offsets, words, .. } = self.taps;
        // SAFETY: the word is one of the texels'; the image's memory is allocated.
        let base = unsafe { fast.image.data.cast_const().add(4 * self.word) };
        let words = &mut words[self.word & 3];
        for slice in 0..fast.slices() {
            let offsets = &offsets.as_chunks::<4>().0[slice & 1];
            let words = &mut words.as_chunks_mut::<4>().0[slice & 1];
            macro_rules! each {
                (|$places:ident| $pair:expr, $single:expr) => {
                    for index in 0..self.wave.subgroups.len() {
                        let is_pair = in_pairs >> (index % SUBGROUPS) & 1 == 1;
                        for left in [0, 2] {
                            // SAFETY: the caller guarantees that all texels were placed, in the
                            // image.
                            let (first, second) = unsafe {
                                let $places = offsets[left].row(index);
                                match is_pair {
                                    true => $pair,
                                    false => {
                                        let first = $single;
                                        let $places = offsets[left + 1].row(index);
                                        (first, $single)
                                    }
                                }
                            };
                            words[left].put(v, index, first);
                            words[left + 1].put(v, index, second);
                        }
                    }
                };
            }
            match fast.info.size_bytes {
                1 => each!(
                    |places| {
                        let both = v.scalars_at::<u16>(base, places);
                        (both, v.right_u(both, 8))
                    },
                    v.scalars_at::<u8>(base, places)
                ),
                2 => each!(
                    |places| {
                        let both = v.words_at(base, places);
                        (both, v.right_u(both, 16))
                    },
                    v.scalars_at::<u16>(base, places)
                ),
                4 => {
                    let readable = fast.image.size_bytes;
                    let mut has_windows = V::HAS_WINDOWS;
                    each!(
                        |places| {
                            let near = match has_windows {
                                true => v.pairs_in_windows(base, places, readable),
                                false => None,
                            };
                            has_windows &= near.is_some();
                            match near {
                                Some(pairs) => pairs,
                                None => v.pairs_at(base, places),
                            }
                        },
                        v.words_at(base, places)
                    );
                }
                size => each!(
                    |places| {
                        let left = v.words_at(base, places);
                        (left, v.words_at(base.add(usize::from(size)), places))
                    },
                    v.words_at(base, places)
                ),
            }
        }
    }
}

/// Fetches both words of texels of eight bytes.
pub(super) struct FetchBoth<'a, 'b> {
    pub fast: &'b Fast<'a>,
    pub wave: &'b Wave<'b>,
    pub taps: &'b mut Taps,
}

impl<V: Vector> Task<V> for FetchBoth<'_, '_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let fast = self.fast;
        let in_pairs = self.taps.in_pairs(fast);
        let Taps {
            offsets,
            words: [firsts, seconds, ..],
            ..
        } = self.taps;
        let data = fast.image.data.cast_const();
        for slice in 0..fast.slices() {
            let offsets = &offsets.as_chunks::<4>().0[slice & 1];
            let firsts = &mut firsts.as_chunks_mut::<4>().0[slice & 1];
            let seconds = &mut seconds.as_chunks_mut::<4>().0[slice & 1];
            for index in 0..self.wave.subgroups.len() {
                let is_pair = in_pairs >> (index % SUBGROUPS) & 1 == 1;
                for left in [0, 2] {
                    // SAFETY: the caller guarantees that all texels were placed, in the image.
                    let [a, b, c, d] = unsafe {
                        let places = offsets[left].row(index);
                        match is_pair {
                            true => v.quads_at(data, places),
                            false => {
                                let (a, b) = v.pairs_at(data, places);
                                let (c, d) = v.pairs_at(data, offsets[left + 1].row(index));
                                [a, b, c, d]
                            }
                        }
                    };
                    firsts[left].put(v, index, a);
                    seconds[left].put(v, index, b);
                    firsts[left + 1].put(v, index, c);
                    seconds[left + 1].put(v, index, d);
                }
            }
        }
    }
}

impl Taps {
    /// The words of the four texels of a subgroup, of four bytes each.
    ///
    /// # Safety
    /// As [`Fast::sample`]; the texels were placed.
    #[inline(always)]
    pub unsafe fn four_words<V: Vector>(
        &self,
        v: V,
        fast: &Fast<'_>,
        index: usize,
        has_windows: &mut bool,
    ) -> [V::I; 4] {
        let data = fast.image.data.cast_const();
        let in_pairs = self.in_pairs(fast) >> (index % SUBGROUPS) & 1;
        let readable = fast.image.size_bytes;
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            if in_pairs == 1 {
                if V::HAS_WINDOWS && *has_windows {
                    let upper = v.pairs_in_windows(data, self.offsets[0].row(index), readable);
                    let lower = v.pairs_in_windows(data, self.offsets[2].row(index), readable);
                    if let (Some((a, b)), Some((c, d))) = (upper, lower) {
                        return [a, b, c, d];
                    }
                    // Not tried again where it is in vain.
                    *has_windows = false;
                }
                let (a, b) = v.pairs_at(data, self.offsets[0].row(index));
                let (c, d) = v.pairs_at(data, self.offsets[2].row(index));
                return [a, b, c, d];
            }
            [
                v.words_at(data, self.offsets[0].row(index)),
                v.words_at(data, self.offsets[1].row(index)),
                v.words_at(data, self.offsets[2].row(index)),
                v.words_at(data, self.offsets[3].row(index)),
            ]
        }
    }
}

/// A texel of those around places: its offsets and its words.
pub(super) struct Tap<'b> {
    pub offsets: &'b ChunkRows,
    pub index: &'b ChunkRows,
    pub words: [&'b mut ChunkRows; 4],
}

impl Taps {
    #[inline(always)]
    pub fn tap(&mut self, tap: usize) -> Tap<'_> {
        let [a, b, c, d] = &mut self.words;
        let tap = tap % MOST;
        Tap {
            offsets: &self.offsets[tap],
            index: &self.index[tap],
            words: [&mut a[tap], &mut b[tap], &mut c[tap], &mut d[tap]],
        }
    }
}

/// Loads texels of formats that are decoded lane by lane, in units.
pub(super) struct LoadEach<'a> {
    pub info: &'a FormatInfo,
    pub base: *const u8,
    pub count: usize,
    pub texel: Tap<'a>,
}

impl<V: Vector> Task<V> for LoadEach<'_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run(self, v: V) {
        let info = self.info;
        let Tap {
            offsets,
            index: in_blocks,
            words: [a, b, c, d],
        } = self.texel;
        for index in 0..self.count {
            // SAFETY: the caller guarantees that the offsets are of texels, and that texels in
            // blocks have indices.
            let texels = unsafe {
                let places = offsets.row(index);
                let mut addresses = [0u64; LANES];
                for lane in 0..LANES {
                    addresses[lane] = places[lane] as u64;
                }
                if info.blocks().is_some() {
                    let indices = in_blocks.row(index);
                    for lane in 0..LANES {
                        addresses[lane] |= (indices[lane] as u64) << BLOCK_INDEX_SHIFT;
                    }
                }
                block::load(info, self.base, &addresses)
            };
            a.put(v, index, v.load_i(&texels[0]));
            b.put(v, index, v.load_i(&texels[1]));
            c.put(v, index, v.load_i(&texels[2]));
            d.put(v, index, v.load_i(&texels[3]));
        }
    }
}
