//! Texels of sixteen pixels, as words: loaded from an attachment and stored to it.

use lanes::quad as axis;
use lanes::vector::{Task, Vector};

use super::lanes::{BY_ROWS, IN_BLOCK, IN_ROW, Row, load_words, row_of, rows_of};
use crate::raster::Target;
use crate::raster::primitive::Bounds;

/// How sixteen pixels lie.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pattern {
    /// One behind the other, from the first place on; the other places do not matter.
    Row,
    /// A 4×4 block: quads row by row.
    Block,
    /// Quads anywhere.
    Inside,
    /// Quads anywhere, of which some are outside in part.
    #[default]
    Quads,
}

/// Where sixteen pixels are.
#[derive(Clone, Copy, Debug, Default)]
pub struct Places {
    /// The first pixel of each quad, in the attachments.
    pub x: [i32; 4],
    pub y: [i32; 4],
    pub layer: [u32; 4],
    /// Other patterns than [`Pattern::Quads`] lie entirely in the render area.
    pub pattern: Pattern,
}

impl Places {
    /// Those of the 4×4 block at (x, y).
    #[inline(always)]
    pub fn block([x, y]: [i32; 2], layer: u32, area: &Bounds) -> Self {
        let is_inside =
            x >= area.left && y >= area.top && x + 4 <= area.right && y + 4 <= area.bottom;
        Self {
            x: [x, x + 2, x, x + 2],
            y: [y, y, y + 2, y + 2],
            layer: [layer; 4],
            pattern: match is_inside {
                true => Pattern::Block,
                false => Pattern::Quads,
            },
        }
    }

    /// Sixteen pixels of a row, from (x, y) on, in the render area.
    #[inline(always)]
    pub fn row(x: i32, y: i32, layer: u32) -> Self {
        Self {
            x: [x; 4],
            y: [y; 4],
            layer: [layer; 4],
            pattern: Pattern::Row,
        }
    }
}

/// The texels of an attachment, up to four words each.
pub type TexelWords = [Row; 4];

/// The first byte of a quad's texels.
#[inline(always)]
pub(super) fn quad(target: &Target, places: &Places, quad: usize, sample: u32) -> *mut u8 {
    let slice = target.first_layer + places.layer[quad];
    let (x, y) = (places.x[quad] as u32, places.y[quad] as u32);
    target.surface.texel(x, y, slice, sample)
}

/// A texel as words of 32 bits.
trait Texel: Copy + Default {
    const WORDS: usize;
    fn word(self, index: usize) -> u32;
    fn from_words(words: [u32; 4]) -> Self;
}

macro_rules! small_texel {
    ($($ty:ty),*) => {$(
        impl Texel for $ty {
            const WORDS: usize = 1;

            #[inline(always)]
            fn word(self, _: usize) -> u32 {
                self as u32
            }

            #[inline(always)]
            fn from_words(words: [u32; 4]) -> Self {
                words[0] as $ty
            }
        }
    )*};
}

small_texel!(u8, u16, u32);

macro_rules! large_texel {
    ($($words:literal),*) => {$(
        impl Texel for [u32; $words] {
            const WORDS: usize = $words;

            #[inline(always)]
            fn word(self, index: usize) -> u32 {
                self[index]
            }

            #[inline(always)]
            fn from_words(words: [u32; 4]) -> Self {
                let mut texel = [0; $words];
                texel.copy_from_slice(&words[..$words]);
                texel
            }
        }
    )*};
}

large_texel!(2, 3, 4);

/// # Safety
/// As [`load`].
#[inline(always)]
unsafe fn load_as<T: Texel>(
    target: &Target,
    places: &Places,
    sample: u32,
    mask: u16,
) -> TexelWords {
    let stride = target.surface.row_stride_bytes as usize;
    let mut texels = [T::default(); 16];
    // SAFETY: texels of pixels of the mask, or of a block that is inside the render area; those are
    // in the attachment.
    unsafe {
        if places.pattern == Pattern::Row {
            let first = quad(target, places, 0, sample);
            texels = first.cast::<[T; 16]>().read_unaligned();
        } else if places.pattern == Pattern::Block {
            let first = quad(target, places, 0, sample);
            let mut rows = [T::default(); 16];
            for row in 0..4 {
                let texels = first.add(row * stride).cast::<[T; 4]>().read_unaligned();
                rows[4 * row..4 * row + 4].copy_from_slice(&texels);
            }
            for lane in 0..16 {
                texels[lane] = rows[BY_ROWS[lane]];
            }
        } else {
            for index in 0..4 {
                let lanes = mask >> (4 * index) & 0xf;
                if lanes == 0 {
                    continue;
                }
                let first = quad(target, places, index, sample).cast::<T>();
                let second = first.cast::<u8>().add(stride).cast::<T>();
                let texels = &mut texels[4 * index..4 * index + 4];
                if lanes == 0xf {
                    texels[..2].copy_from_slice(&first.cast::<[T; 2]>().read_unaligned());
                    texels[2..].copy_from_slice(&second.cast::<[T; 2]>().read_unaligned());
                    continue;
                }
                for lane in 0..4 {
                    if lanes >> lane & 1 != 0 {
                        let row = if lane < 2 { first } else { second };
                        texels[lane] = row.wrapping_add(lane % 2).read_unaligned();
                    }
                }
            }
        }
    }
    let mut words = [[0; 16]; 4];
    for (index, row) in words.iter_mut().enumerate().take(T::WORDS) {
        for lane in 0..16 {
            row[lane] = texels[lane].word(index);
        }
    }
    words
}

/// # Safety
/// As [`store`].
#[inline(always)]
unsafe fn store_as<T: Texel>(
    target: &Target,
    places: &Places,
    sample: u32,
    mask: u16,
    words: &TexelWords,
) {
    let stride = target.surface.row_stride_bytes as usize;
    let mut texels = [T::default(); 16];
    for lane in 0..16 {
        let mut texel = [0; 4];
        for index in 0..T::WORDS {
            texel[index] = words[index][lane];
        }
        texels[lane] = T::from_words(texel);
    }
    // SAFETY: texels of pixels of the mask, which are in the attachment; `wrapping_add` reaches no
    // others.
    unsafe {
        if places.pattern == Pattern::Row {
            let first = quad(target, places, 0, sample).cast::<T>();
            if mask == u16::MAX {
                return first.cast::<[T; 16]>().write_unaligned(texels);
            }
            for lane in 0..16 {
                if mask >> lane & 1 != 0 {
                    first.add(lane).write_unaligned(texels[lane]);
                }
            }
            return;
        }
        if places.pattern == Pattern::Block && mask == u16::MAX {
            let first = quad(target, places, 0, sample);
            let mut rows = [T::default(); 16];
            for lane in 0..16 {
                rows[BY_ROWS[lane]] = texels[lane];
            }
            for row in 0..4 {
                let mut texels = [T::default(); 4];
                texels.copy_from_slice(&rows[4 * row..4 * row + 4]);
                let to = first.add(row * stride).cast::<[T; 4]>();
                to.write_unaligned(texels);
            }
            return;
        }
        for index in 0..4 {
            let lanes = mask >> (4 * index) & 0xf;
            if lanes == 0 {
                continue;
            }
            let first = quad(target, places, index, sample).cast::<T>();
            let second = first.cast::<u8>().wrapping_add(stride).cast::<T>();
            let texels = &texels[4 * index..4 * index + 4];
            if lanes == 0xf {
                first
                    .cast::<[T; 2]>()
                    .write_unaligned([texels[0], texels[1]]);
                second
                    .cast::<[T; 2]>()
                    .write_unaligned([texels[2], texels[3]]);
                continue;
            }
            for lane in 0..4 {
                if lanes >> lane & 1 != 0 {
                    let row = if lane < 2 { first } else { second };
                    row.wrapping_add(lane % 2).write_unaligned(texels[lane]);
                }
            }
        }
    }
}

/// Asks for texels of the first sample that are read or written soon.
#[inline(always)]
pub fn fetch(target: &Target, places: &Places) {
    let (at, stride) = quads(target, places, 0);
    let is_block = places.pattern == Pattern::Block;
    for (quad, first) in at.into_iter().enumerate() {
        // Two quads of a block lie in the same lines.
        if !is_block || quad % 2 == 0 {
            lanes::prefetch_line(first.cast_const());
            lanes::prefetch_line(first.wrapping_add(stride).cast_const());
        }
    }
}

/// Loads the texels of a sample of the pixels of a mask; other lanes hold anything.
///
/// # Safety
/// The pixels of the mask lie in the attachment, as do the layers and the sample; patterns other
/// than [`Pattern::Quads`] lie there entirely. No other thread writes there.
#[inline(always)]
pub unsafe fn load<V: Vector>(
    v: V,
    target: &Target,
    places: &Places,
    sample: u32,
    mask: u16,
) -> [V::I; 4] {
    let size = target.surface.texel_size_bytes;
    // SAFETY: the caller guarantees that the pixels of the mask lie in the attachment, as do the
    // layers and the sample; patterns other than `Pattern::Quads` lie there entirely. No other
    // thread writes there.
    unsafe {
        if size == 4 {
            let words = load_word(v, target, places, sample, mask);
            let none = v.splat_i(0);
            return [words, none, none, none];
        }
        if size == 8 && places.pattern == Pattern::Block {
            let stride = target.surface.row_stride_bytes as usize;
            let first = quad(target, places, 0, sample);
            let (first, second) = v.load_quads_of_pairs(first, stride);
            let none = v.splat_i(0);
            return [first, second, none, none];
        }
        if size == 2 && places.pattern == Pattern::Block {
            let stride = target.surface.row_stride_bytes as usize;
            let words = v.load_quads_of_shorts(quad(target, places, 0, sample), stride);
            let none = v.splat_i(0);
            return [words, none, none, none];
        }
        v.apart(Loading {
            target,
            places,
            sample,
            mask,
        })
    }
}

/// [`load`] of texels of four bytes.
///
/// # Safety
/// As [`load`].
#[inline(always)]
pub unsafe fn load_word<V: Vector>(
    v: V,
    target: &Target,
    places: &Places,
    sample: u32,
    mask: u16,
) -> V::I {
    let first = quad(target, places, 0, sample);
    // SAFETY: the caller keeps the contract of `load`.
    unsafe {
        match places.pattern {
            Pattern::Row => v.load_i(&first.cast::<Row>().read_unaligned()),
            Pattern::Block => v.load_quads(first, target.surface.row_stride_bytes as usize),
            Pattern::Inside => {
                let (at, stride) = quads(target, places, sample);
                let [a, b, c, d] = at;
                let at = [
                    a.cast_const(),
                    b.cast_const(),
                    c.cast_const(),
                    d.cast_const(),
                ];
                v.load_each_quad(at, stride)
            }
            Pattern::Quads => v.load_i(&load_rows(target, places, sample, mask)[0]),
        }
    }
}

/// # Safety
/// As [`load`].
#[inline(never)]
unsafe fn load_rows(target: &Target, places: &Places, sample: u32, mask: u16) -> TexelWords {
    // SAFETY: the caller keeps the contract of `load`.
    unsafe {
        match target.surface.texel_size_bytes {
            1 => load_as::<u8>(target, places, sample, mask),
            2 => load_as::<u16>(target, places, sample, mask),
            4 => load_as::<u32>(target, places, sample, mask),
            8 => load_as::<[u32; 2]>(target, places, sample, mask),
            12 => load_as::<[u32; 3]>(target, places, sample, mask),
            16 => load_as::<[u32; 4]>(target, places, sample, mask),
            _ => [[0; 16]; 4],
        }
    }
}

/// Texels to load, of sizes and patterns that [`load`] leaves.
struct Loading<'a> {
    target: &'a Target,
    places: &'a Places,
    sample: u32,
    mask: u16,
}

impl<V: Vector> Task<V> for Loading<'_> {
    type Output = [V::I; 4];

    /// # Safety
    /// As [`load`].
    #[inline(always)]
    unsafe fn run(self, v: V) -> [V::I; 4] {
        let Self {
            target,
            places,
            sample,
            mask,
        } = self;
        let size = target.surface.texel_size_bytes;
        let none = v.splat_i(0);
        // SAFETY: the caller keeps the contract of `load`; all texels of quads are in the
        // attachment, except for [`Pattern::Quads`].
        unsafe {
            if let (Some(shifts), true) = (shifts(size), places.pattern != Pattern::Quads) {
                let words = load_small(v, target, places, sample, size);
                let shifted = v.right_each(words, v.load_i(shifts));
                let ones = v.splat_i((1 << (8 * size)) - 1);
                return [v.and_i(shifted, ones), none, none, none];
            }
            if let (8 | 16, Some(offsets)) = (size, offsets(v, target, places)) {
                let first = quad(target, places, 0, sample);
                if size == 16 {
                    return v.gather_quads(first, offsets);
                }
                let (first, second) = v.gather_pairs(first, offsets);
                return [first, second, none, none];
            }
            load_words(v, &load_rows(target, places, sample, mask))
        }
    }
}

/// Where texels of one and two bytes lie in the words of [`load_small`].
static BYTES: Row = [0, 8, 16, 24, 0, 8, 16, 24, 0, 8, 16, 24, 0, 8, 16, 24];
static SHORTS: Row = [0, 16, 0, 16, 0, 16, 0, 16, 0, 16, 0, 16, 0, 16, 0, 16];

#[inline(always)]
fn shifts(size: usize) -> Option<&'static Row> {
    match size {
        1 => Some(&BYTES),
        2 => Some(&SHORTS),
        _ => None,
    }
}

/// In each lane the word with its texel: the quad's four bytes, or two shorts of one row.
///
/// # Safety
/// As [`load`]; not of [`Pattern::Quads`].
#[inline(always)]
unsafe fn load_small<V: Vector>(
    v: V,
    target: &Target,
    places: &Places,
    sample: u32,
    size: usize,
) -> V::I {
    let (at, stride) = quads(target, places, sample);
    // SAFETY: the caller keeps the contract of `load`; not of `Pattern::Quads`.
    unsafe {
        if size == 1 {
            let mut words = [0; 4];
            for index in 0..4 {
                let second = at[index].wrapping_add(stride).cast::<u16>();
                let [first, second] = [at[index].cast::<u16>(), second];
                let lower = u32::from(second.read_unaligned());
                words[index] = u32::from(first.read_unaligned()) | lower << 16;
            }
            return spread(v, words);
        }
        let mut words = [[0; 4]; 2];
        for index in 0..4 {
            let second = at[index].wrapping_add(stride).cast::<u32>();
            words[0][index] = at[index].cast::<u32>().read_unaligned();
            words[1][index] = second.read_unaligned();
        }
        v.select(0x3333, spread(v, words[0]), spread(v, words[1]))
    }
}

/// A word for each quad. Not by [`Vector::quads`]: loads of four words at once wait for the stores
/// of each.
#[inline(always)]
fn spread<V: Vector>(v: V, words: [u32; 4]) -> V::I {
    let upper = v.select(
        0x000f,
        v.splat_i(words[0] as i32),
        v.splat_i(words[1] as i32),
    );
    let lower = v.select(
        0x0f00,
        v.splat_i(words[2] as i32),
        v.splat_i(words[3] as i32),
    );
    v.select(0x00ff, upper, lower)
}

/// Stores the texels of the mask's lanes, which are of one or two bytes, and what is there already
/// in the places of other lanes.
///
/// # Safety
/// As [`load_small`].
#[inline(always)]
unsafe fn store_small<V: Vector>(
    v: V,
    storing: &Storing<'_, V>,
    size: usize,
    shifts: &'static Row,
) {
    let Storing {
        target,
        places,
        sample,
        mask,
        words,
    } = *storing;
    let shifts = v.load_i(shifts);
    let new = v.and_i(words[0], v.splat_i((1 << (8 * size)) - 1));
    let mut new = v.left_each(new, shifts);
    let (at, stride) = quads(target, places, sample);
    // SAFETY: the caller keeps the contract of `load`; not of `Pattern::Quads`.
    unsafe {
        if mask != u16::MAX {
            let old = load_small(v, target, places, sample, size);
            let ones = v.left_each(v.splat_i((1 << (8 * size)) - 1), shifts);
            new = v.select(mask, new, v.and_i(old, ones));
        }
        let (first, second) = v.sides::<{ axis::X }>(v.bits_to_f(new));
        let pairs = v.or_i(v.bits_of(first), v.bits_of(second));
        // Quads that are not there look like the first one, which is stored last.
        if size == 1 {
            let (first, second) = v.sides::<{ axis::Y }>(v.bits_to_f(pairs));
            let words = row_of(v, v.or_i(v.bits_of(first), v.bits_of(second)));
            for index in [3, 2, 1, 0] {
                let word = words[4 * index];
                let second = at[index].wrapping_add(stride).cast::<u16>();
                at[index].cast::<u16>().write_unaligned(word as u16);
                second.write_unaligned((word >> 16) as u16);
            }
            return;
        }
        let words = row_of(v, pairs);
        for index in [3, 2, 1, 0] {
            let second = at[index].wrapping_add(stride).cast::<u32>();
            at[index].cast::<u32>().write_unaligned(words[4 * index]);
            second.write_unaligned(words[4 * index + 2]);
        }
    }
}

/// Byte offsets of the texels of a row or a block.
#[inline(always)]
fn offsets<V: Vector>(v: V, target: &Target, places: &Places) -> Option<V::I> {
    let surface = &target.surface;
    let [columns, rows] = match places.pattern {
        Pattern::Row => &IN_ROW,
        Pattern::Block => &IN_BLOCK,
        Pattern::Inside | Pattern::Quads => return None,
    };
    let size = v.splat_i(surface.texel_size_bytes as i32);
    let stride = v.splat_i(surface.row_stride_bytes as i32);
    let row = v.mul_i(v.load_i(rows), stride);
    Some(v.add_i(row, v.mul_i(v.load_i(columns), size)))
}

/// Stores the texels of a sample of the pixels of a mask. In a row and a block, the others are
/// stored as they are.
///
/// # Safety
/// As [`load`].
#[inline(always)]
pub unsafe fn store<V: Vector>(
    v: V,
    target: &Target,
    places: &Places,
    sample: u32,
    mask: u16,
    words: &[V::I; 4],
) {
    // SAFETY: the caller keeps the contract of `load`.
    unsafe {
        let size = target.surface.texel_size_bytes;
        if size == 8 && places.pattern == Pattern::Block {
            let [mut first, mut second, ..] = *words;
            if mask != u16::MAX {
                let old = load(v, target, places, sample, mask);
                first = v.select(mask, first, old[0]);
                second = v.select(mask, second, old[1]);
            }
            let stride = target.surface.row_stride_bytes as usize;
            let at = quad(target, places, 0, sample);
            return v.store_quads_of_pairs(first, second, at, stride);
        }
        if size == 2 && places.pattern == Pattern::Block {
            let mut new = words[0];
            if mask != u16::MAX {
                new = v.select(mask, new, load(v, target, places, sample, mask)[0]);
            }
            let stride = target.surface.row_stride_bytes as usize;
            return v.store_quads_of_shorts(new, quad(target, places, 0, sample), stride);
        }
        if size == 4 {
            return store_word(v, target, places, sample, mask, words[0]);
        }
        v.apart(Storing {
            target,
            places,
            sample,
            mask,
            words: *words,
        });
    }
}

/// [`store`] of texels of four bytes.
///
/// # Safety
/// As [`load`].
#[inline(always)]
pub unsafe fn store_word<V: Vector>(
    v: V,
    target: &Target,
    places: &Places,
    sample: u32,
    mask: u16,
    texels: V::I,
) {
    // SAFETY: the caller keeps the contract of `load`.
    unsafe {
        if matches!(places.pattern, Pattern::Inside | Pattern::Quads) {
            return v.apart(Storing {
                target,
                places,
                sample,
                mask,
                words: [texels; 4],
            });
        }
        let mut new = texels;
        if mask != u16::MAX {
            new = v.select(mask, new, load_word(v, target, places, sample, mask));
        }
        let first = quad(target, places, 0, sample);
        if places.pattern == Pattern::Row {
            first.cast::<Row>().write_unaligned(row_of(v, new));
        } else {
            v.store_quads(new, first, target.surface.row_stride_bytes as usize);
        }
    }
}

/// Where four lanes each begin, and bytes from two of them to the other two. Not of
/// [`Pattern::Quads`].
#[inline(always)]
fn quads(target: &Target, places: &Places, sample: u32) -> ([*mut u8; 4], usize) {
    let surface = &target.surface;
    if places.pattern == Pattern::Row {
        let first = quad(target, places, 0, sample);
        let half = 2 * surface.texel_size_bytes;
        let at = [
            first,
            first.wrapping_add(2 * half),
            first.wrapping_add(4 * half),
            first.wrapping_add(6 * half),
        ];
        return (at, half);
    }
    if places.pattern == Pattern::Block {
        let (first, stride) = (quad(target, places, 0, sample), surface.row_stride_bytes);
        let lower = first.wrapping_add(2 * stride as usize);
        let half = 2 * surface.texel_size_bytes;
        let at = [
            first,
            first.wrapping_add(half),
            lower,
            lower.wrapping_add(half),
        ];
        return (at, stride as usize);
    }
    let at = [
        quad(target, places, 0, sample),
        quad(target, places, 1, sample),
        quad(target, places, 2, sample),
        quad(target, places, 3, sample),
    ];
    (at, surface.row_stride_bytes as usize)
}

/// Texels to store, quad by quad.
struct Storing<'a, V: Vector> {
    target: &'a Target,
    places: &'a Places,
    sample: u32,
    mask: u16,
    words: [V::I; 4],
}

impl<V: Vector> Task<V> for Storing<'_, V> {
    type Output = ();

    /// # Safety
    /// As [`load`].
    #[inline(always)]
    unsafe fn run(self, v: V) {
        let size = self.target.surface.texel_size_bytes;
        let shifts = shifts(size).filter(|_| self.places.pattern != Pattern::Quads);
        if let Some(shifts) = shifts {
            // SAFETY: the caller keeps the contract of `load`.
            return unsafe { store_small(v, &self, size, shifts) };
        }
        let Self {
            target,
            places,
            sample,
            mask,
            words,
        } = self;
        // SAFETY: the caller keeps the contract of `load`; of quads that may be outside in part,
        // texels of the mask's pixels are stored alone.
        unsafe {
            if places.pattern == Pattern::Quads || !matches!(size, 4 | 8 | 16) {
                return store_rows(target, places, sample, mask, &rows_of(v, &words));
            }
            let (at, stride) = quads(target, places, sample);
            let [a, b, ..] = words;
            match size {
                4 => v.put_each_quad([a], mask, at, stride),
                8 => v.put_each_quad([a, b], mask, at, stride),
                _ => v.put_each_quad(words, mask, at, stride),
            }
        }
    }
}

/// # Safety
/// As [`load`].
#[inline(never)]
unsafe fn store_rows(target: &Target, places: &Places, sample: u32, mask: u16, words: &TexelWords) {
    // SAFETY: the caller keeps the contract of `load`.
    unsafe {
        match target.surface.texel_size_bytes {
            1 => store_as::<u8>(target, places, sample, mask, words),
            2 => store_as::<u16>(target, places, sample, mask, words),
            4 => store_as::<u32>(target, places, sample, mask, words),
            8 => store_as::<[u32; 2]>(target, places, sample, mask, words),
            12 => store_as::<[u32; 3]>(target, places, sample, mask, words),
            16 => store_as::<[u32; 4]>(target, places, sample, mask, words),
            _ => {}
        }
    }
}

/// Fills the texels of a sample of a square of pixels with one texel's words.
///
/// # Safety
/// The square lies in the attachment, as do the layer and the sample, and no other thread writes
/// there.
#[inline(always)]
pub unsafe fn fill(
    target: &Target,
    [left, top]: [i32; 2],
    size: i32,
    layer: u32,
    sample: u32,
    words: &[u32; 4],
) {
    let surface = &target.surface;
    let slice = target.first_layer + layer;
    let mut row = surface.texel(left as u32, top as u32, slice, sample);
    for _ in 0..size {
        // SAFETY: the caller guarantees that the square, the layer and the sample lie in the
        // attachment, and no other thread writes there.
        unsafe {
            match surface.texel_size_bytes {
                1 => fill_row::<u8>(row, size, words),
                2 => fill_row::<u16>(row, size, words),
                4 => fill_row::<u32>(row, size, words),
                8 => fill_row::<[u32; 2]>(row, size, words),
                12 => fill_row::<[u32; 3]>(row, size, words),
                16 => fill_row::<[u32; 4]>(row, size, words),
                _ => {}
            }
        }
        row = row.wrapping_add(surface.row_stride_bytes as usize);
    }
}

/// # Safety
/// So many texels are writable.
#[inline(always)]
unsafe fn fill_row<T: Texel>(row: *mut u8, count: i32, words: &[u32; 4]) {
    let texel = T::from_words(*words);
    for index in 0..count as usize {
        // SAFETY: the caller guarantees that so many texels are writable.
        unsafe { row.cast::<T>().add(index).write_unaligned(texel) };
    }
}
