//! Operations on rows in packets with AVX2.

use std::arch::x86_64::*;

use lanes::LaneMask;

/// The numbers of some lanes, and something else in the others.
///
/// # Safety
/// The machine has AVX2.
#[inline(always)]
unsafe fn pick(row: [__m256; 2], lanes: LaneMask, other: f32) -> [__m256; 2] {
    // SAFETY: the caller keeps the contract of this function.
    unsafe {
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
pub(super) unsafe fn least(row: [__m256; 2], lanes: LaneMask) -> f32 {
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
pub(super) unsafe fn greatest(row: [__m256; 2], lanes: LaneMask) -> f32 {
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
