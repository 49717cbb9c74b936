//! Texels of sixteen pixels, as words: loaded from an attachment and stored to it.

use lanes::quad as axis;
use lanes::vector::{Task, Vector};

use super::bytes::{load_bytes, store_bytes};
use super::lanes::{IN_BLOCK, IN_ROW, Row, load_words, row_of, rows_of};
use super::places::{Pattern, Places, quad};
use super::scalar::{load_rows, store_rows};
use crate::raster::Target;

/// Asks for texels of the first sample that are read or written soon.
#[inline(always)]
pub fn fetch(target: &Target, places: &Places) {
    if places.pattern == Pattern::Block {
        let first = quad(target, places, 0, 0);
        let stride = target.surface.row_stride_bytes as usize;
        for row in 0..4 {
            lanes::prefetch_line(first.wrapping_add(row * stride).cast_const());
        }
        return;
    }
    let (at, stride) = quads(target, places, 0);
    for first in at {
        lanes::prefetch_line(first.cast_const());
        lanes::prefetch_line(first.wrapping_add(stride).cast_const());
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
    // SAFETY: the caller keeps the contract of this function.
    unsafe { load_sized(v, target, places, sample, mask, size) }
}

/// [`load`], with the size of a texel, which the caller may know when it is compiled.
///
/// # Safety
/// As [`load`].
#[inline(always)]
pub unsafe fn load_sized<V: Vector>(
    v: V,
    target: &Target,
    places: &Places,
    sample: u32,
    mask: u16,
    size: usize,
) -> [V::I; 4] {
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
        if size == 1 && matches!(places.pattern, Pattern::Row | Pattern::Block) {
            let none = v.splat_i(0);
            return [load_bytes(v, target, places, sample), none, none, none];
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
    let size = target.surface.texel_size_bytes;
    // SAFETY: the caller keeps the contract of `load`.
    unsafe { store_sized(v, target, places, sample, mask, words, size) };
}

/// [`store`], with the size of a texel, which the caller may know when it is compiled.
///
/// # Safety
/// As [`load`].
#[inline(always)]
pub unsafe fn store_sized<V: Vector>(
    v: V,
    target: &Target,
    places: &Places,
    sample: u32,
    mask: u16,
    words: &[V::I; 4],
    size: usize,
) {
    // SAFETY: the caller keeps the contract of `load`.
    unsafe {
        if size == 1 && matches!(places.pattern, Pattern::Row | Pattern::Block) {
            let mut new = words[0];
            if mask != u16::MAX {
                new = v.select(mask, new, load_bytes(v, target, places, sample));
            }
            return store_bytes(v, target, places, sample, new);
        }
        if size == 8 && places.pattern == Pattern::Block {
            let [mut first, mut second, ..] = *words;
            if mask != u16::MAX {
                let old = load_sized(v, target, places, sample, mask, size);
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
                let old = load_sized(v, target, places, sample, mask, size)[0];
                new = v.select(mask, new, old);
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
