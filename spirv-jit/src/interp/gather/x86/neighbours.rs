//! Vectors of words that follow one another from lane to lane, in whole registers of AVX2 and
//! AVX-512: a transposition of words and of quarters.

use std::arch::x86_64::*;

use super::Register;
use crate::interp::gather::RowPointers;

/// Registers of several quarters.
///
/// # Safety
/// As [`Register`].
pub(super) trait Wide: Register {
    /// Registers that have the quarters of `N` others one register behind another: the first
    /// quarters of all, then the second ones.
    unsafe fn quarters_by_number<const N: usize>(of: [Self; N]) -> [Self; N];
    /// The opposite: registers of the first, second and so on of each `N` quarters.
    unsafe fn quarters_by_register<const N: usize>(of: [Self; N]) -> [Self; N];
}

impl Wide for __m256i {
    #[inline(always)]
    unsafe fn quarters_by_number<const N: usize>(of: [Self; N]) -> [Self; N] {
        let mut sorted = of;
        for k in 0..N / 2 {
            let (a, b) = (of[2 * k], of[2 * k + 1]);
            // SAFETY: the caller keeps the contract of this function.
            unsafe {
                sorted[k] = _mm256_permute2x128_si256::<0x20>(a, b);
                sorted[N / 2 + k] = _mm256_permute2x128_si256::<0x31>(a, b);
            }
        }
        sorted
    }

    #[inline(always)]
    unsafe fn quarters_by_register<const N: usize>(of: [Self; N]) -> [Self; N] {
        let mut sorted = of;
        for k in 0..N / 2 {
            let (a, b) = (of[k], of[N / 2 + k]);
            // SAFETY: the caller keeps the contract of this function.
            unsafe {
                sorted[2 * k] = _mm256_permute2x128_si256::<0x20>(a, b);
                sorted[2 * k + 1] = _mm256_permute2x128_si256::<0x31>(a, b);
            }
        }
        sorted
    }
}

impl Wide for __m512i {
    #[inline(always)]
    unsafe fn quarters_by_number<const N: usize>(of: [Self; N]) -> [Self; N] {
        let mut sorted = of;
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            if N == 2 {
                let low = _mm512_shuffle_i32x4::<0x44>(of[0], of[1]);
                let high = _mm512_shuffle_i32x4::<0xee>(of[0], of[1]);
                sorted[0] = _mm512_shuffle_i32x4::<0xd8>(low, low);
                sorted[1] = _mm512_shuffle_i32x4::<0xd8>(high, high);
                return sorted;
            }
            let (a, b) = (
                _mm512_shuffle_i32x4::<0x44>(of[0], of[1]),
                _mm512_shuffle_i32x4::<0x44>(of[2], of[3]),
            );
            let (c, d) = (
                _mm512_shuffle_i32x4::<0xee>(of[0], of[1]),
                _mm512_shuffle_i32x4::<0xee>(of[2], of[3]),
            );
            sorted[0] = _mm512_shuffle_i32x4::<0x88>(a, b);
            sorted[1] = _mm512_shuffle_i32x4::<0xdd>(a, b);
            sorted[2] = _mm512_shuffle_i32x4::<0x88>(c, d);
            sorted[3] = _mm512_shuffle_i32x4::<0xdd>(c, d);
        }
        sorted
    }

    #[inline(always)]
    unsafe fn quarters_by_register<const N: usize>(of: [Self; N]) -> [Self; N] {
        let mut sorted = of;
        // SAFETY: the caller keeps the contract of this function.
        unsafe {
            if N == 2 {
                sorted[0] = _mm512_shuffle_i32x4::<0x88>(of[0], of[1]);
                sorted[1] = _mm512_shuffle_i32x4::<0xdd>(of[0], of[1]);
                return sorted;
            }
            // Four by four: the opposite is the same.
            Self::quarters_by_number(of)
        }
    }
}

/// [`super::Gather::store_neighbours`] in registers of some width.
///
/// # Safety
/// As there.
#[inline(always)]
pub(super) unsafe fn store_neighbours<R: Wide, const N: usize>(at: *mut u8, rows: RowPointers<N>) {
    let bytes = 16 * R::QUARTERS;
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        for part in 0..4 / R::QUARTERS {
            let mut words = [R::splat(0); N];
            for k in 0..N {
                words[k] = R::load(rows[k].add(bytes * part));
            }
            let (low, high) = (words[0].low_words(words[1]), words[0].high_words(words[1]));
            let mut lanes = words;
            (lanes[0], lanes[1]) = (low, high);
            if N == 4 {
                let (c, d) = (words[2].low_words(words[3]), words[2].high_words(words[3]));
                (lanes[0], lanes[1]) = (low.low_pair(c), low.high_pair(c));
                (lanes[2], lanes[3]) = (high.low_pair(d), high.high_pair(d));
            }
            let sorted = R::quarters_by_number(lanes);
            for k in 0..N {
                sorted[k].store(at.add(bytes * (N * part + k)));
            }
        }
    }
}

/// [`super::Gather::load_neighbours`] in registers of some width.
///
/// # Safety
/// As there.
#[inline(always)]
pub(super) unsafe fn load_neighbours<R: Wide, const N: usize>(at: *const u8, rows: RowPointers<N>) {
    let bytes = 16 * R::QUARTERS;
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        for part in 0..4 / R::QUARTERS {
            let mut loaded = [R::splat(0); N];
            for k in 0..N {
                loaded[k] = R::load(at.add(bytes * (N * part + k)));
            }
            // Two or four lanes' words in each quarter.
            let lanes = R::quarters_by_register(loaded);
            let mut words = lanes;
            (words[0], words[1]) = (lanes[0].even_words(lanes[1]), lanes[0].odd_words(lanes[1]));
            if N == 4 {
                let low = (lanes[0].low_words(lanes[1]), lanes[2].low_words(lanes[3]));
                let high = (lanes[0].high_words(lanes[1]), lanes[2].high_words(lanes[3]));
                (words[0], words[1]) = (low.0.low_pair(low.1), low.0.high_pair(low.1));
                (words[2], words[3]) = (high.0.low_pair(high.1), high.0.high_pair(high.1));
            }
            for k in 0..N {
                words[k].store(rows[k].add(bytes * part));
            }
        }
    }
}
