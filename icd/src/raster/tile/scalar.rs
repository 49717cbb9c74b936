//! Texels that vectors do not move: of quads that lie outside in part, and of odd sizes. Fills.

use super::lanes::BY_ROWS;
use super::places::{Pattern, Places, TexelWords, quad};
use crate::raster::Target;

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
/// As [`load`](super::texels::load).
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
/// As [`store`](super::texels::store).
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

/// # Safety
/// As [`load`](super::texels::load).
#[inline(never)]
pub unsafe fn load_rows(target: &Target, places: &Places, sample: u32, mask: u16) -> TexelWords {
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

/// # Safety
/// As [`load`](super::texels::load).
#[inline(never)]
pub unsafe fn store_rows(
    target: &Target,
    places: &Places,
    sample: u32,
    mask: u16,
    words: &TexelWords,
) {
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
