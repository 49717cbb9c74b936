//! Operations on rows in packets with AVX2: [`portable`](super::portable) in vectors, which
//! compilers do not make of loops with masks.

use std::arch::x86_64::*;

use lanes::LaneMask;

use crate::walk::rows::{Lanes, Words};

/// The halves of a row.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
unsafe fn halves(row: &Lanes) -> [__m256; 2] {
    // SAFETY: the caller guarantees that the machine has AVX2; sixteen numbers.
    unsafe {
        [
            _mm256_loadu_ps(row.as_ptr()),
            _mm256_loadu_ps(row[8..].as_ptr()),
        ]
    }
}

/// Which of eight numbers are not greater than others.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
pub(super) unsafe fn eight_not_greater(numbers: &[f32; 8], others: &[f32; 8]) -> u32 {
    // SAFETY: the caller guarantees that the machine has AVX2; eight numbers each.
    unsafe {
        let (one, other) = (
            _mm256_loadu_ps(numbers.as_ptr()),
            _mm256_loadu_ps(others.as_ptr()),
        );
        _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(one, other)) as u32
    }
}

/// Lanes in which a number is not greater than another.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
pub(super) unsafe fn sixteen_not_greater(numbers: &Lanes, others: &Lanes) -> LaneMask {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        let ([one, next], [other, other_next]) = (halves(numbers), halves(others));
        let low = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(one, other));
        let high = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(next, other_next));
        LaneMask::from_bits((low | high << 8) as u16)
    }
}

/// Lanes with this word.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
pub(super) unsafe fn equal(row: &Words, word: u32) -> LaneMask {
    // SAFETY: the caller guarantees that the machine has AVX2; sixteen words.
    unsafe {
        let word = _mm256_set1_epi32(word as i32);
        let equal = |half: usize| {
            let words = _mm256_loadu_si256(row[half..].as_ptr().cast());
            _mm256_movemask_ps(_mm256_castsi256_ps(_mm256_cmpeq_epi32(words, word)))
        };
        LaneMask::from_bits((equal(0) | equal(8) << 8) as u16)
    }
}

/// The numbers of some lanes, and something else in the others.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
unsafe fn pick(row: &Lanes, lanes: LaneMask, other: f32) -> [__m256; 2] {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        let row = halves(row);
        if lanes == LaneMask::ALL {
            return row;
        }
        let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
        let blend = |row: __m256, lanes: u16| {
            let chosen = _mm256_and_si256(_mm256_set1_epi32(lanes.into()), bits);
            let chosen = _mm256_castsi256_ps(_mm256_cmpeq_epi32(chosen, bits));
            _mm256_blendv_ps(_mm256_set1_ps(other), row, chosen)
        };
        let lanes = lanes.bits();
        [blend(row[0], lanes), blend(row[1], lanes >> 8)]
    }
}

/// The least number of some lanes.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
pub(super) unsafe fn least(row: &Lanes, lanes: LaneMask) -> f32 {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        let [low, high] = pick(row, lanes, f32::INFINITY);
        let eight = _mm256_min_ps(low, high);
        let four = _mm_min_ps(
            _mm256_castps256_ps128(eight),
            _mm256_extractf128_ps::<1>(eight),
        );
        let two = _mm_min_ps(four, _mm_movehl_ps(four, four));
        _mm_cvtss_f32(_mm_min_ss(two, _mm_movehdup_ps(two)))
    }
}

/// The greatest number of some lanes.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
pub(super) unsafe fn greatest(row: &Lanes, lanes: LaneMask) -> f32 {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
        let [low, high] = pick(row, lanes, f32::NEG_INFINITY);
        let eight = _mm256_max_ps(low, high);
        let four = _mm_max_ps(
            _mm256_castps256_ps128(eight),
            _mm256_extractf128_ps::<1>(eight),
        );
        let two = _mm_max_ps(four, _mm_movehl_ps(four, four));
        _mm_cvtss_f32(_mm_max_ss(two, _mm_movehdup_ps(two)))
    }
}
