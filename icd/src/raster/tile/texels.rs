//! Texels of sixteen pixels, as words: loaded from an attachment and stored to it.

use super::lanes::{BY_ROWS, Row};
use crate::raster::Target;

/// Where sixteen pixels are: four quads.
#[derive(Clone, Copy, Debug, Default)]
pub struct Places {
    /// The first pixel of each quad, in the attachments.
    pub x: [i32; 4],
    pub y: [i32; 4],
    pub layer: [u32; 4],
    /// The quads are those of one 4×4 block, all of it inside the render area.
    pub is_block: bool,
}

impl Places {
    /// Those of the 4×4 block at (x, y).
    pub fn block(x: i32, y: i32, layer: u32, is_block: bool) -> Self {
        Self {
            x: [x, x + 2, x, x + 2],
            y: [y, y, y + 2, y + 2],
            layer: [layer; 4],
            is_block,
        }
    }
}

/// What an attachment's texels are made of, up to four words.
pub type Words = [Row; 4];

/// The first byte of a quad's texels.
fn quad(target: &Target, places: &Places, quad: usize, sample: u32) -> *mut u8 {
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
                std::array::from_fn(|index| words[index])
            }
        }
    )*};
}

large_texel!(2, 3, 4);

/// # Safety
/// As [`load`].
#[inline(always)]
unsafe fn load_as<T: Texel>(target: &Target, places: &Places, sample: u32, mask: u16) -> Words {
    let stride = target.surface.row_stride_bytes as usize;
    let mut texels = [T::default(); 16];
    // SAFETY: texels of pixels of the mask, or of a block that is inside the render area; those are in the attachment.
    unsafe {
        if places.is_block {
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
    words: &Words,
) {
    let stride = target.surface.row_stride_bytes as usize;
    let mut texels = [T::default(); 16];
    for lane in 0..16 {
        texels[lane] = T::from_words(std::array::from_fn(|index| match index < T::WORDS {
            true => words[index][lane],
            false => 0,
        }));
    }
    // SAFETY: texels of pixels of the mask, which are in the attachment; `wrapping_add` reaches no others.
    unsafe {
        if places.is_block && mask == u16::MAX {
            let first = quad(target, places, 0, sample);
            let mut rows = [T::default(); 16];
            for lane in 0..16 {
                rows[BY_ROWS[lane]] = texels[lane];
            }
            for row in 0..4 {
                let texels: [T; 4] = std::array::from_fn(|column| rows[4 * row + column]);
                first
                    .add(row * stride)
                    .cast::<[T; 4]>()
                    .write_unaligned(texels);
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

/// Loads the texels of a sample of the pixels of a mask; other lanes hold anything.
///
/// # Safety
/// The pixels of the mask lie in the attachment, as do the layers and the sample; a block does as a whole. Nobody else writes there.
#[inline(always)]
pub unsafe fn load(target: &Target, places: &Places, sample: u32, mask: u16) -> Words {
    // SAFETY: the caller's promise.
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

/// Stores the texels of a sample of the pixels of a mask.
///
/// # Safety
/// As [`load`].
#[inline(always)]
pub unsafe fn store(target: &Target, places: &Places, sample: u32, mask: u16, words: &Words) {
    // SAFETY: the caller's promise.
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
